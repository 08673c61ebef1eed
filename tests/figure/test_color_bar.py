"""Color bars against the transfer function whose colors, opacities and values they show."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.figure.color_bar import bar_range, color_bar
from rle_splat.figure.page import Text, Tile

BLACK = (0.0, 0.0, 0.0)
STEPS = TransferFunction(
    name="Steps", unit="HU", opacity=((-100.0, 0.0), (0.0, 0.2), (0.0, 0.8), (300.0, 0.4)),
    color=((-100.0, 0.1, 0.2, 0.9), (100.0, 0.9, 0.5, 0.1), (300.0, 1.0, 1.0, 1.0)),
)  # fmt: skip


def test_a_color_bar_has_the_colors_and_opacities_of_the_function():
    items = color_bar(STEPS, "1 mm", "HU", (0.0, 0.0, 40.0), 2.0, 10.0, BLACK)
    curve, strip = (item.rgba for item in items if isinstance(item, Tile))
    columns = strip.shape[1]
    values = -100.0 + 400.0 * (np.arange(columns) + 0.5) / columns
    assert (strip[..., 3] == 1.0).all()
    assert np.abs(strip[..., :3] - STEPS.color_at(values)).max() < 1e-6
    assert curve[..., 3].sum(axis=0) / len(curve) == pytest.approx(STEPS.alpha_at(values), abs=1e-6)
    assert (np.diff(curve[..., 3], axis=0) >= 0.0).all(), "it stands on the strip"
    inside = curve[..., 3] == 1.0
    assert np.array_equal(curve[inside], np.broadcast_to(strip[0], curve.shape)[inside])


def test_where_a_pixel_shows_one_value_the_bar_has_what_is_shown_of_it():
    items = color_bar(STEPS, None, "SUVbw", (0.0, 0.0, 40.0), 2.0, 10.0, BLACK)
    (shown,) = (item.rgba for item in items if isinstance(item, Tile))
    values = -100.0 + 400.0 * (np.arange(shown.shape[1]) + 0.5) / shown.shape[1]
    assert shown[0, :, 3] == pytest.approx(STEPS.alpha_at(values), abs=1e-6)
    assert shown[0, :, :3] == pytest.approx(STEPS.color_at(values) * shown[0, :, 3:], abs=1e-6)
    texts = [item.text for item in items if isinstance(item, Text)]
    assert "Values in SUVbw" in texts and not any(text.startswith("Opacity") for text in texts)


def test_a_color_bar_has_its_ticks_where_the_values_are():
    items = color_bar(STEPS, "1 mm", "HU", (3.0, 0.0, 40.0), 2.0, 10.0, BLACK)
    strip = [item for item in items if isinstance(item, Tile)][1]
    labels = {item.text: item.x for item in items if isinstance(item, Text) and item.anchor == "middle"}
    assert {"−100", "0", "100", "200", "300"} <= set(labels)
    for text, x in labels.items():
        share = (x - strip.x) * 10.0 / strip.rgba.shape[1]
        assert share == pytest.approx((float(text.replace("−", "-")) + 100.0) / 400.0)
    assert {"Opacity per 1 mm", "Values in HU"} <= {item.text for item in items if isinstance(item, Text)}


def test_a_function_of_one_point_has_a_bar_too():
    low, high = bar_range(replace(STEPS, opacity=((40.0, 1.0),), color=((40.0, 1.0, 0.0, 0.0),)))
    assert low < 40.0 < high


def test_functions_that_differ_have_a_bar_each(drawing):
    style = replace(drawing.style, width_cm=6.0)
    functions = STEPS, replace(STEPS, shade=None)
    scenes = [drawing.scene(style=style, count=2, function=function) for function in functions]
    texts = [item.text for item in drawing.made(*scenes, style=style).page.items if isinstance(item, Text)]
    assert texts.count("Opacity per 1 mm") == 2
    assert [text for text in texts if text in ("a", "b")] == ["a", "b"]


def test_a_color_bar_shows_the_values_that_are_visible():
    bone = replace(STEPS, opacity=((-1000.0, 0.0), (150.0, 0.0), (300.0, 0.5), (900.0, 0.0), (3000.0, 0.0)))
    assert bar_range(bone) == (150.0, 900.0)
    assert bar_range(replace(bone, opacity=((150.0, 0.2), (900.0, 0.5)))) == (-100.0, 900.0), "its span"
