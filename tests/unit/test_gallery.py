"""The gallery, as far as it goes without Blender: what stands in for scans, finer grids, pictures put together, the
page, and names that agree."""

import ast
import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from devtools import gallery, gallery_pictures
from devtools.places import Failure

DEVTOOLS = Path(gallery.__file__).parent


def module_of(name: str):
    spec = importlib.util.spec_from_file_location(name, DEVTOOLS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def data(monkeypatch, tmp_path):
    """The module that finds or makes the volumes, on a machine without any scan."""
    monkeypatch.syspath_prepend(str(DEVTOOLS))
    module = module_of("gallery_data")
    monkeypatch.setattr(module, "DATA", tmp_path / "nothing")
    return module


def table_of(name: str) -> dict:
    """A table of gallery_sets.py, which needs Blender to be imported: its keys with the source of their values."""
    for node in ast.parse((DEVTOOLS / "gallery_sets.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == name:
            return {key.value: ast.unparse(value) for key, value in zip(node.value.keys, node.value.values)}
    raise AssertionError(name)


def test_every_scene_has_a_set_and_a_volume(data):
    assert set(gallery.SHOTS) == set(table_of("SETS")) == set(table_of("DATA_OF"))
    assert all(hasattr(data, ast.literal_eval(source)) for source in table_of("DATA_OF").values())


@pytest.mark.parametrize(
    ("name", "between"),
    [("head", (300, 2500)), ("chest", (60, 150)), ("vessels", (60, 150)), ("smoke", (0.2, 1.0))],
)
def test_where_there_are_no_scans_numbers_stand_in_for_them(data, tmp_path, name, between):
    path, options, source = getattr(data, name)(tmp_path)
    voxels = np.frombuffer(path.read_bytes(), options["dtype"])
    assert voxels.size == np.prod(options["shape"]) and source == data.MADE
    seen = (voxels >= between[0]) & (voxels <= between[1])
    assert 0.002 < seen.mean() < 0.5


def test_a_scan_without_a_stand_in_is_asked_for(data, tmp_path):
    with pytest.raises(RuntimeError, match="RLE_SPLAT_DATA"):
        data.engine(tmp_path)


def test_the_made_chest_has_a_heart_without_bones(data, tmp_path):
    path, options, _ = data.chest(tmp_path)
    voxels = np.fromfile(path, np.uint8).reshape(options["shape"][::-1])
    labels = np.fromfile(data.organs(tmp_path), np.uint8).reshape(voxels.shape)
    assert 0.005 < (labels == data.HEART).mean() < 0.1
    assert 55 < np.median(voxels[labels == data.HEART]) < 160 and (voxels[labels == data.HEART] > 165).mean() < 0.02


def test_a_head_is_peeled_on_one_side_and_cleared_of_what_is_around_it(data, tmp_path):
    shape = (40, 44, 48)
    z, y, x = np.indices(shape)
    radius = np.sqrt((z - 20) ** 2 + (y - 24) ** 2 + (x - 24) ** 2)
    voxels = np.full(shape, -1000, np.int16)
    voxels[radius < 14], voxels[radius < 10] = 40, 800
    rest = np.zeros(shape, bool)
    rest[:, 1, 10:30] = True
    voxels[rest] = 200
    path = tmp_path / "ball.raw"
    path.write_bytes(voxels.tobytes())
    labels = np.fromfile(data.peel(tmp_path, path, shape[::-1]), np.uint8).reshape(shape)
    side = x < 0.43 * shape[2]
    assert ((labels == data.PEELED) == (side & ~rest)).all()
    assert (labels[rest] == data.STRAY).all() and not (labels[radius < 14] == data.STRAY).any()


# --- grids ------------------------------------------------------------------------------------------------------------


def test_doubled_slices_keep_a_slope_and_round_off_a_step():
    grids = module_of("gallery_grids")
    slope = np.arange(6.0)[:, None, None] * np.ones((1, 2, 3))
    for axis in range(3):
        fine = np.moveaxis(grids.doubled(np.moveaxis(slope, 0, axis), axis), axis, 0)
        assert fine.shape == (11, 2, 3)
        np.testing.assert_allclose(fine[2:-2, 0, 0], np.arange(1.0, 4.5, 0.5), atol=1e-5)
    step = grids.doubled((np.arange(6) > 2.0)[:, None, None] * np.ones((1, 1, 1)), 0)[:, 0, 0]
    assert (np.diff(step) > -1e-5).all() and np.diff(step).max() < 0.35 and step[5] == pytest.approx(0.5)


def test_what_is_connected_is_found_around_corners_and_nothing_else():
    grids = module_of("gallery_grids")
    mask = np.zeros((5, 9, 9), bool)
    mask[2, 1, 1:8] = mask[2, 1:8, 7] = mask[2, 7, 3:8] = mask[2:5, 7, 3] = True
    apart = np.zeros_like(mask)
    apart[2, 4, 1:4] = True
    seeds = np.zeros_like(mask)
    seeds[2, 1, 1] = seeds[0, 0, 0] = True
    assert (grids.connected(mask | apart, seeds) == mask).all()


def test_a_share_is_that_of_the_box_around_a_voxel():
    mask = np.zeros((7, 7, 7), bool)
    mask[3, 3, 3] = True
    share = module_of("gallery_grids").share(mask, 1)
    assert share[3, 3, 3] == share[2, 4, 3] == pytest.approx(1 / 27) and share[3, 3, 5] == 0.0


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_parts_beside_each_other_have_captions():
    part = Image.new("RGB", (300, 200))
    seen = np.asarray(gallery_pictures.captioned(part, gallery_pictures.CAPTIONS["glass"])).max(axis=2) > 0
    assert seen[180:, :150].any() and not seen[:180].any() and not np.asarray(part).any()


def test_parts_are_put_side_by_side_in_their_order():
    parts = [Image.new("RGB", (4, 2), color) for color in ((9, 0, 0), (0, 9, 0), (0, 0, 9))]
    whole = np.asarray(gallery_pictures.put_together(parts, 2, gap=1))
    assert whole.shape == (5, 9, 3)
    assert whole[0, 0].tolist() == [9, 0, 0] and whole[1, 8].tolist() == [0, 9, 0] and whole[4, 0].tolist() == [0, 0, 9]
    assert not whole[:, 4].any() and not whole[2].any()


def test_what_is_clear_shows_a_backdrop_lit_from_the_middle():
    part = Image.new("RGBA", (40, 30), (255, 255, 255, 0))
    part.paste((200, 10, 10, 255), (0, 0, 8, 8))
    seen = np.asarray(gallery_pictures.on_backdrop(part), int)
    assert (seen[:8, :8] == (200, 10, 10)).all()
    assert np.abs(seen[14, 20] - gallery_pictures.CENTER).max() <= 2 and seen[29, 39].sum() < seen[14, 20].sum() / 2


def test_a_jpeg_keeps_to_its_number_of_bytes(tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (64, 96, 3), np.uint8)
    best = gallery_pictures.save_jpeg(Image.fromarray(noise), tmp_path / "best.jpg")
    small = gallery_pictures.save_jpeg(Image.fromarray(noise), tmp_path / "small.jpg", most=6000)
    assert best > small and (tmp_path / "small.jpg").stat().st_size <= 6000 < (tmp_path / "best.jpg").stat().st_size


def test_a_turn_is_a_gif_of_all_its_frames(tmp_path):
    frames = [Image.new("RGB", (16, 12), (20 * k, 10, 0)) for k in range(8)]
    gallery_pictures.save_turn(frames, tmp_path / "turn.gif")
    with Image.open(tmp_path / "turn.gif") as turn:
        assert turn.n_frames == 8 and turn.info["loop"] == 0
        turn.seek(5)
        assert np.abs(np.asarray(turn.convert("RGB"), int) - (100, 10, 0)).max() <= 12


# --- the page ---------------------------------------------------------------------------------------------------------


def test_the_page_tells_what_is_on_what_it_took_and_what_was_off():
    effects = [
        {"name": "shading", "on": True, "reason": "diffuse 0.8", "ms": 12.34},
        {"name": "specular", "on": True, "reason": "shininess 20", "ms": None},
        {"name": "shadows", "on": False, "reason": "no light casts any", "ms": 0.0},
    ]
    report = {
        "effects": effects, "stages_ms": {"total": 99.6}, "image": {"width": 8, "height": 6}, "source": "a scan",
        "threads": 2,
    }  # fmt: skip
    told = gallery.effect_table(report)
    assert "| shading | 12.3 | diffuse 0.8 |" in told and "| specular | within another |" in told
    assert "100 ms for 8 x 6 pixels of a scan, 2 thread(s). Off, for nothing: shadows." in told


@pytest.mark.parametrize(("names", "percent", "said"), [(("moon",), 10.0, "moon"), ((), 0.0, "percent")])
def test_what_is_not_in_the_gallery_is_refused_before_anything_is_made(names, percent, said):
    with pytest.raises(Failure, match=said):
        gallery.gallery(names, percent)
