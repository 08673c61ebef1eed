"""Which classification a transfer function needs on a volume, in words (algorithm.md 1.10).

Pre-classification, the paper's way, classifies voxels and interpolates the result.  That is exact where the transfer
function is linear between the values of neighboring voxels.  Elsewhere it blurs and dilates; this module measures by
how much.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ...classify.classification import opacity_distance, optical_depth
from ...runtime.figures import figure_text
from .features import LEVELS

PAIRS = 20_000  # of neighboring voxels, drawn at random
BETWEEN = (np.arange(8) + 0.5) / 8.0  # sample positions from one voxel to its neighbor
QUANTILE = 0.99  # of the pairs between which the medium is not transparent
TOLERABLE = 2.0  # levels that pre may be off within one voxel


@dataclass(frozen=True)
class Need:
    """The classification that a transfer function needs.

    Attributes
    ----------
    levels : float
        The difference of interpolated opacity from the opacity of the interpolated value, within one voxel's depth:
        the quantile QUANTILE.
    classification : str
        The simplest one that shows the transfer function without that error.
    sentence : str
        For people.
    """

    levels: float
    classification: str
    sentence: str

    def report(self) -> dict:
        """JSON-ready."""
        return asdict(self)


def need_of(volume, transfer_function) -> Need:
    """Find the classification that a transfer function needs on a volume, from a sample of neighboring voxels."""
    levels = _misstated(volume, transfer_function, np.random.default_rng(0))
    if levels <= TOLERABLE:
        return Need(
            levels, "pre",
            f"The transfer function is nearly linear between neighboring voxels, within {figure_text(levels)} levels: "
            "any classification shows it as it is.",
        )  # fmt: skip
    return Need(
        levels, "post",
        "Between neighboring voxels the transfer function deviates from a straight line by up to "
        f"{levels:.0f} levels of opacity: pre, which interpolates classified voxels, blurs and dilates that much; post "
        "shows it as it is.",
    )  # fmt: skip


def _misstated(volume, function, random) -> float:
    """``Need.levels`` of a transfer function on a volume; ``random``: a Generator."""
    shape = np.array(volume.voxels.shape)
    axes = [axis for axis in range(3) if shape[axis] > 1]
    if not axes:
        return 0.0
    axis = random.choice(axes, PAIRS)
    step = axis[:, None] == np.arange(3)
    first = (random.random((PAIRS, 3)) * (shape - step)).astype(np.int64)
    values = [volume.physical(volume.voxels[tuple(index.T)]) for index in (first, first + step)]
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
