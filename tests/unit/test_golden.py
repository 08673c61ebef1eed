"""Each preset looks as a person has approved it (``dev.py golden``), and a change that anybody would see is noticed."""

import numpy as np
import pytest
from PIL import Image

from devtools import golden
from devtools.real_blender_tests import WINDOW_SCRIPTS
from rle_splat.classify.presets import PRESETS

MOST_BYTES, MOST_BYTES_OF_WINDOW = 8192, 40000  # of a file


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
    windows = {path.stem: path.stat().st_size for path in golden.WINDOWS.iterdir()}
    assert set(windows) == set(golden.PHOTOGRAPHS) and max(windows.values()) <= MOST_BYTES_OF_WINDOW


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


@pytest.mark.parametrize("script", golden.PHOTOGRAPHS)
def test_green_in_a_window_is_noticed_and_a_word_is_not(script):
    """Whatever is warm in a photograph, as bone and skin are, or else its brightest pixels, become green."""
    window = golden.load(script, golden.WINDOWS)
    assert window is not None and f"{script}.py" in WINDOW_SCRIPTS
    red, _, blue = np.moveaxis(window.astype(int), -1, 0)
    warm = (red - blue > 40) | (window.min(axis=2) > 160)
    changed = np.where(warm[..., None], green(window), window)
    assert not golden.is_same(golden.difference(window, changed), golden.LARGEST_OF_WINDOW)
    word = window.copy()
    word[60, 100:104] = word[60, 100:104] // 2 + 30  # of gray letters, an eighth as large
    assert golden.is_same(golden.difference(window, word), golden.LARGEST_OF_WINDOW)


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


def test_what_has_changed_is_listed_shown_and_approved(tmp_path, capsys):
    bone = golden.load("ct-bone")
    today, folder, sheet = {"ct-bone": bone, "ct-skin": bone}, tmp_path / "golden", tmp_path / "sheet.png"
    folder.mkdir()
    for name, picture in (("ct-bone", green(bone)), ("ct-skin", bone), ("gone", bone)):
        Image.fromarray(picture).save(folder / f"{name}.png")
    assert golden.compare(today, today, False, folder, sheet) == ["ct-bone", "gone"]
    assert "ct-skin" in capsys.readouterr().out
    assert Image.open(sheet).size == (2 * 3 * bone.shape[1], 2 * bone.shape[0])
    assert golden.compare(today, today, True, folder, sheet) == ["ct-bone", "gone"]
    assert golden.compare(today, today, False, folder, sheet) == []
    assert sorted(path.stem for path in folder.iterdir()) == ["ct-bone", "ct-skin"]
