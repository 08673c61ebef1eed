"""Single rays through the tables of a scalar volume, with no sheet resampled and nothing warped (algorithm.md 1.9,
"direct"): dear for a whole picture, cheap for the few pixels at which a warp errs most.

A ray is cut at every voxel plane.  What lies between two cuts is slabs, over which the scalar changes linearly, the
transfer function is averaged as by the depth rule preintegrated, and light is that of the slab's middle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..axes import AXES
from ..jit import inner_loop, kernel
from ..parallel import share_out
from ..view.base_plane import BasePlane
from ..view.eye import IndexView
from .scalar_scanline import NOT_KEPT
from .voxel_groups import CODE_BITS

SPAN = 4.0  # entries of a value table from which on a mean is taken over them; below, two of them are mixed
SLIVER = 1e-9  # voxels of depth: cuts no further apart are one
CORNERS = 8


class RayList(NamedTuple):
    """Rays of one principal axis, (n,) float64 each.

    At ``s`` voxels along the viewing direction a ray is at voxel ``first_x + s * step_x`` of scanline
    ``first_y + s * step_y`` of slice ``sign * s``; it is followed from ``enter`` to ``leave``.  ``length``: world
    length per voxel of depth.
    """

    first_x: np.ndarray
    step_x: np.ndarray
    first_y: np.ndarray
    step_y: np.ndarray
    enter: np.ndarray
    leave: np.ndarray
    length: np.ndarray


def rays_through(plane: BasePlane, view: IndexView, shape_xyz, columns, rows, clip) -> RayList:
    """The rays through pixel positions (n,), from the left and the top, within the box of the voxel centres.

    All of them must belong to the plane's principal axis and direction.  ``clip``: the least and the largest planar
    depth that is seen.
    """
    i, j, k = AXES[plane.axis]
    scaled = plane.homography / np.abs(plane.homography).max()
    at = np.linalg.inv(scaled) @ np.stack((columns, rows, np.ones(len(columns))))
    x, y = at[:2] / at[2]
    dx, dy = (np.broadcast_to(slope, x.shape) for slope in plane.slopes(x, y))
    at_zero, per_voxel = plane.depth_along(x, y)
    firsts = x - plane.reference * dx, y - plane.reference * dy, np.zeros(len(x)), at_zero
    steps = plane.sign * dx, plane.sign * dy, np.full(len(x), float(plane.sign)), plane.sign * per_voxel
    ends = *((0.0, shape_xyz[axis] - 1.0) for axis in (i, j, k)), clip
    enter, leave = np.full(len(x), -np.inf), np.full(len(x), np.inf)
    for first, step, (low, high) in zip(firsts, steps, ends, strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            both = np.sort(((low - first) / step, (high - first) / step), axis=0)
        straight = step == 0.0
        outside = straight & ((first < low) | (first > high))
        enter = np.where(straight, enter, np.maximum(enter, both[0]))
        leave = np.where(straight, leave, np.minimum(leave, both[1]))
        leave = np.where(outside, -np.inf, leave)
    if not view.is_parallel:
        enter = np.maximum(enter, plane.sign * view.eye[k])
    length = np.linalg.norm(np.tensordot(view.to_world, plane.ray_steps(x, y), axes=1), axis=0)
    columns = firsts[0], steps[0], firsts[1], steps[1], enter, leave, length
    return RayList(*(np.ascontiguousarray(column, np.float64) for column in columns))


@inner_loop(forceinline=True)
def _voxel_at(runs, run, voxel, width, x):
    """Where the record of voxel ``x`` of a scanline is, whose runs begin at ``run`` and records at ``voxel``; -1 where
    it is not kept."""
    at = 0
    while True:
        at += int(runs[run])
        if x < at or at >= width:
            return -1
        count = int(runs[run + 1])
        if x < at + count:
            return voxel + x - at
        at, voxel, run = at + count, voxel + count, run + 2


@inner_loop(forceinline=True)
def _gather(
    pointers, data_starts, runs, scalars, lights, light_unit, width, slice_, scanline, x, corners, channels, first
):
    """Whether all eight voxels of a cell are kept; scalars and lights of each into ``corners`` from ``first`` on."""
    to = first
    for k in range(slice_, slice_ + 2):
        for j in range(scanline, scanline + 2):
            run = int(pointers[k, j])
            if run < 0:
                return False
            for i in range(x, x + 2):
                voxel = _voxel_at(runs, run, int(data_starts[k, j]), width, i)
                if voxel < 0:
                    return False
                value = np.float32(scalars[voxel])
                if value <= NOT_KEPT:
                    return False
                corners[to] = value
                if lights is not None:
                    for channel in range(channels - 1):
                        bits = np.uint32(np.uint32(lights[voxel, channel]) << CODE_BITS)
                        corners[to + 1 + channel] = bits.view(np.float32) * light_unit
                to += channels
    return True


@inner_loop(forceinline=True)
def _between(corners, first, channels, channel, x, y, z):
    """The trilinear value of a channel at ``x``, ``y``, ``z`` in [0, 1]."""
    at = first + channel
    near = (corners[at] * (1.0 - x) + corners[at + channels] * x) * (1.0 - y)
    near += (corners[at + 2 * channels] * (1.0 - x) + corners[at + 3 * channels] * x) * y
    at += 4 * channels
    far = (corners[at] * (1.0 - x) + corners[at + channels] * x) * (1.0 - y)
    far += (corners[at + 2 * channels] * (1.0 - x) + corners[at + 3 * channels] * x) * y
    return near * (1.0 - z) + far * z


@inner_loop(forceinline=True)
def _mean(table, sums, channel, first, second, last, width):
    """The table's mean between two of its entries, which may be parts of entries."""
    i, j = min(int(first), last - 1), min(int(second), last - 1)
    low = sums[4 * i + channel] + (first - i) * table[4 * i + channel]
    high = sums[4 * j + channel] + (second - j) * table[4 * j + channel]
    return max((high - low) / width, 0.0)


