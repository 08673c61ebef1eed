"""Normals at a scale, on kept voxels: gradients of the smoothed field, as long as they can be trusted.

Stored values are smoothed by a Gaussian of some millimeters, so that slices far apart leave no rings, and

    m = N / sqrt(R^2 + (NOISE E)^2)

is kept of each voxel, at most 1 long: N is the central difference of the smoothed values, R the root mean square of
its length over the 27 voxels around, and E the length that errors of stored values give it.  So m is about 1 long at a
surface, short where there is little but noise, and nearly 0 where normals turn over, as in the middle of a wall.  So
that walls differ from what is flat, what |N| lacks of LEAST R is added to N along x.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..runtime.work_sizes import SMOOTHED_AT_ONCE
from ..volume.stored_scalars import StoredScalars, by_type
from . import reference
from .sample_light import ONE

CUT = 3.0  # standard deviations at which the Gaussian ends
MOST_SMOOTHED = 2.0  # mm, by itself: slices 5 mm apart must not erase vessels
NOISE = 40.0  # times E: gradients from 13 E on are trusted wholly
LEAST = 0.04  # of R
FLOAT_STEPS = 256.0  # machine epsilons: what values carry, and what smoothing in float32 adds, must not be seen
# Planes that a step smooths beyond its own: a difference, and the mean of its squares.
BEYOND = 2
NATIVE = ("uint8", "int8", "uint16", "int16", "float32")  # types that are smoothed as they are
_ZERO, _ONE, _TWO, _THREE = (np.float32(n) for n in range(4))
_LEAST = np.float32(LEAST)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The gradients of kept voxels.

    Attributes
    ----------
    vectors : (m, 3) ndarray of int16
        ONE times m, in the volume's own space, towards larger stored values.
    steepness : (m,) ndarray of float32
        Length of N, stored values per mm.
    """

    vectors: np.ndarray
    steepness: np.ndarray

    @property
    def nbytes(self) -> int:
        return self.vectors.nbytes + self.steepness.nbytes


def automatic_sigma(spacing) -> float:
    """How far values are smoothed by themselves, mm: by the largest distance of slices, MOST_SMOOTHED at most."""
    return float(min(max(spacing), MOST_SMOOTHED))


def gaussian(sigma: float, spacing: float) -> np.ndarray:
    """(2 r + 1,) weights at whole voxels of a Gaussian cut at CUT sigmas, whose sum is 1."""
    reach = int(CUT * sigma / spacing + 1e-9)
    if reach == 0:
        return np.ones(1)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * spacing / sigma) ** 2)
    return weights / weights.sum()


