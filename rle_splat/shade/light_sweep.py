"""Transmittance from a light to each voxel: a front-to-back sweep of run-length encoded extinction from the light.

This is the splat again (algorithm.md 4.2), of one channel instead of four. The sheet holds the optical depth
along each ray of light so far; the footprint is the tent. Before a slice is added, the sheet is interpolated at each of
its voxels, half of the voxel's own depth is added, and the transmittance is written. Bands of sheet rows are
independent, except for the row where two meet, which both compute.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference
from .light_sheets import Sweep
from .reference import FULL

BAND = 8  # sheet rows that one worker sweeps at once: through 512 slices of 512 voxels in less than 30 ms
TENT = 1.0  # voxels that a slice reaches beyond its outermost ones
LOG2E = np.float32(1.0 / math.log(2.0))
MOST = np.float32(64.0)  # optical depth in powers of two, at which nothing is left
# 2**r - 1 on [-1/2, 1/2]: Taylor terms ln(2)**n / n!; the truncation error is a hundredth of a code.
TERMS = tuple(np.float32(math.log(2.0) ** n / math.factorial(n)) for n in range(1, 7))
T1, T2, T3, T4, T5, T6 = TERMS
_ZERO, _ONE, _HALF, _FULL = np.float32(0.0), np.float32(1.0), np.float32(0.5), np.float32(FULL)


def sweep_light(sweep: Sweep, tables, starts, extinction, meshes, codes, *, threads: int = 0) -> None:
    """Write the transmittance from a light to the voxels that a sweep lights; other voxels are not changed.

    Parameters
    ----------
    tables : RunTables
        Of the sweep's axis.
    starts : (n_slices, n_scanlines) ndarray of int64
        First entry of each scanline in ``extinction`` and ``codes``.
    extinction : (m,) ndarray of float32
        1 / world length.
    meshes : (height, width, samples) ndarray of float32 or None
        Distances in slices from the sweep's first slice to the first mesh, ascending, on the rays of each sheet pixel.
    codes : (m,) ndarray of uint16
        Output: FULL times the transmittance, rounded.
    threads : int
        0 for one per core.
    """
    geometry = (sweep.slices, sweep.scale, sweep.offset_x, sweep.offset_y, sweep.before, sweep.whole, sweep.spans)
    arrays = (tables.scanline_pointers, tables.runs, starts, extinction)
    if not compiled():
        reference.sweep_light(sweep, tables, starts, extinction, meshes, codes)
        return
    held = tuple(read_only(array) for array in arrays)
    with parallel_call(threads):
        _sweep(geometry, sweep.skipped, held, meshes, sweep.width, sweep.height, tables.width, sweep.length, codes)


@kernel
def _sweep(geometry, skipped, held, meshes, width, height, n_voxels, length, codes):
    """Kernel of ``sweep_light``.

    ``geometry``: arrays slices, scale, offset_x, offset_y, before, whole, spans of a Sweep; ``skipped``, ``width``,
    ``height``, ``length``: its other fields. ``held``: scanline pointers, runs, starts, extinction. ``n_voxels``: per
    scanline.
    """
    bands = (height + BAND - 1) // BAND
    share_out(_sweep_bands, bands, (geometry, skipped, held, meshes, width, height, n_voxels, length, codes))


@kernel(inner=True)
def _sweep_bands(begin, end, geometry, skipped, held, meshes, width, height, n_voxels, length, codes):
    """``_sweep`` for bands [begin, end) of sheet rows."""
    slices, scales, offsets_x, offsets_y, before, whole, spans = geometry
    pointers = held[0]
    line = np.zeros(n_voxels + 3, np.float32)  # begins with voxel -1
    depth = np.empty((BAND + 1, width), np.float32)
    lit = np.empty((0 if meshes is None else BAND + 1, width), np.float32)
    for band in range(begin, end):
        top = band * BAND
        rows = min(BAND + 1, height - top)
        depth[:] = _ZERO
        if meshes is not None:
            lit[:] = _ONE
        for n in range(slices.size):
            k, scale, offset_x, offset_y = slices[n], scales[n], offsets_x[n], offsets_y[n]
            if meshes is not None:
                _pass_meshes(meshes, top, rows, np.float32(n), lit)
            first = max(math.floor((top - offset_y) / scale) - 1, spans[n, 2])
            last = min(math.ceil((top + BAND - offset_y) / scale) + 1, spans[n, 3])
            for j in range(first, last):
                if pointers[k, j] < 0:
                    continue
                y = scale * j + offset_y
                row = math.floor(y) - top
                if 0 <= row < BAND:
                    below = depth[row : row + 2]
                    _read_line(
                        held,
                        k,
                        j,
                        (scale, offset_x, y, np.float32(y - top - row)),
                        spans[n],
                        before[n],
                        length,
                        below,
                        None if meshes is None else lit[row : row + 2],
                        codes,
                    )
            if n < skipped:
                continue
            n -= skipped
            layer = (slices[n], scales[n], offsets_x[n], offsets_y[n], whole[n])
            add_slice(held, layer, top, rows, n_voxels, TENT, line, depth)


@kernel(inner=True)
def add_slice(held, layer, top, rows, n_voxels, reach, line, depth):
    """Add the optical depth of a slice to ``rows`` rows of the sheet from row ``top`` on.

    ``layer``: number of the slice, its map to the sheet and its weight. ``reach``: voxels, how far beyond its outermost
    voxels the slice reaches. ``line``: zeros, (n_voxels + 3,).
    """
    k, scale, offset_x, offset_y, whole = layer
    pointers = held[0]
    n_lines = pointers.shape[1]
    for row in range(rows):
        v = (top + row - offset_y) / scale
        if not -reach < v < n_lines - 1.0 + reach:
            continue
        j = math.floor(v)
        share = np.float32(v - j)
        least, most = n_voxels, -1
        for far in range(2):
            weight = share if far else _ONE - share
            at = j + far
            if 0 <= at < n_lines and weight > _ZERO and pointers[k, at] >= 0:
                least, most = _add_line(held, k, at, weight * whole, n_voxels, least, most, line)
        if most >= 0:
            _add_row(
                line, scale, offset_x, max(least - 1.0, -reach), min(most + 1.0, n_voxels - 1.0 + reach), depth[row]
            )
            line[least + 1 : most + 2] = _ZERO


@kernel(inner=True)
def _pass_meshes(meshes, top, rows, reached, lit):
    """Share of each sheet pixel's rays that meet no mesh before the slice ``reached``, to ``lit``."""
    samples = meshes.shape[2]
    for row in range(rows):
        for x in range(lit.shape[1]):
            if meshes[top + row, x, 0] <= reached:
                met = 1
                while met < samples and meshes[top + row, x, met] <= reached:
                    met += 1
                lit[row, x] = _ONE - np.float32(met) / np.float32(samples)


