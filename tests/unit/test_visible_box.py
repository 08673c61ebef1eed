"""The box around the voxels that a transfer function shows."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.classify.visible_box import visible_box
from rle_splat.scene import Labels
from rle_splat.volume.volume import Volume

FUNCTION = TransferFunction(
    name="test", unit=None, opacity=((10.0, 0.0), (11.0, 0.5), (20.0, 0.5), (21.0, 0.0)),
    color=((0.0, 1.0, 1.0, 1.0), (30.0, 1.0, 1.0, 1.0)))  # fmt: skip


@pytest.mark.parametrize("dtype", ["uint8", "int16", "float32"])
def test_it_holds_every_visible_voxel_and_no_more(dtype):
    voxels = np.full((6, 7, 8), -3 if dtype != "uint8" else 3, dtype)
    for x, y, z in ((2, 5, 1), (6, 3, 4), (4, 4, 2)):
        voxels[z, y, x] = 15
    voxels[0, 0, 0] = 40  # above what is shown
    if dtype == "float32":
        voxels[5, 6, 7] = np.nan
    first, last = visible_box(Volume(voxels, np.eye(4)), FUNCTION)
    np.testing.assert_array_equal(first, (2, 3, 1))
    np.testing.assert_array_equal(last, (6, 5, 4))


def test_labels_that_are_hidden_are_not_seen_and_others_by_their_own_function():
    voxels, numbers = np.full((6, 7, 8), 3, np.int16), np.zeros((6, 7, 8), np.uint8)
    voxels[1, 2, 3], voxels[4, 5, 6], voxels[0, 0, 0] = 15, 15, 40
    numbers[4, 5, 6], numbers[0, 0, 0] = 1, 2
    grid, map_volume = Volume(voxels, np.eye(4)), Volume(numbers, np.eye(4))
    above = replace(FUNCTION, opacity=((30.0, 0.0), (31.0, 0.5)))
    for functions, first, last in (
        ({}, (3, 2, 1), (6, 5, 4)), ({1: None}, (3, 2, 1), (3, 2, 1)), ({0: None}, (6, 5, 4), (6, 5, 4)),
        ({1: None, 2: above}, (0, 0, 0), (3, 2, 1)),
    ):  # fmt: skip
        found = visible_box(grid, FUNCTION, Labels(map_volume, functions))
        np.testing.assert_array_equal(found, (first, last))


def test_nothing_visible_has_no_box():
    assert visible_box(Volume(np.zeros((2, 2, 2), np.uint8), np.eye(4)), FUNCTION) is None
