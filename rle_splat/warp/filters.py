"""Filters of the warp: weights of four taps, as cubic polynomials of the fraction toward the third tap.

Rows are powers 0 to 3 of the fraction, columns the taps (algorithm.md 1.5). "bilinear": second order. "keys":
Keys (1981) with a = -1/2, the Catmull-Rom spline, third order. "cubic": the cubic B-spline with coefficients that make
it interpolate (``spline_prefilter``), fourth order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

POLYNOMIALS = {
    "bilinear": np.array([[0, 1, 0, 0], [0, -1, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]]),
    "keys": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2.0,
    "cubic": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0,
}


class WarpFilter(NamedTuple):
    """A filter of the warp.

    Attributes
    ----------
    is_prefiltered : bool
        Whether it applies to spline coefficients of color and alpha instead of samples.
    taps : int
        Number of taps along each axis.
    table : (96,) ndarray of float32
        Read-only; the table argument of ``taps.tap4x4``.
    """

    is_prefiltered: bool
    taps: int
    table: np.ndarray

    @classmethod
    def of(cls, name: str) -> WarpFilter:
        polynomials, is_prefiltered = POLYNOMIALS[name], name == "cubic"
        to_alpha = np.array([[1, 1, 1, 1], [0, 0, 0, 0]]) if is_prefiltered else [[1, 1, 1, -1], [0, 0, 0, 1]]
        weights = np.repeat(polynomials, 4, axis=1)
        table = np.concatenate((weights, np.tile(to_alpha, 4))).astype(np.float32).reshape(-1)
        table.flags.writeable = False
        return cls(is_prefiltered, int(np.count_nonzero(polynomials.any(axis=0))), table)


FILTERS = {name: WarpFilter.of(name) for name in POLYNOMIALS}
