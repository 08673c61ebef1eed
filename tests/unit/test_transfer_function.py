"""The transfer function: points, steps, ends, NaN, its file, and what it refuses."""

import json
import math

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction, blinn_shininess
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import LARGEST_VALUE

WHITE = ((0.0, 1.0, 1.0, 1.0),)
INF, NAN = math.inf, math.nan


def curve(*opacity, color=WHITE, **more):
    return TransferFunction(opacity=opacity, color=color, **more)


@pytest.mark.parametrize(
    "opacity, value, alpha",
    [
        (((0, 0.2), (10, 0.6)), 5.0, 0.4),
        (((0, 0.2), (10, 0.6)), -1.0, 0.2),  # held ends
        (((0, 0.2), (10, 0.6)), 11.0, 0.6),
        (((0, 0.2), (10, 0.6)), INF, 0.6),
        (((0, 0.2), (10, 0.6)), -INF, 0.2),
        (((0, 0.2), (10, 0.6)), NAN, 0.0),  # not measured: transparent
        (((10, 0.6), (0, 0.2)), 5.0, 0.4),  # unsorted
        (((3, 0.7),), -100.0, 0.7),  # a single point is constant
        (((3, 0.7),), INF, 0.7),
        (((0, 0.1), (5, 0.1), (5, 0.9), (10, 0.9)), 5.0, 0.9),  # a step is right-continuous
        (((0, 0.1), (5, 0.1), (5, 0.9), (10, 0.9)), np.nextafter(5.0, 0.0), 0.1),
        (((5, 0.1), (5, 0.5), (5, 0.9)), 5.0, 0.9),  # nothing but one step: no 0/0
        (((5, 0.1), (5, 0.5), (5, 0.9)), 4.999, 0.1),
        (((5, 0.9), (0, 0.0), (5, 0.1)), 5.0, 0.1),  # equal values keep their order
    ],
)
def test_alpha_at(opacity, value, alpha):
    assert curve(*opacity).alpha_at(value) == pytest.approx(alpha, abs=1e-15)


def test_evaluation_keeps_shape_and_is_float64():
    function = curve((0, 0.0), (1, 1.0), color=((0, 0.0, 0.5, 2.0), (1, 1.0, 0.5, 4.0)))
    values = np.linspace(-1.0, 2.0, 24, dtype=np.float32).reshape(2, 3, 4)
    assert function.alpha_at(values).shape == (2, 3, 4)
    assert function.alpha_at(values).dtype == np.float64
    assert function.color_at(values).shape == (2, 3, 4, 3)
    assert function.color_at(0.5).tolist() == [0.5, 0.5, 3.0]
    table = function.table(values)
    np.testing.assert_array_equal(table[..., 3], function.alpha_at(values))
    np.testing.assert_array_equal(table[..., :3], function.color_at(values))
    np.testing.assert_array_equal(function.color_at(NAN), (0.0, 0.0, 0.0))


def test_without_steps_it_agrees_with_numpy():
    rng = np.random.default_rng(3)
    positions = np.sort(rng.uniform(-1000, 3000, 9))
    heights = rng.uniform(0, 1, 9)
    values = rng.uniform(-2000, 4000, 1000)
    function = curve(*zip(positions, heights))
    np.testing.assert_allclose(function.alpha_at(values), np.interp(values, positions, heights), atol=1e-14)


def test_remapping_moves_the_ends_exactly():
    function = curve((-1000, 0), (500, 0.3), (2000, 1), color=((-500, 0, 0, 0), (2000, 1, 1, 1)), unit="HU")
    moved = function.remapped(0.1, 0.7)
    assert moved.span == (0.1, 0.7)
    assert moved.unit is None
    assert moved.alpha_at(0.4) == pytest.approx(0.3)
    np.testing.assert_allclose(moved.remapped(-1000, 2000).opacity, function.opacity)


def test_a_window_of_no_width_is_a_step():
    function = curve((0, 0.0), (1, 1.0)).windowed(40.0, 0.0)
    assert function.alpha_at([39.9, 40.0, 40.1]).tolist() == [0.0, 1.0, 1.0]
    assert curve((0, 0.0), (1, 1.0), unit="HU").windowed(40.0, 400.0).span == (-160.0, 240.0)
    with pytest.raises(RleSplatError, match="width"):
        function.windowed(0.0, -1.0)


def test_keys_follow_what_the_picture_depends_on():
    function = curve((0, 0.0), (1, 1.0))
    assert curve((1, 1.0), (0, 0.0), name="other").key == function.key
    reshaded = curve((0, 0.0), (1, 1.0), shade=Shade(ambient=0.9))
    assert reshaded.key != function.key
    assert reshaded.classification_key == function.classification_key
    assert curve((0, 0.0), (1, 0.9)).classification_key != function.classification_key
    assert curve((0, 0.0), (1, 1.0), opacity_unit_distance=2.0).key != function.key


