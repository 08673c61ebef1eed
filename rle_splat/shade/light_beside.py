"""Transmittance from a light to a point beside each voxel.

The sheet is that of ``light_sweep``: it holds the optical depth D(n) along each ray of light before slice n.  A point
lies between two slices, n and n + 1, at f in [0, 1) of the way, and extinction changes linearly between them, so that

    depth = (1 - f)^2 / 2 D(n) + (1/2 + f (1 - f)) D(n + 1) + f^2 / 2 D(n + 2)

times the length between two slices, each D interpolated in its sheet: the quadratic B-spline is the integral of the
linear one.  Before the first slice nothing has been taken from the light, beyond the last one nothing more is, and the
slices end at their outermost voxels.  Voxels
are sorted by n and by the band of sheet rows that their points lie in, so that each is read while the three sheets are
there, by the worker that has them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only, thread_count
from ..runtime.parallel import share_out
from . import reference
from .light_sheets import Sweep
from .light_sweep import BAND, LOG2E, add_slice, transmit
from .reference import BOXED, FULL
from .surface_points import STEPS

SORTED_AT_ONCE = 1 << 17  # voxels of a part that is sorted by one worker; 2 ms
MOST_PARTS = 64
AT_ONCE = 1 << 19  # voxels that a worker sorts or reads between two chances to cancel, 10 ms
_ZERO, _ONE, _HALF, _FULL = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(FULL)


class Sorted(NamedTuple):
    """Points that a sweep lights, by band of sheet rows and by slice, else in the order of the voxels.

    Attributes
    ----------
    first : (bands, slices + 1) ndarray of int64
        First entry of each band and slice.
    voxel : (n,) ndarray of uint32
        Number of the voxel.
    place : (n, 3) ndarray of float32
        Sheet pixel X and Y, and slices behind the slice; negative before the first slice, and above 1 behind the last.
    """

    first: np.ndarray
    voxel: np.ndarray
    place: np.ndarray


def light_beside_steps(
    sweep: Sweep, tables, starts, extinction, meshes, voxels: VisibleVoxels, offsets, matrix, codes, *, threads: int = 0
):
    """Write the transmittance from a light to points beside voxels, of those points that a sweep reaches.

    Parameters
    ----------
    sweep : Sweep
        Of a pyramid: made ``beside`` voxels. Each point is in one of the pyramids of a light.
    tables, starts, extinction, meshes
        As ``light_sweep.sweep_light`` takes them.
    voxels : VisibleVoxels
    offsets : (m, 3) ndarray of int16
        From the voxels to their points along x, y, z, in STEPS of a voxel.
    matrix : (4, 4) ndarray of float64
        Voxel index (x, y, z) to world.
    codes : (m,) ndarray of uint16
        Output, in the order of ``voxels``: FULL times the transmittance, rounded.
    threads : int
        0 for one per core.

    Yields
    ------
    float
        Fraction done.
    """
    place = sweep.to_sheet @ matrix  # of voxel indices
    if not compiled():
        reference.light_beside(sweep, tables, starts, extinction, meshes, voxels, offsets / STEPS, place, codes)
        return
    found = yield from _sort_steps(sweep, voxels, offsets, place, threads)
    layers = (sweep.slices, sweep.scale, sweep.offset_x, sweep.offset_y, sweep.whole)
    held = tuple(read_only(array) for array in (tables.scanline_pointers, tables.runs, starts, extinction))
    bands, at_once = len(found.first), _at_once(len(found.first), len(found.voxel), threads)
    for first in range(0, bands, at_once):
        yield 0.5 + 0.5 * first / bands
        count = min(at_once, bands - first)
        with parallel_call(threads):
            _light_bands(
                first, count, layers, held, meshes, sweep.width, sweep.height, tables.width, sweep.length, found, codes
            )


def _at_once(parts: int, voxels: int, threads: int) -> int:
    """How many of the parts, which have so many voxels together, a step of the generators handles."""
    return max(AT_ONCE * parts // max(voxels, 1), 1) * thread_count(threads)


def _sort_steps(sweep: Sweep, voxels: VisibleVoxels, offsets, place, threads: int):
    """Generator of fractions up to 1/2: the Sorted points of a sweep; ``place`` (4, 4): voxel indices to its sheet."""
    parts = min(max(len(voxels) // SORTED_AT_ONCE, 1), MOST_PARTS)
    # Parts are whole rows of about as many voxels.
    ends = np.searchsorted(voxels.row_start, np.linspace(0, len(voxels), parts + 1)[1:-1])
    ends = np.concatenate(([0], ends, [len(voxels.row_start) - 1])).astype(np.int64)
    bands, slices = -(-(sweep.height - 1) // BAND), len(sweep.slices)
    source = (0.0, 0.0, 0.0) if sweep.source is None else tuple(sweep.source.tolist())
    sheet = (tuple(place.ravel().tolist()), source, sweep.side, slices, sweep.width, sweep.height)
    lists = (read_only(voxels.row_start), read_only(voxels.column), offsets, voxels.shape_xyz[1])
    to = np.zeros((parts, bands * slices), np.int64)
    voxel, found, at_once = np.empty(0, np.uint32), np.empty((0, 3), np.float32), _at_once(parts, len(voxels), threads)
    for filling in range(2):
        for begin in range(0, parts, at_once):
            yield 0.25 * (filling + begin / parts)
            with parallel_call(threads):
                _sort(begin, min(at_once, parts - begin), lists, ends, sheet, to, voxel, found)
        if filling:
            break
        # From counts to first entries: those of a band and slice together, in the order of the parts.
        counts, n = to.sum(axis=0), 0
        first = np.zeros(counts.size + 1, np.int64)
        np.cumsum(counts, out=first[1:])
        to = np.cumsum(to, axis=0) - to + first[:-1]
        n = int(first[-1])
        voxel, found = empty(n, np.uint32), empty((n, 3), np.float32)
        if n == 0:
            break
    first = np.stack([first[b * slices : (b + 1) * slices + 1] for b in range(bands)])
    return Sorted(first, voxel, found)


# --- kernels ----------------------------------------------------------------------------------------------------


@kernel
def _sort(begin, count, lists, ends, sheet, to, voxel, found):
    """Count the points of parts [begin, begin + count) by band and slice, or write them, if there is room for any.

    ``lists``: row_start, column, offsets, number of y. ``ends`` (parts + 1,): rows of the parts. ``sheet``: the map to
    it, row by row, and source, side, number of slices, width and height. ``to`` (parts, bands * slices): counts, then
    entries to be written next.
    """
    share_out(_sort_parts, count, (begin, lists, ends, sheet, to, voxel, found))


@kernel(inner=True)
def _sort_parts(begin, end, first, lists, ends, sheet, to, voxel, found):
    row_start, column, offsets, n_y = lists
    m, source, side, slices, width, height = sheet
    step, filling = 1.0 / STEPS, voxel.size > 0
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    for part in range(first + begin, first + end):
        own = to[part]
        for row in range(ends[part], ends[part + 1]):
            y0, z0 = np.float64(row % n_y), np.float64(row // n_y)
            begin_row = row_start[row]
            # Slices start at zero, so the compiler knows that no index is negative.
            xs, moved = column[begin_row : row_start[row + 1]], offsets[begin_row : row_start[row + 1]]
            for i in range(xs.size):
                x, y, z = xs[i] + step * moved[i, 0], y0 + step * moved[i, 1], z0 + step * moved[i, 2]
                if side >= 0 and _pyramid_of(x - source[0], y - source[1], z - source[2]) != side:
                    continue
                along = 1.0
                if side >= 0:
                    along = 1.0 / (m[8] * x + m[9] * y + m[10] * z + m[11])
                u = np.float32((m[0] * x + m[1] * y + m[2] * z + m[3]) * along)
                v = np.float32((m[4] * x + m[5] * y + m[6] * z + m[7]) * along)
                s = m[12] * x + m[13] * y + m[14] * z + m[15]
                # Rays beside the sheet pass no voxel, nor do those on its border.
                u, v = min(max(u, _ZERO), right), min(max(v, _ZERO), bottom)
                n = np.int64(min(max(s, 0.0), slices - 1.0))
                bucket = np.uint64(min(np.int64(v), height - 2) // BAND * slices + n)
                k = np.uint64(own[bucket])
                own[bucket] += 1
                if filling:
                    voxel[k] = begin_row + i
                    found[k, 0], found[k, 1], found[k, 2] = u, v, np.float32(s - n)


@kernel(inline="always")
def _pyramid_of(x, y, z):
    """Side of the pyramid that a point is in, seen from the light: as ``Sweep.side``; -1 at the light itself."""
    a, b, c = abs(x), abs(y), abs(z)
    if a >= b and a >= c:
        return -1 if a == 0.0 else 1 if x > 0.0 else 0
    if b >= c:
        return 3 if y > 0.0 else 2
    return 5 if z > 0.0 else 4


@kernel
def _light_bands(first, count, layers, held, meshes, width, height, n_voxels, length, points, codes):
    """Sweep bands [first, first + count) of sheet rows; arguments as of ``light_sweep._sweep``.

    ``layers``: slices, scale, offset_x, offset_y, whole of a Sweep. ``points``: Sorted.
    """
    share_out(_light_some, count, (first, layers, held, meshes, width, height, n_voxels, length, points, codes))


@kernel(inner=True)
def _light_some(begin, end, from_, layers, held, meshes, width, height, n_voxels, length, points, codes):
    """``_light_bands`` for some of them."""
    slices, scales, offsets_x, offsets_y, whole = layers
    n_slices = slices.size
    line = np.zeros(n_voxels + 3, np.float32)
    depth = np.empty((3, BAND + 1, width), np.float32)  # D(n) is in sheet n % 3
    for band in range(from_ + begin, from_ + end):
        top, first = band * BAND, points.first[band]
        rows = min(BAND + 1, height - top)
        last = n_slices - 1
        while last >= 0 and first[last] == first[last + 1]:
            last -= 1
        if last < 0:
            continue
        # The first slice weighs less than 1 where the medium begins, or where the light is right before it.
        depth[0] = _ZERO
        if whole[0] != _ONE:
            layer = (slices[0], scales[0], offsets_x[0], offsets_y[0], whole[0] - _ONE)
            add_slice(held, layer, top, rows, n_voxels, BOXED, line, depth[0])
        for n in range(min(last + 2, n_slices)):
            after = depth[(n + 1) % 3]
            after[:] = depth[n % 3]
            layer = (slices[n], scales[n], offsets_x[n], offsets_y[n], _ONE)
            add_slice(held, layer, top, rows, n_voxels, BOXED, line, after)
            if n > 0 and first[n - 1] < first[n]:
                sheets = (depth[(n - 1) % 3], depth[n % 3], after)
                _read(
                    first[n - 1], first[n], np.float32(n - 1), _ONE, top, height, sheets, length, meshes, points, codes
                )
        if last == n_slices - 1:
            sheets = (depth[last % 3], depth[(last + 1) % 3], depth[(last + 1) % 3])
            _read(
                first[last],
                first[last + 1],
                np.float32(last),
                _ZERO,
                top,
                height,
                sheets,
                length,
                meshes,
                points,
                codes,
            )


@kernel(inner=True)
def _read(begin, end, n, most, top, height, sheets, length, meshes, points, codes):
    """Codes of entries [begin, end) of ``points``, which lie behind slice ``n``, by at most ``most`` as far as voxels
    are concerned; ``sheets``: D(n), D(n + 1), D(n + 2)."""
    a, b, c = sheets
    # Of unsigned indices the compiler knows that they are not negative.
    width, last_y, top_y, one = np.uint64(a.shape[1]), np.uint64(height - 2), np.uint64(top), np.uint64(1)
    alike = not length[1:].any()  # parallel light: all rays have the same length
    long = np.float32(math.sqrt(length[0])) * LOG2E
    places, voxels = points.place[begin:end], points.voxel[begin:end]
    for k in range(voxels.size):
        u, v, f = places[k, 0], places[k, 1], places[k, 2]
        x, y = min(np.uint64(u), width - np.uint64(2)), min(np.uint64(v), last_y)
        right, down, i, j = u - np.float32(x), v - np.float32(y), y - top_y, x + one
        g = min(max(f, _ZERO), most)
        wa, wc = _HALF * (_ONE - g) * (_ONE - g), _HALF * g * g
        wb = _ONE - wa - wc
        upper = wa * a[i, x] + wb * b[i, x] + wc * c[i, x]
        upper += right * (wa * a[i, j] + wb * b[i, j] + wc * c[i, j] - upper)
        i += one
        lower = wa * a[i, x] + wb * b[i, x] + wc * c[i, x]
        lower += right * (wa * a[i, j] + wb * b[i, j] + wc * c[i, j] - lower)
        tau = max(upper + down * (lower - upper), _ZERO) if f >= _ZERO else _ZERO
        if not alike:
            linear = length[0] + u * (length[1] + u * length[3])
            long = np.float32(math.sqrt(max(linear + v * (length[2] + u * length[4] + v * length[5]), 0.0))) * LOG2E
        passed = transmit(tau * long)
        if meshes is not None:
            s = n + f
            near, far = _share(meshes, y, x, s), _share(meshes, y + one, x, s)
            near += right * (_share(meshes, y, j, s) - near)
            far += right * (_share(meshes, y + one, j, s) - far)
            passed *= near + down * (far - near)
        codes[np.uint64(voxels[k])] = np.uint16(passed * _FULL + _HALF)


@kernel(inline="always")
def _share(meshes, y, x, reached):
    """Share of a sheet pixel's rays that meet no mesh before the slice ``reached``."""
    samples = meshes.shape[2]
    met = 0
    while met < samples and meshes[y, x, met] <= reached:
        met += 1
    return _ONE - np.float32(met) / np.float32(samples)
