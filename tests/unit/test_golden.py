"""Each preset looks as a person has approved it (``dev.py golden``), and a change that anybody would see is noticed."""

import numpy as np
import pytest
from PIL import Image

from devtools import golden
from rle_splat.classify.presets import PRESETS

MOST_BYTES = 8192  # of a file


@pytest.fixture(scope="module")
def today():
    return golden.pictures()


@pytest.mark.parametrize("name", PRESETS)
def test_each_preset_looks_as_approved(name, today):
    approved = golden.load(name)
    assert approved is not None, f"'dev.py golden --approve' makes that of {name}"
    apart = golden.difference(approved, today[name])
    assert golden.is_same(apart), (
        f"{name} has changed: mean {apart.mean():.2f}, largest {apart.max():.2f}; 'dev.py golden' shows it"
    )


def test_there_is_no_other_picture_and_all_are_small():
    found = {path.stem: path.stat().st_size for path in golden.FOLDER.iterdir()}
    assert set(found) == set(PRESETS) and max(found.values()) <= MOST_BYTES


def green(picture):
    return (picture * (0.3, 1.0, 0.3)).astype(np.uint8)


def darker(picture):
    return np.rint(0.93 * picture).astype(np.uint8)


def moved(picture):
    return np.roll(picture, 1, axis=1)


def mirrored(picture):
    return picture[:, ::-1]


@pytest.mark.parametrize("change", (green, darker, moved, mirrored))
def test_a_change_that_anybody_sees_is_noticed(change):
    bone = golden.load("ct-bone")
    assert not golden.is_same(golden.difference(bone, change(bone)))


def test_roundings_are_not():
    bone = golden.load("ct-bone")
    rounded = bone + np.random.default_rng(1).integers(-1, 2, bone.shape)
    assert golden.is_same(golden.difference(bone, rounded.clip(0, 255).astype(np.uint8)))


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        # Lightness alone, by CIE's formula: white 100, and the middle one, of 0.1842 of its light, 50.
        ((255, 255, 255), (0, 0, 0), 100.0), ((119, 119, 119), (0, 0, 0), 50.03),
        # Red and green as tables of sRGB have them in CIELAB: (53.24, 80.09, 67.20) and (87.73, -86.18, 83.18).
        ((255, 0, 0), (0, 255, 0), 34.49 + np.hypot(166.27, 15.98)),
    ],
)  # fmt: skip
def test_the_difference_of_flat_pictures_is_that_of_tables(one, other, expected):
    first, second = (np.full((12, 12, 3), color, np.uint8) for color in (one, other))
    np.testing.assert_allclose(golden.difference(first, second), expected, rtol=3e-3)


def test_what_has_changed_is_listed_shown_and_approved(tmp_path, monkeypatch, capsys):
    bone = golden.load("ct-bone")
    monkeypatch.setattr(golden, "pictures", lambda: {"ct-bone": bone, "ct-skin": bone})
    folder, sheet = tmp_path / "golden", tmp_path / "sheet.png"
    folder.mkdir()
    for name, picture in (("ct-bone", green(bone)), ("ct-skin", bone), ("gone", bone)):
        Image.fromarray(picture).save(folder / f"{name}.png")
    assert golden.compare(False, folder, sheet) == ["ct-bone", "gone"] and "ct-skin" in capsys.readouterr().out
    assert Image.open(sheet).size == (2 * 3 * bone.shape[1], 2 * bone.shape[0])
    assert golden.compare(True, folder, sheet) == ["ct-bone", "gone"]
    assert golden.compare(False, folder, sheet) == []
    assert sorted(path.stem for path in folder.iterdir()) == ["ct-bone", "ct-skin"]
