"""Masks of voxels: made from values, grown, shrunk, smoothed, filled, and parts of them.

A mask is a (nz, ny, nx) array of bool, in the order of ``Volume.voxels``; a spacing is (x, y, z).  Distances are exact
ones between the centers of voxels (package edt), and connected voxels share faces (package cc3d).  Work on a mask is
limited to the box around it.  Each function is a generator of Progress that can be closed between two calls of a
library, and returns a new mask.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np

from ..runtime.jit import available_threads
from ..runtime.memory import refuse_beyond
from ..runtime.steps import Progress, announce, rescale
from ..scene import RleSplatError
from ..volume.volume import Volume

CC3D = "connected-components-3d"  # the package of the module cc3d
BYTES = 12  # for each voxel of a mask's box while a library works on it, the mask and the result included
CONNECTIVITY = 6  # neighbors of a voxel: those that share a face


def load(module: str, package: str):
    """Import a library of the segment tools; RleSplatError if this Python lacks it."""
    try:
        return import_module(module)
    except ImportError:
        raise RleSplatError(
            f"Segment tools need the package {package}, which this Python lacks; install it, or use the extension in "
            "Blender, which includes it."
        ) from None


def check_memory(voxels: int) -> None:
    """Refuse work on more voxels than memory has room for."""
    refuse_beyond(voxels * BYTES, "The segment tool needs")


def box_of(mask: np.ndarray, spacing, length: float = 0.0) -> tuple:
    """Slices of the box around a mask, larger by one voxel and ``length`` on each side; RleSplatError if it is empty.

    Parameters
    ----------
    mask : (nz, ny, nx) ndarray of bool
    spacing : (3,) array_like
        Distance between voxels along x, y, z.
    length : float
        In the unit of the spacing.
    """
    box = []
    for axis, step in enumerate(np.asarray(spacing)[::-1]):
        others = tuple(other for other in range(3) if other != axis)
        filled = np.flatnonzero(mask.any(axis=others))
        if not len(filled):
            raise RleSplatError("The segment has no voxels; choose another one.")
        margin = int(length / step) + 1
        box.append(slice(max(filled[0] - margin, 0), filled[-1] + margin + 1))
    return tuple(box)


def _distances(mask: np.ndarray, spacing) -> np.ndarray:
    """(nz, ny, nx) float32: distance from each voxel of a mask to the nearest one that is not in it; 0 outside.

    Beyond the array nothing is outside.
    """
    edt = load("edt", "edt")
    check_memory(mask.size)
    steps = tuple(float(step) for step in spacing[::-1])
    return edt.edt(np.ascontiguousarray(mask), anisotropy=steps, parallel=available_threads())


def label_parts(mask: np.ndarray) -> np.ndarray:
    """Number of the connected component of each voxel of a mask, from 1; 0 outside."""
    cc3d = load("cc3d", CC3D)
    check_memory(mask.size)
    return cc3d.connected_components(np.ascontiguousarray(mask), connectivity=CONNECTIVITY, binary_image=True)


def _check_length(length: float) -> None:
    if not 0.0 < length < float("inf"):
        raise RleSplatError(f"The distance must be above 0, not {length:g}.")


def threshold_steps(volume: Volume, low: float, high: float):
    """Generator of Progress: the voxels whose physical values are from ``low`` to ``high``.

    Raises
    ------
    RleSplatError
        If ``low`` is above ``high``, or no value is between them.
    """
    if low > high:
        raise RleSplatError(f"The lowest value, {low:g}, is above the highest one, {high:g}; exchange them.")
    mask = np.empty(volume.voxels.shape, bool)
    yield from announce(_between_steps(volume, low, high, mask), 0.0, 1.0, "comparing values")
    if not mask.any():
        raise RleSplatError(f"No voxel has a value from {low:g} to {high:g}; choose other values.")
    return mask


def _between_steps(volume: Volume, low: float, high: float, mask: np.ndarray):
    """Generator of fractions done: fill a mask, slice by slice."""
    for z, stored in enumerate(volume.voxels):
        values = volume.physical(stored)
        np.logical_and(values >= low, values <= high, out=mask[z])
        yield z / len(mask)


def connect_steps(mask: np.ndarray, seed):
    """Generator of Progress: the voxels of a mask that are connected to one of them.

    Parameters
    ----------
    mask : (nz, ny, nx) ndarray of bool
    seed : (3,) sequence of int
        Voxel index x, y, z.

    Raises
    ------
    RleSplatError
        If the seed lies outside of the volume or of the mask.
    """
    x, y, z = (int(n) for n in seed)
    inside = all(0 <= n < count for n, count in zip((z, y, x), mask.shape))
    if not (inside and mask[z, y, x]):
        raise RleSplatError("Nothing is visible at this place; choose a voxel of a visible part.")
    yield Progress(0.0, "following what is connected")
    box = box_of(mask, (1, 1, 1))
    components = label_parts(mask[box])
    result = np.zeros_like(mask)
    yield Progress(0.9, "following what is connected")
    np.equal(components, components[tuple(n - one.start for n, one in zip((z, y, x), box))], out=result[box])
    return result


def grow_steps(mask: np.ndarray, spacing, length: float):
    """Generator of Progress: a mask and all voxels within a distance of it: its dilation by a ball.

    Parameters
    ----------
    mask : (nz, ny, nx) ndarray of bool
    spacing : (3,) array_like
        Distance between voxels along x, y, z.
    length : float
        Radius of the ball, in the unit of the spacing.

    Raises
    ------
    RleSplatError
        If the mask is empty, the length is not above 0, or there is not enough memory.
    """
    _check_length(length)
    yield Progress(0.0, "growing the segment")
    box, result = box_of(mask, spacing, length), mask.copy()
    np.less_equal(_distances(~mask[box], spacing), length, out=result[box])
    return result


def shrink_steps(mask: np.ndarray, spacing, length: float):
    """Generator of Progress: a mask without all voxels within a distance of others: its erosion by a ball.

    The mask is not shrunk at the sides of the volume.  Parameters and errors as of ``grow_steps``.
    """
    _check_length(length)
    yield Progress(0.0, "shrinking the segment")
    box, result = box_of(mask, spacing), mask.copy()
    np.greater(_distances(mask[box], spacing), length, out=result[box])
    return result


def smooth_steps(mask: np.ndarray, spacing, length: float):
    """Generator of Progress: a mask without bumps and notches that are smaller than a ball of radius ``length``.

    It is opened, then closed.  Parameters and errors as of ``grow_steps``; parts that are thinner than the ball are
    lost, and RleSplatError is raised where nothing would be left.
    """
    tools, share = (shrink_steps, grow_steps, grow_steps, shrink_steps), 0.25
    for number, tool in enumerate(tools):
        steps = tool(mask, spacing, length)
        mask = yield from rescale(steps, number * share, (number + 1) * share, "smoothing the segment")
        if not mask.any():
            raise RleSplatError(f"No part of the segment is as thick as {2.0 * length:g}; smooth it less.")
    return mask


def fill_steps(mask: np.ndarray):
    """Generator of Progress: a mask and all voxels that it encloses.

    Raises
    ------
    RleSplatError
        If the mask is empty, or there is not enough memory.
    """
    yield Progress(0.0, "filling holes")
    box, result = box_of(mask, (1, 1, 1)), mask.copy()
    components = label_parts(~mask[box])
    is_open = np.zeros(int(components.max()) + 1, bool)  # whether a component reaches a side of the box
    for axis in range(3):
        for side in (0, -1):
            is_open[components.take(side, axis)] = True
    is_open[0] = False  # the mask itself
    np.logical_not(is_open[components], out=result[box])
    return result


def keep_largest_steps(mask: np.ndarray):
    """Generator of Progress: the largest connected part of a mask.

    Raises
    ------
    RleSplatError
        If the mask is empty, or there is not enough memory.
    """
    yield Progress(0.0, "looking for the largest part")
    box, result = box_of(mask, (1, 1, 1)), np.zeros_like(mask)
    components = label_parts(mask[box])
    yield Progress(0.6, "looking for the largest part")
    sizes = load("cc3d", CC3D).statistics(components, no_slice_conversion=True)["voxel_counts"]
    sizes[0] = 0  # outside of the mask
    np.equal(components, sizes.argmax(), out=result[box])
    return result
