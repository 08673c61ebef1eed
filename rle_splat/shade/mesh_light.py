"""What meshes leave of the light of a lamp at voxels, looked up in the depth of the meshes as the lamp sees them.

The sheet of a sweep (``light_sheets``) is that picture: each pixel has several rays of light, and each ray the slice
at which it first meets a mesh.  A voxel looks itself up, between four pixels, at the point where its surface begins:
so a mesh that touches the surface casts its shadow there, and one below the surface does not show through.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only, thread_count
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from . import reference
from .light_sheets import Sweep
from .surface_points import STEPS, Points, onto_surface

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
        Whether light is looked up at the points off the surface, in place of the surface.
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
    nearest = np.ascontiguousarray(meshes[..., 0])
    seen = (read_only(nearest), read_only(meshes), float(nearest.min()))
    lists = (read_only(voxels.row_start), read_only(voxels.column), tuple(points), voxels.shape_xyz[1])
    pieces = -(-len(voxels) // (LOOKED_UP_AT_ONCE * thread_count(threads)))
    ends = np.searchsorted(voxels.row_start, np.linspace(0, len(voxels), pieces + 1)).tolist()
    for piece, (first, last) in enumerate(pairwise(ends)):
        yield piece / pieces
        with parallel_call(threads):
            _block(first, last - first, lists, seen, place, pyramid, np.float32(share), beside, left)


# --- kernels ----------------------------------------------------------------------------------------------------


@kernel
def _block(first, count, lists, seen, place, pyramid, share, beside, left):
    """Kernel of ``block_steps`` for ``count`` rows from ``first`` on.

    ``seen``: the first of each pixel's ``meshes``, these themselves, and the first of all.  ``place``: voxel to sheet,
    16 numbers.  ``pyramid``: 0 of parallel light, else 1 or -1 where it opens upwards or downwards; its source; axes.
    """
    share_out(_block_rows, count, (first, lists, seen, place, pyramid, share, beside, left))


@kernel(inner=True)
def _block_rows(begin, end, first, lists, seen, place, pyramid, share, beside, left):
    """``_block`` for some of them."""
    row_start, column, (normals, offsets, lamp), rows = lists
    nearest, meshes, least = seen
    up, source, axes = pyramid
    height, width, samples = meshes.shape
    edges = lamp[3]
    half, one, whole = np.float32(0.5), np.float32(1.0), 1.0 / STEPS
    for row in range(first + begin, first + end):
        y, z = np.float64(row % rows), np.float64(row // rows)
        for v in range(row_start[row], row_start[row + 1]):
            part = whole if beside else whole * onto_surface(normals, offsets, edges, v)
            px, py, pz = column[v] + part * offsets[v, 0], y + part * offsets[v, 1], z + part * offsets[v, 2]
            reached = place[12] * px + place[13] * py + place[14] * pz + place[15]
            if reached <= least or not _within(up, source, axes, (px, py, pz)):
                continue
            w = place[8] * px + place[9] * py + place[10] * pz + place[11]
            if w <= 0.0:
                continue
            x = (place[0] * px + place[1] * py + place[2] * pz + place[3]) / w
            x = min(max(x, 0.0), width - 1.0)
            across = (place[4] * px + place[5] * py + place[6] * pz + place[7]) / w
            across = min(max(across, 0.0), height - 1.0)
            i, j = min(np.int64(x), width - 2), min(np.int64(across), height - 2)
            right, down = np.float32(x - i), np.float32(across - j)
            blocked = np.float32(0.0)
            for corner in range(4):
                far, beyond = corner >> 1, corner & 1
                if nearest[j + far, i + beyond] >= reached:
                    continue
                met = 1
                while met < samples and meshes[j + far, i + beyond, met] < reached:
                    met += 1
                weight = (down if far else one - down) * (right if beyond else one - right)
                blocked += weight * np.float32(met)
            left[v] -= np.uint16(blocked / np.float32(samples) * share + half)


@inner_loop
def _within(up, source, axes, point):
    """Whether a point is in the pyramid of rays from a source; one on the border is in that of the lowest axis."""
    if up == 0:
        return True
    a, b, c = axes
    reach = up * (point[c] - source[c])
    aside, along = abs(point[a] - source[a]), abs(point[b] - source[b])
    if reach <= 0.0 or aside > reach or along > reach:
        return False
    return (aside < reach or c < a) and (along < reach or c < b)
