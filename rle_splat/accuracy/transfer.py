"""The truth's own reading of transfer-function points: scalar -> opacity, colour, extinction."""

from __future__ import annotations

import numpy as np

# alpha = 1 means an infinite extinction; it is capped at the optical depth of 24 halvings, 1 - 2^-24 being the
# float32 number next to 1.
TAU_CAP = 24.0 * np.log(2.0)


def piecewise_linear(points, values) -> np.ndarray:
    """Values at piecewise linear points ((x, y...), ...), a repeated x being a right-continuous step.

    ``values``: any shape; the result has that shape, with one more axis when the points carry several y.
    Outside the points the end values hold; at NaN the result is NaN.
    """
    table = np.asarray(sorted(points, key=lambda p: p[0]), dtype=np.float64)
    x, y = table[:, 0], table[:, 1:]
    v = np.asarray(values, dtype=np.float64)
    right = np.searchsorted(x, v, side="right")  # first point strictly above v, so that steps are right-continuous
    low, high = np.clip(right - 1, 0, len(x) - 1), np.clip(right, 0, len(x) - 1)
    gap = x[high] - x[low]
    share = np.where(gap > 0.0, (v - x[low]) / np.where(gap > 0.0, gap, 1.0), 0.0)
    share = np.where(right == 0, 0.0, share)
    result = y[low] + share[..., None] * (y[high] - y[low])
    result[np.isnan(v)] = np.nan
    return result[..., 0] if y.shape[1] == 1 else result


def opacity_unit_distance(transfer_function, volume) -> float:
    """The distance alpha refers to, in the volume's unit: the function's own, else the smallest spacing."""
    own = transfer_function.opacity_unit_distance
    return float(np.sqrt((volume.affine[:3, :3] ** 2).sum(axis=0)).min() if own is None else own)


def extinction_and_color(transfer_function, values, world_distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Physical scalars -> (extinction in 1/world length, unassociated colour (..., 3)); NaN is transparent.

    ``world_distance``: world length of the opacity unit distance.
    """
    alpha = np.nan_to_num(piecewise_linear(transfer_function.opacity, values), nan=0.0)
    color = np.nan_to_num(piecewise_linear(transfer_function.color, values), nan=0.0)
    with np.errstate(divide="ignore"):
        tau = np.minimum(-np.log1p(-alpha), TAU_CAP)
    return tau / world_distance, color
