"""A volume of fewer, larger voxels, for small pictures and for volumes that are too large."""

import hashlib
import math
from dataclasses import replace
from functools import reduce

import numpy as np

from ..runtime.memory import refuse_beyond
from ..runtime.steps import Progress
from ..scene import RleSplatError
from .volume import Volume

AT_ONCE = 1 << 18  # voxels that are merged at once, which stay in the processor's cache


def factors_of(volume: Volume, side: int) -> tuple[int, int, int]:
    """How many voxels are averaged along x, y and z for a volume of about so many voxels along its longest side.

    Parameters
    ----------
    side : int
        Voxels along the longest side; they are about as wide as high.
    """
    lengths = np.array(volume.shape_xyz) * volume.spacing
    wanted = float(lengths.max()) / side
    found = np.maximum(1, np.rint(wanted / np.where(volume.spacing > 0.0, volume.spacing, wanted)))
    return tuple(int(min(factor, count)) for factor, count in zip(found, volume.shape_xyz))


def node_to_index(factors) -> np.ndarray:
    """(4, 4) float64: index of a block of so many voxels along x, y and z to the voxel index of its middle."""
    matrix = np.diag((*factors, 1.0))
    matrix[:3, 3] = 0.5 * (np.array(factors) - 1.0)
    return matrix


def sample_steps(volume: Volume, level: int):
    """Generator of Progress: every 2^``level``-th voxel along each axis, so that little of a large file is read.

    Parameters
    ----------
    volume : Volume
        Possibly mapped from its file.
    level : int
        At least 1.

    Returns
    -------
    Volume
        Its voxels are where they were. Its ``levels`` are those that can be sampled, with the volume itself before
        them, and a remark says that voxels were left out.

    Raises
    ------
    RleSplatError
        If there is no such level, or its voxels need more memory than is free.
    """
    most = max(volume.shape_xyz).bit_length() - 1
    if not 0 < level <= most:
        raise RleSplatError(f"There is no level {level}: {volume.name or 'the volume'} has those from 0 to {most}.")
    levels = tuple(tuple(len(_every(2**n, count)) for count in volume.shape_xyz) for n in range(most + 1))
    chosen = [_every(2**level, count) for count in volume.shape_xyz]
    size = math.prod(levels[level]) * volume.voxels.dtype.itemsize
    refuse_beyond(size, f"Level {level} of the volume needs", "choose a coarser one")
    voxels = np.empty(levels[level][::-1], volume.voxels.dtype)
    x, y = (slice(one.start, one.stop, one.step) for one in chosen[:2])
    for number, plane in enumerate(chosen[2]):
        yield Progress(number / len(voxels), f"Reading one of {2**level} planes")
        voxels[number] = volume.voxels[plane, y, x]
    voxels.flags.writeable = False
    to_voxels = np.diag((*(3 * [float(2**level)]), 1.0))
    to_voxels[:3, 3] = [one.start for one in chosen]
    remark = (
        f"Of every {2**level} voxels along each axis one was read, and none were averaged: what is thinner than that "
        "may be jagged or missing."
    )
    return replace(
        volume, voxels=voxels, affine=volume.affine @ to_voxels, levels=levels, remarks=(*volume.remarks, remark)
    )


def _every(step: int, count: int) -> range:
    """Every ``step``-th of so many voxels, one at least, from the middle of the first block on."""
    return range(min(step // 2, count // 2), count, step)


def average(planes: list, fy: int, fx: int) -> np.ndarray:
    """Means of ``fy`` by ``fx`` voxels in all of some arrays of planes, rounded for whole numbers."""
    is_whole, count = planes[0].dtype.kind in "iu", len(planes) * fy * fx
    kind = np.int32 if is_whole and planes[0].itemsize < 4 and count < 1 << 15 else np.float64
    total = _folded(np.add, [plane.astype(kind) for plane in planes], fy, fx) / count
    return np.rint(total, out=total) if is_whole else total


def majority(planes: list, fy: int, fx: int) -> np.ndarray:
    """What more than half of the voxels of each block hold, as in ``average``; one of their values where none does.

    By Boyer and Moore, where a block does not hold one value alone.
    """
    found = _folded(np.minimum, planes, fy, fx)
    mixed = np.nonzero(found != _folded(np.maximum, planes, fy, fx))
    first, *others = (plane[:, y::fy, x::fx][mixed] for plane in planes for y in range(fy) for x in range(fx))
    lead = np.ones(first.shape, np.int16)
    for part in others:
        lead += np.where(part == first, np.int16(1), np.int16(-1))
        np.copyto(first, part, where=lead < 0)
        np.abs(lead, out=lead)
    found[mixed] = first
    return found


def _folded(merge, planes: list, fy: int, fx: int) -> np.ndarray:
    """Planes merged with each other, then rows and then columns: what is one after another in memory first."""
    rows = reduce(merge, planes)
    columns = reduce(merge, [rows[:, y::fy] for y in range(fy)])
    return reduce(merge, [columns[..., x::fx] for x in range(fx)])


def reduce_steps(volume: Volume, factors: tuple[int, int, int], merge=average):
    """Generator of fractions done: merge blocks of voxels.

    Parameters
    ----------
    volume : Volume
        Blocks that reach beyond its far faces are filled up with the voxels there.
    factors : (fx, fy, fz)
        Voxels along each side of a block.
    merge : callable
        ``average``, or ``majority`` for labels.

    Returns
    -------
    Volume
        In the same place, read-only. Stored values have the volume's own type.

    Raises
    ------
    RleSplatError
        If the volume of larger voxels itself needs more memory than is free.
    """
    (fx, fy, fz), fine = factors, volume.voxels
    nx, ny, nz = (-(-count // factor) for count, factor in zip(volume.shape_xyz, factors))
    refuse_beyond(nx * ny * nz * fine.dtype.itemsize, "The volume in larger voxels needs", "free some memory")
    beyond = [(0, 0), (0, ny * fy - fine.shape[1]), (0, nx * fx - fine.shape[2])]
    voxels = np.empty((nz, ny, nx), fine.dtype)
    at_once = max(AT_ONCE // (fz * fine[0].size), 1)
    for first in range(0, nz, at_once):
        last = min(first + at_once, nz)
        yield first / nz
        planes = fine[first * fz : last * fz]
        beyond[0] = 0, (last - first) * fz - len(planes)
        if any(map(any, beyond)):
            planes = np.pad(planes, beyond, mode="edge")
        voxels[first:last] = merge([planes[z::fz] for z in range(fz)], fy, fx)
    voxels.flags.writeable = False
    found = replace(volume, voxels=voxels, affine=volume.affine @ node_to_index(factors))
    # Its own voxels need not be read for a hash of them.
    content = f"{merge.__name__} of {volume.voxel_key} in blocks of {factors}"
    found.measured["voxel_key"] = hashlib.blake2b(content.encode(), digest_size=16).hexdigest()
    return found
