"""Small fields on which errors are measured (algorithm.md, appendix): opacities per unit distance, (nz, ny, nx)
float32."""

from __future__ import annotations

import numpy as np


def radius_from_centre(size: int) -> np.ndarray:
    """(size, size, size) float64 distance of each voxel from the middle of the grid, in voxels."""
    z, y, x = np.ogrid[:size, :size, :size]
    middle = 0.5 * (size - 1)
    return np.sqrt((x - middle) ** 2.0 + (y - middle) ** 2 + (z - middle) ** 2)


def _opacity(extinction) -> np.ndarray:
    return (-np.expm1(-extinction)).astype(np.float32)


def smooth_shell(size: int = 48) -> np.ndarray:
    """A Gaussian shell three voxels wide round an off-centre blob: dense enough for rays to be terminated."""
    r = radius_from_centre(size)
    z, y, x = np.ogrid[:size, :size, :size]
    from_blob = (x - 0.6 * size) ** 2.0 + (y - 0.45 * size) ** 2 + (z - 0.5 * size) ** 2
    extinction = 0.5 * np.exp(-0.5 * ((r - 0.3 * size) / 3.0) ** 2)
    extinction = extinction + 0.6 * np.exp(-0.5 * from_blob / (0.08 * size) ** 2)
    return _opacity(np.where(extinction > 1e-4, extinction, 0.0))


def thin_shell(size: int = 48) -> np.ndarray:
    """A Gaussian shell one voxel wide."""
    extinction = 0.7 * np.exp(-0.5 * (radius_from_centre(size) - 0.33 * size) ** 2)
    return _opacity(np.where(extinction > 1e-4, extinction, 0.0))


def binary_shell(size: int = 48) -> np.ndarray:
    """A shell three voxels thick that is either there (extinction 0.7) or not: the hardest edges there are."""
    r = radius_from_centre(size)
    return _opacity(np.where(np.abs(r - 0.33 * size) <= 1.5, 0.7, 0.0))


FIELDS = {"smooth": smooth_shell, "thin": thin_shell, "binary": binary_shell}
