"""Light beside voxels by a ray from each point to the light, through the extinction of the voxels.

Extinction is interpolated trilinearly.  Along a ray it is a cubic in each cell, which Gauss-Legendre quadrature of two
nodes integrates exactly, so no grid and no sheet blurs what arrives.  It takes longer than ``light_nodes``: a ray for
each kept voxel and each point of a light.

Extinction lies in bricks of SIDE^3 cells with all corners of theirs, so that a ray reads one brick after the other and
passes over empty ones.  Lengths are those of the world, positions are voxel indices.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only, thread_count
from ..runtime.parallel import share_out
from ..runtime.steps import map_steps
from ..runtime.work_sizes import BRICK_SIDE as SIDE
from ..volume.blocks import cut_chunks
from . import reference
from .reference import FULL
from .sample_light import OCTAVES
from .surface_points import STEPS, Points, lamp_from_row, row_pieces, towards_lamp

SHIFT = SIDE.bit_length() - 1
CORNERS = SIDE + 1
LAYER, BRICK = CORNERS**2, CORNERS**3
FURTHEST = 8  # bricks that a ray passes over at once
OPAQUE = 10.0  # optical depth from which a ray is not followed further: at most 5e-5 of the light arrives
TRACED_AT_ONCE = 1 << 14  # voxels whose rays a worker follows between two chances to cancel, 10 to 30 ms
FILLED_AT_ONCE = 1 << 22  # voxels, shown or not, that are brought to bricks likewise, 10 ms
_LOW, _HIGH = 0.5 - math.sqrt(1.0 / 12.0), 0.5 + math.sqrt(1.0 / 12.0)  # nodes of the quadrature on [0, 1]
_ZERO = np.float32(0.0)


class Bricks(NamedTuple):
    """Extinction of a volume.

    Attributes
    ----------
    numbers : (bz, by, bx) ndarray of int32
        Of each brick in ``corners``; of an empty one minus the distance to the nearest other one, in bricks.
    corners : (n * BRICK,) ndarray of float32
        By z, y and x; 1 / world length.
    """

    numbers: np.ndarray
    corners: np.ndarray

    @property
    def nbytes(self) -> int:
        return self.numbers.nbytes + self.corners.nbytes


class Cuts(NamedTuple):
    """What clip objects remove, in voxel indices.

    Attributes
    ----------
    planes : (n, 4) ndarray of float64
        A point is kept where a x + b y + c z <= d for each.
    boxes : (k, 3, 4) ndarray of float64
        Voxel index to the space of a box, in which it is the cube from -1 to 1, whose inside is removed.
    """

    planes: np.ndarray
    boxes: np.ndarray


def brick_steps(voxels: VisibleVoxels, extinction, *, threads: int = 0):
    """Generator of fractions: the Bricks of the extinction (m,) float32 of kept voxels."""
    counts = [max(-(-(n - 1) // SIDE), 1) for n in voxels.shape_xyz[::-1]]
    numbers = np.zeros(counts, np.int32)
    lists = read_only(voxels.row_start), read_only(voxels.column), read_only(extinction)
    if compiled():
        steps = _fill_steps(lists, voxels.shape_xyz, numbers, np.zeros(0, np.float32), threads)
        yield from map_steps(steps, lambda done: 0.3 * done)
    else:
        reference.mark_bricks(*lists, voxels.shape_xyz, numbers)
    yield 0.3
    shown = numbers > 0
    numbers[:] = _distances(shown)
    numbers[shown] = np.arange(np.count_nonzero(shown))
    corners = np.zeros(np.count_nonzero(shown) * BRICK, np.float32)
    yield 0.5
    if compiled():
        steps = _fill_steps(lists, voxels.shape_xyz, numbers, corners, threads)
        yield from map_steps(steps, lambda done: 0.5 + 0.5 * done)
    else:
        reference.fill_bricks(*lists, voxels.shape_xyz, numbers, corners)
    return Bricks(numbers, corners)


def _fill_steps(lists, shape_xyz, numbers, corners, threads: int):
    """Generator of fractions: the kernel ``_fill``, some layers of bricks at a time."""
    (row_start, *lists), (nx, ny, nz) = lists, shape_xyz
    for first, last in cut_chunks(len(numbers), SIDE * ny * nx, FILLED_AT_ONCE * thread_count(threads)):
        yield first / len(numbers)
        rest = nx, ny, nz - SIDE * first
        with parallel_call(threads):
            _fill(row_start[SIDE * first * ny :], *lists, rest, numbers[first:last], corners)


def _distances(shown) -> np.ndarray:
    """Minus the distance of each brick to the nearest other one that is ``shown``, in bricks, at most FURTHEST."""
    distance, near = np.full(shown.shape, FURTHEST, np.int32), shown
    for number in range(1, FURTHEST):
        for axis in range(3):
            wide = np.pad(near, [(int(other == axis),) * 2 for other in range(3)])
            wide = np.moveaxis(wide, axis, 0)
            near = np.moveaxis(wide[:-2] | wide[1:-1] | wide[2:], 0, axis)
        distance = np.where(near, np.minimum(distance, number), distance)
    return -distance


def trace_steps(
    voxels: VisibleVoxels, points: Points, bricks: Bricks, to_world, light, is_sun: bool, cuts: Cuts, weight: float,
    free, scattered: bool, sums, *, threads: int = 0,
):  # fmt: skip
    """Generator of fractions done: add the light of one point to what arrives at points beside voxels.

    Parameters
    ----------
    voxels : VisibleVoxels
    points : Points
        Beside the voxels.
    bricks : Bricks
    to_world : (4, 4) ndarray of float64
        Voxel index to world.
    light : (3,) ndarray of float64
        World position of the light, or the direction in which a sun shines.
    is_sun : bool
    cuts : Cuts
    weight : float
        Of this point of the light.
    free : (m,) ndarray of uint16
        FULL times what meshes leave of its light; of length 0 where they leave all.
    scattered : bool
        Whether what scatters on the way is asked for, the mean of the light's further OCTAVES.
    sums : (m,) ndarray of float32
        The shares that arrive.
    threads : int
        0 for one per core.
    """
    matrix = np.asarray(to_world, np.float64)
    inverse = np.linalg.inv(matrix[:3, :3])
    if is_sun:
        point = inverse @ (-np.asarray(light, np.float64) / np.linalg.norm(light))
    else:
        point = inverse @ (np.asarray(light, np.float64) - matrix[:3, 3])
    metric = matrix[:3, :3].T @ matrix[:3, :3]
    opaque = OPAQUE / (OCTAVES[1][-1] if scattered else 1.0)
    lamp = (is_sun, tuple(point.tolist()), tuple(metric.ravel().tolist()), np.float32(weight), scattered, opaque)
    lists = read_only(voxels.row_start), read_only(voxels.column), tuple(points), voxels.shape_xyz
    medium = read_only(bricks.numbers), read_only(bricks.corners)
    limits = tuple(map(read_only, cuts))
    if not compiled():
        reference.trace_light(lists, bricks, lamp, limits, free, sums)
        return
    for done, first, count in row_pieces(voxels, TRACED_AT_ONCE * thread_count(threads)):
        yield done
        with parallel_call(threads):
            _trace(first, count, lists, medium, lamp, limits, read_only(free), sums)


# --- kernels ----------------------------------------------------------------------------------------------------


@kernel
def _fill(row_start, column, extinction, shape_xyz, numbers, corners):
    """Write extinction to the corners of bricks; without ``corners``, mark in ``numbers`` which have any."""
    share_out(_fill_layers, numbers.shape[0], (row_start, column, extinction, shape_xyz, numbers, corners))


@kernel(inner=True)
def _fill_layers(begin, end, row_start, column, extinction, shape_xyz, numbers, corners):
    """``_fill`` for layers of bricks [begin, end)."""
    _, n_y, n_z = shape_xyz
    for layer in range(begin, end):
        for z in range(layer * SIDE, min(layer * SIDE + CORNERS, n_z)):
            for y in range(n_y):
                row = z * n_y + y
                _fill_row(row_start[row], row_start[row + 1], y, z, layer, column, extinction, numbers, corners)


@inner_loop
def _fill_row(first, last, y, z, layer, column, extinction, numbers, corners):
    """``_fill`` for voxels [first, last) of a row, in one layer; one on the border of bricks is a corner of each."""
    _, b_y, b_x = numbers.shape
    for v in range(first, last):
        if extinction[v] <= _ZERO:
            continue
        x = np.int64(column[v])
        for j in range(max((y - 1) >> SHIFT, 0), min(y >> SHIFT, b_y - 1) + 1):
            for i in range(max((x - 1) >> SHIFT, 0), min(x >> SHIFT, b_x - 1) + 1):
                if corners.size == 0:
                    numbers[layer, j, i] = 1
                    continue
                at = np.int64(numbers[layer, j, i]) * BRICK + (z - layer * SIDE) * LAYER
                corners[at + (y - j * SIDE) * CORNERS + x - i * SIDE] = extinction[v]


@kernel
def _trace(first, count, lists, medium, lamp, limits, free, sums):
    """Kernel of ``trace_steps`` for ``count`` rows from ``first`` on."""
    share_out(_trace_rows, count, (first, lists, medium, lamp, limits, free, sums))


@kernel(inner=True)
def _trace_rows(begin, end, first, lists, medium, lamp, limits, free, sums):
    """``_trace`` for some of them."""
    row_start, column, (normals, offsets, begins), shape_xyz = lists
    is_sun, (lx, ly, lz), metric, weight, scattered, opaque = lamp
    n_y, step = shape_xyz[1], 1.0 / STEPS
    high = (shape_xyz[0] - 1.0, shape_xyz[1] - 1.0, shape_xyz[2] - 1.0)
    flat = min(high[0], min(high[1], high[2])) < 1.0  # a medium without thickness
    for row in range(first + begin, first + end):
        y, z = row % n_y, row // n_y
        from_row = lamp_from_row(begins, np.float64(y), np.float64(z))
        for v in range(row_start[row], row_start[row + 1]):
            left = weight * (np.float32(free[v]) / np.float32(FULL)) if free.size > 0 else weight
            if left == _ZERO:
                continue
            x = np.float64(column[v])
            wx, wy, wz = towards_lamp(begins, from_row, np.float32(x), normals, offsets, v)
            o = (  # not beyond the outermost nodes, from which other qualities read
                min(max(x + step * wx, -1.0), high[0] + 1.0),
                min(max(y + step * wy, -1.0), high[1] + 1.0),
                min(max(z + step * wz, -1.0), high[2] + 1.0),
            )
            d = (lx, ly, lz) if is_sun else (lx - o[0], ly - o[1], lz - o[2])
            depth = 0.0
            if not flat:
                depth = _depth_along(o, d, 1e300 if is_sun else 1.0, high, medium, limits, metric, opaque)
            passed = math.exp(-depth)
            if scattered:
                root = math.sqrt(passed)
                passed = (2.0 * root + math.sqrt(root)) / 3.0
            sums[v] += left * np.float32(passed)


@inner_loop
def _enter(o, d, low, high, begin, end):
    """What a slab from ``low`` to ``high`` leaves of a ray from ``begin`` to ``end``, along one axis."""
    if d == 0.0:
        return (begin, end) if low <= o <= high else (1.0, 0.0)
    a, b = (low - o) / d, (high - o) / d
    return max(begin, min(a, b)), min(end, max(a, b))


@inner_loop
def _apply(row, o, d):
    """A row of an affine map, of a point and of a direction."""
    return (
        row[0] * o[0] + row[1] * o[1] + row[2] * o[2] + row[3],
        row[0] * d[0] + row[1] * d[1] + row[2] * d[2],
    )


@inner_loop
def _depth_along(o, d, end, high, medium, limits, metric, opaque):
    """Optical depth of a ray o + t d, t from 0 to ``end``, in the box of voxel centers, without what is cut away."""
    begin = 0.0
    for axis in range(3):
        begin, end = _enter(o[axis], d[axis], 0.0, high[axis], begin, end)
    planes, boxes = limits
    for k in range(planes.shape[0]):
        row = planes[k]
        inside = row[3] - (row[0] * o[0] + row[1] * o[1] + row[2] * o[2])
        away = row[0] * d[0] + row[1] * d[1] + row[2] * d[2]
        if away == 0.0:
            end = end if inside >= 0.0 else begin
        elif away > 0.0:
            end = min(end, inside / away)
        else:
            begin = max(begin, inside / away)
    if end <= begin:
        return 0.0
    length = math.sqrt(
        metric[0] * d[0] * d[0] + metric[4] * d[1] * d[1] + metric[8] * d[2] * d[2]
        + 2.0 * (metric[1] * d[0] * d[1] + metric[2] * d[0] * d[2] + metric[5] * d[1] * d[2])
    )  # fmt: skip
    depth = 0.0
    while begin < end and depth < opaque:
        # On to the next box that is removed, then to where the ray leaves it.
        until, after = end, end
        for k in range(boxes.shape[0]):
            near, far = 0.0, 1e300
            for axis in range(3):
                at, along = _apply(boxes[k, axis], o, d)
                near, far = _enter(at, along, -1.0, 1.0, near, far)
            if far > begin and near < far and near < until:
                until, after = near, far
        if until > begin:
            depth += _walk(o, d, begin, until, medium, (opaque - depth) / length) * length
        begin = max(after, until)
    return depth


@inner_loop
def _walk(o, d, begin, end, medium, opaque):
    """Integral of the extinction along o + t d from ``begin`` to ``end``, not followed beyond ``opaque``."""
    numbers, corners = medium
    b_z, b_y, b_x = numbers.shape
    last_x, last_y, last_z = b_x * SIDE - 1, b_y * SIDE - 1, b_z * SIDE - 1
    (ox, oy, oz), (dx, dy, dz) = o, d
    far = 1e300
    ix, iy, iz = 1.0 / dx if dx != 0.0 else far, 1.0 / dy if dy != 0.0 else far, 1.0 / dz if dz != 0.0 else far
    # By the middle of a very short piece ahead, so that a ray which begins on a face is in the cell that it enters.
    t = begin + 1e-9 * (end - begin)
    x = min(max(np.int64(math.floor(ox + t * dx)), 0), last_x)
    y = min(max(np.int64(math.floor(oy + t * dy)), 0), last_y)
    z = min(max(np.int64(math.floor(oz + t * dz)), 0), last_z)
    total, t = 0.0, begin
    while True:
        number = np.int64(numbers[z >> SHIFT, y >> SHIFT, x >> SHIFT])
        if number < 0:
            # Over the cube of empty bricks around.
            wide = -number - 1
            low_x, low_y, low_z = (x >> SHIFT) - wide, (y >> SHIFT) - wide, (z >> SHIFT) - wide
            span = (2 * wide + 1) << SHIFT
            low_x, low_y, low_z = low_x << SHIFT, low_y << SHIFT, low_z << SHIFT
            tx = (low_x + (span if dx > 0.0 else 0) - ox) * ix if dx != 0.0 else far
            ty = (low_y + (span if dy > 0.0 else 0) - oy) * iy if dy != 0.0 else far
            tz = (low_z + (span if dz > 0.0 else 0) - oz) * iz if dz != 0.0 else far
            t = max(t, min(tx, min(ty, tz)))
            if t >= end:
                return total
            # The axis that is left goes to the cell beyond exactly; the others stay between the faces of the cube.
            x = min(max(np.int64(math.floor(ox + t * dx)), low_x), low_x + span - 1)
            y = min(max(np.int64(math.floor(oy + t * dy)), low_y), low_y + span - 1)
            z = min(max(np.int64(math.floor(oz + t * dz)), low_z), low_z + span - 1)
            if tx <= ty and tx <= tz:
                x = low_x + span if dx > 0.0 else low_x - 1
            elif ty <= tz:
                y = low_y + span if dy > 0.0 else low_y - 1
            else:
                z = low_z + span if dz > 0.0 else low_z - 1
            if x < 0 or y < 0 or z < 0 or x > last_x or y > last_y or z > last_z:
                return total
            continue
        base = number * BRICK
        brick_x, brick_y, brick_z = x >> SHIFT, y >> SHIFT, z >> SHIFT
        tx = (x + (1 if dx > 0.0 else 0) - ox) * ix if dx != 0.0 else far
        ty = (y + (1 if dy > 0.0 else 0) - oy) * iy if dy != 0.0 else far
        tz = (z + (1 if dz > 0.0 else 0) - oz) * iz if dz != 0.0 else far
        while x >> SHIFT == brick_x and y >> SHIFT == brick_y and z >> SHIFT == brick_z:
            until = min(min(tx, ty), min(tz, end))
            if until > t:
                at = base + ((z & (SIDE - 1)) * CORNERS + (y & (SIDE - 1))) * CORNERS + (x & (SIDE - 1))
                piece = until - t
                u, w = t + _LOW * piece, t + _HIGH * piece
                total += 0.5 * piece * (
                    _between(corners, at, ox + u * dx - x, oy + u * dy - y, oz + u * dz - z)
                    + _between(corners, at, ox + w * dx - x, oy + w * dy - y, oz + w * dz - z)
                )  # fmt: skip
                t = until
            if t >= end or total >= opaque:
                return total
            if tx <= ty and tx <= tz:
                x += 1 if dx > 0.0 else -1
                tx += abs(ix)
            elif ty <= tz:
                y += 1 if dy > 0.0 else -1
                ty += abs(iy)
            else:
                z += 1 if dz > 0.0 else -1
                tz += abs(iz)
            if x < 0 or y < 0 or z < 0 or x > last_x or y > last_y or z > last_z:
                return total


@inner_loop
def _between(corners, at, x, y, z):
    """Extinction at a point of a cell, whose first corner is number ``at``."""
    x, y, z = np.float32(x), np.float32(y), np.float32(z)
    near = corners[at] + x * (corners[at + 1] - corners[at])
    far = corners[at + CORNERS] + x * (corners[at + CORNERS + 1] - corners[at + CORNERS])
    front = near + y * (far - near)
    at += LAYER
    near = corners[at] + x * (corners[at + 1] - corners[at])
    far = corners[at + CORNERS] + x * (corners[at + CORNERS + 1] - corners[at + CORNERS])
    return front + z * (near + y * (far - near) - front)
