"""What single rays go through and where they go: rows of kept voxels, bricks of them, and rays within the box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..view.base_plane import BasePlane
from ..view.clip_intervals import Cuts, clip_rays
from ..view.eye import IndexView
from ..volume.axes import AXES
from ..volume.stored_scalars import StoredScalars

BRICK_BITS = 2  # of a brick's 2**BRICK_BITS voxels along each side, all of which are leaped over together


class RowVoxels(NamedTuple):
    """The kept voxels of a volume, in rows along x; row number ``z * ny + y``.

    ``bits``: (nz * ny, words) uint64, a bit for each voxel that is kept.  ``row_start``: (nz * ny + 1,), where the
    records of a row begin.  ``bricks``: (z, y, x) uint8, 0 where none of a brick's voxels is kept.  ``scalars`` (m,)
    and ``codes`` (m, channels) int16 or None: as ``encode.scalars.ScalarVolume`` has them, in rows; the kernel takes
    StoredScalars, so that one serves all types.  ``shown``: (k, 2)
    float64, a cell shows something where, for any row (a, b), its largest scalar is at least a and its smallest at most
    b; others may be kept too.  ``shape``: voxels along z, y, x.  ``further``: ChannelVoxels, or None.
    """

    bits: np.ndarray
    row_start: np.ndarray
    bricks: np.ndarray
    scalars: np.ndarray | StoredScalars
    codes: np.ndarray | None
    shown: np.ndarray
    shape: tuple[int, int, int]
    further: ChannelVoxels | None = None


class ChannelVoxels(NamedTuple):
    """Further channels of the same voxels.

    ``values``: (m, channels) float32, as ``encode.scalars.ScalarVolume`` has them, in rows.  ``shown`` of all of them,
    as RowVoxels has it, those of channel number ``n`` from ``begins[n]`` to ``begins[n + 1]``.
    """

    values: np.ndarray
    shown: np.ndarray
    begins: np.ndarray


class RayList(NamedTuple):
    """Rays of one principal axis.

    At ``s`` voxels along the viewing direction of that axis a ray is at voxel ``first + s * step``, each (n, 3) float64
    of x, y, z; it is followed from ``enter`` to ``leave`` (pieces, n), piece by piece.  ``length``: (n,) world length
    per voxel of depth.  ``depth``: (n, 2) planar depth at ``s`` = 0 and per voxel of ``s``.
    """

    first: np.ndarray
    step: np.ndarray
    enter: np.ndarray
    leave: np.ndarray
    length: np.ndarray
    depth: np.ndarray


def bricks_of(bits: np.ndarray, shape_xyz) -> np.ndarray:
    """The ``bricks`` of RowVoxels from their ``bits``."""
    nx, ny, nz = shape_xyz
    size = 1 << BRICK_BITS
    words = bits.astype("<u8", copy=False).reshape(nz, ny, -1)
    for axis, count in ((1, ny), (0, nz)):
        words = np.bitwise_or.reduceat(words, np.arange(0, count, size), axis=axis)
    eights = words.view(np.uint8)
    parts = [eights >> first & (1 << size) - 1 for first in range(0, 8, size)]
    return np.ascontiguousarray(np.stack(parts, axis=-1).reshape(*eights.shape[:2], -1)[..., : -(-nx // size)])


def rays_through(
    plane: BasePlane, view: IndexView, shape_xyz, columns, rows, clip, cuts: Cuts | None = None
) -> RayList:
    """The rays through pixel positions (n,), from the left and the top, within the box of the voxel centers.

    All of them must belong to the plane's principal axis and direction.  ``clip``: the least and the largest planar
    depth that is seen, numbers or (n,).  ``cuts``: what is cut out of them.  Element by element: the bits of a matrix
    product depend on its size.
    """
    i, j, k = AXES[plane.axis]
    inverse = np.linalg.inv(plane.homography / np.abs(plane.homography).max())
    x, y, w = (row[0] * columns + row[1] * rows + row[2] for row in inverse)
    x, y = x / w, y / w
    dx, dy = (np.broadcast_to(slope, x.shape) for slope in plane.slopes(x, y))
    at_zero, per_voxel = plane.depth_along(x, y)
    first, step = np.zeros((len(x), 3)), np.empty((len(x), 3))
    first[:, i], first[:, j] = x - plane.reference * dx, y - plane.reference * dy
    step[:, i], step[:, j], step[:, k] = plane.sign * dx, plane.sign * dy, plane.sign
    depth = np.stack(np.broadcast_arrays(at_zero, plane.sign * per_voxel), axis=1)
    enter, leave = np.full(len(x), -np.inf), np.full(len(x), np.inf)
    sides = *((first[:, axis], step[:, axis], 0.0, shape_xyz[axis] - 1.0) for axis in range(3)), (*depth.T, *clip)
    for at, along, low, high in sides:
        with np.errstate(divide="ignore", invalid="ignore"):
            both = np.sort(((low - at) / along, (high - at) / along), axis=0)
        straight = along == 0.0
        outside = straight & ((at < low) | (at > high))
        enter = np.where(straight, enter, np.maximum(enter, both[0]))
        leave = np.where(straight, leave, np.minimum(leave, both[1]))
        leave = np.where(outside, -np.inf, leave)
    if not view.is_parallel:
        enter = np.maximum(enter, plane.sign * view.eye[k])
    moved = (row[0] * step[:, 0] + row[1] * step[:, 1] + row[2] * step[:, 2] for row in view.to_world)
    length = np.sqrt(sum(each * each for each in moved))
    enter, leave = enter[None], leave[None]
    if cuts is not None:
        begin, end = clip_rays(first, step, cuts)
        enter, leave = np.maximum(enter, begin), np.minimum(leave, end)
    return RayList(first, step, enter, leave, length, np.ascontiguousarray(depth))
