"""The kernels of ``scalar_rays`` once more in numpy, to be read, to run where numba is missing, and to test against.

All rays go at a time, from one cut to the next (algorithm.md 1.14).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..shade.sample_light import ONE, light_of_samples
from ..splat.reference.label_parts import labels_at, share_of_near
from ..splat.scalar_scanline import NOT_KEPT
from .ray_light import ray_light
from .scalar_rays import COMPOSITED, HALF, NO_VALUE, SLIVER, SPAN, WALKED

CELL = np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(8, 3)  # corners as x, y, z


def trace_rays(voxels, rays, lookup, channels, labels, light, slabs, least, results):
    """Fills ``results`` as ``scalar_rays.trace_rays`` does, but walks through empty bricks, too; ``light``: a
    SampleLight or None."""
    # Of each channel: where its values are among the planes of a voxel, its ranges that are shown, its lookup.
    parts, further = [(0, voxels.shown, lookup)], voxels.further
    for n in range(0 if further is None else further.values.shape[1]):
        number = channels.own + n
        shown = further.shown[further.begins[n] : further.begins[n + 1]]
        parts.append((channels.planes[number], shown, _lookup_at(channels, number)))
    if labels is not None:
        functions = [_lookup_at(channels, number) for number in range(channels.own)]
    out, half, work = results
    if min(voxels.shape) < 2:
        return
    dense, falling = _dense(voxels), None if light is None else ray_light(light, rays)
    tops = np.array(dense.shape[2::-1]) - 2
    state, planes = np.column_stack((out[:, :3], 1.0 - out[:, 3])), 0 if light is None else light.planes
    here = rays.enter.copy()
    live = np.flatnonzero(here < rays.leave)
    while len(live):
        a, stop = here[live], rays.leave[live]
        b = _next_cut(rays.first[live], rays.step[live], a, stop)
        cell = np.floor(rays.first[live] + rays.step[live] * (0.5 * (a + b))[:, None])
        cell = np.clip(cell, 0, tops).astype(np.int64)
        corners = dense[tuple(np.moveaxis(cell[:, None] + CELL, -1, 0))[::-1]]
        shown = np.zeros(len(a), bool)
        for plane, ranges, _ in parts:
            low, high = (choose(corners[..., plane], axis=1)[:, None] for choose in (np.min, np.max))
            shown |= ((high >= ranges[:, 0]) & (low <= ranges[:, 1])).any(axis=1) & (low[:, 0] > NO_VALUE)
        kept = shown & (corners[..., -1] > NOT_KEPT).all(axis=1)
        here[live] = b
        work[live, WALKED] += 1
        mine = live[kept]
        work[mine, COMPOSITED] += 1
        stretch = rays.first[mine] - cell[kept], rays.step[mine], a[kept], b[kept], rays.length[mine]
        light_of = None if light is None else partial(_light_of, light, falling, mine)
        classify = partial(_classify_parts, parts)
        if labels is not None:
            classify = partial(_classify_labels, functions, parts[1:], labels, cell[kept])
        state[mine], half[mine] = _composite(
            state[mine], half[mine], corners[kept][..., :-1], *stretch, classify, light_of, planes, slabs, least
        )
        live = live[(here[live] < rays.leave[live]) & (state[live, 3] >= least)]
    out[:, :3], out[:, 3] = state[:, :3], 1.0 - state[:, 3]


def _lookup_at(channels, number: int) -> tuple:
    """As ``scalar_slab.lookup_at``."""
    first, last = channels.begins[number : number + 2]
    return channels.tables[first:last], channels.sums[first:last], *channels.numbers[number], (last - first) // 4 - 1


def _dense(voxels) -> np.ndarray:
    """(z, y, x, planes) float64: scalar, codes, values of further channels and last 1 of every voxel, NOT_KEPT where it
    is not kept."""
    n_z, n_y, n_x = voxels.shape
    codes = 0 if voxels.codes is None else voxels.codes.shape[1]
    channels = 2 + codes + (0 if voxels.further is None else voxels.further.values.shape[1])
    kept = np.unpackbits(voxels.bits.astype("<u8").view(np.uint8).reshape(n_z * n_y, -1), axis=1, bitorder="little")
    dense = np.full((n_z * n_y, n_x, channels), NOT_KEPT)
    kept = kept[:, :n_x] > 0
    dense[kept, 0] = voxels.scalars
    if voxels.codes is not None:
        dense[kept, 1 : 1 + codes] = voxels.codes / float(ONE)
    if voxels.further is not None:
        dense[kept, 1 + codes : -1] = voxels.further.values
    dense[kept, -1] = 1.0
    return dense.reshape(n_z, n_y, n_x, channels)


def _next_cut(first, step, a, stop):
    """(n,) where rays, (n, 3) positions and steps, next meet a voxel plane after ``a``, ``stop`` at most."""
    position = first + step * a[:, None]
    ahead = np.sign(step)
    cut = np.where(ahead > 0.0, np.floor(position) + 1.0, np.ceil(position) - 1.0) - first
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = cut / step
        after = (cut + ahead) / step
    reached = np.where(reached > (a + SLIVER)[:, None], reached, after)
    reached[step == 0.0] = np.inf
    return np.maximum(np.minimum(reached.min(axis=1), stop), np.minimum(a + SLIVER, stop))


def _trilinear(corners, position):
    """(n, channels) float64 between corners (n, 8, channels) at (n, 3) positions in the cell."""
    position = np.clip(position, 0.0, 1.0)[:, None]
    weights = np.where(CELL == 1, position, 1.0 - position).prod(axis=-1)
    return (weights[..., None] * corners).sum(axis=1)


def _light_of(light, falling, rays, seen, planes, s):
    """Light and highlights (n, 3) of those of ``rays`` that are ``seen``, at ``s`` (n,) along them."""
    rays = rays[seen]
    points = falling.start[rays] + s[:, None] * falling.step[rays]
    return light_of_samples(light, planes, falling.to_eye[rays], points)


def _classify_slab(lookup, before, here):
    """(n, 4) RGB times extinction, and extinction, of slabs in which the scalar goes from one value to another."""
    table, sums, origin, rate, _, low, high, nearest, furthest, last = lookup
    table, sums = table.reshape(-1, 4).astype(np.float64), sums.reshape(-1, 4).astype(np.float64)
    before, here = (np.clip(value, nearest, furthest) for value in (before, here))
    smallest, largest = np.minimum(before, here), np.maximum(before, here)
    spread, middle = (largest - smallest) * rate, 0.5 * (smallest + largest)
    ends = [np.clip((end - origin) * rate, 0.0, last) for end in (smallest, largest)]
    cells = [np.minimum(end.astype(np.int64), last - 1) for end in ends]
    low_sum, high_sum = (sums[c] + (end - c)[:, None] * table[c] for c, end in zip(cells, ends, strict=True))
    mean = np.maximum((high_sum - low_sum) / np.maximum(spread, SPAN)[:, None], 0.0)
    position = np.clip((middle - origin) * rate - 0.5, 0.0, last - 1.0)
    entry = position.astype(np.int64)
    part = (position - entry)[:, None]
    own = table[entry] * (1.0 - part) + table[np.minimum(entry + 1, last - 1)] * part
    own[(middle < low) | (middle > high)] = 0.0
    sampled = np.where((spread >= SPAN)[:, None], mean, own)
    sampled[(largest < low) | (smallest > high)] = 0.0
    return sampled


def _classify_parts(parts, whole, there, here, before, after):
    """(n, 4) what slabs show of all channels, which have values ``there`` and ``here`` at their ends (n, planes);
    ``whole``: whether all corners have one.  ``before``, ``after``: where the ends are."""
    return sum(
        np.where(whole[:, [plane]], _classify_slab(lookup, there[:, plane], here[:, plane]), 0.0)
        for plane, _, lookup in parts
    )


def _classify_labels(functions, further, labels, cell, whole, there, here, before, after):
    """As ``_classify_parts`` of ``further`` channels and of the volume itself, by the functions of labels.

    ``before``, ``after``: (n, 3) in the ``cell``.
    """
    added = _classify_parts(further, whole, there, here, before, after)
    before, way = before + cell, after - before
    near, far = labels_at(labels, before), labels_at(labels, after + cell)
    share = share_of_near(near, far, lambda share: labels_at(labels, before + share[:, None] * way))
    near, far = near[0], far[0]
    found = np.zeros((len(near), 4))
    for number in np.unique((near, far)):
        part = (near == number) * share + (far == number) * (1.0 - share)
        found += part[:, None] * _classify_slab(functions[number], there[:, 0], here[:, 0])
    return np.where(whole[:, [0]], found, 0.0) + added


def _composite(state, half, corners, first, step, a, b, length, classify, light_of, light_planes, slabs, least):
    """The rays' color and transmittance (n, 4) after their slabs from ``a`` to ``b`` of one cell each, and where half
    is absorbed; ``classify``: ``_classify_parts`` or ``_classify_labels``; ``light_of(seen, planes, s)``: light and
    highlights of the rays ``seen``, of so many ``light_planes``, or None."""
    count = np.maximum(np.ceil((b - a) * slabs - SLIVER), 1).astype(np.int64)
    thick = (b - a) / count
    before = None
    whole = (corners > NO_VALUE).all(axis=1)
    for slab in range(int(count.max(initial=-1)) + 1):
        s = a + thick * slab
        here, there = _trilinear(corners, first + step * s[:, None]), before
        before = here
        if slab == 0:
            continue
        ends = (first + step * along[:, None] for along in (s - thick, s))
        sampled = classify(whole, there, here, *ends)
        seen = (slab <= count) & (sampled[:, 3] > 0.0) & (state[:, 3] >= least)
        color, sigma = sampled[:, :3], sampled[:, 3]
        if light_of is not None:
            middle = s[seen] - 0.5 * thick[seen]
            planes = _trilinear(corners[seen], first[seen] + step[seen] * middle[:, None])[:, 1 : 1 + light_planes]
            light, gloss = light_of(seen, planes, middle)
            color[seen] = color[seen] * light + sigma[seen, None] * gloss
        deep = sigma * length * thick
        absorbed = -np.expm1(-deep)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = state[:, :3] + (state[:, 3] * absorbed / sigma)[:, None] * color
            crossing = s - thick + thick * np.log(state[:, 3] / HALF) / deep
        crosses = seen & (state[:, 3] > HALF) & (state[:, 3] * (1.0 - absorbed) <= HALF)
        half = np.where(crosses, crossing, half)
        state = np.where(seen[:, None], np.column_stack((after, state[:, 3] * (1.0 - absorbed))), state)
    return state, half
