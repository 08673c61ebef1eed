"""Light on the nodes of a grid, and light beside voxels, read from it.

Nodes lie ``pitch`` voxels apart: on every voxel, or in the middle of every cube of 2 x 2 x 2.  Beyond the volume is one
more layer on each side.  The sheet of a sweep is that of ``light_sweep``: it holds the sum D(n) of extinction along
each ray of light before slice n.  At a node of slice n it is that before its slice and half of what the slice takes,
or less where the slice before takes little,

    D(n) + min(D(n + 1) - D(n), RISE (D(n) - D(n - 1))) / 2,

interpolated in the sheet, times the length between two slices.  Before the first slice nothing has been taken from the
light, and slices end at their outermost voxels.  The light at a point beside a voxel is interpolated trilinearly
between the eight nodes around it, and the point is as many nodes away as it would be voxels.  Some of these nodes lie
in the surface, more or less deep: with half of every slice, balls with an opacity step ripple by 3 to 7 %, so by 0.2.
Lights of several samples share a grid: each sample takes from it, at most as much as it gives.
"""

from __future__ import annotations

import math

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only, thread_count
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from . import reference
from .light_sheets import Sweep
from .light_sweep import BAND, LOG2E, add_slice, transmit
from .node_block import BLOCK, read_block
from .reference import BOXED, FULL, RISE
from .surface_points import STEPS, Points, lamp_from_row, row_pieces, towards_lamp

NODES_AT_ONCE = 1 << 20  # nodes that a worker lights between two chances to cancel, 10 ms
FILLED_AT_ONCE = 1 << 21  # nodes that are filled between two chances to cancel, 9 ms in memory that was never used
READ_AT_ONCE = 1 << 18  # voxels that a worker reads the light of between two chances to cancel, 10 ms
_ZERO, _ONE, _HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)


