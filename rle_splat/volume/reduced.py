"""A coarser copy of a volume for small pictures: means of blocks of any size along each axis, in one pass.

``coarser`` makes voxels twice as large along all axes, for the picture itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .volume import Volume


def factors_of(volume: Volume, side: int) -> tuple[int, int, int]:
    """How many voxels are averaged along x, y and z.

    Parameters
    ----------
    volume : Volume
    side : int
        The longest side of the coarser volume has about so many voxels, and those of it are about as wide as high.
    """
    lengths = np.array(volume.shape_xyz) * volume.spacing
    wanted = float(lengths.max()) / side
    found = np.maximum(1, np.rint(wanted / np.where(volume.spacing > 0.0, volume.spacing, wanted)))
    return tuple(int(min(factor, count)) for factor, count in zip(found, volume.shape_xyz))


def reduced_steps(volume: Volume, side: int):
    """Generator of fractions done: average blocks of voxels.

    Parameters
    ----------
    volume : Volume
    side : int
        See ``factors_of``.

    Returns
    -------
    Volume
        In the same place, read-only; 32-bit floats, or the volume's own type if it has at most 16 bits.  Voxels at the
        far faces that fill no block are left out.
    """
    fx, fy, fz = factors_of(volume, side)
    nx, ny, nz = (count // factor for count, factor in zip(volume.shape_xyz, (fx, fy, fz)))
    own = volume.voxels.dtype
    keeps_type = own.kind in "iu" and own.itemsize <= 2
    voxels = np.empty((nz, ny, nx), own if keeps_type else np.float32)
    for z in range(nz):
        yield z / nz
        total = np.zeros((ny, nx), np.float64)
        for plane in volume.voxels[z * fz : (z + 1) * fz, : ny * fy, : nx * fx]:
            # Along x first, in one pass over the plane's rows.
            total += plane.reshape(ny, fy, nx, fx).sum(axis=3, dtype=np.float64).sum(axis=1)
        mean = total / (fx * fy * fz)
        voxels[z] = np.rint(mean) if keeps_type else mean
    voxels.flags.writeable = False
    to_voxels = np.diag((fx, fy, fz, 1.0))
    to_voxels[:3, 3] = 0.5 * (np.array((fx, fy, fz)) - 1.0)  # the middle of the first block
    return replace(volume, voxels=voxels, affine=volume.affine @ to_voxels)
