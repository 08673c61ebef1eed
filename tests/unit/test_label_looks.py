"""Opacity of labels: a factor on their transfer function, or the same for all their voxels."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.label_styles import SOLID_VOXELS, LabelStyle, distinct_color, read_label_styles, style_labels
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.scalar_labels import LabelFunctions
from rle_splat.scene import Labels, RleSplatError
from rle_splat.volume.volume import NamedLabel, Volume

OWN = TransferFunction(
    name="own", unit=None, opacity=((0.0, 0.0), (100.0, 0.8)), color=((0.0, 1.0, 0.5, 0.25),), opacity_unit_distance=2.0
)
VOLUME = Volume(np.zeros((2, 3, 4), np.uint8), np.diag((1.0, 0.5, 3.0, 1.0)))


def test_an_opacity_scales_the_curve():
    found = LabelStyle(1, opacity=0.5).function(VOLUME, OWN)
    assert found.opacity == ((0.0, 0.0), (100.0, 0.4)) and found.opacity_unit_distance == 2.0
    assert LabelStyle(1).function(VOLUME, OWN) == OWN


def test_a_solid_label_has_one_opacity_for_a_thickness_in_voxels():
    found = LabelStyle(1, color=(0.0, 0.0, 1.0), opacity=0.3, solid=True).function(VOLUME, OWN)
    assert [found.alpha_at(value) for value in (-50.0, 0.0, 500.0)] == [0.3] * 3
    assert found.opacity_unit_distance == SOLID_VOXELS * 0.5
    assert LabelStyle(1, hidden=True, solid=True).function(VOLUME, OWN) is None


def test_they_are_read_from_a_file(tmp_path):
    path = tmp_path / "looks.json"
    path.write_text('[{"label": 2, "solid": true, "opacity": 0.25}]', encoding="utf-8")
    (style,) = read_label_styles(path)
    assert (style.solid, style.opacity) == (True, 0.25)


@pytest.mark.parametrize(
    ("given", "words"),
    (
        ({"opacity": 1.5}, "from 0 to 1"),
        ({"opacity": "x"}, "from 0 to 1"),
        ({"solid": 1}, "hidden and solid must be true or false"),
    ),
)
def test_nonsense_is_refused(given, words):
    with pytest.raises(RleSplatError, match=words):
        LabelStyle(1, **given)


def _label_map(*names) -> Volume:
    return replace(VOLUME, voxels=np.arange(24, dtype=np.uint8).reshape(2, 3, 4) % 3, name="map", named_labels=names)


def test_labels_have_the_names_and_colors_of_their_file():
    """A label without a color looks like the scan, and so does one that the file does not name."""
    red = (0.5, 0.0, 0.0)
    found = style_labels(_label_map(NamedLabel(1, "liver", red), NamedLabel(2, "ribs")), VOLUME, OWN, smooth=False)
    assert found.functions == {1: replace(OWN, color=((0.0, *red),))}
    assert found.names == {1: "liver", 2: "ribs"} and not found.smooth


def test_labels_without_names_are_solid_in_distinct_colors_and_the_background_is_hidden():
    found = style_labels(_label_map(), VOLUME, OWN)
    assert found.functions[0] is None and list(found.functions) == [0, 1, 2] and found.smooth
    assert [found.functions[n].color for n in (1, 2)] == [((0.0, *distinct_color(n)),) for n in (1, 2)]
    assert [found.functions[n].alpha_at(0.0) for n in (1, 2)] == [1.0, 1.0]


def test_styles_count_in_place_of_those_of_the_file():
    styles = (LabelStyle(2, hidden=True), LabelStyle(7, "seven"))
    found = style_labels(_label_map(NamedLabel(1, "liver", (0.5, 0.0, 0.0))), VOLUME, OWN, styles)
    assert (found.functions, found.names) == ({2: None}, {7: "seven"})


@pytest.mark.parametrize(("labels", "styles", "words"), (
    (replace(VOLUME, voxels=np.full((2, 3, 4), np.nan, np.float32)), None, "whole numbers"),
    (Volume(np.arange(600, dtype=np.uint16).reshape(6, 10, 10), np.eye(4), name="ct"), None, "ct has more than 512"),
    (_label_map(), {1: OWN}, "must be LabelStyle"),
))  # fmt: skip
def test_labels_that_cannot_be_shown_are_refused(labels, styles, words):
    with pytest.raises(RleSplatError, match=words):
        style_labels(labels, VOLUME, OWN, styles)


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint16, np.int32])
def test_voxels_of_every_type_find_their_function(kind):
    """Labels without one have the scene's own, those of the same look the same, also below zero."""
    low = 0 if np.iinfo(kind).min == 0 else -7
    numbers = np.array((low, 0, 1, 5, 127, 9), kind).reshape(1, 2, 3)
    red = replace(OWN, color=((0.0, 1.0, 0.0, 0.0),))
    functions = {5: red, 127: None, 9: red} | ({-7: red} if low else {})
    found = LabelFunctions.of(Labels(Volume(numbers, np.eye(4)), functions), OWN)
    assert found.numbers_of(0, 1).ravel().tolist() == [1 if low else 0, 0, 0, 1, 2, 1]
