"""Single rays without numba: all of them a stretch between two cuts at a time, the same sums as ``scalar_rays``."""

from __future__ import annotations

import numpy as np

from .scalar_rays import SLIVER, SPAN
from .scalar_scanline import NOT_KEPT
from .scalar_sheets_numpy import dense_slice

CELL = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(8, 3)  # corners as (slice, scanline, voxel), voxels first


def trace_rays_numpy(tables, rays, sign, look, matt, gloss, slabs, least, out):
    """Fills ``out`` as ``scalar_rays.trace_rays`` does."""
    channels = 1 if tables.lights is None else 1 + tables.lights.shape[1]
    shape = *tables.pointers.shape, tables.width
    if min(shape) < 2:
        return
    dense = np.zeros((*shape, channels), np.float32)
    dense[..., 0] = NOT_KEPT
    for k in range(shape[0]):
        found = dense_slice(tables, k)
        if found is not None:
            dense[k] = found
    tops = np.array(shape) - 2
    first = np.stack((np.zeros_like(rays.enter), rays.first_y, rays.first_x), axis=1)
    step = np.stack((np.full_like(rays.enter, sign), rays.step_y, rays.step_x), axis=1)
    state = np.zeros((len(out), 4))
    state[:, 3] = 1.0
    here = rays.enter.copy()
    live = np.flatnonzero((here < rays.leave) & (state[:, 3] >= least))
    while len(live):
        a, stop = here[live], rays.leave[live]
        b = _next_cut(first[live], step[live], a, stop)
        cell = np.floor(first[live] + step[live] * (0.5 * (a + b))[:, None])
        cell = np.clip(cell, 0, tops).astype(np.int64)
        corners = dense[tuple(np.moveaxis(cell[:, None] + CELL, -1, 0))]
        kept = (corners[..., 0] > NOT_KEPT).all(axis=1)
        here[live] = b
        mine = live[kept]
        stretch = first[mine] - cell[kept], step[mine], a[kept], b[kept], rays.length[mine]
        state[mine] = _composited(state[mine], corners[kept], *stretch, look, matt, gloss, slabs, least)
        live = live[(here[live] < rays.leave[live]) & (state[live, 3] >= least)]
    out[:, :3], out[:, 3] = state[:, :3], 1.0 - state[:, 3]


def _next_cut(first, step, a, stop):
    """(n,) where rays, (n, 3) places and steps, next meet a voxel plane after ``a``, ``stop`` at most."""
    place = first + step * a[:, None]
    ahead = np.sign(step)
    cut = np.where(ahead > 0.0, np.floor(place) + 1.0, np.ceil(place) - 1.0) - first
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = cut / step
        after = (cut + ahead) / step
    reached = np.where(reached > (a + SLIVER)[:, None], reached, after)
    reached[:, 0] = np.floor(a) + 1.0
    reached[step == 0.0] = np.inf
    return np.maximum(np.minimum(reached.min(axis=1), stop), np.minimum(a + SLIVER, stop))


def _trilinear(corners, place):
    """(n, channels) float64 between corners (n, 8, channels) at (n, 3) places in the cell."""
    place = np.clip(place, 0.0, 1.0)[:, None]
    weights = np.where(CELL == 1, place, 1.0 - place).prod(axis=-1)
    return (weights[..., None] * corners).sum(axis=1)


def _composited(state, corners, first, step, a, b, length, look, matt, gloss, slabs, least):
    """The rays' colour and transmittance (n, 4) after their slabs from ``a`` to ``b`` of one cell each."""
    table, sums, origin, rate, _, low, high, nearest, furthest, last = look
    table, sums = table.reshape(-1, 4).astype(np.float64), sums.reshape(-1, 4).astype(np.float64)
    count = np.maximum(np.ceil((b - a) * slabs), 1).astype(np.int64)
    thick = (b - a) / count
    before = np.zeros(len(a))
    for slab in range(int(count.max(initial=-1)) + 1):
        s = a + thick * slab
        here = np.clip(_trilinear(corners, first + step * s[:, None])[:, 0], nearest, furthest)
        smallest, largest = np.minimum(before, here), np.maximum(before, here)
        before = here
        if slab == 0:
            continue
        spread, middle = (largest - smallest) * rate, 0.5 * (smallest + largest)
        ends = [np.clip((end - origin) * rate, 0.0, last) for end in (smallest, largest)]
        cells = [np.minimum(end.astype(np.int64), last - 1) for end in ends]
        low_sum, high_sum = (sums[c] + (end - c)[:, None] * table[c] for c, end in zip(cells, ends, strict=True))
        mean = np.maximum((high_sum - low_sum) / np.maximum(spread, SPAN)[:, None], 0.0)
        place = np.clip((middle - origin) * rate - 0.5, 0.0, last - 1.0)
        entry = place.astype(np.int64)
        part = (place - entry)[:, None]
        own = table[entry] * (1.0 - part) + table[np.minimum(entry + 1, last - 1)] * part
        own[(middle < low) | (middle > high)] = 0.0
        looks = np.where((spread >= SPAN)[:, None], mean, own)
        seen = (slab <= count) & (largest >= low) & (smallest <= high) & (looks[:, 3] > 0.0) & (state[:, 3] >= least)
        light = _trilinear(corners, first + step * (s - 0.5 * thick)[:, None])
        color, sigma = looks[:, :3], looks[:, 3]
        if matt:
            color = color * light[:, list(matt)]
        if gloss:
            color = color + sigma[:, None] * light[:, list(gloss)]
        absorbed = -np.expm1(-sigma * length * thick)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = state[:, :3] + (state[:, 3] * absorbed / sigma)[:, None] * color
        state = np.where(seen[:, None], np.column_stack((after, state[:, 3] * (1.0 - absorbed))), state)
    return state
