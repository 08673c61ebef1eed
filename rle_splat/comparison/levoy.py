"""Levoy's ray casting with early termination and space leaping.

M. Levoy, Efficient ray tracing of volume data, ACM Transactions on Graphics 9(3), 1990: the paper's [3].
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import kernel, need_kernels, parallel_call, prange, read_only
from ..runtime.lanes import add4
from ..scene import NO_DEPTH, Quality
from .medium import CHANNELS, ShadedScene, pixel_rays
from .system import ReadySystem, picture

TITLE = "Levoy's ray casting"
STEP = 1.0  # of the smallest voxel spacing, the default of current ray casters
BLOCK = 4  # cells along a side of the blocks that are leaped over where nothing absorbs


def prepare(medium: ShadedScene, quality: Quality, step: float = STEP, leaping: bool = True) -> ReadySystem:
    """Cast rays through the pre-classified medium, interpolated trilinearly, zero outside the grid.

    Parameters
    ----------
    quality : Quality
        Only its termination and threads count.
    step : float
        Distance of samples, in the smallest voxel spacing.
    leaping : bool
        Leap over empty blocks; the picture is the same.
    """
    need_kernels(TITLE)
    field = medium.field
    blocks = occupied_blocks(field)
    memory = {"voxels": field.nbytes, "blocks": blocks.nbytes if leaping else 0}
    return ReadySystem(lambda: cast(medium, quality, blocks, step, leaping), memory, {"step_voxels": step})


def occupied_blocks(field: np.ndarray) -> np.ndarray:
    """(bz, by, bx) uint8: whether anything absorbs in each block of BLOCK^3 cells of a padded field (.., .., .., 4).

    A cell absorbs where one of its eight corners does; the corners on a block's far faces lie in the next blocks.
    """
    busy = field[..., 3] > 0.0
    for axis in range(3):
        ahead = np.zeros_like(busy)
        source, target = [slice(None)] * 3, [slice(None)] * 3
        source[axis], target[axis] = slice(1, None), slice(None, -1)
        ahead[tuple(target)] = busy[tuple(source)]
        busy = busy | ahead
    counts = [-(-n // BLOCK) for n in busy.shape]
    whole = np.zeros([BLOCK * n for n in counts], dtype=bool)
    whole[tuple(slice(n) for n in busy.shape)] = busy
    return whole.reshape(counts[0], BLOCK, counts[1], BLOCK, counts[2], BLOCK).any(axis=(1, 3, 5)).astype(np.uint8)


def cast(medium: ShadedScene, quality: Quality, blocks, step: float = STEP, leaping: bool = True):
    """Cast one frame; a Rendering with depth."""
    view, camera = medium.view, medium.scene.camera
    start, direction = pixel_rays(view)
    start[:, 2] += 1.0  # the field is padded by one voxel
    spacing = float(np.linalg.norm(view.to_world, axis=0).min())
    image = np.empty((view.height, view.width, CHANNELS), np.float32)
    depth = np.full((view.height, view.width), NO_DEPTH, np.float32)
    with parallel_call(quality.threads) as workers:
        cast_rows(
            workers, read_only(medium.field), read_only(blocks), start, direction, view.to_world, camera.clip_start,
            camera.clip_end, step * spacing, quality.termination, leaping, image, depth,
        )  # fmt: skip
    return picture(image, depth)


@kernel(inline="always")
def _steps_to_leave(position, advance, block):
    """The number of samples until a ray leaves its block along one axis; 1e30 where it is parallel to the faces."""
    if advance > 0.0:
        return ((block + 1) * BLOCK - position) / advance
    if advance < 0.0:
        return (block * BLOCK - position) / advance
    return 1e30


@kernel
def _cast(field, flat, blocks, origin, advance, count, length, least, leaping, sample):
    """Cast one ray: red, green, blue, transmittance, and the number of steps to transmittance one half (or -1).

    ``field``: (nz + 2, ny + 2, nx + 2, 4) float32; ``flat``: the same, flat.  ``blocks``: uint8.  ``origin``: (3,)
    padded index position of the first sample.  ``advance``: (3,) from one sample to the next.  ``length``: world length
    of a sample.  ``least``: transmittance at which the ray ends.  ``sample``: (4,) float32, scratch.  Each step is a
    homogeneous slab: C += T (1 - exp(-tau)) Q / tau.
    """
    red = green = blue = 0.0
    transmittance, half = 1.0, -1.0
    nz, ny, nx = field.shape[0], field.shape[1], field.shape[2]
    k = 0
    while k < count:
        x, y, z = origin[0] + k * advance[0], origin[1] + k * advance[1], origin[2] + k * advance[2]
        i = min(max(int(x), 0), nx - 2)
        j = min(max(int(y), 0), ny - 2)
        m = min(max(int(z), 0), nz - 2)
        if leaping and blocks[m // BLOCK, j // BLOCK, i // BLOCK] == 0:
            leap = min(
                _steps_to_leave(x, advance[0], i // BLOCK),
                _steps_to_leave(y, advance[1], j // BLOCK),
                _steps_to_leave(z, advance[2], m // BLOCK),
            )
            k += max(1, math.ceil(min(leap, float(count))))
            continue
        fx, fy, fz = x - i, y - j, z - m
        sample[0] = sample[1] = sample[2] = sample[3] = 0.0
        for dz in range(2):
            wz = fz if dz == 1 else 1.0 - fz
            for dy in range(2):
                wyz = wz * (fy if dy == 1 else 1.0 - fy)
                at = 4 * (((m + dz) * ny + j + dy) * nx + i)
                add4(flat, at, np.float32(wyz * (1.0 - fx)), sample, 0)
                add4(flat, at + 4, np.float32(wyz * fx), sample, 0)
        sigma = float(sample[3])
        if sigma > 0.0:
            tau = sigma * length
            weight = -transmittance * math.expm1(-tau) / sigma
            red += weight * sample[0]
            green += weight * sample[1]
            blue += weight * sample[2]
            behind = transmittance * math.exp(-tau)
            if transmittance >= 0.5 and behind < 0.5:
                half = k + math.log(2.0 * transmittance) / tau
            transmittance = behind
            if transmittance < least:
                break
        k += 1
    return red, green, blue, transmittance, half


@kernel(parallel=True)
def cast_rows(workers, field, blocks, start, direction, to_world, near, far, step, least, leaping, image, depth):
    """Cast the ray of each pixel.

    ``field``: (nz + 2, ny + 2, nx + 2, 4) float32.  ``blocks``: (bz, by, bx) uint8.  ``start``, ``direction``: (3, 3)
    float64 of ``pixel_rays``, in padded indices.  ``to_world``: (3, 3) float64.  ``near``, ``far``: planar depths.
    ``step``: world length.  ``least``: transmittance at which rays end.  Written: ``image`` (H, W, 4) float32 color and
    transmittance, ``depth`` (H, W) float32 planar depth of transmittance one half.
    """
    height, width = depth.shape
    flat = field.reshape(-1)
    for worker in prange(workers):
        sample = np.zeros(4, np.float32)
        origin, along, at_zero = np.zeros(3), np.zeros(3), np.zeros(3)
        for row in range(worker, height, workers):  # in turn, because neighboring rows take the same time
            for column in range(width):
                c, r = column + 0.5, row + 0.5
                first, last = near, far
                for axis in range(3):
                    at_zero[axis] = start[axis, 0] * c + start[axis, 1] * r + start[axis, 2]
                    along[axis] = direction[axis, 0] * c + direction[axis, 1] * r + direction[axis, 2]
                    top = field.shape[2 - axis] - 1.0
                    if along[axis] == 0.0:
                        last = last if 0.0 <= at_zero[axis] <= top else -np.inf
                        continue
                    a, b = -at_zero[axis] / along[axis], (top - at_zero[axis]) / along[axis]
                    first, last = max(first, min(a, b)), min(last, max(a, b))
                image[row, column, 0] = image[row, column, 1] = image[row, column, 2] = 0.0
                image[row, column, 3] = 1.0
                if not last > first:
                    continue
                squares = 0.0
                for axis in range(3):
                    world = 0.0
                    for other in range(3):
                        world += to_world[axis, other] * along[other]
                    squares += world * world
                speed = math.sqrt(squares)
                count = math.ceil((last - first) * speed / step)
                stride = (last - first) / count
                for axis in range(3):
                    origin[axis] = at_zero[axis] + (first + 0.5 * stride) * along[axis]
                    along[axis] *= stride
                red, green, blue, transmittance, half = _cast(
                    field, flat, blocks, origin, along, count, stride * speed, least, leaping, sample
                )
                image[row, column, 0], image[row, column, 1], image[row, column, 2] = red, green, blue
                image[row, column, 3] = transmittance
                if half >= 0.0:
                    depth[row, column] = first + half * stride
