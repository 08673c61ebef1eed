"""Labels brought onto the grid of a volume by the places of both in the patient, by nearest neighbor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..runtime.memory import refuse_beyond
from ..runtime.steps import Progress
from ..scene import RleSplatError
from .volume import PATIENT, Volume

TOLERANCE = 0.05  # voxels; grids that differ by less anywhere are the same
CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)
DOING = "matching the labels to the volume"


def on_grid_steps(labels: Volume, volume: Volume):
    """Generator of Progress: a label map on the grid of a volume.

    Parameters
    ----------
    labels : Volume
        Whole numbers.
    volume : Volume

    Returns
    -------
    Volume
        ``labels`` itself if both have one grid, or if one of them is not in patient space: then voxels of the same
        index belong together. Else a new label map: voxels in another order are reordered exactly, and on another grid
        each voxel takes the nearest label, 0 outside. ``remarks`` say what was done.

    Raises
    ------
    RleSplatError
        If no voxel of the volume lies within the label map.
    """
    if PATIENT not in (labels.space, volume.space):
        return labels
    if labels.space != volume.space:
        which = "volume" if volume.space is None else "label file"
        remark = f"The {which} does not say how it lies in the patient, so labels were matched voxel by voxel."
        return replace(labels, remarks=(*labels.remarks, remark))
    matrix = np.linalg.inv(labels.affine) @ volume.affine  # index of the volume -> index of the labels
    last = np.array(volume.shape_xyz) - 1.0
    moved = CORNERS * last @ matrix[:3, :3].T + matrix[:3, 3]
    if labels.shape_xyz == volume.shape_xyz and np.abs(moved - CORNERS * last).max() <= TOLERANCE:
        return labels
    needed = math.prod(volume.shape_xyz) * labels.voxels.dtype.itemsize
    refuse_beyond(needed, "Labels on the grid of the volume need", "crop or downsample the volume")
    yield Progress(0.0, DOING)
    order = _axis_order(matrix, last)
    if order is None:
        voxels, outside = yield from _gathered_steps(labels.voxels, matrix, volume.shape_xyz)
    else:
        voxels, outside = yield from _reordered_steps(labels.voxels, matrix, order, volume.shape_xyz)
    if outside == voxels.size:
        raise RleSplatError(
            "The label file lies elsewhere: no voxel of the volume is within it; choose the labels of this scan."
        )
    remark = _remark(labels, volume, moved, order, outside / voxels.size)
    return replace(labels, voxels=voxels, affine=volume.affine, remarks=(*labels.remarks, remark))


def _remark(labels: Volume, volume: Volume, moved, order, outside: float) -> str:
    """What was done, in one sentence; ``moved``: the volume's corners as indices of the labels."""
    whole = np.abs(moved - np.round(moved)).max() <= TOLERANCE
    fits = order is not None and [labels.shape_xyz[i] for i in range(3)] == [volume.shape_xyz[a] for a in order]
    if whole and fits and outside == 0.0:
        return "The label file stores its voxels in another order; they were reordered."
    shape = " x ".join(map(str, labels.shape_xyz))
    beyond = f", and {outside:.0%} of the volume lie outside it" if outside > 0.0 else ""
    return f"The label file has another grid ({shape} voxels); each voxel takes the nearest label{beyond}."


def _axis_order(matrix, last) -> tuple | None:
    """For each axis of the labels the one axis of the volume that it depends on; None if the grids are turned."""
    reach = np.abs(matrix[:3, :3]) * last  # how many voxels of the labels each axis of the volume moves
    order = np.abs(matrix[:3, :3]).argmax(axis=1)
    rest = reach.sum(axis=1) - reach[np.arange(3), order]
    if sorted(order) != [0, 1, 2] or rest.max() > TOLERANCE:
        return None
    return tuple(int(a) for a in order)


def _reordered_steps(voxels: np.ndarray, matrix, order, shape_xyz):
    """Generator of Progress: gather along the axes one by one; return (voxels, how many lie outside)."""
    counts = voxels.shape[::-1]
    found, inside = [], []
    for i, axis in enumerate(order):
        index = np.round(matrix[i, axis] * np.arange(shape_xyz[axis]) + matrix[i, 3]).astype(np.int64)
        inside.append((index >= 0) & (index < counts[i]))
        found.append(np.clip(index, 0, counts[i] - 1))
    along_z = order.index(2)  # the axis of the labels that follows the volume's slices
    others = [i for i in (2, 1, 0) if i != along_z]
    result = np.zeros(shape_xyz[::-1], dtype=voxels.dtype)
    grid = np.ix_(*(found[i] for i in others))
    keep = np.logical_and.outer(*(inside[i] for i in others))
    covered = 0
    for z in range(shape_xyz[2]):
        if inside[along_z][z]:
            plane = np.take(voxels, found[along_z][z], axis=2 - along_z)[grid] * keep
            result[z] = plane if order[others[0]] == 1 else plane.T
            covered += int(keep.sum())
        yield Progress(z / shape_xyz[2], DOING)
    return result, result.size - covered


def _gathered_steps(voxels: np.ndarray, matrix, shape_xyz):
    """Generator of Progress: gather each voxel's nearest label; return (voxels, how many lie outside)."""
    nx, ny, nz = shape_xyz
    counts = np.array(voxels.shape[::-1])
    result = np.zeros((nz, ny, nx), dtype=voxels.dtype)
    x, y = np.arange(nx), np.arange(ny)[:, None]
    covered = 0
    for z in range(nz):
        index = [np.rint(row[0] * x + row[1] * y + (row[2] * z + row[3])).astype(np.int64) for row in matrix[:3]]
        inside = np.logical_and.reduce([(i >= 0) & (i < n) for i, n in zip(index, counts)])
        ix, iy, iz = (i[inside] for i in index)
        result[z][inside] = voxels[iz, iy, ix]
        covered += int(inside.sum())
        yield Progress(z / nz, DOING)
    return result, result.size - covered
