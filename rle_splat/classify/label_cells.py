"""Which label's function a point between voxels belongs to, for samples of a post-classified volume (algorithm.md 4.2).

Labels say in whole voxels where an organ ends.  Each function's indicator, smoothed, says it between voxels: a point
belongs to the function whose smoothed indicator is largest there, interpolated between the eight voxels around it.  So
any number of functions may meet, and a boundary is the same from both sides.  Only functions that one of the eight
voxels has count; where these have the same one, as nearly everywhere, it is taken without looking further.

The indicator is smoothed by NARROW G - (NARROW - 1) G * G, with G a Gaussian of SIGMA voxels.  On a boundary of mean
curvature H a Gaussian of s voxels makes of the indicator 1/2 - H s / sqrt(2 pi), so that it moves what is curved.
G * G is a Gaussian of sqrt(2) s, and with NARROW = sqrt(2) / (sqrt(2) - 1) the two errors cancel.  Measured on spheres
and tori whose voxels are labeled by their centers (``tests/truths/test_label_boundaries.py``): more than 99 % of a
boundary are within 0.25 voxels of where it belongs, where voxels as they are leave 82 %.  What is thin would vanish, so
a voxel always keeps its own function, and the differences of the others from it.

Two organs side by side would have a groove in their surface: each has a quarter where they meet and what is around them
a half.  So all bodies together are weighed against all that is outside of them: the largest indicator of each of the
two groups is raised to the group's sum, and the others in proportion.

Each voxel has the number of its function, bits that say where others are near, and how far its own function leads
before the strongest other.  In a cell of two functions the interpolated leads decide; where more meet, voxels at a
boundary have up to KINDS functions and their weights.  They also have the slopes of these, for light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import read_only
from ..scene import RleSplatError
from ..volume.blocks import cut_chunks

SIGMA, RADIUS = 1.6, 4  # voxels, of G, and where it is cut
NARROW = np.sqrt(2.0) / (np.sqrt(2.0) - 1.0)  # weight of G before G * G
REACH = 2 * RADIUS  # voxels that matter to a smoothed indicator
HALO = REACH + 1  # and to its slope
CACHED = 1 << 17  # voxels that are smoothed at a time, which stay in the processor's cache
AT_ONCE = 1 << 23  # voxels of a piece: thick enough that its halo costs little
EVEN = 0.02  # twice the least lead of a voxel's own function before another one
LEAD = 0.1  # where another one is stronger by as much; more, where little of its own function is left
KINDS = 4  # functions that a voxel knows, its own among them
# Bits of a voxel's number: the eight voxels of the cell that begins at it have several functions; more than two count
# in this cell; the 27 voxels around it have several functions.
MIXED, SEVERAL, BESIDE = 1 << 15, 1 << 14, 1 << 13
WEIGHT_OF_ONE = 1 << 13
SLOPE_OF_ONE = 1 << 14
NO_KIND = BESIDE - 1
LEAD_OF_ONE = 64  # a lead of 1, as leads are stored
CORNERS = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(8, 3)  # of a cell, as z, y, x
NOTHING = -9.0  # less than any weight
TAPS = np.exp(-0.5 * (np.arange(-RADIUS, RADIUS + 1) / SIGMA) ** 2).astype(np.float32)
TAPS /= TAPS.sum()


@dataclass(frozen=True, eq=False)
class LabelCells:
    """Which function each voxel has, and voxels at a boundary know of their neighbors.

    Attributes
    ----------
    shape_xyz : (nx, ny, nz)
    numbers : (nz * ny * nx,) ndarray of uint16
        Function number, and MIXED, SEVERAL and BESIDE.
    leads : (nz * ny * nx,) ndarray of int8
        LEAD_OF_ONE times the lead of the voxel's own function before the strongest other one, limited to what can be
        stored, as it is far from boundaries.
    row_start : (nz * ny + 1,) ndarray of int64
        First entry of ``column`` of each row along x.
    column : (m,) ndarray of int32
        x of voxels that have another function among the 26 around.
    kinds : (m, KINDS) ndarray of uint16
        Their own function, and others by falling weight, NO_KIND where there are no more.
    weights : (m, KINDS) ndarray of int16
        WEIGHT_OF_ONE times each function's weight, of which the largest decides; 0 where there are no more.
    slopes : (m, KINDS, 3) ndarray of int16
        SLOPE_OF_ONE times how much of each function's indicator, smoothed by G * G, more there is two voxels further
        along x, y, z; 0 where edges are not smooth.
    """

    shape_xyz: tuple[int, int, int]
    numbers: np.ndarray
    leads: np.ndarray
    row_start: np.ndarray
    column: np.ndarray
    kinds: np.ndarray
    weights: np.ndarray
    slopes: np.ndarray

    @property
    def nbytes(self) -> int:
        arrays = self.numbers, self.leads, self.row_start, self.column, self.kinds, self.weights, self.slopes
        return sum(array.nbytes for array in arrays)

    def of_rows(self, row_start, column) -> np.ndarray:
        """(n,) function number of voxels listed by rows, as of VisibleVoxels."""
        return self.numbers[self._places(row_start, column)] & NO_KIND

    def look_up(self, row_start, column) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of n voxels listed by rows: (n,) function numbers; (b,) which of them are at boundaries, ascending; and (b,)
        which of the voxels at boundaries each of these is."""
        asked = self._places(row_start, column)
        found = self.numbers[asked]
        at = np.flatnonzero(found & BESIDE)
        return found & NO_KIND, at, np.searchsorted(self._places(self.row_start, self.column), asked[at])

    def _places(self, row_start, column) -> np.ndarray:
        """(n,) int64 indices into ``numbers`` of voxels listed by rows."""
        return np.repeat(np.arange(len(row_start) - 1) * self.shape_xyz[0], np.diff(row_start)) + column


