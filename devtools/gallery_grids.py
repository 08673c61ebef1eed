"""Finer and smoother slices of a head with thick ones, for the figure and the picture of shadows."""

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
