"""The warp's filters: what four taps weigh, as cubic polynomials of the fraction towards the third of them.

Rows are powers 0 to 3 of the fraction, columns the taps.  "bilinear": second order.  "keys": Keys (1981), a = -1/2,
the Catmull-Rom spline; third order.  "cubic": the cubic B-spline, of coefficients that make it interpolate
(``spline_prefilter``); fourth order.  (algorithm.md 1.5)
"""

from __future__ import annotations

from functools import cache

import numpy as np

POLYNOMIALS = {
    "bilinear": np.array([[0, 1, 0, 0], [0, -1, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]]),
    "keys": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2.0,
    "cubic": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0,
}


def is_prefiltered(name: str) -> bool:
    """Whether the filter weighs spline coefficients, of colour and alpha, and not samples."""
    return name == "cubic"


@cache
def taps_of(name: str) -> int:
    """Along each axis."""
    return int(np.count_nonzero(POLYNOMIALS[name].any(axis=0)))


@cache
def table_of(name: str) -> np.ndarray:
    """(96,) float32, read-only: the filter as ``tap4x4`` takes it."""
    to_alpha = np.array([[1, 1, 1, 1], [0, 0, 0, 0]]) if is_prefiltered(name) else [[1, 1, 1, -1], [0, 0, 0, 1]]
    weights = np.repeat(POLYNOMIALS[name], 4, axis=1)
    table = np.concatenate((weights, np.tile(to_alpha, 4))).astype(np.float32).reshape(-1)
    table.flags.writeable = False
    return table