def cell_steps(numbers_of, outside: np.ndarray, shape_xyz, smooth: bool):
    """Generator of fractions done: find what voxels at boundaries know.

    Parameters
    ----------
    numbers_of : callable
        ``numbers_of(first, last)``: (planes, ny, nx) uint16 function numbers of planes [first, last).
    outside : (functions,) ndarray of bool
        Which functions are those of what lies around the bodies that are seen.
    shape_xyz : (nx, ny, nz)
    smooth : bool
        Whether edges are smooth; else they show the voxels.

    Returns
    -------
    LabelCells

    Raises
    ------
    RleSplatError
        With more functions than have numbers.
    """
    if len(outside) >= NO_KIND:
        raise RleSplatError(
            f"There are {len(outside)} labels with different looks; at most {NO_KIND - 1} are possible."
        )
    nx, ny, nz = shape_xyz
    numbers = np.empty((nz, ny, nx), np.uint16)
    found = []
    for first, last in cut_chunks(nz, ny * nx, AT_ONCE):
        yield first / nz
        low, high = max(first - HALO, 0), min(last + HALO, nz)
        planes = numbers_of(low, high)
        own = slice(first - low, last - low)
        numbers[first:last] = planes[own]
        mixed = _mixed_cells(planes)
        numbers[first:last][mixed[own]] |= MIXED
        found.append(_Boundary(planes, mixed, outside, own.start, own.stop).records(smooth))
    rows, *columns = (np.concatenate(each) for each in zip(*found))
    row_start = np.concatenate(([0], np.cumsum(rows)))
    leads = _mark_boundaries(numbers, row_start, *columns[:3])
    return LabelCells(tuple(shape_xyz), *map(read_only, (numbers.reshape(-1), leads, row_start, *columns)))


def _mixed_cells(planes) -> np.ndarray:
    """Bool, shape of ``planes``: whether the cell from a voxel to the next ones has several functions.

    It has them if they differ along one of its edges.
    """
    mixed = np.zeros(planes.shape, bool)
    for axis in range(3):
        differ = np.zeros(planes.shape, bool)
        values = np.moveaxis(planes, axis, 0)
        np.not_equal(values[:-1], values[1:], out=np.moveaxis(differ, axis, 0)[:-1])
        for other in {0, 1, 2} - {axis}:
            moved = np.moveaxis(differ, other, 0)
            moved[:-1] |= moved[1:]
        mixed |= differ
    return mixed


def _where(mask) -> np.ndarray:
    """(3, n): indices z, y, x of the voxels of a mask, faster than by np.nonzero."""
    return np.stack(np.unravel_index(np.flatnonzero(mask), mask.shape))


