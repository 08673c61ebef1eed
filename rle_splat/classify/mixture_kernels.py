"""Kernels for voxels that are classified by several transfer functions, with lookup tables by bit pattern.

The table entry of a voxel is ``size``
times the number of its function, plus the bit pattern of its value.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference

PIECE = 1 << 14  # voxels per piece of work
NO_LABELS = read_only(np.empty(0, np.uint8))  # so that one kernel serves voxels with and without


def mark_seen(stored, labels, numbers, shown, size: int, seen, threads: int = 0) -> None:
    """Set ``seen`` where a voxel is visible.

    Parameters
    ----------
    stored : (n,) ndarray of unsigned integers
        Bit patterns of the values.
    labels : (n,) ndarray of unsigned integers or None
        Bit patterns of the labels.
    numbers : ndarray of uint16
        Function number by bit pattern of the label.
    shown : ndarray of bool
        Whether a table entry has an opacity above 0.
    size : int
        Table entries per function.
    seen : (n,) ndarray of bool
        Written where True.
    threads : int
        0 for one per core.
    """
    if compiled():
        with parallel_call(threads):
            _mark(-(-len(seen) // PIECE), (stored, labels, numbers, shown, size, seen))
    else:
        reference.mark_seen(stored, labels, numbers, shown, size, seen)


def add_channel(
    indices, stored, labels, numbers, tables, size: int, distance: float, properties, threads: int = 0,
) -> None:  # fmt: skip
    """Add one channel to the optical properties of voxels.

    Parameters
    ----------
    indices : (n,) ndarray of int64
        Indices into the flat volume.
    stored, labels, numbers
        As in ``mark_seen``, for the whole volume.
    tables : tuple
        By table entry: (m,) alpha, (m,) extinction, (m, 3) color, and (m,) bool, whether alpha refers to ``distance``.
    size : int
        Table entries per function.
    distance : float
        World length to which the opacity in ``properties`` refers.
    properties : (n, 5) ndarray of float64
        Extinction, opacity, RGB; changed in place.
    threads : int
        0 for one per core.
    """
    if compiled():
        with parallel_call(threads):
            own = NO_LABELS if labels is None else labels
            _add(-(-len(indices) // PIECE), (indices, stored, own, numbers, *tables, size, distance, properties))
    else:
        reference.add_channel(indices, stored, labels, numbers, tables, size, distance, properties)


@kernel
def _mark(pieces, arguments):
    """Kernel of ``mark_seen``."""
    share_out(_mark_pieces, pieces, arguments)


@kernel(inner=True)
def _mark_pieces(begin, end, stored, labels, numbers, shown, size, seen):
    """``_mark`` for pieces [begin, end)."""
    for i in range(begin * PIECE, min(end * PIECE, seen.size)):
        entry = np.int64(stored[i])
        if labels is not None:
            entry += size * np.int64(numbers[labels[i]])
        seen[i] |= shown[entry]


@kernel
def _add(pieces, arguments):
    """Kernel of ``add_channel``."""
    share_out(_add_pieces, pieces, arguments)


@kernel(inner=True, exact=True)
def _add_pieces(
    begin, end, indices, stored, labels, numbers, alphas, extinctions, colors, per_distance, size, distance, properties
):
    """``_add`` for pieces [begin, end); arithmetic as in ``reference.mix``."""
    for i in range(begin * PIECE, min(end * PIECE, indices.size)):
        entry = np.int64(stored[indices[i]])
        if labels.size > 0:
            entry += size * np.int64(numbers[labels[indices[i]]])
        extinction = extinctions[entry]
        if extinction > 0.0:
            alone = properties[i, 0] == 0.0 and per_distance[entry]
            total = properties[i, 0] + extinction
            properties[i, 0] = total
            properties[i, 1] = alphas[entry] if alone else -math.expm1(-total * distance)
            for channel in range(3):
                properties[i, 2 + channel] += extinction / total * (colors[entry, channel] - properties[i, 2 + channel])
