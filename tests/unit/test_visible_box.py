"""The box around the voxels that a transfer function shows."""

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.classify.visible_box import visible_box
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


def test_nothing_visible_has_no_box():
    assert visible_box(Volume(np.zeros((2, 2, 2), np.uint8), np.eye(4)), FUNCTION) is None