def _mark_boundaries(numbers, row_start, column, kinds, weights) -> np.ndarray:
    """Add BESIDE and SEVERAL to ``numbers`` (nz, ny, nx); the leads of LabelCells."""
    nz, ny, nx = numbers.shape
    leads = np.full(numbers.size, np.iinfo(np.int8).max, np.int8)
    flat, scale = numbers.reshape(-1), LEAD_OF_ONE / WEIGHT_OF_ONE
    for first, last in cut_chunks(nz, ny * nx, AT_ONCE):
        top = min(last + 1, nz)
        records = slice(row_start[first * ny], row_start[top * ny])
        rows = np.repeat(np.arange(first * ny, top * ny), np.diff(row_start[first * ny : top * ny + 1]))
        at = rows * nx + column[records]
        flat[at] |= BESIDE
        lead = scale * (weights[records, 0].astype(np.int32) - weights[records, 1])
        leads[at] = np.clip(np.rint(lead), 1, np.iinfo(np.int8).max)
        others = np.full((top - first) * ny * nx, NO_KIND, np.uint16)
        others[at - first * ny * nx] = kinds[records, 1]
        found = np.flatnonzero(numbers[first:last] & MIXED)
        z, y, x = np.unravel_index(found, (last - first, ny, nx))
        # From a cell's first corner to the others; at the ends of the volume that corner again.
        up, across, along = (z < top - first - 1) * (ny * nx), (y < ny - 1) * nx, x < nx - 1
        near = flat[first * ny * nx : top * ny * nx]
        corners = [found + a * up + b * across + c * along for a, b, c in CORNERS]
        own, other = (np.stack([values[one] for one in corners]) for values in (near, others))
        own &= NO_KIND
        low, high = own.min(axis=0), own.max(axis=0)
        are_two = ((own == low) & (other == high)) | ((own == high) & (other == low))
        near[found[~are_two.all(axis=0)]] |= SEVERAL
    return leads


class _Boundary:
    """Voxels at boundaries in planes [first, last) of some planes of function numbers."""

    def __init__(self, planes, mixed, outside, first: int, last: int):
        self.planes, self.outside = planes, outside
        beside = mixed.copy()  # a voxel that differs from one of the 26 around shares a cell with it
        for axis in range(3):
            moved = np.moveaxis(beside, axis, 0)
            moved[1:] |= moved[:-1]
        self.rows = np.count_nonzero(beside[first:last], axis=2).reshape(-1)
        self.at = _where(beside[first:last])
        self.at[0] += first
        self.own = planes[tuple(self.at)]
        around = _where(beside)
        self.boxes = _boxes(planes[tuple(around)], around)

    def records(self, smooth: bool) -> tuple[np.ndarray, ...]:
        """Voxels of each row, and the columns of LabelCells."""
        m = len(self.own)
        # Kinds first, since numpy is slow along short axes.
        kinds = np.full((KINDS, m), NO_KIND, np.uint16)
        weights, slopes = np.zeros((KINDS, m), np.float32), np.zeros((KINDS, m, 3), np.float32)
        kinds[0] = self.own
        if smooth:
            weights[1:] = NOTHING
            rest, rest_slopes = np.ones(m, np.float32), np.zeros((m, 3), np.float32)
            for number, (low, high) in self.boxes.items():
                if number == 0:
                    continue
                rows = np.flatnonzero(
                    ((self.at >= (low - REACH)[:, None]) & (self.at <= (high + REACH)[:, None])).all(axis=0)
                )  # fmt: skip
                if not len(rows):
                    continue
                weight, slope = self._indicator(number, rows)
                rest[rows] -= weight
                rest_slopes[rows] -= slope
                self._note(kinds, weights, slopes, rows, number, weight, slope)
            self._note(kinds, weights, slopes, np.arange(m), 0, rest, rest_slopes)
            _weigh(kinds, weights, self.outside)
            order = np.argsort(-weights[1:], axis=0, kind="stable") + 1
            kinds[1:], weights[1:] = (np.take_along_axis(each, order, axis=0) for each in (kinds, weights))
            slopes[1:] = slopes[order, np.arange(m)]
            absent = kinds == NO_KIND
            weights[absent], slopes[absent] = 0.0, 0.0
        else:
            weights[0] = 1.0
        codes = np.clip(np.rint(weights * WEIGHT_OF_ONE), -32768, 32767).astype(np.int16)
        columns = kinds, codes, np.rint(slopes * SLOPE_OF_ONE).astype(np.int16)
        return self.rows, self.at[2].astype(np.int32), *(np.ascontiguousarray(each.swapaxes(0, 1)) for each in columns)

    def _indicator(self, number: int, rows):
        """The smoothed indicator of a function and its slopes along x, y, z at ``rows`` of ``at``: (n,) and (n, 3)
        float32."""
        at = self.at[:, rows]
        # What is smoothed twice, with a margin for slopes, lies in planes of its own; and a margin for each smoothing.
        begin, end = at.min(axis=1) - HALO, at.max(axis=1) + HALO + 1
        inside = tuple(slice(max(a, 0), min(b, n)) for a, b, n in zip(begin, end, self.planes.shape))
        beyond = [(max(-a, 0), max(b - n, 0)) for a, b, n in zip(begin, end, self.planes.shape)]
        once = _blurred(np.pad((self.planes[inside] == number).astype(np.float32), beyond, mode="edge"))
        twice = _blurred(once)
        once = once[RADIUS:-RADIUS, RADIUS:-RADIUS, RADIUS:-RADIUS]
        steps = twice.strides[0] // 4, twice.strides[1] // 4, 1
        flat, places = twice.reshape(-1), np.array(steps) @ (at - begin[:, None] - REACH)
        slopes = np.stack([flat[places + step] - flat[places - step] for step in reversed(steps)], axis=1)
        weight = np.float32(NARROW) * once.reshape(-1)[places] - np.float32(NARROW - 1.0) * flat[places]
        return weight, slopes

    def _note(self, kinds, weights, slopes, rows, number: int, weight, slope) -> None:
        """Take a function into the records of ``rows``: as their own, or in place of the weakest other."""
        mine = self.own[rows] == number
        slot = np.where(mine, 0, 1 + np.argmin(weights[1:, rows], axis=0))
        some = mine | (weight > weights[slot, rows])
        rows, slot = rows[some], slot[some]
        kinds[slot, rows], weights[slot, rows], slopes[slot, rows] = number, weight[some], slope[some]


