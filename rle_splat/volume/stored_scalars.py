"""Stored values as kernels take them, so that one kernel serves volumes of all types.

A kernel of its own for each type would have to be compiled for each.  A branch more for each run, row or cell of voxels
takes at most some hundredths of the time.  (With a branch for each voxel, sizes of gradients took 1.8 times as long.)
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop, read_only


class StoredScalars(NamedTuple):
    """Stored values in the array of their type; the arrays of the other types are empty."""

    uint8: np.ndarray
    int8: np.ndarray
    uint16: np.ndarray
    int16: np.ndarray
    float32: np.ndarray

    @classmethod
    def of(cls, scalars):
        """Of an array of one of the types; all are empty for an array of another type."""
        kinds = cls._fields
        return cls(*(read_only(scalars) if scalars.dtype == kind else _empty(kind, scalars.ndim) for kind in kinds))

    def array(self):
        """The array that is not empty, unless there are no values."""
        return max(self, key=len)


class StoredValues(NamedTuple):
    """Stored values of any type: ``scalars``, or ``other`` where they have no array there; kernels are compiled for
    each type of ``other``."""

    scalars: StoredScalars
    other: np.ndarray

    @classmethod
    def of(cls, values):
        """Of an array of any type."""
        known = values.dtype.name in StoredScalars._fields
        return cls(StoredScalars.of(values), _empty("float64", values.ndim) if known else read_only(values))


@cache
def _empty(kind: str, dimensions: int) -> np.ndarray:
    return read_only(np.empty((0,) * dimensions, kind))


def by_type(function):
    """Return a loop that calls ``function(values, ...)``, a loop as well, as ``loop(scalars, ...)`` with the array of
    StoredScalars that is not empty."""

    @inner_loop
    def loop(scalars, *arguments):
        if scalars.uint8.size > 0:
            return function(scalars.uint8, *arguments)
        if scalars.int16.size > 0:
            return function(scalars.int16, *arguments)
        if scalars.uint16.size > 0:
            return function(scalars.uint16, *arguments)
        if scalars.float32.size > 0:
            return function(scalars.float32, *arguments)
        return function(scalars.int8, *arguments)

    return loop


def by_any_type(function):
    """As ``by_type``, for StoredValues."""
    own = by_type(function)

    @inner_loop
    def loop(values, *arguments):
        if values.other.size > 0:
            return function(values.other, *arguments)
        return own(values.scalars, *arguments)

    return loop
