"""The generated CT head: in range, of the size it states, and different on its left and right as it promises."""

import numpy as np
import pytest

from devtools.phantom import BEAD_MM, EXTENT_MM, head_phantom

SPACING = 2.5  # mm; coarse, to be quick


def voxel(point_mm):
    """(z, y, x) of the voxel nearest to a point in mm."""
    low = [axis[0] for axis in EXTENT_MM]
    return tuple(round((point_mm[axis] - low[axis]) / SPACING) for axis in (2, 1, 0))


@pytest.fixture(scope="module")
def head():
    return head_phantom(SPACING)


def test_type_range_and_size(head):
    assert head.dtype == np.int16
    assert head.min() == -1000 and head.max() > 2000
    assert head.shape == tuple(round((high - low) / SPACING) + 1 for low, high in reversed(EXTENT_MM))


def test_the_bead_is_at_the_left_temple_only(head):
    x, y, z = BEAD_MM
    assert x < 0.0, "+x is the patient's right"
    assert head[voxel((x, y, z))] > 2500
    assert head[voxel((-x, y, z))] == -1000


@pytest.mark.parametrize(
    ("point", "low", "high"),
    [
        ((30, 0, 30), 20, 45),  # brain
        ((-13, 2, 10), 0, 15),  # left ventricle
        ((0, 82.5, 5), -1001, -700),  # frontal sinus
        ((31, 82.5, -22.5), 5, 30),  # right eye
        ((0, 90, -105), 300, 1300),  # chin
        ((-85, -100, 100), -1001, -999),  # air beside the head
    ],
)
def test_tissues_have_their_numbers(head, point, low, high):
    assert low <= head[voxel(point)] <= high


def test_left_and_right_differ_inside_too(head):
    left = (head[:, :, : head.shape[2] // 2] == 8).sum()
    right = (head[:, :, head.shape[2] // 2 + 1 :] == 8).sum()
    assert left > right, "the left ventricle is the larger one"
