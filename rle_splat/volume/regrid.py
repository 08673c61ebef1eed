"""Further volumes brought onto the grid of a volume by the places of both in the patient.

Labels take the nearest voxel; the values of channels are interpolated linearly.
"""

import math
from dataclasses import replace

import numpy as np

from ..runtime.memory import refuse_beyond
from ..runtime.steps import Progress, map_steps
from ..scene import RleSplatError
from ..scene.further_volumes import TOLERANCE, is_same_grid, move_corners
from .interpolate import interpolate
from .volume import PATIENT, Volume, range_steps

DOING = "matching {} to the volume"
NAMES = {False: "The segmentation file", True: "The channel"}


def on_grid_steps(one: Volume, volume: Volume, values: bool = False):
    """Generator of Progress: a label map or a channel on the grid of a volume.

    Parameters
    ----------
    one : Volume
        A label map, or a channel.
    values : bool
        Whether ``one`` holds values, which may be interpolated, and not labels.

    Returns
    -------
    Volume
        ``one`` itself if both have one grid. If one of them is not in patient space, voxels of the same index belong
        together; if neither is, ``one`` gets the affine of ``volume``. Else a new volume: voxels in another order are
        reordered exactly. On another grid each voxel takes the nearest label, 0 outside, or the value between its
        neighbors, the lowest one outside. ``remarks`` say what was done.

    Raises
    ------
    RleSplatError
        If no voxel of the volume lies within ``one``.
    """
    if PATIENT not in (one.space, volume.space):
        return one if is_same_grid(volume, one) else replace(one, affine=volume.affine)
    name = NAMES[values]
    if one.space != volume.space:
        which = "The volume" if volume.space is None else name
        what = "channels" if values else "labels"
        remark = f"{which} does not say how it lies in the patient, so {what} were matched voxel by voxel."
        return replace(one, remarks=(*one.remarks, remark))
    if is_same_grid(volume, one):
        return one
    needed = math.prod(volume.shape_xyz) * one.voxels.dtype.itemsize
    what = "A channel" if values else "Labels"
    refuse_beyond(needed, f"{what} on the grid of the volume need")
    doing = DOING.format("a channel" if values else "the labels")
    yield Progress(0.0, doing)
    own, moved = move_corners(volume, one)
    matrix = np.linalg.inv(one.affine) @ volume.affine  # index of the volume -> index of the other
    order = _axis_order(matrix, own[-1])
    whole = np.abs(moved - np.round(moved)).max() <= TOLERANCE
    filling = 0
    if values:
        low, _ = yield from _fractions(range_steps(one), doing)
        filling = (low - one.intercept) / one.slope
    if order is not None and (whole or not values):
        steps = _reorder_steps(one.voxels, matrix, order, volume.shape_xyz, filling)
    else:
        take = _take_between if values else _take_nearest
        steps = _sample_steps(one.voxels, matrix, volume.shape_xyz, filling, take)
    voxels, outside = yield from _fractions(steps, doing)
    if outside == voxels.size:
        scan = "a channel" if values else "the labels"
        raise RleSplatError(f"{name} lies elsewhere: no voxel of the volume is within it; choose {scan} of this scan.")
    remark = _remark(one, volume, name, order, whole, outside / voxels.size)
    return replace(one, voxels=voxels, affine=volume.affine, remarks=(*one.remarks, remark))


def _fractions(steps, doing: str):
    """Generator of Progress: the steps of a generator of fractions."""
    return (yield from map_steps(steps, lambda done: Progress(done, doing)))


def _remark(one: Volume, volume: Volume, name: str, order, whole: bool, outside: float) -> str:
    """What was done, in one sentence."""
    fits = order is not None and [one.shape_xyz[i] for i in range(3)] == [volume.shape_xyz[a] for a in order]
    if whole and fits and outside == 0.0:
        return f"{name} stores its voxels in another order; they were reordered."
    shape = " x ".join(map(str, one.shape_xyz))
    beyond = f", and {outside:.0%} of the volume lie outside it" if outside > 0.0 else ""
    takes = "each voxel takes the nearest label" if name == NAMES[False] else "its values were interpolated"
    return f"{name} has another grid ({shape} voxels); {takes}{beyond}."


def _axis_order(matrix, last) -> tuple | None:
    """For each axis of the labels the one axis of the volume that it depends on; None if the grids are turned."""
    reach = np.abs(matrix[:3, :3]) * last  # how many voxels of the labels each axis of the volume moves
    order = np.abs(matrix[:3, :3]).argmax(axis=1)
    rest = reach.sum(axis=1) - reach[np.arange(3), order]
    if sorted(order) != [0, 1, 2] or rest.max() > TOLERANCE:
        return None
    return tuple(int(a) for a in order)


def _reorder_steps(voxels: np.ndarray, matrix, order, shape_xyz, filling):
    """Generator of fractions: gather along the axes one by one; return (voxels, how many lie outside)."""
    counts = voxels.shape[::-1]
    found, inside = [], []
    for i, axis in enumerate(order):
        index = np.round(matrix[i, axis] * np.arange(shape_xyz[axis]) + matrix[i, 3]).astype(np.int64)
        inside.append((index >= 0) & (index < counts[i]))
        found.append(np.clip(index, 0, counts[i] - 1))
    along_z = order.index(2)  # the axis of the labels that follows the volume's slices
    others = [i for i in (2, 1, 0) if i != along_z]
    result = np.full(shape_xyz[::-1], filling, dtype=voxels.dtype)
    grid = np.ix_(*(found[i] for i in others))
    keep = np.logical_and.outer(*(inside[i] for i in others))
    covered = 0
    for z in range(shape_xyz[2]):
        if inside[along_z][z]:
            plane = np.take(voxels, found[along_z][z], axis=2 - along_z)[grid]
            plane[~keep] = filling
            result[z] = plane if order[others[0]] == 1 else plane.T
            covered += int(keep.sum())
        yield z / shape_xyz[2]
    return result, result.size - covered


def _sample_steps(voxels: np.ndarray, matrix, shape_xyz, filling, take):
    """Generator of fractions: look up the places of a volume's voxels; return (voxels, how many lie outside).

    ``take``: ``_take_nearest`` or ``_take_between``.
    """
    nx, ny, nz = shape_xyz
    result = np.full((nz, ny, nx), filling, dtype=voxels.dtype)
    x, y = np.arange(nx), np.arange(ny)[:, None]
    covered = 0
    for z in range(nz):
        found, inside = take(voxels, [row[0] * x + row[1] * y + (row[2] * z + row[3]) for row in matrix[:3]])
        result[z][inside] = found
        covered += int(inside.sum())
        yield z / nz
    return result, result.size - covered


def _take_nearest(voxels: np.ndarray, places) -> tuple[np.ndarray, np.ndarray]:
    """The voxels nearest to places, and which of these lie inside."""
    index = [np.rint(place).astype(np.int64) for place in places]
    inside = np.logical_and.reduce([(i >= 0) & (i < n) for i, n in zip(index, voxels.shape[::-1])])
    x, y, z = (i[inside] for i in index)
    return voxels[z, y, x], inside


def _take_between(voxels: np.ndarray, places) -> tuple[np.ndarray, np.ndarray]:
    """Values between voxels, and which places lie inside: half a voxel beyond the outermost centers at most."""
    value, inside = interpolate(voxels, places)
    return np.rint(value) if voxels.dtype.kind in "iu" else value, inside