def _weigh(kinds, weights, outside) -> None:
    """Make the weights of LabelCells of smoothed indicators (KINDS, m), in place."""
    there = kinds != NO_KIND
    beyond = outside[np.where(there, kinds, 0)]
    for group in (there & beyond, there & ~beyond):
        found = np.where(group, weights, np.float32(0.0))
        total, most = found.sum(axis=0), found.max(axis=0).clip(0.0)
        scale = np.divide(total, most, out=np.ones_like(total), where=total > most)
        np.multiply(weights, scale, out=weights, where=group)
    leads = weights[0] - weights[1:]
    leads = np.maximum(leads, np.maximum(np.minimum(EVEN - leads, LEAD), -leads - LEAD))
    strongest = np.argmax(weights[1:], axis=0)[None]
    own = np.take_along_axis(weights[1:], strongest, axis=0) + np.take_along_axis(leads, strongest, axis=0)
    weights[0] = np.maximum(weights[0], own[0])
    weights[1:] = np.where(there[1:], weights[0] - leads, NOTHING)


def _boxes(numbers, at) -> dict:
    """Of each function number: the smallest and largest indices z, y, x of its voxels, (3,) each."""
    order = np.argsort(numbers, kind="stable")
    known, first = np.unique(numbers[order], return_index=True)
    if not len(known):
        return {}
    ends = (reduce.reduceat(at[:, order], first, axis=1) for reduce in (np.minimum, np.maximum))
    return {int(number): both for number, *both in zip(known, *(end.T for end in ends))}


def _blurred(values) -> np.ndarray:
    """Smoothed by G, RADIUS voxels less at each side."""
    found = np.empty(np.array(values.shape) - 2 * RADIUS, np.float32)
    step = max(CACHED // values[0].size, 1)
    for first in range(0, len(found), step):
        part = values[first : first + step + 2 * RADIUS]
        for axis in range(3):
            count, before = part.shape[axis] - 2 * RADIUS, (slice(None),) * axis
            moved = [part[*before, begin : begin + count] for begin in range(2 * RADIUS + 1)]
            part = TAPS[RADIUS] * moved[RADIUS]
            for i in range(RADIUS):  # taps are alike on both sides
                pair = moved[i] + moved[2 * RADIUS - i]
                pair *= TAPS[i]
                part += pair
        found[first : first + step] = part
    return found
