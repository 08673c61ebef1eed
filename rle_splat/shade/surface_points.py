"""Where the surface beside a voxel faces, and where its shadows begin.

The vector m of a voxel (``surface_normals``) is turned to where extinction falls and gives way to the plane's normal
beside faces.  Shadows begin at a point x' a little off the surface, so that a surface does not shade itself:

    x' = x + b n,  n = m / |m|,  b = FURTHER w(|m|) min(depth + width, FARTHEST width),
    width = sum over axes of |n . a|

in which a are the voxel's edges, w is the trust of ``sample_light`` and depth estimates how far the voxel lies behind
the surface: the distance to the nearest value that shows nothing, over the steepness of the values.

On the far side of a wall this point is behind the wall.  Where the wall is thin, the eye sees a mean of both sides, and
light that arrives at one of them only would show the grid of voxels.  So light of a lamp, in the direction l, begins at

    x' = x + (1 - t) b n + t p,  t = smoothstep(0, LEAST^2, |m|^2) (1 - |m|^2 smoothstep(-FACING, FACING, m.l)),

in which p is FURTHER FARTHEST widths towards the lamp: a side that faces away from it has no light of a surface.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..runtime.work_sizes import PLACED_AT_ONCE
from ..volume.stored_scalars import StoredValues, by_any_type
from . import reference
from .lighting import unit_vectors
from .sample_light import ONE, TRUSTED
from .surface_normals import LEAST, Surfaces

FARTHEST = 3.0  # widths of a voxel along the normal: with 2 a lit plane ripples by 1.4 %, with 4 more light leaks
FURTHER = 9.0 / 8.0  # so that x' is off what trilinear interpolation shows of the surface, too
NEAR, FAR = 1.0, 2.0  # widths from a face at which its normal begins to fade and is gone
SIDE = 0.5  # of the balance of distances, over which the side changes to which extinction falls
STEPS = 1024.0  # of a voxel, in which offsets are kept
FACING = 0.25  # of m.l, on both sides of 0, over which the point beside a voxel goes over to the lamp's side
NO_LAMP, FAR_LAMP, NEAR_LAMP = range(3)
FURTHEST = 32767.0 / STEPS
BOX_NEAR = 1  # voxels from a face of the box whose normal is the face's: its width is one voxel
LARGEST = 1e300  # in place of infinity, so that differences stay numbers
_TINY, _ZERO, _HALF, _ONE, _TWO, _THREE = map(np.float32, (1e-30, 0.0, 0.5, 1.0, 2.0, 3.0))


class Faces(NamedTuple):
    """Faces that cut the volume, beside those of its box.

    Attributes
    ----------
    normals : (n, 3) ndarray of float64
        Unit, world, away from what is kept.
    offsets, widths : (n,) ndarray of float64
        The plane is normal . x = offset; extent of a voxel along the normal, world.
    removed : (k, 2, 4, 4) ndarray of float64
        Boxes that are taken away: world to their own space, where they are the cube from -1 to 1, and back.
    """

    normals: np.ndarray
    offsets: np.ndarray
    widths: np.ndarray
    removed: np.ndarray


class Points(NamedTuple):
    """Where light is read beside voxels.

    Attributes
    ----------
    normals, offsets : (m, 3) ndarray of int16
        Of ``place_steps``.
    lamp : tuple
        Kind; direction to the lamp, or its place, world; for a direction, p along x, y, z in STEPS of a voxel;
        index to world, three rows of four, and back, nine numbers.
    """

    normals: np.ndarray
    offsets: np.ndarray
    lamp: tuple


def points_for(light, normals, offsets, index_to_world) -> Points:
    """The Points of a Light; those off the surface itself for None."""
    matrix = np.asarray(index_to_world, np.float64)
    to_index, kind, place, way = np.linalg.inv(matrix[:3, :3]), NO_LAMP, np.zeros(3), np.zeros(3)
    if light is not None and light.type == "SUN":
        kind, place = FAR_LAMP, unit_vectors(light.matrix_world[None, :3, 2])[0]
        way = STEPS * FURTHER * FARTHEST * np.abs(place @ matrix[:3, :3]).sum() * (to_index @ place)
    elif light is not None:
        kind, place = NEAR_LAMP, light.matrix_world[:3, 3]
    numbers = place, way, matrix[:3], to_index
    return Points(read_only(normals), read_only(offsets), (kind, *(tuple(each.ravel().tolist()) for each in numbers)))


def faces_of(clips, index_to_world) -> Faces:
    """The faces of clip objects.

    Parameters
    ----------
    clips : sequence of Clip
    index_to_world : (4, 4) ndarray of float64
    """
    edges = np.asarray(index_to_world, np.float64)[:3, :3]
    rows, removed = [], []
    for clip in clips:
        own = np.linalg.inv(clip.matrix_world)
        if clip.kind == "plane":
            sign = 1.0 if clip.keep == "inside" else -1.0
            rows.append((*(sign * own[2, :3]), -sign * own[2, 3]))
        elif clip.keep == "inside":
            rows += [(*(s * own[axis, :3]), 1.0 - s * own[axis, 3]) for axis in range(3) for s in (1.0, -1.0)]
        else:
            removed.append((own, clip.matrix_world))
    rows = np.array(rows, np.float64).reshape(-1, 4)
    rows /= np.maximum(np.linalg.norm(rows[:, :3], axis=1, keepdims=True), 1e-300)
    normals = np.ascontiguousarray(rows[:, :3])
    widths = np.abs(normals @ edges).sum(axis=1)
    boxes = np.array(removed, np.float64).reshape(-1, 2, 4, 4)
    return Faces(*(read_only(np.ascontiguousarray(each)) for each in (normals, rows[:, 3], widths, boxes)))


def row_pieces(voxels: VisibleVoxels, at_once: int):
    """Yield the fraction done, the first row and the number of rows of pieces of about so many voxels."""
    pieces = -(-len(voxels) // at_once)
    ends = np.searchsorted(voxels.row_start, np.linspace(0, len(voxels), pieces + 1)).tolist()
    for piece, (first, last) in enumerate(pairwise(ends)):
        yield piece / pieces, first, last - first


def shown_ranges(opacity) -> np.ndarray:
    """(k, 2) float64, ascending: the ranges of values that a transfer function shows; its ends may be infinite.

    Parameters
    ----------
    opacity : sequence of (value, alpha)
        Linear between its points; beyond its ends the last alpha holds.
    """
    points = sorted(opacity, key=lambda point: point[0])
    x = [-np.inf, *(float(value) for value, _ in points), np.inf]
    alpha = [points[0][1], *(a for _, a in points), points[-1][1]]
    found = []
    for i in range(len(x) - 1):
        if x[i] == x[i + 1] or max(alpha[i], alpha[i + 1]) <= 0.0:
            continue
        if found and found[-1][1] == x[i] and alpha[i] > 0.0:
            found[-1][1] = x[i + 1]
        else:
            found.append([x[i], x[i + 1]])
    return np.array(found, np.float64).reshape(-1, 2)


def place_steps(
    surfaces: Surfaces, voxels: VisibleVoxels, volume, transfer_function, index_to_world, faces: Faces, *,
    with_points: bool, threads: int = 0,
):  # fmt: skip
    """Generator of fractions done: turn vectors to where extinction falls, and find where shadows begin.

    Parameters
    ----------
    surfaces : Surfaces
        Of the voxels.
    volume : Volume
    transfer_function : TransferFunction
    index_to_world : (4, 4) ndarray of float64
    with_points : bool
        Whether points are asked for.
    threads : int
        0 for one per core.

    Returns
    -------
    codes : (m, 3) ndarray of int16
        ONE times m, world.
    offsets : (m, 3) ndarray of int16 or None
        STEPS times x' - x in voxels, along x, y, z.
    """
    matrix = np.asarray(index_to_world, np.float64)
    own_to_world = matrix[:3, :3] @ np.linalg.inv(np.asarray(volume.affine, np.float64)[:3, :3])
    world_per_mm = float(np.cbrt(abs(np.linalg.det(own_to_world))))
    covector = -np.sign(volume.slope) * np.linalg.inv(own_to_world / world_per_mm).T
    kind = np.asarray(volume.voxels).dtype
    stored = voxels.stored.view(kind) if kind.itemsize == voxels.stored.itemsize else voxels.stored
    ranges = np.clip(shown_ranges(transfer_function.opacity), -LARGEST, LARGEST)
    codes, offsets = empty((len(voxels), 3), np.int16), empty((len(voxels) if with_points else 0, 3), np.int16)
    upward = np.linalg.inv(matrix[:3, :3])  # rows: normals of the faces of the box, over the distance of two layers
    apart = 1.0 / np.linalg.norm(upward, axis=1, keepdims=True)
    box = read_only(np.concatenate((upward * apart, apart), axis=1))
    arguments = (
        float(volume.slope), float(volume.intercept), ranges,
        read_only(voxels.row_start), read_only(voxels.column), voxels.shape_xyz, tuple(covector.ravel().tolist()),
        tuple(matrix[:3].ravel().tolist()), tuple(upward.ravel().tolist()), world_per_mm,
        faces, box, codes, offsets,
    )  # fmt: skip
    if not compiled():
        reference.place_surfaces(surfaces.vectors, surfaces.steepness, stored, *arguments)
        return read_only(codes), read_only(offsets) if with_points else None
    for done, first, count in row_pieces(voxels, PLACED_AT_ONCE):
        yield done
        with parallel_call(threads):
            _place(first, count, surfaces.vectors, surfaces.steepness, StoredValues.of(stored), *arguments)
    return read_only(codes), read_only(offsets) if with_points else None


# --- kernels ----------------------------------------------------------------------------------------------------


@inner_loop
def lamp_from_row(lamp, y, z):
    """float32 direction to a lamp, world, or the way to it from voxel 0 of the row (y, z)."""
    kind, (lx, ly, lz), _, matrix, _ = lamp
    if kind == NEAR_LAMP:
        lx -= matrix[1] * y + matrix[2] * z + matrix[3]
        ly -= matrix[5] * y + matrix[6] * z + matrix[7]
        lz -= matrix[9] * y + matrix[10] * z + matrix[11]
    return np.float32(lx), np.float32(ly), np.float32(lz)


@inner_loop
def towards_lamp(lamp, row, x, normals, offsets, i):
    """float32 STEPS times x' - x along x, y, z, of voxel number ``i`` at a float32 x; see ``Points``.

    ``row``: of ``lamp_from_row``.
    """
    kind, _, way, matrix, to_index = lamp
    ox, oy, oz = np.float32(offsets[i, 0]), np.float32(offsets[i, 1]), np.float32(offsets[i, 2])
    if kind == NO_LAMP:
        return ox, oy, oz
    lx, ly, lz = row
    px, py, pz = np.float32(way[0]), np.float32(way[1]), np.float32(way[2])
    if kind == NEAR_LAMP:
        xx, yx, zx = np.float32(matrix[0]), np.float32(matrix[4]), np.float32(matrix[8])
        lx, ly, lz = lx - xx * x, ly - yx * x, lz - zx * x
        away = max(np.sqrt(lx * lx + ly * ly + lz * lz), _TINY)
        part = _ONE / away
        lx, ly, lz = lx * part, ly * part, lz * part
        width = (
            abs(lx * xx + ly * yx + lz * zx)
            + abs(lx * np.float32(matrix[1]) + ly * np.float32(matrix[5]) + lz * np.float32(matrix[9]))
            + abs(lx * np.float32(matrix[2]) + ly * np.float32(matrix[6]) + lz * np.float32(matrix[10]))
        )
        reach = np.float32(STEPS) * min(np.float32(FURTHER * FARTHEST) * width, away)  # not beyond the lamp
        px = reach * (lx * np.float32(to_index[0]) + ly * np.float32(to_index[1]) + lz * np.float32(to_index[2]))
        py = reach * (lx * np.float32(to_index[3]) + ly * np.float32(to_index[4]) + lz * np.float32(to_index[5]))
        pz = reach * (lx * np.float32(to_index[6]) + ly * np.float32(to_index[7]) + lz * np.float32(to_index[8]))
    scale = np.float32(1.0 / ONE)
    mx, my, mz = scale * normals[i, 0], scale * normals[i, 1], scale * normals[i, 2]
    square = min(mx * mx + my * my + mz * mz, _ONE)
    facing = min(max(_HALF + np.float32(0.5 / FACING) * (mx * lx + my * ly + mz * lz), _ZERO), _ONE)
    trust = min(np.float32(LEAST**-2) * square, _ONE)
    t = trust * trust * (_THREE - _TWO * trust)
    t *= _ONE - facing * facing * (_THREE - _TWO * facing) * square
    most = np.float32(STEPS * FURTHEST)
    return (
        min(max(ox + t * (px - ox), -most), most),
        min(max(oy + t * (py - oy), -most), most),
        min(max(oz + t * (pz - oz), -most), most),
    )


@kernel
def _place(
    first, count, vectors, steepness, stored, slope, intercept, ranges, row_start, column, shape_xyz, covector, matrix,
    to_index, world_per_mm, faces, box, codes, offsets,
):  # fmt: skip
    """Kernel of ``place_steps`` for ``count`` rows from ``first`` on.

    ``stored``: StoredValues.  ``matrix``: three rows of four; ``covector``, ``to_index``: nine numbers.
    """
    share_out(
        _place_rows, count,
        (first, vectors, steepness, stored, slope, intercept, ranges, row_start, column, shape_xyz, covector, matrix,
         to_index, world_per_mm, faces, box, codes, offsets),
    )  # fmt: skip


@inner_loop
def _as_float(values, i):
    return np.float64(values[i])


_value_at = by_any_type(_as_float)


@inner_loop
def smoothstep(t):
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@inner_loop
def _side(value, ranges):
    """1 where extinction falls towards lower values, -1 towards higher ones, between them where both are as near; and
    the distance to the nearest value on that side that shows nothing, 0 where there is none or it is this one."""
    below, above = -LARGEST, LARGEST
    inside = False
    for k in range(ranges.shape[0]):
        if value < ranges[k, 0]:
            above = ranges[k, 0]
            break
        if value <= ranges[k, 1]:
            below, above, inside = ranges[k, 0], ranges[k, 1], True
            break
        below = ranges[k, 1]
    has_below, has_above = below > -LARGEST, above < LARGEST
    if not has_below and not has_above:
        return 1.0, 0.0
    down, up = value - below, above - value
    if inside:
        balance = _balance(up, down, has_above, has_below)
        side = 2.0 * smoothstep(0.5 * (balance / SIDE + 1.0)) - 1.0
        return side, down if side >= 0.0 else up
    balance = _balance(down, up, has_below, has_above)
    return 2.0 * smoothstep(0.5 * (balance / SIDE + 1.0)) - 1.0, 0.0


@inner_loop
def _balance(one, other, has_one, has_other):
    """(one - other) / (one + other) of two distances, of which one may be infinite; 1 where both are 0."""
    if not has_one:
        return 1.0
    if not has_other:
        return -1.0
    return (one - other) / (one + other) if one + other > 0.0 else 1.0


@kernel(inner=True)
def _clip_faces(px, py, pz, faces, matrix, keep, fx, fy, fz, nearest):
    """What faces of clip objects leave of m, their part of it, and the distance to the nearest face, at a point."""
    normals, plane_offsets, widths, removed = faces
    for k in range(widths.size):
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        distance = abs(plane_offsets[k] - (nx * px + ny * py + nz * pz))
        share = 1.0 - smoothstep((distance / widths[k] - NEAR) / (FAR - NEAR))
        keep *= 1.0 - share
        fx, fy, fz = fx + share * nx, fy + share * ny, fz + share * nz
        nearest = min(nearest, distance) if share > 0.0 else nearest
    for k in range(removed.shape[0]):
        own, back = removed[k, 0], removed[k, 1]
        ux = own[0, 0] * px + own[0, 1] * py + own[0, 2] * pz + own[0, 3]
        uy = own[1, 0] * px + own[1, 1] * py + own[1, 2] * pz + own[1, 3]
        uz = own[2, 0] * px + own[2, 1] * py + own[2, 2] * pz + own[2, 3]
        # To the nearest point of the box.
        ux, uy, uz = min(max(ux, -1.0), 1.0) - ux, min(max(uy, -1.0), 1.0) - uy, min(max(uz, -1.0), 1.0) - uz
        nx = back[0, 0] * ux + back[0, 1] * uy + back[0, 2] * uz
        ny = back[1, 0] * ux + back[1, 1] * uy + back[1, 2] * uz
        nz = back[2, 0] * ux + back[2, 1] * uy + back[2, 2] * uz
        distance = math.sqrt(nx * nx + ny * ny + nz * nz)
        if distance > 0.0:
            nx, ny, nz = nx / distance, ny / distance, nz / distance
            share = 1.0 - smoothstep((distance / _width(nx, ny, nz, matrix) - NEAR) / (FAR - NEAR))
            keep *= 1.0 - share
            fx, fy, fz = fx + share * nx, fy + share * ny, fz + share * nz
            nearest = min(nearest, distance) if share > 0.0 else nearest
    return keep, fx, fy, fz, nearest


@inner_loop
def _width(nx, ny, nz, matrix):
    """Extent of a voxel along a unit vector, world; ``matrix``: three rows of four."""
    return (
        abs(nx * matrix[0] + ny * matrix[4] + nz * matrix[8])
        + abs(nx * matrix[1] + ny * matrix[5] + nz * matrix[9])
        + abs(nx * matrix[2] + ny * matrix[6] + nz * matrix[10])
    )


@inner_loop
def _box_faces(x, y, z, shape_xyz, box, keep, fx, fy, fz, nearest):
    """As ``_clip_faces``, of the box of voxel centers, whose faces count on the two outermost layers; ``box``: (3, 4)
    unit normals of the faces of x, y, z, upwards, and the distance of two layers."""
    at = (x, y, z)
    for axis in range(3):
        last = shape_xyz[axis] - 1
        for side in range(2):
            layers = last - at[axis] if side == 1 else at[axis]
            if last > 0 and layers <= BOX_NEAR:
                sign = 1.0 if side == 1 else -1.0
                keep = 0.0
                fx, fy, fz = fx + sign * box[axis, 0], fy + sign * box[axis, 1], fz + sign * box[axis, 2]
                nearest = min(nearest, layers * box[axis, 3])
    return keep, fx, fy, fz, nearest


@kernel(inner=True)
def _place_rows(
    begin, end, first, vectors, steepness, stored, slope, intercept, ranges, row_start, column, shape_xyz, covector,
    matrix, to_index, world_per_mm, faces, box, codes, offsets,
):  # fmt: skip
    """``_place`` for rows [first + begin, first + end)."""
    n_x, n_y, n_z = shape_xyz
    one, steep_unit = np.float64(ONE), abs(slope) / world_per_mm
    cut = faces.widths.size > 0 or faces.removed.shape[0] > 0
    for row in range(first + begin, first + end):
        y, z = row % n_y, row // n_y
        outer_row = min(min(y, n_y - 1 - y), min(z, n_z - 1 - z)) <= BOX_NEAR
        for i in range(row_start[row], row_start[row + 1]):
            x = np.int64(column[i])
            ax, ay, az = np.float64(vectors[i, 0]), np.float64(vectors[i, 1]), np.float64(vectors[i, 2])
            mx = covector[0] * ax + covector[1] * ay + covector[2] * az
            my = covector[3] * ax + covector[4] * ay + covector[5] * az
            mz = covector[6] * ax + covector[7] * ay + covector[8] * az
            side, away = _side(_value_at(stored, i) * slope + intercept, ranges)
            size = math.sqrt(mx * mx + my * my + mz * mz)
            scale = side * math.sqrt(ax * ax + ay * ay + az * az) / (one * size) if size > 0.0 else 0.0
            mx, my, mz = mx * scale, my * scale, mz * scale
            keep, fx, fy, fz, nearest = 1.0, 0.0, 0.0, 0.0, LARGEST
            if outer_row or x <= BOX_NEAR or x >= n_x - 1 - BOX_NEAR:
                keep, fx, fy, fz, nearest = _box_faces(x, y, z, shape_xyz, box, keep, fx, fy, fz, nearest)
            if cut:
                px = matrix[0] * x + matrix[1] * y + matrix[2] * z + matrix[3]
                py = matrix[4] * x + matrix[5] * y + matrix[6] * z + matrix[7]
                pz = matrix[8] * x + matrix[9] * y + matrix[10] * z + matrix[11]
                keep, fx, fy, fz, nearest = _clip_faces(px, py, pz, faces, matrix, keep, fx, fy, fz, nearest)
            mx, my, mz = keep * mx + fx, keep * my + fy, keep * mz + fz
            size = math.sqrt(mx * mx + my * my + mz * mz)
            if size > 1.0:
                mx, my, mz, size = mx / size, my / size, mz / size, 1.0
            codes[i, 0], codes[i, 1] = np.int16(np.rint(mx * one)), np.int16(np.rint(my * one))
            codes[i, 2] = np.int16(np.rint(mz * one))
            if offsets.shape[0] == 0:
                continue
            if size == 0.0:
                offsets[i, 0] = offsets[i, 1] = offsets[i, 2] = np.int16(0)
                continue
            nx, ny, nz = mx / size, my / size, mz / size
            width = _width(nx, ny, nz, matrix)
            most = FARTHEST * width
            steep = np.float64(steepness[i]) * steep_unit
            depth = min(away / steep, most) if steep > 0.0 else most if away > 0.0 else 0.0
            if keep < 1.0:
                depth = keep * depth + (1.0 - keep) * nearest
            b = FURTHER * smoothstep(size / TRUSTED) * min(depth + width, most)
            offsets[i, 0] = _moved(b, nx * to_index[0] + ny * to_index[1] + nz * to_index[2])
            offsets[i, 1] = _moved(b, nx * to_index[3] + ny * to_index[4] + nz * to_index[5])
            offsets[i, 2] = _moved(b, nx * to_index[6] + ny * to_index[7] + nz * to_index[8])


@inner_loop
def _moved(b, way):
    """Code of an offset of ``b`` times ``way`` voxels."""
    return np.int16(np.rint(min(max(b * way, -FURTHEST), FURTHEST) * STEPS))
