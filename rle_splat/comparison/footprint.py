"""Footprint tables (Westover): the integral of a voxel's kernel along each ray near the voxel.

In parallel projection the footprints of all voxels differ only by their offset within a pixel.  So the footprint is
integrated once for a view, for a table of offsets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel
from ..view.eye import IndexView
from .medium import pixel_frame

# Offsets within a pixel, along each side: enough to misplace no footprint by more than 1/160 of its reach, up to
# MOST_SUBPIXELS.
PLACES_PER_REACH = 80.0
MOST_SUBPIXELS = 32
_GAUSS = (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0))  # exact for products of three linear functions


@dataclass(frozen=True, eq=False)
class FootprintTable:
    """A footprint table.

    Attributes
    ----------
    weights : (subpixels * subpixels * height * width,) float32
        The world length of a ray through a pixel, weighted by the kernel of a voxel.  The first two axes are the offset
        of the footprint's begin between pixel centers, row before column.
    shape : (3,) int64
        Subpixels, height, width.
    reach : (2,) float64
        Half width and half height, in pixels.
    """

    weights: np.ndarray
    shape: np.ndarray
    reach: np.ndarray


def footprint(view: IndexView, scale: float = 1.0) -> FootprintTable:
    """Make the footprint of a trilinear kernel of half width ``scale`` voxels, for a view with parallel rays."""
    frame, _ = pixel_frame(view)
    reach = scale * np.abs(frame[:2]).sum(axis=1)
    width, height = (math.floor(2.0 * r) + 1 for r in reach)
    subpixels = int(np.clip(np.ceil(PLACES_PER_REACH / reach.max()), 1, MOST_SUBPIXELS))
    between = (np.arange(subpixels) + 0.5) / subpixels
    u = np.arange(width) + between[:, None] - reach[0]
    v = np.arange(height) + between[:, None] - reach[1]
    offsets = np.zeros((subpixels, subpixels, height, width, 3))
    offsets[..., 0] = u[None, :, None, :]
    offsets[..., 1] = v[:, None, :, None]
    inverse = np.linalg.inv(frame) / scale
    along = inverse[:, 2]
    length = scale * np.linalg.norm(view.to_world @ along)
    weights = length * tent_line_integral(offsets.reshape(-1, 3) @ inverse.T, along)
    shape = np.array((subpixels, height, width), np.int64)
    return FootprintTable(weights.astype(np.float32), shape, reach)


def tent_line_integral(points: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(N,) float64: the exact integral over t of tent(x) tent(y) tent(z) at points (N, 3) + t * along (3,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        kinks = (np.array((-1.0, 0.0, 1.0)) - points[:, :, None]) / along[:, None]
    runs = along != 0.0
    beside = (~runs & (np.abs(points) >= 1.0)).any(axis=1)
    ends = np.sort(kinks[:, runs][:, :, [0, 2]], axis=2)
    first, last = ends[..., 0].max(axis=1), ends[..., 1].min(axis=1)
    last = np.where(beside, first, np.maximum(first, last))
    cuts = np.sort(np.clip(kinks[:, runs].reshape(len(points), -1), first[:, None], last[:, None]), axis=1)
    total = np.zeros(len(points))
    for begin, end in zip(cuts[:, :-1].T, cuts[:, 1:].T):
        for node in _GAUSS:
            at = points + (begin + node * (end - begin))[:, None] * along
            total += 0.5 * (end - begin) * np.maximum(1.0 - np.abs(at), 0.0).prod(axis=1)
    return total


@kernel(inline="always")
def first_pixel(position, reach, subpixels):
    """The first pixel of a footprint around ``position`` (one coordinate, in pixels), and the index of its offset, of
    ``subpixels``."""
    edge = position - 0.5 - reach
    first = math.ceil(edge)
    return int(first), min(int((first - edge) * subpixels), subpixels - 1)


@kernel(inline="always")
def composite_sample(image, row, column, length, red, green, blue, sigma):
    """Composite one sample behind a pixel of ``image`` (H, W, 4), color and transmittance.

    ``length``: world length.  ``red``, ``green``, ``blue``, ``sigma``: a voxel's record.
    C += T (1 - exp(-tau)) Q / tau;  T *= exp(-tau).
    """
    transmittance = image[row, column, 3]
    tau = sigma * length
    weight = -transmittance * math.expm1(-tau) / sigma
    image[row, column, 0] += weight * red
    image[row, column, 1] += weight * green
    image[row, column, 2] += weight * blue
    image[row, column, 3] = transmittance * math.exp(-tau)
