"""The sheets of several programs and of presets, and the lamps that depend on a scene."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import side_by_side
from benchmarks.frames import view_scene
from benchmarks.lamps import under
from benchmarks.scenes import shells
from benchmarks.side_by_side import SUBJECTS, Subject
from rle_splat.classify.transfer_function import Shade
from rle_splat.pipeline.render import render
from rle_splat.runtime.jit import compiled
from rle_splat.scene import Quality
from rle_splat.volume.volume import Volume

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")


@pytest.fixture
def small(tmp_path, monkeypatch):
    """Pictures of 24 pixels of a small volume, below a temporary folder."""
    volume, function = shells(24)
    monkeypatch.setattr(side_by_side, "SIZE", 24)
    monkeypatch.setattr(side_by_side, "FOLDER", tmp_path)
    monkeypatch.setattr(side_by_side, "read", lambda subject: volume)
    monkeypatch.setitem(SUBJECTS, "shells", Subject("", function, (30, 10)))
    monkeypatch.setitem(side_by_side.PRESETS, "shells: own", SUBJECTS["shells"])
    return tmp_path


def test_pictures_are_kept_and_joined(small, capsys):
    image = pytest.importorskip("PIL.Image")
    side_by_side.draw("ours", ["shells"], 0.0, 24)
    with np.load(small / "shells-ours.npz") as kept:
        ours, seconds = kept["rgba"], float(kept["seconds"])
    assert ours.shape == (24, 24, 4) and ours[..., 3].max() > 0.5 and seconds > 0.0
    np.savez(small / "shells-cycles.npz", rgba=ours * (0.25, 0.25, 0.25, 1.0), seconds=60.0)
    side_by_side.join(["shells"], ["ours", "cycles"], 24, small / "sheet.png", 80)
    sheet = np.asarray(image.open(small / "sheet.png")).astype(int)
    # Cycles' picture is made as bright.
    assert np.abs(sheet[-24:, -24:] - sheet[-24:, :24]).max() <= 1
    assert '"cycles": 60.0' in capsys.readouterr().out


def test_larger_pictures_are_scaled_down_in_linear_color(small):
    image = pytest.importorskip("PIL.Image")
    pixels = np.zeros((48, 48, 4))
    pixels[::2, ::2] = 1.0  # a quarter of the light
    np.savez(small / "shells-ours.npz", rgba=pixels, seconds=1.0)
    side_by_side.join(["shells"], ["ours"], 24, small / "sheet.png", 80)
    expected = round(255 * (1.055 * (0.25 + 0.75 * 0.008) ** (1 / 2.4) - 0.055))
    assert (np.asarray(image.open(small / "sheet.png"))[-24:] == expected).all()


def test_crops_are_twice_as_large(small, monkeypatch):
    image = pytest.importorskip("PIL.Image")
    monkeypatch.setattr(side_by_side, "CROP", 12)
    monkeypatch.setattr(side_by_side, "CROPS", {"part": ("shells", 6, 8)})
    side_by_side.draw("ours", ["shells"], 0.0, 24)
    side_by_side.join(["shells"], ["ours"], 24, small / "whole.png", 80)
    side_by_side.join_crops(["ours"], small / "crops.png", 80)
    whole, crops = (np.asarray(image.open(small / f"{name}.png"))[-24:] for name in ("whole", "crops"))
    np.testing.assert_array_equal(crops[::2, ::2], whole[8:20, 6:18])
    assert crops.shape == (24, 24, 3) and crops.std() > 10.0


def test_a_sheet_of_presets(small):
    image = pytest.importorskip("PIL.Image")
    side_by_side.join_presets(["shells: own"], 24, small / "sheet.png", 80)
    assert np.asarray(image.open(small / "sheet.png"))[-24:].std() > 10.0


def test_a_volume_whose_first_slice_is_on_top_is_turned(monkeypatch):
    volume, _ = shells(8)
    monkeypatch.setattr(side_by_side, "read_volume", lambda path: volume)
    turned = side_by_side.read(Subject("scan.nii", "ct-bone", (0, 0), turned=True)).voxels
    for axis in (0, 1):
        np.testing.assert_array_equal(turned.take(0, axis), np.flip(volume.voxels, (0, 1)).take(0, axis))


def test_what_lies_beside_the_body_is_left_out(tmp_path, monkeypatch):
    z, y, x = np.ogrid[:60, :60, :60]
    body, table = (z - 30) ** 2 + (y - 24) ** 2 + (x - 30) ** 2 < 18**2, (y >= 54) & (y < 56) & (z > 0)
    volume = Volume(np.where(body | table, 400, 10).astype(np.uint16), np.diag((2.0, 2.0, 2.0, 1.0)))
    monkeypatch.setattr(side_by_side, "FOLDER", tmp_path)
    monkeypatch.setattr(side_by_side, "read_volume", lambda path: volume)
    subject = Subject("scan.nii", "ct-bone", (0, 0), alone=True)
    for _ in range(2):  # found, and as it was kept
        np.testing.assert_array_equal(side_by_side.read(subject).voxels, np.where(body, volume.voxels, 10))
    assert [path.name for path in tmp_path.iterdir()] == ["scan.nii.body.npy"]


def test_vtk_shows_what_normals_are_made_of(monkeypatch):
    scene, shown = view_scene(*shells(24), (30, 10), 24), []
    voxels = np.zeros((31, 31, 31), np.uint8)
    voxels[15, 15, 15] = 200
    function = replace(scene.transfer_function, shade=replace(Shade(), smoothness=2.0))
    point = replace(scene, volume=Volume(voxels, np.eye(4)), transfer_function=function)
    monkeypatch.setattr(side_by_side, "draw_vtk", lambda scene, _: shown.append(scene.volume) or (None, 1.0))
    side_by_side.draw_vtk_smoothed(point, None)
    line = shown[0].voxels[15, 15, 15:]
    np.testing.assert_allclose(line[:6] / line[0], np.exp(-0.5 * (np.arange(6) / 2.0) ** 2), rtol=1e-5)


def test_an_area_lamp_is_as_bright_as_the_sun():
    scene = view_scene(*shells(32), (30, 15), 48)
    found = []
    for name in ("sun", "area lamp"):
        lit = under(scene, name)
        lit = replace(lit, lights=tuple(replace(one, casts_shadow=False) for one in lit.lights))
        found.append(render(lit, Quality.preset("draft", threads=1)).rgba[..., :3].mean())
    assert found[1] == pytest.approx(found[0], rel=0.1)