def surface_steps(volume, row_start: np.ndarray, column: np.ndarray, sigma: float, *, threads: int = 0):
    """Generator of fractions done: find m of kept voxels.

    Parameters
    ----------
    volume : Volume
    row_start : (nz * ny + 1,) ndarray of int64
        First entry of ``column`` of each row of voxels along x.
    column : (m,) ndarray of integers
        x of the kept voxels.
    sigma : float
        Standard deviation of the Gaussian in mm, 0 for none.
    threads : int
        0 for one per core.

    Returns
    -------
    Surfaces
    """
    nx, ny, nz = volume.shape_xyz
    smoothing = Smoothing.of(volume, sigma)
    rows = np.diff(row_start).reshape(nz, ny) > 0
    wanted = dilated(rows)  # rows whose differences count in the mean of squares
    smoothed_rows = dilated(wanted)
    vectors, steepness = empty((len(column), 3), np.int16), empty(len(column), np.float32)
    at_once = max(SMOOTHED_AT_ONCE // (nx * ny), 1)
    # Used by all steps, because the system clears new memory, which took as long as the work on it.
    room, squares = np.empty((2, min(at_once + 2 * BEYOND, nz), ny, nx), np.float32)
    from_, reached = 0, 0  # of the planes in ``room``
    for first in range(0, nz, at_once):
        yield first / nz
        last = min(first + at_once, nz)
        if not rows[first:last].any():
            continue
        low, high = max(first - BEYOND, 0), min(last + BEYOND, nz)
        known = max(reached - low, 0)  # planes of the step before
        room[:known] = room[low - from_ : low - from_ + known]
        smoothed, from_, reached = room[: high - low], low, high
        smoothing.smooth(low + known, smoothed_rows, smoothed[known:], threads)
        lists = read_only(row_start), read_only(column)
        arguments = (
            smoothed, low, nz, first, last, read_only(wanted), lists, smoothing.slopes, smoothing.floor,
            smoothing.per_mm, vectors, steepness,
        )  # fmt: skip
        if compiled():
            with parallel_call(threads):
                _find(squares, *arguments)
        else:
            reference.find_surfaces(*arguments)
        _leave_out_holes(smoothing.voxels[first:last], row_start[first * ny : last * ny + 1], column, vectors)
    return Surfaces(read_only(vectors), read_only(steepness))


def _leave_out_holes(planes, row_start, column, vectors) -> None:
    """Set the vectors to 0 of the voxels of some planes that are not finite."""
    if planes.dtype.kind != "f" or np.isfinite(planes).all():
        return
    own = slice(row_start[0], row_start[-1])
    row = np.repeat(np.arange(len(row_start) - 1), np.diff(row_start))
    vectors[own][~np.isfinite(planes.reshape(-1, planes.shape[2])[row, column[own]])] = 0


def dilated(rows: np.ndarray) -> np.ndarray:
    """(nz, ny) bool: true where a neighbor is, too."""
    found = rows.copy()
    found[1:] |= rows[:-1]
    found[:-1] |= rows[1:]
    along = found.copy()
    along[:, 1:] |= found[:, :-1]
    along[:, :-1] |= found[:, 1:]
    return along


@dataclass(frozen=True, eq=False)
class Smoothing:
    """How the voxels of a volume are smoothed and their differences measured.

    Attributes
    ----------
    voxels : (nz, ny, nx) ndarray
    taps : three (2 r + 1,) ndarrays of float32
        Weights along x, y, z.
    center, scale : float
        Stored values are smoothed as (value - center) * scale, so that no square overflows.
    slopes : tuple of float32
        The matrix, row by row, that makes differences per voxel a gradient in the volume's own space.
    floor : tuple of float32
        NOISE times E is noise + error * |value + middle|, of a smoothed value: ``noise``, ``error`` and ``middle``.
    per_mm : float
        What a gradient's length is divided by to be per mm.
    """

    voxels: np.ndarray
    taps: tuple
    center: float
    scale: float
    slopes: tuple
    floor: tuple
    per_mm: float

    @classmethod
    def of(cls, volume, sigma: float) -> Smoothing:
        voxels = np.asarray(volume.voxels)
        spacing = np.asarray(volume.spacing, np.float64)
        taps = [gaussian(sigma, distance) for distance in spacing]
        directions = np.asarray(volume.affine, np.float64)[:3, :3] / spacing
        slopes = np.linalg.inv(directions).T / spacing
        steepest = np.abs(slopes).max()  # so that no unit of length makes squares overflow
        noise = NOISE * noise_of_gradient(taps, spacing) / steepest
        center, scale, error = 0.0, 1.0, 0.0
        if voxels.dtype.kind == "f" or voxels.dtype.name not in NATIVE:
            low, high = sorted((value - volume.intercept) / volume.slope for value in volume.value_range)
            center = 0.0 if voxels.dtype.name in NATIVE else 0.5 * (low + high)
            largest = max(abs(low - center), abs(high - center))
            scale = 1.0 / largest if 0.0 < largest < np.inf else 1.0
        if voxels.dtype.kind == "f":
            error, noise = noise * FLOAT_STEPS * float(np.finfo(np.float32).eps), 0.0
        taps = tuple(read_only(each.astype(np.float32)) for each in taps)
        floor = tuple(np.float32(each) for each in (noise * scale, error, center * scale))
        return cls(
            voxels, taps, center, scale, tuple((slopes / steepest).astype(np.float32).ravel()), floor, scale / steepest,
        )  # fmt: skip

    def smooth(self, low: int, wanted: np.ndarray, found: np.ndarray, threads: int) -> None:
        """Smooth the planes from ``low`` on, rows that are ``wanted`` (nz, ny), into ``found``.

        ``found`` (planes, ny, nx) float32 is NaN where no voxel is finite.

        Voxels outside the volume and such that are not finite are left out, and the rest is divided by its weights
        (normalized convolution, Knutsson and Westin 1993).
        """
        reach = self.taps[2].size // 2
        first, last = max(low - reach, 0), min(low + len(found) + reach, len(self.voxels))
        values, holes = self.voxels[first:last], None
        if values.dtype.name not in NATIVE or (values.dtype.kind == "f" and self.scale != 1.0):
            values = ((values.astype(np.float64) - self.center) * self.scale).astype(np.float32)
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                values, holes = np.where(finite, values, _ZERO), finite.astype(np.uint8)
        self._smooth(values, first, low, wanted, found, threads)
        if holes is not None:
            weights = np.empty_like(found)
            self._smooth(holes, first, low, wanted, weights, threads)
            known = weights > 1e-6
            np.divide(found, weights, out=found, where=known)
            found[~known] = np.nan

    def _smooth(self, values, first, low, wanted, found, threads) -> None:
        values, arguments = np.ascontiguousarray(values), (first, low, read_only(wanted), *self.taps, found)
        if compiled():
            with parallel_call(threads):
                _smooth(StoredScalars.of(values), *arguments)
        else:
            reference.smooth(values, *arguments)


def noise_of_gradient(taps, spacing) -> float:
    """Root mean square length per mm of the gradient that independent errors, uniform over a step of 1, give.

    Their variance is 1/12.  The gradient along an axis convolves with the difference of two shifted kernels along it
    and with the kernels across, so that its variance is 1/12 times the product of the sums of their squares.
    """
    squares, total = [float((kernel**2).sum()) for kernel in taps], 0.0
    for axis in range(3):
        slope = np.convolve(taps[axis], (0.5, 0.0, -0.5)) / spacing[axis]
        across = np.prod([square for other, square in enumerate(squares) if other != axis])
        total += float((slope**2).sum()) * across / 12.0
    return float(np.sqrt(total))


# --- kernels ----------------------------------------------------------------------------------------------------


@inner_loop
def _sum_deep(values, first, end, row, weights, sums):
    """Weighted sum of a row (nx,) of planes [first, end)."""
    sums[:] = _ZERO
    for n in range(first, end):
        share, source = weights[n - first], values[n, row]
        for x in range(sums.size):
            sums[x] += share * np.float32(source[x])


_sum_stored = by_type(_sum_deep)


@kernel
def _smooth(values, first, low, wanted, along, across, deep, found):
    """Smooth planes [low, low + len(found)) of ``values``, StoredScalars whose plane 0 is plane ``first`` of the
    volume."""
    share_out(_smooth_planes, found.shape[0], (values, first, low, wanted, along, across, deep, found))


@kernel(inner=True)
def _smooth_planes(begin, end, values, first, low, wanted, along, across, deep, found):
    n_z, (_, n_y, n_x) = wanted.shape[0], found.shape
    up, out, beside = deep.size // 2, across.size // 2, along.size // 2
    deep_sums, line = np.empty((n_y, n_x), np.float32), np.zeros(n_x + 2 * beside, np.float32)
    ready = np.empty(n_y, np.bool_)
    middle = line[beside : beside + n_x]
    # What of the Gaussian lies inside, for each x.
    inside = np.zeros(n_x, np.float32)
    for tap in range(along.size):
        for x in range(max(beside - tap, 0), min(n_x + beside - tap, n_x)):
            inside[x] += along[tap]
    for plane in range(begin, end):
        z = low + plane
        z0, z1 = max(z - up, 0), min(z + up, n_z - 1)
        weight_z = _ZERO
        for other in range(z0, z1 + 1):
            weight_z += deep[other - z + up]
        ready[:] = False
        for y in range(n_y):
            if not wanted[z, y]:
                continue
            y0, y1 = max(y - out, 0), min(y + out, n_y - 1)
            weight = _ZERO
            middle[:] = _ZERO
            for row in range(y0, y1 + 1):
                sums = deep_sums[row]
                if not ready[row]:
                    ready[row] = True
                    _sum_stored(values, z0 - first, z1 + 1 - first, row, deep[z0 - z + up :], sums)
                share = across[row - y + out]
                weight += share
                for x in range(n_x):
                    middle[x] += share * sums[x]
            to = found[plane, y]
            to[:] = _ZERO
            for tap in range(along.size):
                share, source = along[tap], line[tap:]
                for x in range(n_x):
                    to[x] += share * source[x]
            weight = _ONE / (weight * weight_z)
            for x in range(n_x):
                to[x] *= weight / inside[x]


@kernel
def _find(squares, smoothed, low, n_z, first, last, wanted, lists, slopes, floor, per_mm, vectors, steep):
    """Fill ``vectors`` and ``steep`` of the voxels of planes [first, last); ``squares``: scratch like ``smoothed``."""
    from_, count = max(first - 1, 0), min(last + 1, n_z) - max(first - 1, 0)
    share_out(_square_planes, count, (from_, smoothed, low, n_z, wanted, slopes, squares))
    share_out(
        _find_rows, (last - first) * smoothed.shape[1],
        (smoothed, squares, low, n_z, first, lists, slopes, floor, per_mm, vectors, steep),
    )  # fmt: skip


@kernel(inline="always")
def _finite(value, here):
    """A neighbor, or the voxel itself in place of one that is not finite."""
    return value if np.abs(value) < np.inf else here


@inner_loop(exact=True)
def _invert_root(square):
    """1 / sqrt(square), rounded twice: the processors' estimate of it differs between makers."""
    return ONE / np.sqrt(square)


@kernel(inner=True)
def _gradient_row(smoothed, low, n_z, z, y, slopes, line, shares, gradient):
    """Gradients of a row: central differences, one-sided at the ends.

    ``line`` (nx + 2,): scratch. ``shares`` (nx,): one over the distance of the neighbors along x. ``gradient``: three
    (nx,) arrays of float32, written. ``slopes``: nine numbers.
    """
    _, n_y, n_x = smoothed.shape
    z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
    here, above, below = smoothed[z - low, y], smoothed[z0 - low, y], smoothed[z1 - low, y]
    north, south = smoothed[z - low, y0], smoothed[z - low, y1]
    across, deep = _ONE / np.float32(max(y1 - y0, 1)), _ONE / np.float32(max(z1 - z0, 1))
    line[0], line[n_x + 1] = here[0], here[n_x - 1]
    line[1 : n_x + 1] = here
    west, east = line[:n_x], line[2:]
    gx, gy, gz = gradient
    for x in range(n_x):
        own = here[x]
        dx = shares[x] * (_finite(east[x], own) - _finite(west[x], own))
        dy = across * (_finite(south[x], own) - _finite(north[x], own))
        dz = deep * (_finite(below[x], own) - _finite(above[x], own))
        known = np.abs(own) < np.inf
        dx, dy, dz = dx if known else _ZERO, dy if known else _ZERO, dz if known else _ZERO
        gx[x] = slopes[0] * dx + slopes[1] * dy + slopes[2] * dz
        gy[x] = slopes[3] * dx + slopes[4] * dy + slopes[5] * dz
        gz[x] = slopes[6] * dx + slopes[7] * dy + slopes[8] * dz


@kernel(inner=True)
def _row_scratch(n_x):
    """``line``, ``shares`` and ``gradient`` of ``_gradient_row``."""
    shares = np.full(n_x, 0.5, np.float32)
    shares[0] = shares[n_x - 1] = _ONE
    gradient = np.empty(n_x, np.float32), np.empty(n_x, np.float32), np.empty(n_x, np.float32)
    return np.empty(n_x + 2, np.float32), shares, gradient


@kernel(inner=True)
def _square_planes(begin, end, from_, smoothed, low, n_z, wanted, slopes, squares):
    """Squared lengths of the gradients of rows that are ``wanted``, of planes [from_ + begin, from_ + end)."""
    _, n_y, n_x = smoothed.shape
    line, shares, gradient = _row_scratch(n_x)
    gx, gy, gz = gradient
    for z in range(from_ + begin, from_ + end):
        for y in range(n_y):
            if wanted[z, y]:
                _gradient_row(smoothed, low, n_z, z, y, slopes, line, shares, gradient)
                to = squares[z - low, y]
                for x in range(n_x):
                    to[x] = gx[x] * gx[x] + gy[x] * gy[x] + gz[x] * gz[x]


@kernel(inner=True)
def _find_rows(begin, end, smoothed, squares, low, n_z, first, lists, slopes, floor, per_mm, vectors, steep):
    """``_find`` for rows [begin, end) of the planes from ``first`` on."""
    (row_start, column), (noise, error, middle) = lists, floor
    _, n_y, n_x = smoothed.shape
    line, shares, gradient = _row_scratch(n_x)
    gx, gy, gz = gradient
    sums = np.zeros(n_x + 2, np.float32)  # begins with voxel -1
    inside, size_of, mm = sums[1 : n_x + 1], np.empty(n_x, np.float32), 1.0 / per_mm
    west, east = sums[:n_x], sums[2:]
    for row in range(begin, end):
        z, y = first + row // n_y, row % n_y
        here = slice(row_start[z * n_y + y], row_start[z * n_y + y + 1])
        xs, found, slope = column[here], vectors[here], steep[here]
        if xs.size == 0:
            continue
        z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
        inside[:] = _ZERO
        for k in range(z0, z1 + 1):
            for j in range(y0, y1 + 1):
                source = squares[k - low, j]
                for x in range(n_x):
                    inside[x] += source[x]
        _gradient_row(smoothed, low, n_z, z, y, slopes, line, shares, gradient)
        rows, values = _ONE / np.float32((z1 - z0 + 1) * (y1 - y0 + 1)), smoothed[z - low, y]
        for x in range(n_x):
            count = _THREE if shares[x] < _ONE else min(np.float32(n_x), _TWO)
            around = (west[x] + inside[x] + east[x]) * rows / count
            least = noise + error * np.abs(values[x] + middle)
            size = gx[x] * gx[x] + gy[x] * gy[x] + gz[x] * gz[x]
            whole = max(around + least * least, size)
            scale = _invert_root(whole) if _ZERO < whole < np.inf else _ZERO
            length = np.sqrt(size)
            gx[x] += max(_LEAST * np.sqrt(around) - length, _ZERO)
            gx[x], gy[x], gz[x] = np.rint(gx[x] * scale), np.rint(gy[x] * scale), np.rint(gz[x] * scale)
            size_of[x] = length
        for i in range(xs.size):
            x = np.uint64(xs[i])
            found[i, 0], found[i, 1], found[i, 2] = np.int16(gx[x]), np.int16(gy[x]), np.int16(gz[x])
            slope[i] = np.float64(size_of[x]) * mm
