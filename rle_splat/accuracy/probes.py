"""Probe pixels: where an image is compared with the truth, and what such a sample allows to be said."""

from __future__ import annotations

import numpy as np

# -ln(0.05): with no failure in n independent probes, at 95 % confidence at most this many in n fail.
RULE_OF_THREE = 3.0


def stratified_pixels(width: int, height: int, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows (ints) of about ``count`` distinct pixels, one drawn at random from each cell of a grid.

    Never more than ``count``, and every pixel of the image can be drawn.
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
    """Columns and rows of the ``count`` pixels with the largest local difference in a picture (H, W, C)."""
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


def statement(errors, tolerance: float) -> str:
    """What random probes allow to be said about all pixels; ``errors`` one per probe, in the tolerance's unit."""
    errors = np.asarray(errors, dtype=np.float64)
    count, failed = len(errors), int((errors > tolerance).sum())
    if failed:
        return f"{failed} of {count} random probes differ by more than {tolerance:g}."
    share = min(1.0, RULE_OF_THREE / count)
    return (
        f"None of {count} random probes differs by more than {tolerance:g}: "
        f"at 95 % confidence at most {share:.2%} of the pixels do."
    )