@inner_loop
def _trace(begin, end, tables, rays, sign, look, matt, gloss, slabs, least, corners, out):
    """Rays [begin, end); see ``trace_rays``."""
    table, sums, origin, rate, _, low, high, nearest, furthest, last = look
    pointers, data_starts, runs, scalars, lights, light_unit, width = tables
    channels = 1 + len(matt) + len(gloss)
    tops = pointers.shape[0] - 2, pointers.shape[1] - 2, width - 2
    if min(tops[0], min(tops[1], tops[2])) < 0:
        return
    first_x, step_x, first_y, step_y, enter, leave, lengths = rays
    size = corners.shape[1]
    corners = corners.reshape(corners.size)
    for ray in range(begin, end):
        clear, red, green, blue = 1.0, 0.0, 0.0, 0.0
        a, stop = enter[ray], leave[ray]
        while a < stop and clear >= least:
            b = min(math.floor(a) + 1.0, stop)
            for place, step in ((first_x[ray], step_x[ray]), (first_y[ray], step_y[ray])):
                if step != 0.0:
                    here = place + step * a
                    cut = (math.floor(here) + 1.0 if step > 0.0 else math.ceil(here) - 1.0) - place
                    if cut > (a + SLIVER) * step if step > 0.0 else cut < (a + SLIVER) * step:
                        b = min(b, cut / step)
                    else:
                        b = min(b, (cut + (1.0 if step > 0.0 else -1.0)) / step)
            b = max(b, min(a + SLIVER, stop))
            middle = 0.5 * (a + b)
            x = min(max(math.floor(first_x[ray] + step_x[ray] * middle), 0), tops[2])
            y = min(max(math.floor(first_y[ray] + step_y[ray] * middle), 0), tops[1])
            z = min(max(math.floor(sign * middle), 0), tops[0])
            mine = ray * size
            if _gather(
                pointers, data_starts, runs, scalars, lights, light_unit, width, z, y, x, corners, channels, mine
            ):
                count = max(math.ceil((b - a) * slabs), 1)
                thick = (b - a) / count
                length = lengths[ray] * thick
                before = 0.0
                for slab in range(count + 1):
                    s = a + thick * slab
                    px = min(max(first_x[ray] + step_x[ray] * s - x, 0.0), 1.0)
                    py = min(max(first_y[ray] + step_y[ray] * s - y, 0.0), 1.0)
                    pz = min(max(sign * s - z, 0.0), 1.0)
                    here = _between(corners, mine, channels, 0, px, py, pz)
                    here = min(max(here, nearest), furthest)
                    smallest, largest = min(before, here), max(before, here)
                    before = here
                    if slab == 0 or largest < low or smallest > high:
                        continue
                    spread = (largest - smallest) * rate
                    if spread >= SPAN:
                        first = min(max((smallest - origin) * rate, 0.0), float(last))
                        second = min(max((largest - origin) * rate, 0.0), float(last))
                        sigma = _mean(table, sums, 3, first, second, last, spread)
                        if sigma <= 0.0:
                            continue
                        r = _mean(table, sums, 0, first, second, last, spread)
                        g = _mean(table, sums, 1, first, second, last, spread)
                        bl = _mean(table, sums, 2, first, second, last, spread)
                    else:
                        value = 0.5 * (smallest + largest)
                        if value < low or value > high:
                            continue
                        place = min(max((value - origin) * rate - 0.5, 0.0), last - 1.0)
                        entry = int(place)
                        part, after = place - entry, 4 * min(entry + 1, last - 1)
                        entry *= 4
                        sigma = table[entry + 3] * (1.0 - part) + table[after + 3] * part
                        if sigma <= 0.0:
                            continue
                        r = table[entry] * (1.0 - part) + table[after] * part
                        g = table[entry + 1] * (1.0 - part) + table[after + 1] * part
                        bl = table[entry + 2] * (1.0 - part) + table[after + 2] * part
                    s -= 0.5 * thick
                    px = min(max(first_x[ray] + step_x[ray] * s - x, 0.0), 1.0)
                    py = min(max(first_y[ray] + step_y[ray] * s - y, 0.0), 1.0)
                    pz = min(max(sign * s - z, 0.0), 1.0)
                    if len(matt) == 1:
                        shine = _between(corners, mine, channels, 1, px, py, pz)
                        r, g, bl = r * shine, g * shine, bl * shine
                    elif len(matt) == 3:
                        r *= _between(corners, mine, channels, 1, px, py, pz)
                        g *= _between(corners, mine, channels, 2, px, py, pz)
                        bl *= _between(corners, mine, channels, 3, px, py, pz)
                    if len(gloss) == 1:
                        shine = sigma * _between(corners, mine, channels, 2, px, py, pz)
                        r, g, bl = r + shine, g + shine, bl + shine
                    elif len(gloss) == 3:
                        r += sigma * _between(corners, mine, channels, 4, px, py, pz)
                        g += sigma * _between(corners, mine, channels, 5, px, py, pz)
                        bl += sigma * _between(corners, mine, channels, 6, px, py, pz)
                    absorbed = -math.expm1(-sigma * length)
                    share = clear * absorbed / sigma
                    red, green, blue = red + share * r, green + share * g, blue + share * bl
                    clear *= 1.0 - absorbed
                    if clear < least:
                        break
            a = b
        out[ray, 0], out[ray, 1], out[ray, 2], out[ray, 3] = red, green, blue, 1.0 - clear


@kernel
def trace_rays(tables, rays, sign, look, matt, gloss, slabs, least, corners, out):
    """Premultiplied rgba (n, 4) float32 of single rays.

    ``tables``: ScalarTables of a principal axis; ``rays``: RayList of it; ``sign``: which way they go along it.
    ``look``, ``matt``, ``gloss``, ``least``: as ``splat_scalar_rows`` has them.  ``slabs``: that a voxel's depth is
    cut into, at least.  ``corners``: scratch, (n, 8 * (1 + channels of light)) float32.
    """
    share_out(_trace, out.shape[0], (tables, rays, sign, look, matt, gloss, slabs, least, corners, out))
