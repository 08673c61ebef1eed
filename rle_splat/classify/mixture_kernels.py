"""Kernels for voxels that are classified by several transfer functions, with lookup tables by bit pattern.

The table entry of a voxel is ``size``
times the number of its function, plus the bit pattern of its value.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import kernel, read_only
from ..runtime.parallel import share_out

PIECE = 1 << 14  # voxels per piece of work
NO_LABELS = read_only(np.empty(0, np.uint8))  # so that one kernel serves voxels with and without


@kernel
def mark_seen(stored, labels, numbers, shown, size, seen):
    """Set ``seen`` where a voxel is visible.

    ``stored`` (n,) and ``labels`` (n,) or None: unsigned bit patterns; ``numbers``: uint16 function number by bit
    pattern of the label; ``shown``: bool, whether a table entry has an opacity above 0; ``size``: table entries per
    function; ``seen`` (n,) bool, written where True.
    """
    share_out(_mark_pieces, -(-seen.size // PIECE), (stored, labels, numbers, shown, size, seen))


@kernel(inner=True)
def _mark_pieces(begin, end, stored, labels, numbers, shown, size, seen):
    """``mark_seen`` for pieces [begin, end)."""
    for i in range(begin * PIECE, min(end * PIECE, seen.size)):
        entry = np.int64(stored[i])
        if labels is not None:
            entry += size * np.int64(numbers[labels[i]])
        seen[i] |= shown[entry]


@kernel
def add_channel(
    indices, stored, labels, numbers, alphas, extinctions, colors, per_distance, size, distance, properties
):
    """Add one channel to the optical properties of voxels.

    ``indices`` (n,) int64 into the flat volume; ``stored``, ``labels`` and ``numbers`` as in ``mark_seen``, for the
    whole volume, NO_LABELS without labels; by table entry ``alphas`` (m,), ``extinctions`` (m,), ``colors`` (m, 3) and
    ``per_distance`` (m,), whether alpha refers to ``distance``, the world length to which the opacity in ``properties``
    refers; ``properties`` (n, 5) float64 extinction, opacity, RGB, changed in place.
    """
    arguments = (
        indices, stored, labels, numbers, alphas, extinctions, colors, per_distance, size, distance, properties,
    )  # fmt: skip
    share_out(_add_pieces, -(-indices.size // PIECE), arguments)


@kernel(inner=True, exact=True)
def _add_pieces(
    begin, end, indices, stored, labels, numbers, alphas, extinctions, colors, per_distance, size, distance, properties
):
    """``add_channel`` for pieces [begin, end); arithmetic as in ``reference.mix``."""
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
