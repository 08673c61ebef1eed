"""What meshes leave of the light of a lamp at voxels, looked up in the depth of the meshes as the lamp sees them.

The sheet of a sweep (``light_sheets``) is that picture: each pixel has several rays of light, and each ray the slice
at which it first meets a mesh.  A voxel looks itself up between four pixels, and not the point beside it where the
shadows of voxels begin: so a mesh that touches a surface casts its shadow on it.
"""

from __future__ import annotations

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only, thread_count
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from . import reference
from .light_sheets import Sweep
from .surface_points import FARTHEST, FURTHER, STEPS, Points, row_pieces

LOOKED_UP_AT_ONCE = 1 << 19  # voxels that a worker looks up between two chances to cancel, 10 ms


def block_steps(
    sweep: Sweep, meshes, voxels: VisibleVoxels, points: Points, matrix, share: int, beside: bool, left, *,
    threads: int = 0,
):  # fmt: skip
    """Generator of fractions done: take from voxels the light of a sweep that meets a mesh before.

    Parameters
    ----------
    sweep : Sweep
        Each voxel is in one of the pyramids of a light.
    meshes : (height, width, samples) ndarray of float32
        Slices, ascending, from the sweep's first to the meshes on the rays of each pixel of its sheet.
    voxels : VisibleVoxels
    points : Points
        Beside the voxels.
    matrix : (4, 4) ndarray of float64
        Voxel index to world.
    share : int
        What the light gives to a voxel that no mesh shades.
    beside : bool
        Whether light is looked up at these points, in place of the voxels.
    left : (m,) ndarray of uint16
        Updated: ``share`` times the light that is blocked, rounded, is subtracted.
    threads : int
        0 for one per core.
    """
    a, b, c = AXES[sweep.axis]
    place = tuple((sweep.to_sheet @ matrix).ravel().tolist())
    source, up = (0.0, 0.0, 0.0), 0
    if sweep.source is not None:
        source, up = tuple(sweep.source.tolist()), 1 if sweep.slices[0] > sweep.source[c] else -1
    pyramid = (up, source, (a, b, c))
    if not compiled():
        reference.block_light(meshes, voxels, points, place, pyramid, share, beside, left)
        return
    nearest, furthest = (np.ascontiguousarray(meshes[..., sample]) for sample in (0, -1))
    seen = (read_only(nearest), read_only(furthest), read_only(meshes))
    limits = _limits(nearest, np.reshape(place, (4, 4)), np.asarray(matrix, np.float64)[:3, :3])
    lists = (read_only(voxels.row_start), read_only(voxels.column), points.offsets, voxels.shape_xyz[1])
    for done, first, count in row_pieces(voxels, LOOKED_UP_AT_ONCE * thread_count(threads)):
        yield done
        with parallel_call(threads):
            _block(first, count, lists, seen, limits, place, pyramid, np.float32(share), beside, left)


def _limits(nearest, place, edges) -> np.ndarray:
    """(n, 4) float64: a voxel that meshes may shade has a x + b y + c z + d >= 0 of each row.

    Those before all meshes and beside the rectangle of the sheet that they cover are left out, with as much to spare as
    a point is away from its voxel.
    """
    rows, columns = (np.flatnonzero(np.isfinite(nearest).any(axis=axis)) for axis in (1, 0))
    found = [place[2], place[3] - (0.0, 0.0, 0.0, float(nearest.min()))]
    for own, covered, count in ((0, columns, nearest.shape[1]), (1, rows, nearest.shape[0])):
        if covered[0] > 1:  # points beyond the sheet are looked up on its border
            found.append(place[own] - (covered[0] - 1.0) * place[2])
        if covered[-1] < count - 2:
            found.append((covered[-1] + 1.0) * place[2] - place[own])
    limits = np.array(found)
    furthest = FURTHER * FARTHEST * np.linalg.norm(edges) * np.linalg.norm(np.linalg.inv(edges), axis=1)
    limits[:, 3] += np.abs(limits[:, :3]) @ furthest
    return limits


# --- kernels ----------------------------------------------------------------------------------------------------


