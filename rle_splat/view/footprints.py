"""Footprints: separable kernels that spread a voxel over a sheet and over the neighboring sheets.

A footprint is the same function along all three voxel axes, so it is a product of one-dimensional weights that depend
on (row, slice) and (column, slice) only (algorithm.md 1.5). The weights of all kernels but the Gaussian sum to
one. Gaussian weights are divided by their sum over all voxels, transparent ones included: dividing by the sum over
visited voxels would brighten every boundary.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel
from ..scene import FOOTPRINTS as NAMES

NEAREST, TENT, BSPLINE2, BSPLINE3, GAUSSIAN = range(5)
# Wide enough that the ripple from truncated tails stays below half a level (algorithm.md 1.5).
GAUSSIAN_SIGMA = 0.7
GAUSSIAN_RADIUS = 3.0


@dataclass(frozen=True)
class VoxelKernel:
    """A reconstruction kernel.

    Attributes
    ----------
    kind : int
        Number in kernels.
    radius : float
        Half the support, voxels.
    about : str
        Description for display.
    """

    kind: int
    radius: float
    about: str


FOOTPRINTS = {
    "nearest": VoxelKernel(NEAREST, 0.5, "box of one voxel: for label maps and for inspecting voxels"),
    "tent": VoxelKernel(TENT, 1.0, "trilinear, second order: the default"),
    "bspline2": VoxelKernel(BSPLINE2, 1.5, "quadratic B-spline: smooth, blurs a little"),
    "bspline3": VoxelKernel(BSPLINE3, 2.0, "cubic B-spline: smoothest, blurs most"),
    "gaussian": VoxelKernel(GAUSSIAN, GAUSSIAN_RADIUS, "normalized Gaussian of Westover's splatting, sigma 0.7 voxel"),
}
assert tuple(FOOTPRINTS) == NAMES, "scene/quality.py lists other footprints"


@kernel(exact=True)
def voxel_at(pixel, shift, scale):
    """Voxel coordinate of a sheet pixel, where pixel = ``scale`` * voxel + ``shift``.

    Rounded as numpy does, because footprints with an edge, and voxels that are not kept, depend on the side.
    """
    return (pixel - shift) / scale


@kernel(exact=True)
def footprint_weight(kind, t):
    """The kernel at ``t`` voxels from its center, float64. The box includes its left end only."""
    d = abs(t)
    if kind == TENT:
        return max(1.0 - d, 0.0)
    if kind == BSPLINE3:
        if d < 1.0:
            return 2.0 / 3.0 + d * d * (0.5 * d - 1.0)
        return max(2.0 - d, 0.0) ** 3 / 6.0
    if kind == BSPLINE2:
        if d < 0.5:
            return 0.75 - d * d
        return 0.5 * max(1.5 - d, 0.0) ** 2
    if kind == GAUSSIAN:
        return math.exp(-0.5 * (d / GAUSSIAN_SIGMA) ** 2) if d < GAUSSIAN_RADIUS else 0.0
    return 1.0 if -0.5 <= t < 0.5 else 0.0


@kernel
def tap_count(radius):
    """Largest number of voxels whose footprints of ``radius`` reach one point."""
    return max(math.ceil(2.0 * radius), 1)


@kernel(exact=True)
def first_tap(kind, x, radius):
    """First voxel whose footprint of ``radius`` reaches ``x``; a box's right end belongs to the next voxel."""
    if kind == NEAREST:
        return math.floor(x - radius) + 1
    return math.ceil(x - radius)


@kernel(exact=True)
def tap_weight(kind, x, voxel, stretch):
    """Weight of ``voxel`` at ``x`` for a footprint widened by ``stretch``, before normalization, float64."""
    return footprint_weight(kind, (x - voxel) / stretch)


def footprint_values(kind: int, t: np.ndarray) -> np.ndarray:
    """Reference implementation of ``footprint_weight``: the kernel at ``t`` voxels from its center, float64."""
    d = np.abs(t)
    if kind == TENT:
        return np.maximum(1.0 - d, 0.0)
    if kind == BSPLINE3:
        return np.where(d < 1.0, 2.0 / 3.0 + d * d * (0.5 * d - 1.0), np.maximum(2.0 - d, 0.0) ** 3 / 6.0)
    if kind == BSPLINE2:
        return np.where(d < 0.5, 0.75 - d * d, 0.5 * np.maximum(1.5 - d, 0.0) ** 2)
    if kind == GAUSSIAN:
        return np.where(d < GAUSSIAN_RADIUS, np.exp(-0.5 * (d / GAUSSIAN_SIGMA) ** 2), 0.0)
    return np.where((t >= -0.5) & (t < 0.5), 1.0, 0.0)


def footprint_weights(footprint: VoxelKernel, positions: np.ndarray, stretch: float = 1.0):
    """Weights of the voxels around positions.

    Parameters
    ----------
    positions : (n,) array_like
        Voxels.
    stretch : float
        Factor by which the footprint is widened, for minification.

    Returns
    -------
    first : (n,) ndarray of int64
        First voxel.
    weights : (n, taps) ndarray of float32
        Each row sums to one.
    """
    radius = footprint.radius * stretch
    taps = max(math.ceil(2.0 * radius), 1)
    positions = np.asarray(positions, dtype=np.float64)
    if footprint.kind == NEAREST:
        first = np.floor(positions - radius).astype(np.int64) + 1
    else:
        first = np.ceil(positions - radius).astype(np.int64)
    values = footprint_values(footprint.kind, (positions[:, None] - (first[:, None] + np.arange(taps))) / stretch)
    total = values.sum(axis=1, keepdims=True)
    return first, (values / np.where(total > 0.0, total, 1.0)).astype(np.float32)
