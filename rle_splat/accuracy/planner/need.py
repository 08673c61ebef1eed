"""Which classification a transfer function needs on a volume, in words (algorithm.md 1.10).

Classifying voxels first and interpolating what they show, the paper's way, is right where the transfer function is a
straight line between neighbouring values.  Where it is not, that blurs and dilates: here is by how much.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ...classify.classification import opacity_distance, optical_depth
from .features import LEVELS

PAIRS = 20_000  # of neighbouring voxels looked at, drawn at random
BETWEEN = (np.arange(8) + 0.5) / 8.0  # places from one voxel to its neighbour
QUANTILE = 0.99  # of the pairs between which anything is seen
TOLERABLE = 2.0  # levels that pre may be off within one voxel, and still do


@dataclass(frozen=True)
class Need:
    """``levels``: how far opacity that was interpolated is from the opacity of the interpolated value, within one voxel
    of optical depth; nearly the largest.  ``classification``: the simplest that shows the transfer function as it is.
    ``sentence``: for people."""

    levels: float
    classification: str
    sentence: str

    def report(self) -> dict:
        return asdict(self)


def need_of(volume, transfer_function, seed: int = 0) -> Need:
    """The classification that the transfer function needs on this volume, from a sample of neighbouring voxels."""
    levels = _misstated(volume, transfer_function, np.random.default_rng(seed))
    if levels <= TOLERABLE:
        return Need(
            levels, "pre",
            f"The transfer function is nearly straight between neighbouring voxels, within {levels:.2g} levels: any "
            "classification shows it as it is.",
        )  # fmt: skip
    return Need(
        levels, "post",
        f"The transfer function bends between neighbouring voxels by up to {levels:.0f} levels of opacity: pre, which "
        "interpolates what was classified, blurs and dilates that much; post shows it as it is.",
    )  # fmt: skip


def _misstated(volume, function, random) -> float:
    shape = np.array(volume.voxels.shape)
    axes = [axis for axis in range(3) if shape[axis] > 1]
    if not axes:
        return 0.0
    axis = random.choice(axes, PAIRS)
    step = axis[:, None] == np.arange(3)
    first = (random.random((PAIRS, 3)) * (shape - step)).astype(np.int64)
    values = [volume.physical(volume.voxels[tuple(place.T)]) for place in (first, first + step)]
    low, high = (np.asarray(found, dtype=np.float64) for found in values)
    known = np.isfinite(low) & np.isfinite(high)
    low, high, axis = low[known], high[known], axis[known]
    scalars = low[:, None] + (high - low)[:, None] * BETWEEN
    lengths = volume.spacing[::-1][axis] / opacity_distance(volume, function, 1.0)
    ends = [optical_depth(np.asarray(function.alpha_at(end), dtype=np.float64)) for end in (low, high)]
    straight = ends[0][:, None] + (ends[1] - ends[0])[:, None] * BETWEEN
    true = optical_depth(np.asarray(function.alpha_at(scalars), dtype=np.float64))
    off = np.abs((true - straight).mean(axis=1)) * lengths
    seen = np.maximum(true.max(axis=1), np.maximum(*ends)) > 0.0
    if not seen.any():
        return 0.0
    return float(np.quantile(-LEVELS * np.expm1(-off[seen]), QUANTILE))