@kernel
def _block(first, count, lists, seen, limits, place, pyramid, share, beside, left):
    """Kernel of ``block_steps`` for ``count`` rows from ``first`` on.

    ``seen``: the first and the last of each pixel's ``meshes``, and these themselves.  ``limits``: of ``_limits``.
    ``place``: voxel to sheet, 16 numbers.  ``pyramid``: 0 of parallel light, else 1 or -1 where it opens upwards or
    downwards; its source; axes.
    """
    share_out(_block_rows, count, (first, lists, seen, limits, place, pyramid, share, beside, left))


@kernel(inner=True)
def _block_rows(begin, end, first, lists, seen, limits, place, pyramid, share, beside, left):
    """``_block`` for some of them."""
    row_start, column, offsets, rows = lists
    nearest, furthest, meshes = seen
    up, source, axes = pyramid
    height, width = nearest.shape
    step, half, one = 1.0 / STEPS, np.float32(0.5), np.float32(1.0)
    for row in range(first + begin, first + end):
        y, z = np.float64(row % rows), np.float64(row // rows)
        low, high = _between(limits, y, z)
        at, stop = row_start[row], row_start[row + 1]
        while at < stop and column[at] < low:
            at += 1
        while stop > at and column[stop - 1] > high:
            stop -= 1
        if low > high or at >= stop:
            continue
        for v in range(at, stop):
            px, py, pz = np.float64(column[v]), y, z
            if beside:
                px, py, pz = px + step * offsets[v, 0], py + step * offsets[v, 1], pz + step * offsets[v, 2]
            w = 1.0
            if up != 0:
                w = place[8] * px + place[9] * py + place[10] * pz + place[11]
                if w <= 0.0 or not _within(up, source, axes, px, py, pz):
                    continue
                w = 1.0 / w
            depth = np.float32(place[12] * px + place[13] * py + place[14] * pz + place[15])
            u = w * (place[0] * px + place[1] * py + place[2] * pz + place[3])
            t = w * (place[4] * px + place[5] * py + place[6] * pz + place[7])
            u, t = min(max(u, 0.0), width - 1.0), min(max(t, 0.0), height - 1.0)
            i, j = min(np.int64(u), width - 2), min(np.int64(t), height - 2)
            upper, lower = nearest[j], nearest[j + 1]
            if min(min(upper[i], upper[i + 1]), min(lower[i], lower[i + 1])) >= depth:
                continue
            blocked, upper, lower = one, furthest[j], furthest[j + 1]
            if max(max(upper[i], upper[i + 1]), max(lower[i], lower[i + 1])) >= depth:
                right, down = np.float32(u - i), np.float32(t - j)
                blocked = (one - down) * (
                    (one - right) * _met(meshes[j, i], depth) + right * _met(meshes[j, i + 1], depth)
                ) + down * ((one - right) * _met(meshes[j + 1, i], depth) + right * _met(meshes[j + 1, i + 1], depth))
            left[v] -= np.uint16(blocked * share + half)


@inner_loop
def _between(limits, y, z):
    """The first and the last x of a row (y, z) that keep all ``limits``."""
    low, high = -1e300, 1e300
    for k in range(limits.shape[0]):
        slope, rest = limits[k, 0], limits[k, 1] * y + limits[k, 2] * z + limits[k, 3]
        if slope > 0.0:
            low = max(low, -rest / slope)
        elif slope < 0.0:
            high = min(high, -rest / slope)
        elif rest < 0.0:
            return 1.0, 0.0
    return low, high


@inner_loop
def _met(depths, depth):
    """Share of a pixel's rays that meet a mesh before a depth."""
    met = 0
    while met < depths.size and depths[met] < depth:
        met += 1
    return np.float32(met) / np.float32(depths.size)


@inner_loop
def _within(up, source, axes, x, y, z):
    """Whether a point is in the pyramid of rays from a source; one on the border is in that of the lowest axis."""
    a, b, c = axes
    dx, dy, dz = x - source[0], y - source[1], z - source[2]
    reach = up * (dx if c == 0 else dy if c == 1 else dz)
    aside, along = abs(dx if a == 0 else dy if a == 1 else dz), abs(dx if b == 0 else dy if b == 1 else dz)
    if reach <= 0.0 or aside > reach or along > reach:
        return False
    return (aside < reach or c < a) and (along < reach or c < b)