def lit_nodes_steps(shape_xyz):
    """Generator of fractions: the nodes of a grid of so many and of the layer around it, FULL of light.

    Returns (nz + 2, ny + 2, nx + 2) ndarray of uint16.
    """
    nodes = empty([n + 2 for n in shape_xyz[::-1]], np.uint16)
    at_once = max(FILLED_AT_ONCE // nodes[0].size, 1)
    for first in range(0, len(nodes), at_once):
        yield first / len(nodes)
        nodes[first : first + at_once] = FULL
    return nodes


def shade_nodes_steps(sweep: Sweep, tables, starts, extinction, meshes, matrix, nodes, share: int, *, threads: int = 0):
    """Generator of fractions done: take from the nodes that a sweep reaches what does not arrive at them.

    Parameters
    ----------
    sweep : Sweep
        Of a pyramid: made for ``nodes``. Each node is in one of the pyramids of a light.
    tables, starts, extinction, meshes
        As ``light_sweep.sweep_light`` takes them.
    matrix : (4, 4) ndarray of float64
        Node (x, y, z) to world.
    nodes : (nz + 2, ny + 2, nx + 2) ndarray of uint16
        Updated: ``share`` times the light that is blocked, rounded, is subtracted.
    share : int
        What the light gives to a node that nothing shades.
    threads : int
        0 for one per core.
    """
    place = sweep.to_sheet @ matrix
    if not compiled():
        reference.shade_nodes(sweep, tables, starts, extinction, meshes, place, nodes, share)
        return
    layers = _layers(sweep, place)
    held = tuple(read_only(array) for array in (tables.scanline_pointers, tables.runs, starts, extinction))
    a, b, c = AXES[sweep.axis]
    counts, strides = nodes.shape[::-1], [stride // nodes.itemsize for stride in nodes.strides[::-1]]
    source = (0.0, 0.0, 0.0) if sweep.source is None else tuple(float(sweep.source[part]) for part in (a, b, c))
    to = (counts[a], counts[b], strides[a], strides[b], strides[c])
    rays = (sweep.source is not None, *source, sweep.axis < a, sweep.axis < b)
    bands = -(-(sweep.height - 1) // BAND)
    at_once = max(NODES_AT_ONCE * bands // nodes.size, 1) * thread_count(threads)
    for first in range(0, bands, at_once):
        yield first / bands
        with parallel_call(threads):
            _shade_bands(
                first, min(at_once, bands - first), layers, held, meshes, sweep.width, sweep.height, tables.width,
                sweep.length, to, rays, np.float32(share), nodes.reshape(-1),
            )  # fmt: skip


def _layers(sweep: Sweep, place) -> tuple:
    """Slices, scale, offset_x, offset_y and whole of a Sweep, and of the layer of nodes behind its last slice."""
    a, _, c = AXES[sweep.axis]
    behind = sweep.slices[-1] + int(np.sign(place[3, c]))
    w = place[2, c] * behind + place[2, 3]
    ends = (behind, place[0, a] / w, *((place[row, c] * behind + place[row, 3]) / w for row in (0, 1)), 0.0)
    given = (sweep.slices, sweep.scale, sweep.offset_x, sweep.offset_y, sweep.whole)
    return tuple(np.append(array, np.array(end, array.dtype)) for array, end in zip(given, ends))


def read_nodes_steps(
    nodes, pitch: int, strength: float, voxels: VisibleVoxels, points: Points, known, codes, channel: int, *,
    left=None, threads: int = 0,
):  # fmt: skip
    """Generator of fractions done: write the light at points beside voxels to a channel of their codes.

    Parameters
    ----------
    nodes : (nz + 2, ny + 2, nx + 2) ndarray of uint16
    pitch : int
        Voxels from node to node, a power of two.
    strength : float
        1, or what is left of shadows: of ambient occlusion.
    voxels : VisibleVoxels
    points : Points
        Beside the voxels.
    known : (m, w) ndarray of int16 or None
        Codes that are copied to the first w channels before.
    codes : (m, channels) ndarray of int16
        Output, in the order of ``voxels``.
    channel : int
        Number of the channel, at least NORMAL.
    left : (m,) ndarray of uint16, optional
        FULL times what meshes leave of the light at each voxel; by default all.
    threads : int
        0 for one per core.
    """
    copied = 0 if known is None else known.shape[1]
    known = codes if known is None else known
    left = np.zeros(0, np.uint16) if left is None else left
    if not compiled():
        reference.read_nodes(nodes, pitch, strength, voxels, points, left, known[:, :copied], codes, channel)
        return
    lists = read_only(voxels.row_start), read_only(voxels.column), tuple(points), *voxels.shape_xyz[:2]
    grid = (read_only(nodes.reshape(-1)), *nodes.shape)
    for done, first, count in row_pieces(voxels, READ_AT_ONCE * thread_count(threads)):
        yield done
        with parallel_call(threads):
            _read(
                first, count, grid, pitch, np.float32(strength), lists, read_only(left), read_only(known),
                copied, codes, channel,
            )  # fmt: skip


# --- kernels ----------------------------------------------------------------------------------------------------


@kernel
def _shade_bands(first, count, layers, held, meshes, width, height, n_voxels, length, to, rays, share, nodes):
    """Sweep bands [first, first + count) of sheet rows; arguments as of ``light_sweep._sweep``.

    ``layers``: of ``_layers``.  ``to``: nodes along a scanline and across, and strides
    along, across and from slice to slice.  ``rays``: whether they begin in a point, where it is in the same order, and
    whether nodes that are as far along as across the pyramid belong to it, along and across.  ``nodes``: flat.
    """
    share_out(
        _shade_some, count,
        (first, layers, held, meshes, width, height, n_voxels, length, to, rays, share, nodes),
    )  # fmt: skip


@kernel(inner=True)
def _shade_some(
    begin, end, from_, layers, held, meshes, width, height, n_voxels, length, to, rays, share, nodes
):  # fmt: skip
    """``_shade_bands`` for some of them."""
    slices, scales, offsets_x, offsets_y, whole = layers
    last = slices.size - 1  # the layer behind the medium
    along, across, step_i, step_j, step_k = to
    line = np.zeros(n_voxels + 3, np.float32)
    sheets = np.empty((3, BAND + 1, width), np.float32)  # D(n) is in sheet n % 3
    row_depth, row_lit = np.empty(width, np.float32), np.empty(0 if meshes is None else width, np.float32)
    row_taken = np.empty(along + 1, np.uint16)
    for band in range(from_ + begin, from_ + end):
        top = band * BAND
        rows = min(BAND + 1, height - top)
        # The first slice weighs less than 1 where the medium begins, or where the light is right before it.
        sheets[0] = _ZERO
        if whole[0] != _ONE:
            layer = (slices[0], scales[0], offsets_x[0], offsets_y[0], whole[0] - _ONE)
            add_slice(held, layer, top, rows, n_voxels, BOXED, line, sheets[0])
        for n in range(last + 1):
            earlier, before, after = sheets[(n + 2) % 3], sheets[n % 3], sheets[(n + 1) % 3]
            if n < last:
                after[:] = before
                layer = (slices[n], scales[n], offsets_x[n], offsets_y[n], _ONE)
                add_slice(held, layer, top, rows, n_voxels, BOXED, line, after)
                if n == 0:  # counts as if the medium went on before it
                    earlier[:] = before + before - after
            else:  # the medium ends in the middle of the last slice, so that the layer behind has half of it
                after[:] = earlier
            k, scale, offset_x, offset_y = slices[n], scales[n], offsets_x[n], offsets_y[n]
            # Rows of nodes whose rays lie in this band: those beside the sheet are on its border.
            low = max(math.floor((top - offset_y) / scale) - 1, -1)
            high = min(math.ceil((top + BAND - offset_y) / scale) + 2, across - 1)
            if top == 0:
                low = -1
            if top + BAND >= height - 1:
                high = across - 1
            for j in range(low, high):
                y = min(max(scale * j + offset_y, 0.0), height - 1.0)
                row = min(np.int64(y), height - 2) - top
                if not 0 <= row < BAND:
                    continue
                i, stop = _span(rays, k, j, along - 1)
                if i >= stop:
                    continue
                down = np.float32(y - top - row)
                shaded = _mix_rows(earlier, before, after, row, down, row_depth)
                if meshes is not None:
                    _mix_meshes(meshes, top + row, down, np.float32(n), row_lit)
                elif not shaded:
                    continue
                taken = row_taken[: stop - i]
                _find_taken(scale, scale * i + offset_x, y, length, row_depth, row_lit, share, taken)
                at = (k + 1) * step_k + (j + 1) * step_j + (i + 1) * step_i
                if step_i == 1:
                    to = nodes[at : at + taken.size]
                    for m in range(taken.size):
                        to[m] -= taken[m]
                else:
                    for m in range(taken.size):
                        nodes[at + m * step_i] -= taken[m]


@kernel(inline="always")
def _span(rays, k, j, end):
    """First node of a row in the pyramid of the rays, and the one behind the last; nodes are numbered from -1 on."""
    from_point, source_i, source_j, source_k, edge_i, edge_j = rays
    if not from_point:
        return -1, end
    reach = abs(k - source_k)
    aside = abs(j - source_j)
    if aside > reach or (aside == reach and not edge_j):
        return 0, 0
    i = np.int64(min(max(math.floor(source_i - reach) - 1.0, -1.0), end))
    stop = np.int64(min(max(math.ceil(source_i + reach) + 2.0, -1.0), end))
    while i < stop and (abs(i - source_i) > reach or (abs(i - source_i) == reach and not edge_i)):
        i += 1
    while stop > i and (abs(stop - 1 - source_i) > reach or (abs(stop - 1 - source_i) == reach and not edge_i)):
        stop -= 1
    return i, stop


@kernel(inner=True)
def _mix_rows(earlier, before, after, row, down, found):
    """The sums at nodes of a slice between two rows of its sheet, to ``found``; returns whether any is above zero."""
    rise = np.float32(RISE)
    a, b, c = earlier[row], before[row], after[row]
    d, e, f = earlier[row + 1], before[row + 1], after[row + 1]
    shaded = False
    for x in range(found.size):
        upper = b[x] + _HALF * min(c[x] - b[x], rise * (b[x] - a[x]))
        lower = e[x] + _HALF * min(f[x] - e[x], rise * (e[x] - d[x]))
        found[x] = (_ONE - down) * upper + down * lower
        shaded |= found[x] > _ZERO
    return shaded


@kernel(inner=True)
def _mix_meshes(meshes, row, down, reached, found):
    """Share of rays that meet no mesh before the slice ``reached``, between two rows of the sheet, to ``found``."""
    samples = meshes.shape[2]
    for x in range(found.size):
        free = _ZERO
        for far in range(2):
            met = 0
            while met < samples and meshes[row + far, x, met] <= reached:
                met += 1
            weight = down if far else _ONE - down
            free += weight * (_ONE - np.float32(met) / np.float32(samples))
        found[x] = free


@kernel(inner=True)
def _find_taken(scale, first, y, length, depth, lit, share, taken):
    """What is blocked from each node of a row, whose rays begin at ``first`` in the sheet; ``depth``, ``lit``: its
    row."""
    c = length[0] + y * (length[2] + y * length[5])
    cx, cxx = length[1] + y * length[4], length[3]
    count, last = taken.size, depth.size - 1
    if scale == 1.0 and cx == 0.0 and cxx == 0.0 and lit.size == 0 and first >= 0.0 and first + count <= last:
        # Parallel light: all rays have the same length, and lie as far from the pixels.
        cell = np.int64(first)
        far = np.float32(math.sqrt(c)) * LOG2E
        right = np.float32(first - cell) * far
        left, here, there = far - right, depth[cell:], depth[cell + 1 :]
        for m in range(count):
            passed = transmit(max(left * here[m] + right * there[m], _ZERO))
            taken[m] = np.uint16((_ONE - passed) * share + _HALF)
        return
    for m in range(count):
        u = min(max(first + scale * m, 0.0), np.float64(last))
        cell = min(np.int64(u), last - 1)
        right = np.float32(u - cell)
        tau = depth[cell] + right * (depth[cell + 1] - depth[cell])
        long = np.float32(math.sqrt(max(c + u * (cx + u * cxx), 0.0))) * LOG2E
        passed = transmit(max(tau, _ZERO) * long)
        if lit.size > 0:
            passed *= lit[cell] + right * (lit[cell + 1] - lit[cell])
        taken[m] = np.uint16((_ONE - passed) * share + _HALF)


@kernel
def _read(first, count, grid, pitch, strength, lists, left, known, copied, codes, channel):
    """Codes of the voxels of rows [first, first + count).

    ``grid``: nodes, flat, and how many along z, y, x.  ``lists``: row_start, column, Points, and voxels along x
    and y.  ``copied``: channels of ``known`` that are copied.
    """
    share_out(_read_rows, count, (first, grid, pitch, strength, lists, left, known, copied, codes, channel))


@kernel(inner=True)
def _read_rows(begin, end, first, grid, pitch, strength, lists, left, known, copied, codes, channel):
    """``_read`` for some of them."""
    nodes, n_z, n_y, n_x = grid
    row_start, column, (normals, offsets, lamp), columns, rows = lists
    # Positions are whole numbers of STEPS of a voxel, from the first node on.
    voxel, pitch = np.int32(STEPS), np.int32(pitch)
    begins = pitch * voxel - (pitch - 1) * (voxel >> 1)
    node, power = pitch * voxel, 0
    while 1 << power < node:
        power += 1
    # The last position is one step before the last node, so that there is a node behind it.
    last = (np.int32((n_x - 1) * node - 1), np.int32((n_y - 1) * node - 1), np.int32((n_z - 1) * node - 1))
    steps, strides = (np.int32(power), np.int32(node - 1)), (np.int32(n_x), np.int32(n_x * n_y))
    least = (_ONE - strength) * np.float32(32767.0) + _HALF
    scale = (least, strength * np.float32(32767.0 / FULL), _ONE / np.float32(node))
    # A row, and what its last block reads and writes beyond its end.
    xs, ways = np.zeros(columns + BLOCK, np.int32), np.zeros(3 * (columns + BLOCK), np.int16)
    found = np.empty(columns + BLOCK, np.int32)
    channels = codes.shape[1]
    flat, known_flat = codes.reshape(-1), known.reshape(-1)
    for row in range(first + begin, first + end):
        at, stop = row_start[row], row_start[row + 1]
        own, from_row = column[at:stop], lamp_from_row(lamp, np.float64(row % rows), np.float64(row // rows))
        for i in range(own.size):
            xs[i] = np.int32(own[i]) * voxel
            way = towards_lamp(lamp, from_row, np.float32(own[i]), normals, offsets, at + i)
            for axis in range(3):
                ways[3 * i + axis] = np.int16(np.rint(way[axis]))
        starts = (np.int32(begins), np.int32(row % rows * voxel + begins), np.int32(row // rows * voxel + begins))
        for i in range(0, own.size, BLOCK):
            read_block(nodes, xs, ways, i, starts, last, pitch, steps, strides, scale, found)
        to = codes[at:stop]
        if copied == channels:
            held, copy = known_flat[at * channels : stop * channels], flat[at * channels : stop * channels]
            for i in range(copy.size):
                copy[i] = held[i]
        else:
            held_rows = known[at:stop]
            for i in range(own.size):
                for plane in range(copied):
                    to[i, plane] = held_rows[i, plane]
        for i in range(own.size):
            to[i, channel] = np.int16(found[i])
        if left.size > 0:
            for i in range(own.size):
                to[i, channel] = np.int16(np.float32(found[i]) * (np.float32(left[at + i]) / np.float32(FULL)) + _HALF)