@kernel(inner=True)
def _add_line(held, k, j, weight, n_voxels, least, most, line):
    """Add ``weight`` times a scanline's extinction to ``line``, which begins with voxel -1.

    Returns the first and last voxel that any scanline has added so far.
    """
    pointers, runs, starts, extinction = held
    run = np.int64(pointers[k, j])
    data = starts[k, j]
    x = np.int64(0)
    while x < n_voxels:
        x += np.int64(runs[run])
        run += 1
        if x >= n_voxels:
            break
        count = np.int64(runs[run])
        run += 1
        here, there = line[x + 1 : x + 1 + count], extinction[data : data + count]
        for i in range(count):
            here[i] += weight * there[i]
        least = min(least, x)
        x += count
        data += count
        most = max(most, x - 1)
    return least, most


@kernel(inner=True)
def _add_row(line, scale, offset_x, least, most, depth):
    """Add what ``line`` is from ``least`` to ``most``, in voxels, to a row of the sheet."""
    first = max(math.ceil(scale * least + offset_x), 0)
    last = min(math.floor(scale * most + offset_x) + 1, depth.size)
    if first >= last:
        return
    if scale == 1.0:
        u = first - offset_x
        cell = math.floor(u)
        share = np.float32(u - cell)
        to, left, right = depth[first:last], line[cell + 1 :], line[cell + 2 :]
        for i in range(last - first):
            to[i] += (_ONE - share) * left[i] + share * right[i]
        return
    inverse = 1.0 / scale
    for x in range(first, last):
        u = max((x - offset_x) * inverse + 1.0, 0.0)
        cell = int(u)
        share = np.float32(u - cell)
        depth[x] += (_ONE - share) * line[cell] + share * line[cell + 1]


