"""Finer and smoother grids of scans for the gallery, by numpy alone (runs in an environment with numpy)."""

from __future__ import annotations

import numpy as np

# A cubic B-spline at its own points, and half-way between two of them.
AT, BETWEEN = (1 / 6, 4 / 6, 1 / 6), (1 / 48, 23 / 48, 23 / 48, 1 / 48)


def doubled(voxels: np.ndarray, axis: int) -> np.ndarray:
    """Twice the slices along an axis, less one, float32: a cubic B-spline through a scan's slices, which smooths.

    The steps of slices that are thicker than the pixels are wide would show as rings where a surface is nearly parallel
    to them.
    """
    field = np.moveaxis(np.asarray(voxels, np.float32), axis, 0)
    padded = np.pad(field, [(1, 1), (0, 0), (0, 0)], mode="edge")
    fine = np.empty((2 * len(field) - 1, *field.shape[1:]), np.float32)
    fine[::2] = _weighted(padded, AT, len(field))
    fine[1::2] = _weighted(padded, BETWEEN, len(field) - 1)
    return np.moveaxis(fine, 0, axis)


def _weighted(padded: np.ndarray, weights, count: int) -> np.ndarray:
    return sum(np.float32(weight) * padded[k : k + count] for k, weight in enumerate(weights))


def smoothed(voxels: np.ndarray, times: int = 1, axes=(0, 1, 2)) -> np.ndarray:
    """Float32 values averaged with the weights 1 2 1 along each axis, so many times."""
    field = np.asarray(voxels, np.float32)
    for _ in range(times):
        for axis in axes:
            moved = np.moveaxis(field, axis, 0)
            padded = np.pad(moved, [(1, 1), (0, 0), (0, 0)], mode="edge")
            field = np.moveaxis(_weighted(padded, (0.25, 0.5, 0.25), len(moved)), 0, axis)
    return field


def share(mask: np.ndarray, reach: int) -> np.ndarray:
    """What share of the voxels up to ``reach`` away along each axis is in a mask, float32."""
    found = mask.astype(np.float32)
    for axis in range(3):
        padded = np.pad(found, [(reach + 1, reach) if a == axis else (0, 0) for a in range(3)], mode="edge")
        total = np.cumsum(padded, axis, dtype=np.float32)
        high = np.take(total, range(2 * reach + 1, total.shape[axis]), axis)
        low = np.take(total, range(total.shape[axis] - 2 * reach - 1), axis)
        found = (high - low) / (2 * reach + 1)
    return found


def connected(mask: np.ndarray, seeds: np.ndarray, most: int = 400) -> np.ndarray:
    """What of a mask is connected to the seeds by faces, found by spreading in sweeps along the axes."""
    found = mask & seeds
    for _ in range(most):
        before = np.count_nonzero(found)
        for axis in range(3):
            for backward in (False, True):
                found = _spread(found, mask, axis, backward)
        if np.count_nonzero(found) == before:
            break
    return found


def _spread(found: np.ndarray, mask: np.ndarray, axis: int, backward: bool) -> np.ndarray:
    """Fill each run of a mask along an axis from its first found voxel on."""
    grid = np.moveaxis(mask, axis, 0)
    reached = np.moveaxis(found.copy(), axis, 0)
    order = range(len(grid) - 2, -1, -1) if backward else range(1, len(grid))
    for k in order:
        reached[k] |= reached[k + 1 if backward else k - 1] & grid[k]
    return np.moveaxis(reached, 0, axis)
