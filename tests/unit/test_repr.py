"""Volumes and renderings print as one short line, without their arrays."""

import numpy as np

from rle_splat.scene import Rendering
from rle_splat.volume.volume import Volume


def test_a_volume_and_a_rendering_print_as_one_line():
    voxels, affine = np.zeros((3, 4, 5), np.int16), np.diag((0.5, 0.5, 1.25, 1.0))
    ct = Volume(voxels, affine, value_unit="HU", modality="CT", name="a")
    assert repr(ct) == "<Volume CT 'a', 5 x 4 x 3 int16, 0.5 x 0.5 x 1.25 mm, HU>"
    assert repr(Volume(voxels, np.eye(4))) == "<Volume '', 5 x 4 x 3 int16, 1 x 1 x 1 mm>"
    assert repr(Rendering(np.zeros((3, 4, 4)), np.zeros((3, 4)), {})) == "<Rendering of 4 x 3 pixels>"
