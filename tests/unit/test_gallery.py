"""The gallery, as far as it goes without Blender: what stands in for scans, finer grids, backdrops, sheets, the page,
and names that agree."""

import ast
import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from devtools import gallery, gallery_pictures
from devtools.places import Failure
from devtools.sheets import GAP, sheet

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


def sets() -> set[str]:
    """The names in SETS of gallery_sets.py, which needs Blender to be imported."""
    for node in ast.parse((DEVTOOLS / "gallery_sets.py").read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "SETS":
            return {key.value for key in node.value.keys}
    raise AssertionError("SETS")


def test_every_scene_has_a_set_and_a_volume(data):
    assert set(gallery.SHOTS) == sets()
    assert all(hasattr(data, name) for name in sets())


@pytest.mark.slow
def test_where_there_is_no_scan_numbers_stand_in_for_it(data, tmp_path):
    path, options, source = data.head(tmp_path)
    voxels = np.frombuffer(path.read_bytes(), options["dtype"])
    assert voxels.size == np.prod(options["shape"]) and source == data.MADE
    seen = (voxels >= 300) & (voxels <= 2500)
    assert 0.002 < seen.mean() < 0.5


@pytest.mark.parametrize("name", ["skull", "heart"])
def test_a_scan_without_a_stand_in_is_asked_for(data, tmp_path, name):
    with pytest.raises(RuntimeError, match="RLE_SPLAT_DATA"):
        getattr(data, name)(tmp_path)


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


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_what_is_clear_shows_a_backdrop_lit_from_the_middle():
    part = Image.new("RGBA", (40, 30), (255, 255, 255, 0))
    part.paste((200, 10, 10, 255), (0, 0, 8, 8))
    seen = np.asarray(gallery_pictures.on_backdrop(part), int)
    assert (seen[:8, :8] == (200, 10, 10)).all()
    assert np.abs(seen[14, 20] - gallery_pictures.WALL[1]).max() <= 2 and seen[29, 39].sum() < seen[14, 20].sum() / 2


def test_a_jpeg_keeps_to_its_number_of_bytes(tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (64, 96, 3), np.uint8)
    best = gallery_pictures.save_jpeg(Image.fromarray(noise), tmp_path / "best.jpg")
    small = gallery_pictures.save_jpeg(Image.fromarray(noise), tmp_path / "small.jpg", most=6000)
    assert best > small and (tmp_path / "small.jpg").stat().st_size <= 6000 < (tmp_path / "best.jpg").stat().st_size


def test_a_sheet_has_its_pictures_below_their_captions():
    parts = [(caption, np.full((30, 200, 3), gray, np.uint8)) for caption, gray in (("A", 10), ("", 20), ("A", 30))]
    made = sheet(parts, 2)
    bar = (len(made) - GAP) // 2 - 30
    assert made.shape == (2 * (bar + 30) + GAP, 400 + GAP, 3)
    assert (made[bar : bar + 30, :200] == 10).all() and (made[bar : bar + 30, -200:] == 20).all()
    assert (made[-30:, :200] == 30).all() and np.ptp(made[-30:, 200:]) == 0
    long = sheet([("A long caption of a narrow picture", parts[0][1])] * 2)  # in letters small enough for it
    assert np.ptp(long[:-30, 196:204]) == 0 < np.ptp(long[:-30, :196])
    for top in (0, bar + 30 + GAP):  # white letters on the ground
        assert made[top : top + bar, :200].max() > 200 and np.ptp(made[top : top + bar, 200:]) == 0


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
