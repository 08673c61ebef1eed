"""The error estimate of each pixel of a picture, from the differences of the pilots there.

The model of errors (``model``) relates a plan's largest error to the largest difference of the pilots.  The same
relation is taken to hold at each pixel.  A pixel's difference is the largest in its neighborhood, because two pictures
that differ can still be equal at single pixels.  Pixels whose estimate exceeds what is allowed can be traced by single
rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...pipeline.plan_model import Model
from ...scene import Quality, Rendering
from .features import difference_of

AROUND = 2  # pixels to each side: the neighborhood of which the largest difference counts
STEPS = 6  # bins for each doubling of a difference
FAINTEST = 2.0**-8  # levels: smaller differences count as this
GROUP = 32  # neighbors that are drawn together


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Differences of the pilots at each pixel.

    Attributes
    ----------
    depth, sheet : (H, W) float32
        Levels: the largest difference around each pixel between the pilots of two depth rules, and of two sheet
        densities.
    bins : (b, 3) float64
        The same as a histogram: ``depth``, ``sheet`` (upper edges) and the number of pixels that have them.
    """

    depth: np.ndarray
    sheet: np.ndarray
    bins: np.ndarray

    @classmethod
    def of(cls, drawn: dict[str, Rendering]) -> ErrorEstimate:
        """Make one from the renderings of the pilots, by name."""
        depth, sheet = (
            np.maximum(_largest_around(difference_of(drawn["coarse"], drawn[name])), FAINTEST).astype(np.float32)
            for name in ("deep", "dense")
        )
        steps = np.stack([np.ceil(STEPS * np.log2(values)).astype(np.int64).ravel() for values in (depth, sheet)])
        low, high = steps.min(axis=1, keepdims=True), steps.max(axis=1, keepdims=True)
        shape = tuple((high - low).ravel() + 1)
        counts = np.bincount(np.ravel_multi_index(tuple(steps - low), shape), minlength=shape[0] * shape[1])
        seen = np.flatnonzero(counts)
        levels = 2.0 ** ((np.stack(np.unravel_index(seen, shape)) + low) / STEPS)
        return cls(depth, sheet, np.column_stack((*levels, counts[seen])))

    def levels(self, model: Model, plan: Quality, correction: float = 1.0) -> np.ndarray:
        """(H, W) levels: the largest error expected of the plan's sheets and warp at each pixel, without bounds."""
        depth, warp = model.constants(plan)
        return correction * np.hypot(depth * self.depth, warp * self.sheet)

    def largest(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows of the ``count`` pixels of the largest differences."""
        return largest_of(np.hypot(self.depth, self.sheet), count)

    def anywhere(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows of about ``count`` pixels, drawn at random from those where the pilots differ.

        They come in groups of neighbors along rows: rays that pass the same voxels find them in the processor's cache,
        as most of those do that a plan has traced, and lone ones took twice as long.
        """
        rows, columns = np.nonzero((self.depth > FAINTEST) | (self.sheet > FAINTEST))
        groups = np.random.default_rng(0).permutation(-(-len(rows) // GROUP))[: -(-count // GROUP)]
        chosen = (GROUP * np.sort(groups)[:, None] + np.arange(GROUP)).ravel()
        chosen = chosen[chosen < len(rows)]
        return columns[chosen], rows[chosen]


def largest_of(values: np.ndarray, count: int, excluded=None) -> tuple[np.ndarray, np.ndarray]:
    """Find the pixels of the largest values.

    Parameters
    ----------
    values : (H, W) float
    count : int
        The largest number of pixels.
    excluded : (H, W) bool, optional
        Pixels to leave out.

    Returns
    -------
    columns, rows : (n,) int64
        In the order of the picture.
    """
    values = values if excluded is None else np.where(excluded, -np.inf, values)
    count = min(count, values.size if excluded is None else int(np.count_nonzero(~excluded)))
    chosen = np.sort(np.argpartition(values, -max(count, 1), axis=None)[values.size - count :])
    rows, columns = np.unravel_index(chosen, values.shape)
    return columns, rows


def _largest_around(values: np.ndarray) -> np.ndarray:
    """(H, W): the largest of the values at most AROUND pixels away along both axes; values are not negative."""
    for axis in (0, 1):
        widths = [(0, 0), (0, 0)]
        widths[axis] = (AROUND, AROUND)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, widths), 2 * AROUND + 1, axis=axis)
        values = windows.max(axis=-1)
    return values
