"""Mist in a sheet: what a slab has just added to the row is faded by its distance, in associated form.

A slab adds weight * colour to a pixel, weight being the light that it takes away, the difference of transmittances.  In
mist of strength m it adds weight * ((1 - m) * colour + m * fog) instead: so that nothing of what made the colour needs
to know, and the transmittance is what it was.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop
from ..scene import MIST_FALLOFFS, Mist
from ..view.base_plane import BasePlane
from .pixel_block import BLOCK, BLUE, CLEAR, GREEN, RED

QUADRATIC, LINEAR = (MIST_FALLOFFS.index(name) for name in ("QUADRATIC", "LINEAR"))
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class MistRays(NamedTuple):
    """Mist as the sheet pixels of a base plane have it.

    ``place`` (2, H, W) float32: at position 0 of the viewing direction of the axis, and per voxel, how far into the
    mist a ray is, 0 where it starts and 1 where there is nothing else.  ``falloff``: number in MIST_FALLOFFS.
    """

    place: np.ndarray
    falloff: int
    red: np.float32
    green: np.float32
    blue: np.float32


def mist_rays(plane: BasePlane, mist: Mist) -> MistRays:
    x, y = plane.points()
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


@inner_loop(forceinline=True)
def keep_colors(state, row, kept):
    """The colours of a block of the row, to ``kept`` (3 * BLOCK,)."""
    for i in range(3 * BLOCK):
        kept[i] = state[row + i]


@inner_loop(forceinline=True)
def fade_added(mist, state, row, kept, before, middle, v, first_pixel, count):
    """Fade what a slab has added to a block since ``keep_colors``.

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
        clear, fog = _ONE - share, share * (before[i] - state[row + CLEAR + i])
        state[row + RED + i] = kept[RED + i] + clear * (state[row + RED + i] - kept[RED + i]) + fog * red
        state[row + GREEN + i] = kept[GREEN + i] + clear * (state[row + GREEN + i] - kept[GREEN + i]) + fog * green
        state[row + BLUE + i] = kept[BLUE + i] + clear * (state[row + BLUE + i] - kept[BLUE + i]) + fog * blue


def fade_added_numpy(mist: MistRays, state, kept, middle) -> None:
    """Twin of ``fade_added``: ``state`` (H, W, 4), and as it was, ``kept``."""
    share = np.clip(mist.place[0] + mist.place[1] * np.float32(middle), 0.0, 1.0)
    if mist.falloff == QUADRATIC:
        share = share * share
    elif mist.falloff != LINEAR:
        share = np.sqrt(share)
    fog = (share * (kept[..., 3] - state[..., 3]))[..., None] * np.array(mist[2:], np.float32)
    added = state[..., :3] - kept[..., :3]
    state[..., :3] = kept[..., :3] + (1.0 - share)[..., None] * added + fog
