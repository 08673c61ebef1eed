"""Mist in a sheet: what a slab has just added to the row is faded by its distance, in premultiplied form.

A slab adds weight * color to a pixel, where weight is the difference of transmittances ahead of it and behind it.  In
mist of strength m it adds weight * ((1 - m) * color + m * fog) instead.  The transmittance does not change.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop
from ..scene import MIST_FALLOFFS, Mist
from ..view.base_plane import BasePlane
from .pixel_block import BLOCK, BLUE, GREEN, RED, TRANSMITTANCE

QUADRATIC, LINEAR = (MIST_FALLOFFS.index(name) for name in ("QUADRATIC", "LINEAR"))
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class MistRays(NamedTuple):
    """Mist as the sheet pixels of a base plane have it.

    ``place`` (2, H, W) float32, empty where there is no mist: at position 0 of the viewing direction of the axis, and
    per voxel, how far into the mist a ray is, 0 where it starts and 1 where there is nothing else.  ``falloff``: number
    in MIST_FALLOFFS.
    """

    place: np.ndarray
    falloff: int
    red: np.float32
    green: np.float32
    blue: np.float32


NO_MIST = MistRays(np.empty((0, 0, 0), np.float32), 0, np.float32(0.0), np.float32(0.0), np.float32(0.0))


def mist_rays(plane: BasePlane, mist: Mist | None) -> MistRays:
    """The mist of a scene for the sheet pixels of a base plane; ``mist``: None for none."""
    if mist is None:
        return NO_MIST
    x, y = plane.points
    at_zero, per_voxel = plane.depth_along(x[None, :], y[:, None])
    per_voxel = plane.sign * per_voxel
    stretch = 1.0
    if not plane.view.is_parallel:  # from planar depth to the ray's own length
        steps = plane.ray_steps(x[None, :], y[:, None])
        to_world = plane.view.to_world
        square = 0.0
        for row in to_world:  # element by element: the bits of a matrix product depend on its size
            square = square + (row[0] * steps[0] + row[1] * steps[1] + row[2] * steps[2]) ** 2
        stretch = np.sqrt(square) / np.maximum(np.abs(per_voxel), 1e-300)
    near, step = at_zero * stretch - mist.start, per_voxel * stretch
    place = np.stack(np.broadcast_arrays(near / mist.depth, step / mist.depth))
    return MistRays(
        np.ascontiguousarray(place, np.float32), MIST_FALLOFFS.index(mist.falloff), *map(np.float32, mist.color)
    )


@inner_loop
def copy_colors(state, row, ahead):
    """The colors of a block of the row, to ``ahead`` (3 * BLOCK,)."""
    for i in range(3 * BLOCK):
        ahead[i] = state[row + i]


@inner_loop
def fade_added(mist, state, row, ahead, before, middle, v, first_pixel, count):
    """Fade what a slab has added to a block since ``copy_colors``.

    ``before`` (BLOCK,): the transmittance ahead of it.  ``middle``: of the slab, along the viewing direction.
    """
    place, falloff, red, green, blue = mist
    for i in range(count):
        u = first_pixel + i
        share = min(max(place[0, v, u] + place[1, v, u] * np.float32(middle), _ZERO), _ONE)
        if falloff == QUADRATIC:
            share *= share
        elif falloff != LINEAR:
            share = np.float32(math.sqrt(share))
        rest, fog = _ONE - share, share * (before[i] - state[row + TRANSMITTANCE + i])
        state[row + RED + i] = ahead[RED + i] + rest * (state[row + RED + i] - ahead[RED + i]) + fog * red
        state[row + GREEN + i] = ahead[GREEN + i] + rest * (state[row + GREEN + i] - ahead[GREEN + i]) + fog * green
        state[row + BLUE + i] = ahead[BLUE + i] + rest * (state[row + BLUE + i] - ahead[BLUE + i]) + fog * blue
