"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

Which voxels are visible or matter, what they look like (algorithm.md 1.10), and where their records go (1.1).
"""

import numpy as np

from ..volume.blocks import BLOCK_Z
from .points import LARGEST

SHORT = 4  # largest width of a gap that is closed, in voxels
WORD = 64  # voxels of a row in one word of bits
WHOLE = 64  # sum of the filter's weights, 8 of them the voxel's own
_coverage = np.maximum(np.arange(WHOLE + 1), WHOLE // 2) / WHOLE
# Share of a voxel's own function by its coverage in 1/64; within half a level of 1 it is 1, and the voxel is no edge.
OWN_SHARE = _coverage**3 / (_coverage**3 + (1.0 - _coverage) ** 3)
OWN_SHARE[OWN_SHARE > 1.0 - 0.5 / 255.0] = 1.0
OWN_SHARE.setflags(write=False)
NEIGHBORS = 27
AROUND = [(dz, dy, dx) for dz in (-1, 0, 1) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]


def find_seen(shown, rows) -> np.ndarray:
    """(rows, nx) bool: which stored values are visible; ``shown``: Visibility."""
    if shown.by_table:
        return shown.table[rows].astype(bool)
    slope, intercept = float(shown.volume.slope), float(shown.volume.intercept)
    seen = np.zeros(rows.shape, bool)
    for row, stored in zip(seen, rows):  # row by row, to avoid a float64 copy of a large volume
        with np.errstate(over="ignore"):
            values = np.clip(stored.astype(np.float64) * slope + intercept, -LARGEST, LARGEST)
        row[:] = ((values[:, None] >= shown.intervals[:, 0]) & (values[:, None] < shown.intervals[:, 1])).any(axis=1)
    return seen


def with_neighbors(values, of_two, axis: int) -> np.ndarray:
    """The extreme, by a ufunc ``of_two``, of each value and its two neighbors along an axis."""
    found = values.copy()
    into, moved = np.moveaxis(found, axis, 0), np.moveaxis(values, axis, 0)
    of_two(into[1:], moved[:-1], out=into[1:])
    of_two(into[:-1], moved[1:], out=into[:-1])
    return found


def count_kept(bits, counts, pieces):
    """Count the bits of each row, and the connected pieces that they form."""
    seen = unpack(bits)
    counts[:] = np.count_nonzero(seen, axis=1)
    pieces[:] = np.count_nonzero(seen[:, 1:] > seen[:, :-1], axis=1) + seen[:, 0]


def list_seen(seen, rows, column, stored):
    """List x and stored value of each voxel of ``rows`` (rows, nx) that is True in ``seen``."""
    column[:], stored[:] = np.nonzero(seen)[1], rows[seen]


def look_up(stored, slope, intercept, opacity, color) -> tuple:
    """Opacity (n,) and color (n, 3) of stored values, as ``classify_kernels.properties_by_points`` finds them."""
    with np.errstate(over="ignore"):
        values = np.clip(stored.astype(np.float64) * slope + intercept, -LARGEST, LARGEST)
    return find_heights(opacity, values)[:, 0], find_heights(color, values)


def find_heights(function, values: np.ndarray) -> np.ndarray:
    """Heights at physical values, with the arithmetic of the kernels.

    Parameters
    ----------
    function : Pieces
    values : (m,) ndarray of float64
        Finite physical values.

    Returns
    -------
    (m, channels) ndarray of float64
    """
    piece = np.searchsorted(function.values, values, side="right") - 1
    inside = np.maximum(piece, 0)
    after = np.minimum(inside + 1, len(function.values) - 1)
    with np.errstate(over="ignore"):  # far from points that are close together the share overflows and is clamped
        share = np.minimum((values - function.values[inside]) * function.rates[inside], 1.0)
    share = np.where(piece < 0, 0.0, share)[:, None]
    return function.heights[inside] * (1.0 - share) + function.heights[after] * share


def mark_relevant(voxels, first, last, _near, ends, bits):
    """Set the bits of voxels that matter, as ``relevant._mark_relevant``, in planes of blocks [first, last)."""
    n_z, n_y, _ = voxels.shape
    first, last = first * BLOCK_Z, min(last * BLOCK_Z, n_z)
    begin, end = max(first - 1, 0), min(last + 1, n_z)
    low = high = voxels[begin:end]
    for axis in range(3):
        nearer, further = ((slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None)))
        low, high = np.minimum(low[nearer], low[further]), np.maximum(high[nearer], high[further])
    seen = np.zeros(low.shape, bool)
    with np.errstate(invalid="ignore"):
        for least, most in ends:
            seen |= (high >= least) & (low <= most)
    kept = np.zeros((end - begin, n_y, bits.shape[1] * WORD), np.uint8)
    for z in (0, 1):
        for y in (0, 1):
            for x in (0, 1):
                kept[z : z + seen.shape[0], y : y + seen.shape[1], x : x + seen.shape[2]] |= seen
    packed = np.packbits(kept[first - begin : last - begin], axis=-1, bitorder="little")
    bits[first * n_y : last * n_y] = np.ascontiguousarray(packed).view("<u8").reshape(-1, bits.shape[1])


def pack(seen, bits):
    """Set the ``bits`` (rows, words) of the voxels that are True in ``seen`` (rows, nx)."""
    packed = np.packbits(seen, axis=1, bitorder="little")
    bits[:] = np.pad(packed, ((0, 0), (0, 8 * bits.shape[1] - packed.shape[1]))).view("<u8")


def unpack(bits) -> np.ndarray:
    """(rows, words * 64) uint8: the bits, one by one."""
    return np.unpackbits(bits.astype("<u8").view(np.uint8).reshape(len(bits), -1), axis=1, bitorder="little")


def close_gaps(bits, ny: int):
    """Keep the voxels in short gaps, along the rows and then across them, in place; ``ny``: rows of a plane."""
    for first in range(0, len(bits), ny):
        plane = bits[first : first + ny]
        if plane.any():
            _close_rows(plane)
            _close_across(plane)


def _close_rows(rows):
    """Close the gaps of all rows of a plane, as ``gaps._close_row``."""
    padded = np.pad(rows, ((0, 0), (1, 1)))
    here, before = padded[:, 1:], padded[:, :-1]
    spread = here.copy()
    for k in range(1, SHORT + 1):
        spread |= (here << np.uint64(k)) | (before >> np.uint64(WORD - k))
    rows[:] = spread[:, :-1]
    for k in range(1, SHORT + 1):
        rows &= (spread[:, :-1] >> np.uint64(k)) | (spread[:, 1:] << np.uint64(WORD - k))


def _close_across(rows):
    """Close the gaps across the rows of a plane, as ``gaps._close_across``."""
    padded = np.pad(rows, ((SHORT, SHORT), (0, 0)))
    spread = np.bitwise_or.reduce([padded[SHORT - k : len(padded) - k] for k in range(SHORT + 1)])
    rows[:] = np.bitwise_and.reduce([spread[k : k + len(rows)] for k in range(SHORT + 1)])


def mark_seen(stored, labels, numbers, shown, size: int, seen):
    """Set ``seen`` where a voxel is visible, as ``mixture_kernels.mark_seen``."""
    seen |= shown[_entries(stored, labels, numbers, size)]


def add_channel(
    indices, stored, labels, numbers, alphas, extinctions, colors, per_distance, size: int, distance: float, properties
):
    """Add one channel to the optical properties of voxels, as ``mixture_kernels.add_channel``."""
    entry = _entries(stored[indices], labels[indices] if labels.size else None, numbers, size)
    mix(properties, *(table[entry] for table in (alphas, extinctions, colors, per_distance)), distance)


def mix(properties, alpha, extinction, color, per_distance, distance: float) -> np.ndarray:
    """Add a medium of ``extinction`` and ``color`` to ``properties`` and return these."""
    # A voxel with a single medium, whose alpha refers to ``distance``, keeps opacity and color bit for bit.
    alone = (properties[:, 0] == 0.0) & per_distance
    adds = extinction > 0.0
    properties[:, 0] += extinction
    opacity = np.where(alone, alpha, -np.expm1(-properties[:, 0] * distance))
    properties[:, 1] = np.where(adds, opacity, properties[:, 1])
    share = np.divide(extinction, properties[:, 0], out=np.zeros(len(properties)), where=adds)
    properties[:, 2:] += share[:, None] * (color - properties[:, 2:])
    return properties


def _entries(stored, labels, numbers, size: int) -> np.ndarray:
    """(n,) table entry of each voxel."""
    entries = stored.astype(np.intp)
    return entries if labels is None else entries + size * numbers[labels].astype(np.intp)


def find_shares(numbers, hidden, first: int, at) -> tuple:
    """The fields of EdgeShares but the first, of the voxels ``at``: as the kernels of ``label_edges``."""
    _, ny, nx = numbers.shape
    own = np.unravel_index(at + first * ny * nx, numbers.shape)
    weight = np.array([np.prod([2 - abs(step) for step in steps]) for steps in AROUND])
    places = [
        np.ravel_multi_index([np.clip(i + d, 0, n - 1) for i, d, n in zip(own, steps, numbers.shape)], numbers.shape)
        for steps in AROUND
    ]
    places = np.stack(places, axis=1).reshape(-1, NEIGHBORS)
    kinds = numbers.reshape(-1)[places]
    mine = numbers[own]
    own_weight = ((kinds == mine[:, None]) * weight).sum(axis=1)
    own_share = OWN_SHARE[own_weight]
    is_hidden = hidden[mine]
    voxels, found, sources, shares = (
        [np.flatnonzero(~is_hidden)], [mine[~is_hidden]], [at[~is_hidden]], [own_share[~is_hidden]]
    )  # fmt: skip
    left = (kinds != mine[:, None]) & (own_share < 1.0)[:, None]
    while len(rows := np.flatnonzero(left.any(axis=1))):
        kind = kinds[rows, left[rows].argmax(axis=1)]
        same = left[rows] & (kinds[rows] == kind[:, None])
        left[rows] &= ~same
        shown = ~hidden[kind]
        nearest = places[rows, (same * weight).argmax(axis=1)] - first * ny * nx
        voxels.append(rows[shown])
        found.append(kind[shown])
        sources.append(np.where(is_hidden[rows], nearest, at[rows])[shown])
        share = (1.0 - own_share[rows]) * (same * weight).sum(axis=1) / (WHOLE - own_weight[rows])
        shares.append(share[shown])
    voxel = np.concatenate(voxels)
    order = np.argsort(voxel, kind="stable")
    number, source, share = (np.concatenate(parts)[order] for parts in (found, sources, shares))
    return voxel[order], number, source, share


def find_targets(positions) -> np.ndarray:
    """(n,) int64 position of each voxel's record, as ``placing.find_targets``; ``positions``: RecordPositions."""
    voxels, starts = positions.voxels, positions.data_starts
    ny = voxels.shape_xyz[1]
    first, last = positions.span
    rows = np.arange(positions.first_plane * ny, (positions.first_plane + len(starts)) * ny)
    row = np.repeat(rows, np.diff(voxels.row_start)[rows])
    key = voxels.column[first:last].astype(np.int64) if positions.across else row % ny
    line = (row // ny - positions.first_plane) * starts.shape[1] + key
    order = np.argsort(line, kind="stable")
    line = line[order]
    in_line = np.arange(len(line)) - np.searchsorted(line, line, side="left")
    targets = np.empty(len(line), np.int64)
    targets[order] = starts.reshape(-1)[line] + in_line
    return targets