@kernel(inner=True)
def _read_line(held, k, j, line_map, span, before, length, depth, lit, codes):
    """Codes of the voxels of a scanline, from the two rows of the sheet around it.

    ``line_map``: scale and offset along the scanline; its sheet row; distance of that from the upper of the two rows.
    ``lit``: share of the light that meshes let through in the two rows; None without meshes.
    """
    pointers, runs, starts, extinction = held
    scale, offset_x, y, down = line_map
    up = _ONE - down
    c = length[0] + y * (length[2] + y * length[5])
    cx, cxx = length[1] + y * length[4], length[3]
    alike = cx == 0.0 and cxx == 0.0  # parallel light: all rays have the same length
    far = np.float32(math.sqrt(c)) * LOG2E
    run = np.int64(pointers[k, j])
    data = starts[k, j]
    x = np.int64(0)
    while x < span[1]:
        x += np.int64(runs[run])
        run += 1
        if x >= span[1]:
            break
        count = np.int64(runs[run])
        run += 1
        skip = max(span[0] - x, 0)
        i = x + skip
        n = min(x + count, span[1]) - i
        if n > 0:
            own, to = extinction[data + skip : data + skip + n], codes[data + skip : data + skip + n]
            if scale == 1.0 and alike and lit is None:
                u = i + offset_x
                cell = math.floor(u)
                right = np.float32(u - cell)
                upper, lower = depth[0, cell:], depth[1, cell:]
                for m in range(n):
                    left_sum, right_sum = up * upper[m] + down * lower[m], up * upper[m + 1] + down * lower[m + 1]
                    tau = (left_sum + right * (right_sum - left_sum) + before * own[m]) * far
                    to[m] = np.uint16(transmit(tau) * _FULL + _HALF)
            else:
                for m in range(n):
                    u = scale * (i + m) + offset_x
                    cell = int(u)
                    right = np.float32(u - cell)
                    left_sum = up * depth[0, cell] + down * depth[1, cell]
                    right_sum = up * depth[0, cell + 1] + down * depth[1, cell + 1]
                    long = np.float32(math.sqrt(max(c + u * (cx + u * cxx), 0.0))) * LOG2E
                    passed = transmit((left_sum + right * (right_sum - left_sum) + before * own[m]) * long)
                    if lit is not None:
                        left_lit = up * lit[0, cell] + down * lit[1, cell]
                        right_lit = up * lit[0, cell + 1] + down * lit[1, cell + 1]
                        passed *= left_lit + right * (right_lit - left_lit)
                    to[m] = np.uint16(passed * _FULL + _HALF)
        x += count
        data += count


@kernel(inline="always")
def transmit(tau2):
    """2 ** -tau2 for tau2 >= 0; absolute error at most about 2e-7."""
    tau2 = min(tau2, MOST)
    whole = np.int32(tau2 + _HALF)
    r = np.float32(whole) - tau2
    p = r * (T1 + r * (T2 + r * (T3 + r * (T4 + r * (T5 + r * T6)))))
    power = np.int32((np.int32(127) - whole) << np.int32(23)).view(np.float32)
    return power + power * p
