"""Probe pixels: the pixels of a picture that are compared with the truth, and what their errors say of all pixels."""

from dataclasses import dataclass
from math import lgamma

import numpy as np

from .metrics import LEVEL

PROBES = 1000  # by default
TRUTH_TOLERANCE = 1e-7  # of the truth at probes: far below a level, 1/255
LIT_TOLERANCE = 1e-4  # the same with light at every point, which takes long: a fortieth of a level
# -ln(0.05): where none of n independent probes fails, at 95% confidence at most this many in n pixels do.
RULE_OF_THREE = 3.0
STEEP_SHARE = 0.25  # of the probes are the steepest pixels


def draw_pixels(width: int, height: int, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Draw about ``count`` distinct pixels, at most ``count``: one at random from each cell of a grid.

    Parameters
    ----------
    width, height : int
        Of the picture; each of its pixels can be drawn.

    Returns
    -------
    columns, rows : (n,) int64
    """
    count = min(max(int(count), 1), width * height)
    across = int(np.clip(round(np.sqrt(count * width / height)), 1, min(width, count)))
    down = int(np.clip(count // across, 1, height))
    random = np.random.default_rng(seed)
    left, top = np.arange(across + 1) * width // across, np.arange(down + 1) * height // down
    columns = random.integers(left[:-1], left[1:], (down, across))
    rows = random.integers(top[:-1, None], top[1:, None], (down, across))
    return columns.ravel(), rows.ravel()


def steep_pixels(rgba, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of the ``count`` pixels that differ most from a neighbor, in a picture (H, W, C)."""
    rgba = np.asarray(rgba, dtype=np.float64)
    steepness = np.zeros(rgba.shape[:2])
    for axis in (0, 1):
        jump = np.abs(np.diff(rgba, axis=axis)).max(axis=-1)
        before = (slice(None),) * axis + (slice(None, -1),)
        after = (slice(None),) * axis + (slice(1, None),)
        steepness[before] = np.maximum(steepness[before], jump)
        steepness[after] = np.maximum(steepness[after], jump)
    chosen = np.argsort(-steepness, axis=None, kind="stable")[: min(int(count), steepness.size)]
    rows, columns = np.unravel_index(chosen, steepness.shape)
    return columns, rows


@dataclass(frozen=True, eq=False)
class Probes:
    """Pixels to compare with the truth.

    Attributes
    ----------
    columns, rows : (N,) int64
    random : int
        So many, the first ones, are drawn at random and speak for all pixels.  The others are the steepest pixels.
    """

    columns: np.ndarray
    rows: np.ndarray
    random: int

    @property
    def centers(self) -> tuple[np.ndarray, np.ndarray]:
        """(columns, rows) of the pixel centers, as ``truths.truth`` takes them."""
        return self.columns + 0.5, self.rows + 0.5

    def of(self, rgba) -> np.ndarray:
        """(N, C) values of a picture (H, W, C) at the probes."""
        return np.asarray(rgba)[self.rows, self.columns]


def choose_probes(rgba, count: int, seed: int = 0) -> Probes:
    """Choose about ``count`` probes for a picture (H, W, C): three quarters random ones, a quarter steepest ones."""
    height, width = np.shape(rgba)[:2]
    steep = steep_pixels(rgba, round(STEEP_SHARE * count))
    drawn = draw_pixels(width, height, count - len(steep[0]), seed)
    return Probes(*(np.concatenate(both) for both in zip(drawn, steep)), random=len(drawn[0]))


def truth_tolerance(shading: dict) -> float:
    """The tolerance of the truth at probes, for the shading arguments of ``truths.truth``."""
    return LIT_TOLERANCE if "light" in shading else TRUTH_TOLERANCE


def probe_errors(values, true) -> np.ndarray:
    """(N,) levels: the largest absolute difference of any channel at each probe, of (N, C) values."""
    return np.abs(np.asarray(values, np.float64) - np.asarray(true, np.float64)).max(axis=-1) / LEVEL


def error_summary(errors, random: int, tolerance: float) -> dict:
    """Summarize the errors at probes.

    Parameters
    ----------
    errors : (N,) float
        Levels.
    random : int
        So many of them, the first ones, are those of random probes, the others of steep ones.
    tolerance : float
        Levels; a probe that errs more has failed.

    Returns
    -------
    dict
        JSON-ready.  ``random`` and ``steep``: the count, failed, largest and rmse of each kind.  ``largest``: of all.
        ``kept``: whether no probe failed.  ``share``: the largest fraction of all pixels that exceeds the tolerance,
        at a ``confidence`` of 95 %.  ``sentence``: the same for people.
    """
    errors = np.asarray(errors, dtype=np.float64)
    kinds = {"random": errors[:random], "steep": errors[random:]}
    found = {name: _summary(kind, tolerance) for name, kind in kinds.items()}
    failed = found["random"]["failed"]
    return {
        "tolerance": float(tolerance), **found,
        "largest": float(errors.max(initial=0.0)), "kept": not (errors > tolerance).any(),
        "share": share_above(failed, random), "confidence": 0.95,
        "sentence": statement(failed, random, tolerance),
    }  # fmt: skip


def _summary(errors: np.ndarray, tolerance: float) -> dict:
    return {
        "count": len(errors), "failed": int((errors > tolerance).sum()),
        "largest": float(errors.max(initial=0.0)), "rmse": float(np.sqrt((errors**2).mean())) if len(errors) else 0.0,
    }  # fmt: skip


def share_above(failed: int, count: int) -> float:
    """The largest fraction of pixels that exceeds a tolerance, at 95% confidence.

    The rule of three where no probe failed, else the share at which the binomial sum falls to 5 %.  Both hold for
    probes drawn from the cells of a grid too: for a given mean over the cells, the probability that all probes pass is
    largest when all cells are alike.

    Parameters
    ----------
    failed, count : int
        ``failed`` of ``count`` random probes exceed it.
    """
    if count == 0 or failed >= count:
        return 1.0
    if failed == 0:
        return min(1.0, RULE_OF_THREE / count)
    k = np.arange(failed + 1)
    ways = np.array([lgamma(count + 1) - lgamma(n + 1) - lgamma(count - n + 1) for n in k])
    low, high = failed / count, 1.0
    for _ in range(60):
        share = 0.5 * (low + high)
        likely = np.exp(ways + k * np.log(share) + (count - k) * np.log1p(-share)).sum() > 0.05
        low, high = (share, high) if likely else (low, share)
    return high


def statement(failed: int, count: int, tolerance: float) -> str:
    """A sentence about all pixels, from ``failed`` of ``count`` random probes; ``tolerance`` in 8-bit steps."""
    how_many = f"{failed} of {count}" if failed else f"None of {count}"
    return (
        f"{how_many} random sample pixels {'differ' if failed > 1 else 'differs'} from the reference by more than "
        f"{tolerance:g} in 8-bit steps: at 95% confidence at most "
        f"{share_above(failed, count):.2%} of the pixels do."
    )
