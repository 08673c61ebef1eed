"""Where in a picture the model of errors says what: the pilots' differences pixel by pixel.

What is true of the largest difference is taken to be true of each pixel's own, or of a neighbour's where that is
larger: two pictures that differ may cross at a pixel.  Pixels that a plan's sheets would get wrong beyond what is
allowed can be had by rays of their own (``raycast.scalar_rays``); how dear and how good those are is seen from a few.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...scene import Quality, Rendering
from .features import difference_of
from .model import Model

AROUND = 2  # pixels to every side whose difference counts
STEPS = 6  # of the table of differences for each doubling
FAINTEST = 2.0**-8  # levels: smaller differences are taken to be so large
MOST_SLABS = 64
SLABS = tuple(2**n for n in range(1, 7))  # of a voxel's depth, to choose from
MORE_THAN_SEEN = 2.0  # the rays that were not looked at may err so many times as much as those that were
RAY_ORDER = 2.0  # of their errors in slabs


@dataclass(frozen=True, eq=False)
class Doubt:
    """``depth``, ``sheet``: (H, W) float32 levels, the pilots' differences about each pixel.  ``bins``: (b, 3) float64,
    the same as a table of depth, sheet and how many pixels have them."""

    depth: np.ndarray
    sheet: np.ndarray
    bins: np.ndarray

    @classmethod
    def of(cls, drawn: dict[str, Rendering]) -> Doubt:
        """From the pilots' renderings, by name."""
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

    def modelled(self, model: Model, plan: Quality, correction: float = 1.0) -> np.ndarray:
        """(H, W) levels that the plan's sheets and warp are expected to err at most at each pixel, without bounds."""
        depth, warp = model.constants(plan)
        return correction * np.hypot(depth * self.depth, warp * self.sheet)

    def most_doubtful(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows of the ``count`` pixels of the largest differences."""
        return largest_of(np.hypot(self.depth, self.sheet), count)

    def anywhere(self, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Columns and rows of ``count`` pixels at most, at random among those at which there is any difference."""
        rows, columns = np.nonzero((self.depth > FAINTEST) | (self.sheet > FAINTEST))
        chosen = np.sort(np.random.default_rng(seed).permutation(len(rows))[:count])
        return columns[chosen], rows[chosen]


def largest_of(values: np.ndarray, count: int, beside=None) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of the ``count`` largest of ``values`` (H, W); ``beside``: (H, W) bool, none of these."""
    values = values if beside is None else np.where(beside, -np.inf, values)
    count = min(count, values.size if beside is None else int(np.count_nonzero(~beside)))
    chosen = np.sort(np.argpartition(values, -max(count, 1), axis=None)[values.size - count :])
    rows, columns = np.unravel_index(chosen, values.shape)
    return columns, rows


def _largest_around(values: np.ndarray) -> np.ndarray:
    for axis in (0, 1):
        widths = [(0, 0), (0, 0)]
        widths[axis] = (AROUND, AROUND)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, widths), 2 * AROUND + 1, axis=axis)
        values = windows.max(axis=-1)
    return values


@dataclass(frozen=True)
class RayCost:
    """What single rays err and take, from some that were traced twice.

    ``apart``: levels, the largest difference between ``few`` and twice as many slabs.  ``microseconds``: of a ray
    without slabs, and of each slab.  ``correction``: how many times more than is expected of them they were found to
    err.
    """

    few: int
    apart: float
    microseconds: tuple[float, float]
    correction: float = 1.0

    @classmethod
    def of(cls, few: int, apart: float, spent, rays: int) -> RayCost:
        """``spent``: milliseconds that ``rays`` rays took with ``few`` slabs and with twice as many."""
        first, second = (1e3 * ms / max(rays, 1) for ms in spent)
        each = max(second - first, 0.05 * first) / few
        return cls(few, apart, (max(first - few * each, 0.1 * first), each))

    def found(self, measured: float, slabs: int) -> RayCost:
        """After rays of so many slabs were found to err ``measured`` levels."""
        return replace(self, correction=self.correction * max(measured / max(self.error(slabs), 1e-9), 2.0))

    def error(self, slabs: int) -> float:
        """Levels that no ray of so many slabs is expected to err more than."""
        share = 2.0**RAY_ORDER / (2.0**RAY_ORDER - 1.0)
        return self.correction * MORE_THAN_SEEN * share * self.apart * (self.few / slabs) ** RAY_ORDER

    def milliseconds(self, rays: int, slabs: int) -> float:
        return 1e-3 * rays * (self.microseconds[0] + slabs * self.microseconds[1])

    def slabs_for(self, allowed: float) -> int:
        """The fewest slabs that are expected to err at most so many levels; MOST_SLABS where none are."""
        return next((slabs for slabs in SLABS if self.error(slabs) <= allowed), MOST_SLABS)
