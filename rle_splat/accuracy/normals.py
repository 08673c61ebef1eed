"""Unit normals at voxels for the references, by brute force (algorithm.md 1.13)."""

from itertools import product

import numpy as np

SOBEL = {-1: 0.25, 0: 0.5, 1: 0.25}  # offset across the derivative -> weight, of whole numbers
CENTRAL = {0: 1.0}  # the same of floating-point numbers
WHOLE_FLOOR = 0.25  # stored values per voxel: what rounding alone may give
FLOAT_FLOOR = 8.0  # machine epsilons of the largest neighbor per voxel


@np.errstate(invalid="ignore")  # a voxel that is not finite has no normal
def normals_at(volume, indices, index_to_world) -> np.ndarray:
    """Normals of some voxels in world space.

    Parameters
    ----------
    volume : Volume
    indices : tuple of three (n,) ndarrays of int64
        z, y, x.
    index_to_world : (4, 4) ndarray
        Voxel index (x, y, z) to world.

    Returns
    -------
    (n, 3) ndarray of float64
        Unit vectors along the gradient of the scalar; (0, 0, 0) where the gradient is below the noise floor.
    """
    voxels = volume.voxels
    is_whole = voxels.dtype.kind in "iu"
    own, last = voxels[indices].astype(np.float64), np.array(voxels.shape) - 1

    def moved(offset):
        """Indices of a neighbor, kept inside the volume."""
        return tuple(np.clip(index + step, 0, most) for index, step, most in zip(indices, offset, last))

    def value(offset):
        """A neighbor's value; the voxel's own where that is not finite."""
        found = voxels[moved(offset)].astype(np.float64)
        return np.where(np.isfinite(found), found, own)

    gradient, largest = np.zeros((len(own), 3)), np.zeros(len(own))
    weights = SOBEL if is_whole else CENTRAL
    for axis in range(3):
        ahead = np.eye(3, dtype=np.int64)[axis]
        for aside in product(*((0,) if other == axis else weights for other in range(3))):
            weight = np.prod([weights[step] for other, step in enumerate(aside) if other != axis])
            after, before = value(aside + ahead), value(aside - ahead)
            gradient[:, 2 - axis] += weight * (after - before)
            largest = np.maximum(largest, np.maximum(np.abs(after), np.abs(before)))
        gradient[:, 2 - axis] /= np.maximum(moved(ahead)[axis] - moved(-ahead)[axis], 1)
    floor = WHOLE_FLOOR if is_whole else FLOAT_FLOOR * float(np.finfo(voxels.dtype).eps) * largest
    # A gradient is a covector.  Only its direction counts, so the scales of matrix and values are taken out first.
    linear = index_to_world[:3, :3] / np.abs(index_to_world[:3, :3]).max()
    steepest = np.abs(gradient).max(axis=1, keepdims=True)
    direction = np.divide(gradient, steepest, out=np.zeros_like(gradient), where=steepest > 0.0)
    world = np.sign(volume.slope) * np.einsum("ni,ij->nj", direction, np.linalg.inv(linear))
    length = np.linalg.norm(world, axis=1, keepdims=True)
    is_steep = (np.linalg.norm(direction, axis=1) * steepest[:, 0] > floor)[:, None]
    return np.divide(world, length, out=np.zeros_like(world), where=is_steep & (length > 0.0))
