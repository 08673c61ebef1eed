"""Normals at a scale, on kept voxels: gradients of the smoothed field, as long as they can be trusted.

Stored values are smoothed by a Gaussian of some millimeters, so that slices far apart leave no rings, and

    m = N / sqrt(R^2 + (NOISE E)^2)

is kept of each voxel, at most 1 long: N is the central difference of the smoothed values, R the root mean square of
its length over the 27 voxels around, and E the length that errors of stored values give it.  So m is about 1 long at a
surface, short where there is little but noise, and passes through 0 where normals turn over, as in the middle of a
wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..runtime.work_sizes import SMOOTHED_AT_ONCE
from . import reference

CUT = 3.0  # standard deviations at which the Gaussian ends
MOST_SMOOTHED = 2.0  # mm, by itself: slices 5 mm apart must not erase vessels
NOISE = 40.0  # times E: gradients from 13 E on are trusted wholly
FLOAT_STEPS = 8.0  # machine epsilons that a computed constant may carry
ONE = np.float32(32767.0)
# Planes that a step smooths beyond its own: a difference, and the mean of its squares.
BEYOND = 2
NATIVE = ("uint8", "int8", "uint16", "int16", "float32")  # types that are smoothed as they are
_ZERO, _ONE, _SHORTEST = np.float32(0.0), np.float32(1.0), np.float32(1e-30)


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
    """Find m of kept voxels.

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

    Yields
    ------
    float
        Fraction done.

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
    for first in range(0, nz, at_once):
        yield first / nz
        last = min(first + at_once, nz)
        if not rows[first:last].any():
            continue
        low, high = max(first - BEYOND, 0), min(last + BEYOND, nz)
        smoothed = smoothing.planes(low, high, smoothed_rows, threads)
        lists = read_only(row_start), read_only(column)
        arguments = (
            smoothed, low, nz, first, last, read_only(wanted), lists, smoothing.slopes, smoothing.noise,
            smoothing.error, smoothing.center, smoothing.per_mm, vectors, steepness,
        )  # fmt: skip
        if compiled():
            squares = empty(smoothed.shape, np.float32)
            with parallel_call(threads):
                _find(squares, *arguments)
        else:
            reference.find_surfaces(*arguments)
    return Surfaces(read_only(vectors), read_only(steepness))


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
    slopes : tuple of float
        The matrix, row by row, that makes differences per voxel a gradient per mm in the volume's own space.
    noise : float
        Squared: NOISE times E of integers; of floats, times machine epsilons of the value, whose factor is ``error``.
    error : float
    per_mm : float
        What a scaled gradient's length is divided by.
    """

    voxels: np.ndarray
    taps: tuple
    center: float
    scale: float
    slopes: tuple
    noise: float
    error: float
    per_mm: float

    @classmethod
    def of(cls, volume, sigma: float) -> Smoothing:
        voxels = np.asarray(volume.voxels)
        spacing = np.asarray(volume.spacing, np.float64)
        taps = [gaussian(sigma, distance) for distance in spacing]
        directions = np.asarray(volume.affine, np.float64)[:3, :3] / spacing
        slopes = np.linalg.inv(directions).T / spacing
        noise = NOISE * noise_of_gradient(taps, spacing)
        center, scale, error = 0.0, 1.0, 0.0
        if voxels.dtype.kind == "f" or voxels.dtype.name not in NATIVE:
            low, high = sorted((value - volume.intercept) / volume.slope for value in volume.value_range)
            center = 0.0 if voxels.dtype.name in NATIVE else 0.5 * (low + high)
            largest = max(abs(low - center), abs(high - center))
            scale = 1.0 / largest if 0.0 < largest < np.inf else 1.0
        if voxels.dtype.kind == "f":
            error, noise = noise * FLOAT_STEPS * float(np.finfo(voxels.dtype).eps), 0.0
        return cls(
            voxels, tuple(read_only(each.astype(np.float32)) for each in taps), center, scale,
            tuple(slopes.ravel().tolist()), noise * scale, error, scale,
        )  # fmt: skip

    def planes(self, low: int, high: int, wanted: np.ndarray, threads: int) -> np.ndarray:
        """(high - low, ny, nx) float32: smoothed planes [low, high), of rows that are ``wanted`` (nz, ny); NaN where no
        voxel is finite.

        Voxels outside the volume and such that are not finite are left out, and the rest is divided by its weights
        (normalized convolution, Knutsson and Westin 1993).
        """
        reach = self.taps[2].size // 2
        first, last = max(low - reach, 0), min(high + reach, len(self.voxels))
        values, holes = self.voxels[first:last], None
        if values.dtype.name not in NATIVE or (values.dtype.kind == "f" and self.scale != 1.0):
            values = ((values.astype(np.float64) - self.center) * self.scale).astype(np.float32)
        if values.dtype.kind == "f":
            finite = np.isfinite(values)
            if not finite.all():
                values, holes = np.where(finite, values, _ZERO), finite.astype(np.uint8)
        found = self._smoothed(values, first, low, high, wanted, threads)
        if holes is not None:
            weights = self._smoothed(holes, first, low, high, wanted, threads)
            with np.errstate(invalid="ignore", divide="ignore"):
                found = np.where(weights > 1e-6, found / weights, np.float32(np.nan))
        return found

    def _smoothed(self, values, first, low, high, wanted, threads):
        found = empty((high - low, *values.shape[1:]), np.float32)
        arguments = (read_only(np.ascontiguousarray(values)), first, low, read_only(wanted), *self.taps, found)
        if compiled():
            with parallel_call(threads):
                _smooth(*arguments)
        else:
            reference.smooth(*arguments)
        return found


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


@kernel
def _smooth(values, first, low, wanted, along, across, deep, found):
    """Smooth planes [low, low + len(found)) of ``values``, whose plane 0 is plane ``first`` of the volume."""
    share_out(_smooth_planes, found.shape[0], (values, first, low, wanted, along, across, deep, found))


@kernel(inner=True)
def _smooth_planes(begin, end, values, first, low, wanted, along, across, deep, found):
    n_z, (_, n_y, n_x) = wanted.shape[0], values.shape
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
                    sums[:] = _ZERO
                    for other in range(z0, z1 + 1):
                        share, source = deep[other - z + up], values[other - first, row]
                        for x in range(n_x):
                            sums[x] += share * np.float32(source[x])
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
def _find(
    squares, smoothed, low, n_z, first, last, wanted, lists, slopes, noise, error, center, per_mm, vectors, steep
):
    """Fill ``vectors`` and ``steep`` of the voxels of planes [first, last); ``squares``: scratch like ``smoothed``."""
    from_, count = max(first - 1, 0), min(last + 1, n_z) - max(first - 1, 0)
    share_out(_square_planes, count, (from_, smoothed, low, n_z, wanted, slopes, squares))
    share_out(
        _find_rows, (last - first) * smoothed.shape[1],
        (smoothed, squares, low, n_z, first, lists, slopes, noise, error, center, per_mm, vectors, steep),
    )  # fmt: skip


@kernel(inline="always")
def _difference(before, after, here, count):
    """Change per voxel between two neighbors ``count`` apart; one that is not finite counts as ``here``."""
    a = before if np.abs(before) < np.inf else here
    b = after if np.abs(after) < np.inf else here
    return (b - a) / count


@kernel(inner=True)
def _square_planes(begin, end, from_, smoothed, low, n_z, wanted, slopes, squares):
    """Squared lengths of the gradients of rows that are ``wanted``, of planes [from_ + begin, from_ + end)."""
    _, n_y, n_x = smoothed.shape
    for z in range(from_ + begin, from_ + end):
        plane = z - low
        above, below = max(z - 1, 0) - low, min(z + 1, n_z - 1) - low
        deep = np.float32(max(below - above, 1))
        for y in range(n_y):
            if not wanted[z, y]:
                continue
            y0, y1 = max(y - 1, 0), min(y + 1, n_y - 1)
            across = np.float32(max(y1 - y0, 1))
            row, to = smoothed[plane, y], squares[plane, y]
            north, south, near, far = (
                smoothed[plane, y0], smoothed[plane, y1], smoothed[above, y], smoothed[below, y]
            )  # fmt: skip
            for x in range(n_x):
                x0, x1 = max(x - 1, 0), min(x + 1, n_x - 1)
                to[x] = _squared(_gradient(
                    row[x0], row[x1], north[x], south[x], near[x], far[x], row[x], np.float32(max(x1 - x0, 1)), across,
                    deep, slopes,
                ))  # fmt: skip


@kernel(inline="always")
def _gradient(west, east, north, south, near, far, here, along, across, deep, slopes):
    gx = np.float64(_difference(west, east, here, along))
    gy = np.float64(_difference(north, south, here, across))
    gz = np.float64(_difference(near, far, here, deep))
    known = np.abs(here) < np.inf
    gx, gy, gz = gx if known else 0.0, gy if known else 0.0, gz if known else 0.0
    return (
        slopes[0] * gx + slopes[1] * gy + slopes[2] * gz,
        slopes[3] * gx + slopes[4] * gy + slopes[5] * gz,
        slopes[6] * gx + slopes[7] * gy + slopes[8] * gz,
    )


@kernel(inline="always")
def _squared(vector):
    x, y, z = vector
    return np.float32(x * x + y * y + z * z)


@kernel(inner=True)
def _find_rows(
    begin, end, smoothed, squares, low, n_z, first, lists, slopes, noise, error, center, per_mm, vectors, steep
):
    """``_find`` for rows [begin, end) of the planes from ``first`` on."""
    row_start, column = lists
    _, n_y, n_x = smoothed.shape
    sums = np.zeros(n_x + 2, np.float32)  # begins with voxel -1
    for row in range(begin, end):
        z, y = first + row // n_y, row % n_y
        from_, to = row_start[z * n_y + y], row_start[z * n_y + y + 1]
        if from_ == to:
            continue
        z0, z1, y0, y1 = max(z - 1, 0), min(z + 1, n_z - 1), max(y - 1, 0), min(y + 1, n_y - 1)
        inside = sums[1 : n_x + 1]
        inside[:] = _ZERO
        for k in range(z0, z1 + 1):
            for j in range(y0, y1 + 1):
                source = squares[k - low, j]
                for x in range(n_x):
                    inside[x] += source[x]
        rows = (z1 - z0 + 1) * (y1 - y0 + 1)
        here, above, below = smoothed[z - low, y], smoothed[z0 - low, y], smoothed[z1 - low, y]
        north, south = smoothed[z - low, y0], smoothed[z - low, y1]
        across, deep = np.float32(max(y1 - y0, 1)), np.float32(max(z1 - z0, 1))
        for i in range(from_, to):
            x = np.int64(column[i])
            x0, x1 = max(x - 1, 0), min(x + 1, n_x - 1)
            gx, gy, gz = _gradient(
                here[x0], here[x1], north[x], south[x], above[x], below[x], here[x], np.float32(max(x1 - x0, 1)),
                across, deep, slopes,
            )  # fmt: skip
            around = np.float64(sums[x] + sums[x + 1] + sums[x + 2]) / (rows * (x1 - x0 + 1))
            least = noise + error * abs(np.float64(here[x]) + center * per_mm)
            size = gx * gx + gy * gy + gz * gz
            whole = max(around + least * least, size)
            scale = np.float64(ONE) / np.sqrt(whole) if 0.0 < whole < np.inf else 0.0
            vectors[i, 0] = np.int16(np.rint(gx * scale))
            vectors[i, 1] = np.int16(np.rint(gy * scale))
            vectors[i, 2] = np.int16(np.rint(gz * scale))
            steep[i] = np.float32(np.sqrt(size) / per_mm)
