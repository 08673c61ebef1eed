"""Anti-aliasing: shifts against the projection, and the picture against one with more pixels."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.planner.checks import check_tolerance_applies, measurable_scene
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.effects.antialias import SHIFTS, shifted
from rle_splat.effects.exposure import list_exposures
from rle_splat.pipeline.render import render
from rle_splat.scene import Camera, Quality, RleSplatError, Scene
from rle_splat.view.projection import world_to_pixel
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

SIDE, SIZE = 40, 72  # voxels, pixels
HARD = TransferFunction(
    name="", opacity=((99.0, 0.0), (101.0, 0.999)), color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=0.2, shade=None
)


def ball(**more) -> Scene:
    """A hard, opaque ball."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - 0.5 * (SIDE - 1)
    volume = Volume(
        np.clip(100.0 * (16.0 - np.sqrt(x * x + y * y + z * z)) + 100.0, 0, 255).astype(np.uint8), np.eye(4)
    )
    camera, matrix = turntable(volume, azimuth=20.0, elevation=10.0)
    return Scene(volume, HARD, camera, SIZE, SIZE, volume_matrix=matrix, headlight=False, **more)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("pixel_aspect", [(1.0, 1.0), (1.0, 2.0), (3.0, 2.0)])
@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_pictures_are_shifted_by_parts_of_a_pixel(fit, pixel_aspect, kind):
    camera = Camera(type=kind, ortho_scale=6.0, sensor_fit=fit, pixel_aspect=pixel_aspect, shift_x=0.1, shift_y=-0.2)
    scene = replace(ball(antialias=True), camera=camera, width=90, height=64)
    moves = []
    for number in range(5):
        found = world_to_pixel(shifted(scene, number).camera, 90, 64) @ (0.3, -0.2, -5.0, 1.0)
        before = world_to_pixel(camera, 90, 64) @ (0.3, -0.2, -5.0, 1.0)
        moves.append((found / found[2] - before / before[2])[:2])
    assert -np.array(moves[:4]) == pytest.approx(np.array(SHIFTS), abs=1e-9)
    assert moves[4] == pytest.approx(moves[0], abs=1e-12), "they take turns"
    assert np.mean(SHIFTS, axis=0) == pytest.approx([0.0, 0.0])


def test_edges_have_no_steps():
    """The covers of pixels at the edge: nearer to those of 8 x 8 times as many pixels than without."""
    fine = render(replace(ball(), width=8 * SIZE, height=8 * SIZE), Quality.preset("fine")).rgba[..., 3]
    wanted = fine.reshape(SIZE, 8, SIZE, 8).mean(axis=(1, 3))
    edge = (wanted > 0.02) & (wanted < 0.98)
    errors = [np.sqrt(np.mean((render(scene, Quality.preset("fine")).rgba[..., 3] - wanted)[edge] ** 2))
              for scene in (ball(), ball(antialias=True))]  # fmt: skip
    assert edge.sum() > 100 and errors[1] < 0.5 * errors[0] and errors[1] < 0.1, errors


def test_the_picture_is_the_mean_of_shifted_ones_with_the_depth_of_the_scene():
    scene = ball(antialias=True)
    one, other = render(scene, Quality.preset("draft")), render(ball(), Quality.preset("draft"))
    parts = [render(shifted(scene, number), Quality.preset("draft")).rgba.astype(np.float64) for number in range(4)]
    assert np.abs(one.rgba - np.mean(parts, axis=0)).max() < 1e-6 and np.abs(one.rgba - other.rgba).max() > 0.05
    assert np.array_equal(one.depth, other.depth)


def test_each_picture_has_the_plan_of_a_single_one():
    plans = [render(ball(antialias=on), Quality.preset("fine")).report["plan"] for on in (False, True)]
    assert plans[0]["rays"] > 0.0 and plans[0] == plans[1]


def test_a_lens_has_them_without_more_pictures():
    camera = replace(ball().camera, type="PERSP", lens=50.0, aperture_radius=8.0, focus_distance=150.0)
    blurred = [replace(ball(antialias=on), camera=camera) for on in (False, True)]
    found = [list_exposures(one) for one in blurred]
    assert len(found[0]) == len(found[1]) > 4
    assert not any(one.antialias for one in found[1])
    moved = [SIZE * (one.camera.shift_x - other.camera.shift_x) for other, one in zip(*found)]
    assert moved == pytest.approx([SHIFTS[number % 4][0] for number in range(len(moved))], abs=1e-9)


def test_a_tolerance_and_measures_are_of_one_picture():
    with pytest.raises(RleSplatError, match="anti-aliasing"):
        check_tolerance_applies(ball(antialias=True), Quality())
    assert not measurable_scene(ball(antialias=True), Quality()).antialias
    with pytest.raises(RleSplatError, match="antialias must be true or false"):
        ball(antialias=1)
