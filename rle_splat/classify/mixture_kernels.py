"""The loops over voxels that several transfer functions classify, by tables of bit patterns; a numpy twin beside each.

A voxel's entry in the tables is ``size`` times the number of its function, plus its bit pattern.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call
from ..runtime.parallel import share_out

PIECE = 1 << 14  # voxels by one thread at a time


def mark_seen(stored, labels, numbers, shown, size: int, seen, backend: str = "auto", threads: int = 0) -> None:
    """Set ``seen`` (n,) bool where a voxel is shown.

    ``stored`` (n,): bit patterns; ``labels`` (n,): bit patterns too, or None; ``numbers``: of the function of each
    label, by bit pattern; ``shown``: bool, by entry.
    """
    if compiled(backend):
        with parallel_call(threads):
            _mark(-(-len(seen) // PIECE), (stored, labels, numbers, shown, size, seen))
    else:
        seen |= shown[_entries(stored, labels, numbers, size)]


def count_seen(seen, counts, pieces, backend: str = "auto", threads: int = 0) -> None:
    """How many voxels of each row of ``seen`` (rows, nx) bool are seen, and in how many pieces, to ``counts`` and
    ``pieces`` (rows,)."""
    if compiled(backend):
        with parallel_call(threads):
            _count(len(seen), (seen, counts, pieces))
    else:
        counts[:] = np.count_nonzero(seen, axis=1)
        pieces[:] = np.count_nonzero(seen[:, 1:] > seen[:, :-1], axis=1) + seen[:, 0]


def put_columns(seen, row_start, column, backend: str = "auto", threads: int = 0) -> None:
    """The place in its row of each voxel that is seen, to ``column[row_start[0]:]``."""
    if compiled(backend):
        with parallel_call(threads):
            _put(len(seen), (seen, row_start, column))
    else:
        column[row_start[0] : row_start[len(seen)]] = np.nonzero(seen)[1]


def add_looks(
    places, stored, labels, numbers, tables, size: int, distance: float, looks, backend: str = "auto", threads: int = 0
) -> None:
    """Add one channel to ``looks`` (n, 5) float64: extinction, opacity, RGB, of the voxels at ``places`` (n,).

    ``tables``: by entry, (m,) alpha, (m,) extinction, (m, 3) colour, and whether the alpha is per ``distance``, which
    opacities refer to.  ``stored``, ``labels``, ``numbers``: as of ``mark_seen``, of the whole volume.
    """
    if compiled(backend):
        with parallel_call(threads):
            _add(-(-len(places) // PIECE), (places, stored, labels, numbers, *tables, size, distance, looks))
    else:
        entry = _entries(stored[places], None if labels is None else labels[places], numbers, size)
        mix(looks, *(table[entry] for table in tables), distance)


def mix(looks, alpha, extinction, color, per_distance, distance: float) -> None:
    """Add matter of so much ``extinction`` and ``color`` to ``looks``, as ``add_looks`` does."""
    # What one function shows alone, per the distance of the first, keeps its opacity and its colour to the bit.
    alone = (looks[:, 0] == 0.0) & per_distance
    adds = extinction > 0.0
    looks[:, 0] += extinction
    opacity = np.where(alone, alpha, -np.expm1(-looks[:, 0] * distance))
    looks[:, 1] = np.where(adds, opacity, looks[:, 1])
    share = np.divide(extinction, looks[:, 0], out=np.zeros(len(looks)), where=adds)
    looks[:, 2:] += share[:, None] * (color - looks[:, 2:])


def _entries(stored, labels, numbers, size: int) -> np.ndarray:
    entries = stored.astype(np.intp)
    return entries if labels is None else entries + size * numbers[labels].astype(np.intp)


@kernel
def _mark(pieces, arguments):
    share_out(_mark_pieces, pieces, arguments)


@kernel(inner=True)
def _mark_pieces(begin, end, stored, labels, numbers, shown, size, seen):
    for i in range(begin * PIECE, min(end * PIECE, seen.size)):
        entry = np.int64(stored[i])
        if labels is not None:
            entry += size * np.int64(numbers[labels[i]])
        seen[i] |= shown[entry]


@kernel
def _add(pieces, arguments):
    share_out(_add_pieces, pieces, arguments)


@kernel(inner=True, exact=True)
def _add_pieces(
    begin, end, places, stored, labels, numbers, alphas, extinctions, colors, per_distance, size, distance, looks
):
    for i in range(begin * PIECE, min(end * PIECE, places.size)):
        entry = np.int64(stored[places[i]])
        if labels is not None:
            entry += size * np.int64(numbers[labels[places[i]]])
        extinction = extinctions[entry]
        if extinction > 0.0:
            alone = looks[i, 0] == 0.0 and per_distance[entry]
            total = looks[i, 0] + extinction
            looks[i, 0] = total
            looks[i, 1] = alphas[entry] if alone else -math.expm1(-total * distance)
            for channel in range(3):
                looks[i, 2 + channel] += extinction / total * (colors[entry, channel] - looks[i, 2 + channel])


@kernel
def _count(rows, arguments):
    share_out(_count_rows, rows, arguments)


@kernel(inner=True)
def _count_rows(begin, end, seen, counts, pieces):
    for row in range(begin, end):
        count = found = 0
        before = False
        for x in range(seen.shape[1]):
            here = seen[row, x]
            count += here
            found += here and not before
            before = here
        counts[row], pieces[row] = count, found


@kernel
def _put(rows, arguments):
    share_out(_put_rows, rows, arguments)


@kernel(inner=True)
def _put_rows(begin, end, seen, row_start, column):
    for row in range(begin, end):
        at, stop = row_start[row], row_start[row + 1]
        for x in range(seen.shape[1]):
            if at == stop:
                break
            column[at] = x  # written whether seen or not, kept by moving on
            at += seen[row, x]
