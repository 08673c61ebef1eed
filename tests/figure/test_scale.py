"""The scale bar against two balls at a known distance, measured in the pixels of the drawn figure."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.figure.color_bar import ticks
from rle_splat.figure.page import Fill, Text, Tile
from rle_splat.figure.raster import draw
from rle_splat.figure.scale import length_per_pixel, length_text, round_length
from rle_splat.scene import RleSplatError
from rle_splat.view.projection import world_to_pixel

from .conftest import BALLS

APART = BALLS[1][0] - BALLS[0][0]  # voxels


def measured(page) -> tuple[float, float, float]:
    """Pixels between the balls' middles, pixels of the scale bar, and its length as its label says."""
    drawn = draw(page)
    tile = next(item for item in page.items if isinstance(item, Tile))
    left, top = (round(place * page.pixels_per_mm) for place in (tile.x, tile.y))
    height, width = tile.rgba.shape[:2]
    red = drawn[top : top + height, left : left + width, 0] - drawn[top : top + height, left : left + width, 1]
    weights, columns = red.sum(axis=0), np.arange(width) + 0.5
    halves = [(columns < width / 2), (columns >= width / 2)]
    middles = [(weights * columns)[half].sum() / weights[half].sum() for half in halves]
    bar = next(item for item in page.items if isinstance(item, Fill))
    row = int(page.pixels_per_mm * np.mean([y for _, y in bar.points]))
    end = int(page.pixels_per_mm * bar.points[1][0]) + 2
    ink = (1.0 - drawn[row, :end, 0]).sum() / (1.0 - drawn[row, left + 2, 0])
    label = next(item.text for item in page.items if isinstance(item, Text) and item.text.endswith("m"))
    return middles[1] - middles[0], float(ink), float(label.partition(" ")[0])


@pytest.mark.parametrize(
    "spacing, more",
    [
        (1.0, {}),
        (2.5, {"scene_scale": 0.001}),
        (0.5, {"volume_matrix": np.diag((3.0, 3.0, 3.0, 1.0)), "scene_scale": 1.0}),
    ],
)
def test_ten_millimeters_are_ten_millimeters(drawing, balls, spacing, more):
    scene = drawing.scene(balls(affine=np.diag((spacing, spacing, spacing, 1.0))), **more)
    if "volume_matrix" in more:  # the camera sees as much of the enlarged object
        camera = scene.camera
        where = camera.matrix_world.copy()
        where[:3, 3] *= 3.0
        larger = {name: 3.0 * getattr(camera, name) for name in ("ortho_scale", "clip_start", "clip_end")}
        scene = replace(scene, camera=replace(camera, matrix_world=where, **larger))
    length = 2.0 * spacing
    page = drawing.made(scene, style=replace(drawing.style, scale_bar=length)).page
    pixels, bar, label = measured(page)
    assert label == length
    assert bar / label == pytest.approx(pixels / (APART * spacing), rel=0.01)


def test_a_perspective_scale_holds_at_its_depth(drawing):
    scene = drawing.scene(view={"perspective": True, "fov": 50.0})
    style = replace(drawing.style, scale_bar=5.0, scale_depth="center")
    per_pixel = length_per_pixel(scene, "center")
    # Half a voxel off the plane through the middle, along y: from here the points are projected exactly.
    ends = [scene.index_to_world @ (x, 5.5, 6.5, 1.0) for x in (BALLS[0][0], BALLS[1][0])]
    seen = [world_to_pixel(scene.camera, scene.width, scene.height) @ end for end in ends]
    columns = [place[0] / place[2] for place in seen]
    assert per_pixel * (columns[1] - columns[0]) == pytest.approx(APART)
    bar = next(item for item in drawing.made(scene, style=style).page.items if isinstance(item, Fill))
    wide = (bar.points[1][0] - bar.points[0][0]) * style.pixels_per_mm
    assert wide == pytest.approx((columns[1] - columns[0]) * 5.0 / APART)


def test_a_perspective_view_without_a_depth_has_no_scale(drawing):
    scene = drawing.scene(view={"perspective": True})
    made = drawing.made(scene)
    assert not any(isinstance(item, Fill) for item in made.page.items)
    assert any("has no scale bar" in remark for remark in made.remarks)
    with pytest.raises(RleSplatError, match="at one depth only"):
        drawing.made(scene, style=replace(drawing.style, scale_bar=5.0))


def test_a_volume_stretched_along_one_axis_has_no_scale(drawing):
    scene = drawing.scene(volume_matrix=np.diag((1.0, 1.0, 1.2, 1.0)))
    with pytest.raises(RleSplatError, match="stretched more along one axis"):
        drawing.made(scene, style=replace(drawing.style, scale_bar=5.0))


def test_a_bar_longer_than_the_picture_is_refused(drawing):
    with pytest.raises(RleSplatError, match="100 mm is longer than the picture, which shows 25 mm"):
        drawing.made(drawing.scene(), style=replace(drawing.style, scale_bar=100.0))


@pytest.mark.parametrize(
    "longest, length", [(1.0, 1.0), (4.99, 2.0), (5.0, 5.0), (99.0, 50.0), (0.03, 0.02), (1234.0, 1000.0), (1e-4, 1e-4)]
)
def test_lengths_are_round(longest, length):
    assert round_length(longest) == length


@pytest.mark.parametrize(
    "length, unit, text",
    [
        (50.0, "mm", "50 mm"),
        (0.5, "mm", "500 µm"),
        (2000.0, "m", "2 m"),
        (0.005, "um", "5 µm"),
        (3.0, "world", "3 units"),
    ],
)
def test_lengths_are_written_with_their_unit(length, unit, text):
    assert length_text(length, unit) == text


@pytest.mark.parametrize(
    "low, high, most, found",
    [
        (-1000.0, 2000.0, 8, [-1000.0, -500.0, 0.0, 500.0, 1000.0, 1500.0, 2000.0]),
        (0.0, 1.0, 5, [0.0, 0.25, 0.5, 0.75, 1.0]),
        (13.0, 207.0, 4, [50.0, 100.0, 150.0, 200.0]),
    ],
)
def test_ticks_are_round_values_within_the_range(low, high, most, found):
    assert ticks(low, high, most) == found