@pytest.mark.parametrize("shade", [None, Shade(0.1, 0.2, 0.3, 40.0), Shade(shininess=40.0, smoothness=1.5)])
@pytest.mark.parametrize("distance", [None, 0.75])
def test_the_file_holds_everything(tmp_path, shade, distance):
    function = curve((-1000.0, 0.0), (0.1, 1 / 3), name="Näme", unit="HU", shade=shade, opacity_unit_distance=distance)
    path = tmp_path / "function.json"
    function.save(path)
    assert TransferFunction.from_json(path) == function
    mapping = json.loads(path.read_text(encoding="utf-8"))
    assert mapping["shade"] is False if shade is None else mapping["shade"]["shininess"] == 40.0
    assert ("smoothness" in (mapping["shade"] or {})) == (shade is not None and shade.smoothness is not None)
    assert ("opacity_unit_distance" in mapping) == (distance is not None)
    assert mapping["opacity"][1] == [0.1, 1 / 3]


GOOD = {"name": "x", "unit": None, "opacity": [[0, 0], [1, 1]], "color": [[0, 1, 1, 1]], "shade": False}


@pytest.mark.parametrize(
    "change, words",
    [
        ({"opacity": []}, "no opacity points"),
        ({"color": []}, "no color points"),
        ({"opacity": [[0, 1.5]]}, "from 0 to 1"),
        ({"opacity": [[0, -0.1]]}, "from 0 to 1"),
        ({"opacity": [[0, NAN]]}, "finite"),
        ({"opacity": [[INF, 0.5]]}, "finite"),
        ({"opacity": [[0, 0.5, 1]]}, r"\[value, alpha\]"),
        ({"opacity": [[0, "much"]]}, "number"),
        ({"opacity": [[0, True]]}, "number"),
        ({"opacity": 3}, "list"),
        ({"color": [[0, 1, -1, 1]]}, "negative"),
        ({"color": [[0, 1, 1]]}, r"\[value, r, g, b\]"),
        ({"color": [[0, 1, NAN, 1]]}, "finite"),
        ({"opacity_unit_distance": 0}, "above zero"),
        ({"opacity_unit_distance": "long"}, "number"),
        ({"shade": {"ambient": -1}}, "ambient"),
        ({"shade": {"glow": 1}}, "glow"),
        ({"shade": {"highlight": "round"}}, "highlight"),
        ({"shade": {"highlight": "phong", "shininess": "much"}}, "shininess must be a number"),
        ({"shade": {"smoothness": -0.1}}, "from 0 to 100 mm"),
        ({"shade": {"smoothness": "much"}}, "smoothness must be a number"),
        ({"shade": True}, "shade"),
        ({"unit": 5}, "unit"),
        ({"name": 5}, "name"),
        ({"gamma": 5}, "gamma"),
    ],
)
def test_each_mistake_gets_its_sentence(change, words):
    with pytest.raises(RleSplatError, match=words):
        TransferFunction.from_json({**GOOD, **change})


@pytest.mark.parametrize(
    ("shade", "shininess"),
    [
        ({"highlight": "phong", "shininess": 10.0}, 40.0), ({"highlight": "phong"}, 80.0),
        ({"highlight": "phong", "shininess": LARGEST_VALUE}, LARGEST_VALUE),
        ({"highlight": "blinn-phong", "shininess": 10.0}, 10.0), ({"shininess": 10.0}, 10.0),
    ],
)  # fmt: skip
def test_highlights_of_earlier_versions_become_those_of_blinn_phong(shade, shininess):
    given = dict(shade)
    function = TransferFunction.from_json({**GOOD, "shade": shade})
    assert function.shade == Shade(shininess=shininess) and shade == given
    assert "highlight" not in function.to_json()["shade"]


@pytest.mark.parametrize("phong", [5.0, 10.0, 40.0])
def test_a_highlight_of_phong_and_its_blinn_phong_are_nearly_as_bright_at_each_angle(phong):
    """In the plane of light and eye, where h is half as far from the normal as the mirrored light from the eye."""
    angle = np.linspace(0.0, np.pi / 2, 1001)
    blinn = np.cos(angle / 2) ** blinn_shininess(phong)
    np.testing.assert_allclose(blinn, np.cos(angle) ** phong, atol=0.16 / phong)


@pytest.mark.parametrize("missing", ["opacity", "color"])
def test_missing_points_are_named(missing):
    with pytest.raises(RleSplatError, match=missing):
        TransferFunction.from_json({k: v for k, v in GOOD.items() if k != missing})


@pytest.mark.parametrize("text", ["[1, 2]", "{", ""])
def test_a_file_that_is_no_transfer_function_is_refused(tmp_path, text):
    path = tmp_path / "broken.json"
    path.write_text(text)
    with pytest.raises(RleSplatError):
        TransferFunction.from_json(path)
    with pytest.raises(RleSplatError, match=r"missing\.json"):
        TransferFunction.from_json(tmp_path / "missing.json")
