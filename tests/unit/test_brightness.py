"""The brightness of a volume under lights, compared with a headlight: against sums over a sphere's visible pixels."""

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade
from rle_splat.scene import Light
from rle_splat.shade.brightness import relative_brightness
from rle_splat.shade.lighting import lighting

TO_EYE = (0.0, 0.0, 1.0, 0.0)
PIXELS = 401


def falling(angle: float, distance: float, two_sided: bool, world=None):
    """Light of a point lamp of 100 W at an angle from the eye's direction."""
    matrix = np.eye(4)
    matrix[:3, 3] = distance * np.array((np.sin(angle), 0.0, np.cos(angle)))
    lamp = Light(type="POINT", energy=100.0, matrix_world=matrix)
    return lighting(np.eye(4), Shade(0.3, 1.0, 0.0, 1.0, two_sided=two_sided), (lamp,), eye=TO_EYE, world=world)


@pytest.mark.parametrize("two_sided", (True, False))
@pytest.mark.parametrize("angle", (0.0, 0.7, 1.6, 2.5))
def test_a_lamp_is_as_bright_as_on_a_distant_sphere(angle, two_sided):
    y, x = (np.mgrid[:PIXELS, :PIXELS] + 0.5) * (2.0 / PIXELS) - 1.0
    seen = x**2 + y**2 < 1.0
    normals = np.stack((x, y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))), axis=-1)[seen]
    facing = normals @ (np.sin(angle), 0.0, np.cos(angle))
    facing = np.abs(facing) if two_sided else np.maximum(facing, 0.0)
    expected = facing.mean() / normals[:, 2].mean() * 100.0 / (4.0 * np.pi**2 * 5.0**2)
    assert relative_brightness(falling(angle, 5.0, two_sided), (0.0, 0.0, 0.0)) == pytest.approx(expected, rel=3e-3)


def test_a_headlight_is_the_measure():
    light = lighting(np.eye(4), Shade(), headlight_direction=(0.0, 0.0, -1.0), eye=TO_EYE)
    assert relative_brightness(light, (3.0, 1.0, 0.0)) == pytest.approx(1.0)


def test_a_world_of_white_light_is_brighter_than_a_headlight_by_what_that_leaves_dark():
    without, within = (falling(1.0, 5.0, True, world) for world in (None, (1.0, 1.0, 1.0)))
    added = relative_brightness(within, (0, 0, 0)) - relative_brightness(without, (0, 0, 0))
    assert added == pytest.approx(1.5)
