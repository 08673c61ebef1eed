"""A volume of fewer, larger voxels, for small pictures and for volumes that are too large."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from ..runtime.memory import refuse_beyond
from .volume import Volume


def factors_of(volume: Volume, side: int) -> tuple[int, int, int]:
    """How many voxels are averaged along x, y and z for a volume of about so many voxels along its longest side.

    Parameters
    ----------
    volume : Volume
    side : int
        Voxels along the longest side; they are about as wide as high.
    """
    lengths = np.array(volume.shape_xyz) * volume.spacing
    wanted = float(lengths.max()) / side
    found = np.maximum(1, np.rint(wanted / np.where(volume.spacing > 0.0, volume.spacing, wanted)))
    return tuple(int(min(factor, count)) for factor, count in zip(found, volume.shape_xyz))


def reduced_steps(volume: Volume, factors: tuple[int, int, int]):
    """Generator of fractions done: average blocks of voxels.

    Parameters
    ----------
    volume : Volume
        Blocks that reach beyond its far faces are filled up with the voxels there.
    factors : (fx, fy, fz)
        Voxels along each side of a block.

    Returns
    -------
    Volume
        In the same place, read-only. Stored values have the volume's own type; means of whole numbers are rounded.

    Raises
    ------
    RleSplatError
        If the volume of larger voxels itself needs more memory than is free.
    """
    (fx, fy, fz), fine = factors, volume.voxels
    nx, ny, nz = (-(-count // factor) for count, factor in zip(volume.shape_xyz, factors))
    refuse_beyond(nx * ny * nz * fine.dtype.itemsize, "The volume in larger voxels needs", "free some memory")
    beyond = (0, ny * fy - fine.shape[1]), (0, nx * fx - fine.shape[2])
    voxels = np.empty((nz, ny, nx), fine.dtype)
    for z in range(nz):
        yield z / nz
        mean = fine[np.minimum(np.arange(z * fz, (z + 1) * fz), len(fine) - 1)].mean(axis=0, dtype=np.float64)
        if any(map(any, beyond)):
            mean = np.pad(mean, beyond, mode="edge")
        # Along x first, in one pass over the plane's rows.
        mean = mean.reshape(ny, fy, nx, fx).mean(axis=3, dtype=np.float64).mean(axis=1)
        voxels[z] = np.rint(mean) if fine.dtype.kind in "iu" else mean
    voxels.flags.writeable = False
    to_voxels = np.diag((fx, fy, fz, 1.0))
    to_voxels[:3, 3] = 0.5 * (np.array(factors) - 1.0)  # the middle of the first block
    found = replace(volume, voxels=voxels, affine=volume.affine @ to_voxels)
    # Its own voxels need not be read for a hash of them.
    content = f"{volume.voxel_key} in blocks of {factors}"
    vars(found)["voxel_key"] = hashlib.blake2b(content.encode(), digest_size=16).hexdigest()
    return found
