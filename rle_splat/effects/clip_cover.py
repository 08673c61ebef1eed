"""The share of each voxel that clip objects keep, for shadows: what is cut away casts none."""

from collections.abc import Sequence

import numpy as np

from ..classify.visible import VisibleVoxels
from ..scene import Clip

AT_ONCE = 1 << 16  # voxels looked at together, between two chances to cancel, 10 ms for each clip


def cover_steps(clips: Sequence[Clip], voxels: VisibleVoxels, matrix):
    """Generator of fractions done: find the share of each voxel that all clip objects keep.

    Parameters
    ----------
    matrix : (4, 4) ndarray of float64
        Voxel index (x, y, z) to world.

    Returns
    -------
    (m,) ndarray of float32
        0 to 1; between them where a cut is within half a voxel of the voxel center.
    """
    ny, left = voxels.shape_xyz[1], np.empty(len(voxels), np.float32)
    for first in range(0, len(voxels), AT_ONCE):
        yield first / len(voxels)
        part = slice(first, min(first + AT_ONCE, len(voxels)))
        row = np.searchsorted(voxels.row_start, np.arange(part.start, part.stop), side="right") - 1
        index = np.stack((voxels.column[part].astype(np.float64), row % ny, row // ny, np.ones(len(row))))
        left[part] = 1.0
        for clip in clips:
            own = np.linalg.inv(clip.matrix_world) @ matrix
            # Of a plane what lies below z = 0, of a box what lies within 1 of the middle along each axis.
            rows = own[2:3] if clip.kind == "plane" else own[:3]
            inside = np.ones(len(row))
            for sided in (rows,) if clip.kind == "plane" else (rows, -rows):
                for plane in sided:
                    beyond = plane @ index - (0.0 if clip.kind == "plane" else 1.0)
                    inside *= np.clip(0.5 - beyond / np.linalg.norm(plane[:3]), 0.0, 1.0)
            left[part] *= inside if clip.keep == "inside" else 1.0 - inside
    return left
