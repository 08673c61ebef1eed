"""Small fields on which errors are measured (algorithm.md, appendix): opacities per unit distance, (nz, ny, nx)
float32."""

from __future__ import annotations

import numpy as np


def radius_from_center(size: int) -> np.ndarray:
    """(size, size, size) float64 distance of each voxel from the middle of the grid, in voxels."""
    z, y, x = np.ogrid[:size, :size, :size]
    middle = 0.5 * (size - 1)
    return np.sqrt((x - middle) ** 2.0 + (y - middle) ** 2 + (z - middle) ** 2)


def _opacity(extinction) -> np.ndarray:
    return (-np.expm1(-extinction)).astype(np.float32)


def smooth_shell(size: int = 48) -> np.ndarray:
    """A Gaussian shell three voxels wide round an off-center blob: dense enough for rays to be terminated."""
    r = radius_from_center(size)
    z, y, x = np.ogrid[:size, :size, :size]
    from_blob = (x - 0.6 * size) ** 2.0 + (y - 0.45 * size) ** 2 + (z - 0.5 * size) ** 2
    extinction = 0.5 * np.exp(-0.5 * ((r - 0.3 * size) / 3.0) ** 2)
    extinction = extinction + 0.6 * np.exp(-0.5 * from_blob / (0.08 * size) ** 2)
    return _opacity(np.where(extinction > 1e-4, extinction, 0.0))


def thin_shell(size: int = 48) -> np.ndarray:
    """A Gaussian shell one voxel wide."""
    extinction = 0.7 * np.exp(-0.5 * (radius_from_center(size) - 0.33 * size) ** 2)
    return _opacity(np.where(extinction > 1e-4, extinction, 0.0))


def binary_shell(size: int = 48) -> np.ndarray:
    """A shell three voxels thick that is either there (extinction 0.7) or not: the hardest edges there are."""
    r = radius_from_center(size)
    return _opacity(np.where(np.abs(r - 0.33 * size) <= 1.5, 0.7, 0.0))


def blobs(shape_xyz, seed: int, count: int = 6, width=(2.0, 4.0)) -> np.ndarray:
    """Gaussian blobs at random places in the middle of the grid, ``width`` voxels wide, cut to zero far out: smooth,
    lopsided, and without symmetry that could hide a mirrored axis.  (nz, ny, nx) float32 opacities."""
    random = np.random.default_rng(seed)
    z, y, x = np.ogrid[: shape_xyz[2], : shape_xyz[1], : shape_xyz[0]]
    extinction = np.zeros(tuple(shape_xyz)[::-1])
    for _ in range(count):
        cx, cy, cz = (0.2 + 0.6 * random.random(3)) * shape_xyz
        s = random.uniform(*width)
        extinction += random.uniform(0.1, 0.5) * np.exp(-0.5 * ((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / s**2)
    return _opacity(np.where(extinction > 1e-3, extinction, 0.0))


def marschner_lobb(points, frequency: float = 6.0, contrast: float = 0.25) -> np.ndarray:
    """G11: Marschner and Lobb's signal, 0 to 1, at (..., 3) points of the cube from -1 to 1; the customary grid is
    40 samples a side, both ends included."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    wave = np.cos(2.0 * np.pi * frequency * np.cos(0.5 * np.pi * np.sqrt(x * x + y * y)))
    return (1.0 - np.sin(0.5 * np.pi * z) + contrast * (1.0 + wave)) / (2.0 * (1.0 + contrast))


FIELDS = {"smooth": smooth_shell, "thin": thin_shell, "binary": binary_shell}
