"""Footprint tables: how much of a voxel's kernel each ray through its neighbourhood meets (Westover's footprints).

Under parallel projection every voxel has the same footprint but for its place within a pixel, so it is integrated
once for a view and looked up ever after.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..runtime.jit import kernel
from ..view.eye import IndexView
from .pixel_rays import pixel_frame

# Places within a pixel that the table tells apart, along each side: so many that a footprint is never misplaced by
# more than 1/160 of its reach, as far as MOST_SUBPIXELS allow; large footprints need few.
PLACES_PER_REACH = 80.0
MOST_SUBPIXELS = 32
_GAUSS = (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0))  # exact for the cubics that three tents make


@dataclass(frozen=True, eq=False)
class Footprint:
    """``weights``: flat float32 (subpixels, subpixels, height, width): the world length of a ray through a pixel,
    weighted by the kernel of a voxel; the first two tell where between pixel centres the footprint begins, row
    before column.  ``shape``: (3,) int64, subpixels, height, width.  ``reach``: (2,) float64 half width and half
    height, pixels."""

    weights: np.ndarray
    shape: np.ndarray
    reach: np.ndarray


def footprint(view: IndexView, scale: float = 1.0) -> Footprint:
    """The footprint of a trilinear kernel ``scale`` voxels wide on either side, for a view with parallel rays."""
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
    return Footprint(weights.astype(np.float32), shape, reach)


def tent_line_integral(points: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(N,) float64: integral over t of tent(x) tent(y) tent(z) along points (N, 3) + t * along (3,); exact."""
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
    """First pixel of a footprint about ``position`` (pixels, one coordinate), and which of the ``subpixels`` places
    its centre lies at."""
    edge = position - 0.5 - reach
    first = math.ceil(edge)
    return int(first), min(int((first - edge) * subpixels), subpixels - 1)


@kernel(inline="always")
def composite_sample(image, row, column, length, red, green, blue, sigma):
    """One sample over what is behind nothing yet: front to back, ``image`` (H, W, 4) colour and transmittance.

    ``length``: world length; the rest a voxel's record.  C += T (1 - exp(-tau)) Q / tau;  T *= exp(-tau).
    """
    clear = image[row, column, 3]
    tau = sigma * length
    weight = -clear * math.expm1(-tau) / sigma
    image[row, column, 0] += weight * red
    image[row, column, 1] += weight * green
    image[row, column, 2] += weight * blue
    image[row, column, 3] = clear * math.exp(-tau)
