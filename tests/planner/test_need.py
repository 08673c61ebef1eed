"""Proves the words about transfer functions: what the scene shows by pre and by post differs as much as they say."""

import numpy as np
import pytest

from benchmarks.phantoms import radius_from_center
from rle_splat.accuracy.planner.need import need_of
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.volume.volume import Volume


def band(half_width: float) -> TransferFunction:
    """A tent about radius 10, ``half_width`` voxels of the field to either side."""
    return TransferFunction(
        "band", None, ((10.0 - half_width, 0.0), (10.0, 0.6), (10.0 + half_width, 0.0)), ((0.0, 1.0, 1.0, 1.0),), 1.0
    )


@pytest.fixture(scope="module")
def volume():
    return Volume(radius_from_center(28).astype(np.float32), np.eye(4))


def test_the_narrower_the_worse(volume):
    levels = [need_of(volume, band(half_width)).levels for half_width in (0.5, 1.0, 2.0, 4.0, 8.0)]
    assert levels == sorted(levels, reverse=True) and levels[0] > 20.0 and levels[-1] < 8.0


def test_a_narrow_band_needs_post_and_a_straight_line_does_not(volume):
    narrow = need_of(volume, band(0.5))
    assert narrow.classification == "post" and "post shows it as it is" in narrow.sentence
    straight = TransferFunction("ramp", None, ((0.0, 0.0), (25.0, 0.05)), ((0.0, 1.0, 1.0, 1.0),), 1.0)
    wide = need_of(volume, straight)
    assert wide.classification == "pre" and wide.levels < 0.1


@pytest.mark.parametrize("voxels", (np.zeros((4, 4, 4)), np.full((3, 3, 3), np.nan), np.ones((1, 1, 1))))
def test_nothing_to_see_is_no_need(voxels):
    empty = TransferFunction("step", None, ((5.0, 0.0), (6.0, 1.0)), ((0.0, 1.0, 1.0, 1.0),), 1.0)
    assert need_of(Volume(voxels.astype(np.float32), np.eye(4)), empty).classification == "pre"
