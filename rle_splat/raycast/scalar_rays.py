"""Single rays through the voxels of a scalar volume, with no sheet resampled and nothing warped (algorithm.md 1.9,
"direct"): dear for a whole picture, cheap for the few pixels at which a warp errs most.

A ray is cut at every voxel plane.  Between two cuts the trilinear scalar is a cubic of the ray's depth; it is followed
in slabs, over which the scalar changes linearly, the transfer function is averaged as by the depth rule preintegrated,
and light is that of the slab's middle (``ray_light``).  A bit tells whether a voxel is kept, and the bits before it in
its row which of the kept ones it is; bricks without any are leaped over.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.bits import count_bits
from ..runtime.jit import inner_loop, kernel
from ..runtime.parallel import share_out
from ..shade.sample_light import ONE
from ..splat.label_fields import are_cells, crossing, label_at, refine_crossing
from ..splat.scalar_slab import lookup_at
from ..volume.stored_scalars import by_type
from .ray_light import light_at
from .rays import BRICK_BITS

NO_VALUE = -1e38  # of a voxel's values, at most: it is no number
SPAN = 4.0  # entries of a lookup table from which on a mean is taken over them; below, two of them are mixed
SLIVER = 1e-9  # voxels of depth: what is shorter is nothing
WORD_BITS, IN_WORD = 6, 63  # 2**WORD_BITS voxels of a row share a word of bits
POWERS = 4  # of a cubic
ONE_BIT = np.uint64(1)
HALF = 0.5
PER_CODE = 1.0 / float(ONE)
WALKED, COMPOSITED = range(2)  # columns of the work of a ray


@inner_loop
def _pair_at(bits, row_start, row, x):
    """Where the record of voxel ``x`` of a row is; -1 where it, or the next one, is not kept."""
    at, shift = x >> WORD_BITS, np.uint64(x & IN_WORD)
    word = bits[row, at] >> shift
    if word & ONE_BIT == np.uint64(0):
        return -1
    after = (word >> ONE_BIT) if (x & IN_WORD) < IN_WORD else bits[row, at + 1]
    if after & ONE_BIT == np.uint64(0):
        return -1
    record = row_start[row] + count_bits(bits[row, at] & ((ONE_BIT << shift) - ONE_BIT))
    for before in range(at):
        record += count_bits(bits[row, before])
    return record


@inner_loop
def _read_corners(values, i, j, k, m):
    """The values of a cell's corners, records i, j, k, m of (m,) and the next ones, as eight float64."""
    return (
        np.float64(values[i]), np.float64(values[i + 1]), np.float64(values[j]), np.float64(values[j + 1]),
        np.float64(values[k]), np.float64(values[k + 1]), np.float64(values[m]), np.float64(values[m + 1]),
    )  # fmt: skip


_read_scalars = by_type(_read_corners)


@inner_loop
def _least(values):
    """The smallest value of a cell's corners."""
    a0, a1, b0, b1, c0, c1, d0, d1 = values
    return min(min(min(a0, a1), min(b0, b1)), min(min(c0, c1), min(d0, d1)))


@inner_loop
def _is_shown(values, shown):
    """Whether a cell shows something, by ``RowVoxels.shown``; ``values``: of its corners.

    Never with a corner without a value, which one volume has not among its kept voxels.
    """
    a0, a1, b0, b1, c0, c1, d0, d1 = values
    low, high = _least(values), max(max(max(a0, a1), max(b0, b1)), max(max(c0, c1), max(d0, d1)))
    for interval in range(shown.shape[0]):
        if high >= shown[interval, 0] and low <= shown[interval, 1]:
            return low > NO_VALUE
    return False


@inner_loop
def _is_any_shown(further, values, corners, shown):
    """Whether a cell shows something in any channel."""
    if further is None:
        return _is_shown(values, shown)
    if _is_shown(values, shown):
        return True
    i, j, k, m = corners
    for channel in range(further.values.shape[1]):
        first, last = further.begins[channel], further.begins[channel + 1]
        if _is_shown(_read_corners(further.values[:, channel], i, j, k, m), further.shown[first:last]):
            return True
    return False


@inner_loop
def _cubic(values, x, y, z, dx, dy, dz):
    """The trilinear value along a ray from ``x``, ``y``, ``z`` in a cell to so much further, as powers 0 to 3 of the
    way there.  ``values``: of two corners along x; of two further along y; of these four further along z."""
    a0, a1, b0, b1, c0, c1, d0, d1 = values
    a, ap, b, bp = a0 + (a1 - a0) * x, (a1 - a0) * dx, b0 + (b1 - b0) * x, (b1 - b0) * dx
    c, cp, d, dp = c0 + (c1 - c0) * x, (c1 - c0) * dx, d0 + (d1 - d0) * x, (d1 - d0) * dx
    near, near_p, near_pp = a + (b - a) * y, ap + (bp - ap) * y + (b - a) * dy, (bp - ap) * dy
    far, far_p, far_pp = c + (d - c) * y, cp + (dp - cp) * y + (d - c) * dy, (dp - cp) * dy
    away, away_p, away_pp = far - near, far_p - near_p, far_pp - near_pp
    return near + away * z, near_p + away_p * z + away * dz, near_pp + away_pp * z + away_p * dz, away_pp * dz


@inner_loop
def _find_cubics(codes, corners, start, step, cubics):
    """Put the cubics of all channels of ``codes`` along a stretch into ``cubics``; see ``_composite_stretch``."""
    i, j, k, m = corners
    px, py, pz = start
    dx, dy, dz = step
    for channel in range(codes.shape[1]):
        c0, c1, c2, c3 = _cubic(_read_corners(codes[:, channel], i, j, k, m), px, py, pz, dx, dy, dz)
        cubics[0, channel], cubics[1, channel] = c0 * PER_CODE, c1 * PER_CODE
        cubics[2, channel], cubics[3, channel] = c2 * PER_CODE, c3 * PER_CODE


@inner_loop
def _sum_powers(cubics, t):
    """Put what all cubics are at ``t`` into the row behind them."""
    for channel in range(cubics.shape[1]):
        high = (cubics[3, channel] * t + cubics[2, channel]) * t
        cubics[POWERS, channel] = (high + cubics[1, channel]) * t + cubics[0, channel]


@inner_loop
def _mean(table, sums, channel, first, second, last, width):
    """The table's mean between two of its entries, which may be parts of entries."""
    i, j = min(int(first), last - 1), min(int(second), last - 1)
    low = sums[4 * i + channel] + (first - i) * table[4 * i + channel]
    high = sums[4 * j + channel] + (second - j) * table[4 * j + channel]
    return max((high - low) / width, 0.0)


@inner_loop
def _crossing(at, size, first, step, inverse):
    """Where a ray leaves the voxels from ``at`` on, ``size`` of them; infinitely far where it runs along them."""
    return (at + (size if step > 0.0 else 0) - first) * inverse if step != 0.0 else math.inf


@inner_loop
def _absorb(thick):
    """1 - exp(-thick), by its series where that is short (relative error below 1e-9)."""
    if thick < 0.125:
        series = 1 / 6 - thick * (1 / 24 - thick * (1 / 120 - thick / 720))
        return thick * (1.0 - thick * (1 / 2 - thick * series))
    return 1.0 - math.exp(-thick)


@inner_loop
def _classify_slab(lookup, before, here):
    """RGB times extinction, and extinction, of a slab in which the scalar goes from one value to another."""
    table, sums, origin, rate, _, low, high, _, _, last = lookup
    smallest, largest = min(before, here), max(before, here)
    if largest < low or smallest > high:
        return 0.0, 0.0, 0.0, 0.0
    spread = (largest - smallest) * rate
    if spread >= SPAN:
        first = min(max((smallest - origin) * rate, 0.0), float(last))
        second = min(max((largest - origin) * rate, 0.0), float(last))
        sigma = _mean(table, sums, 3, first, second, last, spread)
        if sigma <= 0.0:
            return 0.0, 0.0, 0.0, 0.0
        r = _mean(table, sums, 0, first, second, last, spread)
        g = _mean(table, sums, 1, first, second, last, spread)
        return r, g, _mean(table, sums, 2, first, second, last, spread), sigma
    value = 0.5 * (smallest + largest)
    if value < low or value > high:
        return 0.0, 0.0, 0.0, 0.0
    position = min(max((value - origin) * rate - 0.5, 0.0), last - 1.0)
    entry = int(position)
    share, after = position - entry, 4 * min(entry + 1, last - 1)
    entry *= 4
    sigma = table[entry + 3] * (1.0 - share) + table[after + 3] * share
    r = table[entry] * (1.0 - share) + table[after] * share
    g = table[entry + 1] * (1.0 - share) + table[after + 1] * share
    return r, g, table[entry + 2] * (1.0 - share) + table[after + 2] * share, sigma


@inner_loop
def _ends_of(labels, lookup):
    """Values that stand for those beyond them; with labels each function has its own."""
    if labels is None:
        return lookup.nearest, lookup.furthest
    if not are_cells(labels):
        return lookup.nearest, lookup.furthest
    return np.float32(-math.inf), np.float32(math.inf)


@inner_loop
def _classify_clamped(lookup, before, here):
    """``_classify_slab`` of values that may lie beyond those that stand for them."""
    nearest, furthest = lookup.nearest, lookup.furthest
    return _classify_slab(lookup, min(max(before, nearest), furthest), min(max(here, nearest), furthest))


@inner_loop
def _classify_labeled(labels, channels, lookup, before, here, start, step, begin, end):
    """``_classify_slab`` by the functions of labels, each what of the slab belongs to it, if there are any.

    ``start``, ``step``: voxels, a point and the way on which ``begin`` and ``end`` lie.
    """
    if labels is None:
        return _classify_slab(lookup, before, here)
    if not are_cells(labels):
        return _classify_slab(lookup, before, here)
    px, py, pz = start
    dx, dy, dz = step
    near, near_lead = label_at(labels, px + begin * dx, py + begin * dy, pz + begin * dz)
    far, far_lead = label_at(labels, px + end * dx, py + end * dy, pz + end * dz)
    r, g, bl, sigma = _classify_clamped(lookup_at(channels, near), before, here)
    if near == far:
        return r, g, bl, sigma
    share = crossing(near_lead, far_lead)
    t = begin + share * (end - begin)
    number, lead = label_at(labels, px + t * dx, py + t * dy, pz + t * dz)
    share = refine_crossing(share, near, near_lead, far, far_lead, number, lead)
    more_r, more_g, more_bl, more = _classify_clamped(lookup_at(channels, far), before, here)
    return (
        more_r + share * (r - more_r), more_g + share * (g - more_g), more_bl + share * (bl - more_bl),
        more + share * (sigma - more),
    )  # fmt: skip


@inner_loop
def _find_channels(further, corners, start, step, cubics):
    """Put the cubics of further channels along a stretch into ``cubics``; that of one without a value at some corner
    is far below all values."""
    if further is not None:
        i, j, k, m = corners
        px, py, pz = start
        dx, dy, dz = step
        values = further.values
        for n in range(values.shape[1]):
            own = _read_corners(values[:, n], i, j, k, m)
            least = _least(own)
            c0, c1, c2, c3 = _cubic(own, px, py, pz, dx, dy, dz)
            if least <= NO_VALUE:
                c0, c1, c2, c3 = least, 0.0, 0.0, 0.0
            cubics[0, n], cubics[1, n], cubics[2, n], cubics[3, n] = c0, c1, c2, c3


@inner_loop
def _add_channels(further, channels, cubics, begin, end, r, g, bl, sigma):
    """What a slab shows, with that of further channels; ``begin``, ``end``: of the slab, parts of the stretch.

    ``channels``: ChannelLookups.
    """
    if further is not None:
        for n in range(further.values.shape[1]):
            c0, c1, c2, c3 = cubics[0, n], cubics[1, n], cubics[2, n], cubics[3, n]
            if c0 > NO_VALUE:
                lookup = lookup_at(channels, channels.own + n)
                before = min(max(((c3 * begin + c2) * begin + c1) * begin + c0, lookup.nearest), lookup.furthest)
                here = min(max(((c3 * end + c2) * end + c1) * end + c0, lookup.nearest), lookup.furthest)
                more_r, more_g, more_bl, more = _classify_slab(lookup, before, here)
                r, g, bl, sigma = r + more_r, g + more_g, bl + more_bl, sigma + more
    return r, g, bl, sigma


@inner_loop
def _composite_stretch(
    further, channels, labels, codes, own, lookup, light, number, corners, cell, start, step, a, deep, length, slabs,
    least, scratch, ray,
):  # fmt: skip
    """Composite one stretch of a ray within a cell, cut into slabs; what ``ray`` is behind it.

    ``further``, ``codes``: of RowVoxels.  ``channels``, ``labels``, ``lookup``, ``light``, ``slabs``, ``least``: see
    ``trace_rays``.  ``own``: scalars of the cell's corners.  ``number``: of the ray.  ``corners``: records of the
    cell's four pairs of voxels along x.  ``cell``: its first voxel, x, y, z.  ``start``: where the stretch begins in
    the cell, voxels; ``step``: voxels along x, y, z per voxel of depth.  ``a`` and ``deep``: where it begins, and its
    length, in voxels of depth; ``length``: world length per voxel of depth.  ``scratch``: (POWERS + 1, channels)
    float64 and its last row.  ``ray``: red, green, blue, transmittance, and the depth at which half is absorbed.
    """
    nearest, furthest = _ends_of(labels, lookup)
    px, py, pz = start
    dx, dy, dz = step
    at = cell[0] + px, cell[1] + py, cell[2] + pz
    red, green, blue, transmittance, at_half = ray
    cubics, planes, values = scratch
    c0, c1, c2, c3 = _cubic(own, px, py, pz, dx * deep, dy * deep, dz * deep)
    count = max(math.ceil(deep * slabs - SLIVER), 1)
    part = 1.0 / count
    length = length * deep * part
    has_value = further is None or _least(own) > NO_VALUE  # one volume always has one
    _find_channels(further, corners, start, (dx * deep, dy * deep, dz * deep), values)
    here = min(max(c0, nearest), furthest)
    lit = False
    for slab in range(1, count + 1):
        t = slab * part
        before = here
        here = min(max(((c3 * t + c2) * t + c1) * t + c0, nearest), furthest)
        r, g, bl, sigma = 0.0, 0.0, 0.0, 0.0
        if has_value:
            r, g, bl, sigma = _classify_labeled(
                labels, channels, lookup, before, here, at, (dx * deep, dy * deep, dz * deep), t - part, t
            )
        r, g, bl, sigma = _add_channels(further, channels, values, t - part, t, r, g, bl, sigma)
        if sigma <= 0.0:
            continue
        if light is not None:
            if not lit:
                lit = True
                _find_cubics(codes, corners, start, (dx * deep, dy * deep, dz * deep), cubics)
            t -= 0.5 * part
            _sum_powers(cubics, t)
            lit_red, lit_green, lit_blue, red_shine, green_shine, blue_shine = light_at(
                light, planes, number, a + deep * t
            )
            r, g, bl = r * lit_red, g * lit_green, bl * lit_blue
            r, g, bl = r + sigma * red_shine, g + sigma * green_shine, bl + sigma * blue_shine
        thick = sigma * length
        absorbed = _absorb(thick)
        gain = transmittance * absorbed / sigma
        red, green, blue = red + gain * r, green + gain * g, blue + gain * bl
        left = transmittance * (1.0 - absorbed)
        if left <= HALF < transmittance:
            at_half = a + deep * part * (slab - 1.0 + math.log(transmittance / HALF) / thick)
        transmittance = left
        if transmittance < least:
            break
    return red, green, blue, transmittance, at_half


@inner_loop
def _columns_of(codes):
    """How many numbers a voxel has in an array that may be None."""
    return 0 if codes is None else codes.shape[1]


@inner_loop
def _trace(begin, end, voxels, rays, lookup, channels, labels, light, slabs, least, scratch, results):
    """Rays [begin, end); see ``trace_rays``."""
    bits, row_start, bricks, scalars, codes, shown, (n_z, n_y, n_x), further = voxels
    out, half, work = results
    if begin >= end:
        return
    planes = _columns_of(codes)
    buffers = scratch[begin, :, :planes], scratch[begin, POWERS, :planes], scratch[begin, :, planes:]
    for ray in range(begin, end):
        red, green, blue, transmittance = out[ray, 0], out[ray, 1], out[ray, 2], 1.0 - out[ray, 3]
        at_half = half[ray]
        walked = composited = 0
        ox, oy, oz = rays.first[ray, 0], rays.first[ray, 1], rays.first[ray, 2]
        dx, dy, dz = rays.step[ray, 0], rays.step[ray, 1], rays.step[ray, 2]
        ix, iy, iz = 1.0 / dx, 1.0 / dy, 1.0 / dz
        sx, sy, sz = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1, 1 if dz > 0.0 else -1
        ax, ay, az = abs(ix), abs(iy), abs(iz)
        tx = ty = tz = math.inf
        a, stop = rays.enter[ray], rays.leave[ray]
        x = y = z = -1
        if a < stop:
            x = min(max(math.floor(ox + dx * a), 0), n_x - 2)
            y = min(max(math.floor(oy + dy * a), 0), n_y - 2)
            z = min(max(math.floor(oz + dz * a), 0), n_z - 2)
            tx = _crossing(x, 1, ox, dx, ix)
            ty = _crossing(y, 1, oy, dy, iy)
            tz = _crossing(z, 1, oz, dz, iz)
        while a < stop and transmittance >= least:
            if x < 0 or y < 0 or z < 0 or x > n_x - 2 or y > n_y - 2 or z > n_z - 2:
                break
            walked += 1
            if bricks[z >> BRICK_BITS, y >> BRICK_BITS, x >> BRICK_BITS] == 0:
                size = 1 << BRICK_BITS
                x0, y0, z0 = x & -size, y & -size, z & -size
                tx = _crossing(x0, size, ox, dx, ix)
                ty = _crossing(y0, size, oy, dy, iy)
                tz = _crossing(z0, size, oz, dz, iz)
                reached = min(tx, min(ty, tz))
                a = max(a, reached)
                if tx <= reached:
                    x = x0 + size if dx > 0.0 else x0 - 1
                else:
                    x = min(max(math.floor(ox + dx * a), x0), min(x0 + size - 1, n_x - 2))
                if tx > reached >= ty:
                    y = y0 + size if dy > 0.0 else y0 - 1
                else:
                    y = min(max(math.floor(oy + dy * a), y0), min(y0 + size - 1, n_y - 2))
                if tx > reached < ty:
                    z = z0 + size if dz > 0.0 else z0 - 1
                else:
                    z = min(max(math.floor(oz + dz * a), z0), min(z0 + size - 1, n_z - 2))
                tx = _crossing(x, 1, ox, dx, ix)
                ty = _crossing(y, 1, oy, dy, iy)
                tz = _crossing(z, 1, oz, dz, iz)
                continue
            reached = min(tx, min(ty, tz))
            b = min(reached, stop)
            if b > a + SLIVER:
                i = _pair_at(bits, row_start, z * n_y + y, x)
                j = _pair_at(bits, row_start, z * n_y + y + 1, x) if i >= 0 else -1
                k = _pair_at(bits, row_start, (z + 1) * n_y + y, x) if j >= 0 else -1
                m = _pair_at(bits, row_start, (z + 1) * n_y + y + 1, x) if k >= 0 else -1
                if m >= 0:
                    corners, own = (i, j, k, m), _read_scalars(scalars, i, j, k, m)
                    if _is_any_shown(further, own, corners, shown):
                        composited += 1
                        red, green, blue, transmittance, at_half = _composite_stretch(
                            further, channels, labels, codes, own, lookup, light, ray, corners, (x, y, z),
                            (ox + dx * a - x, oy + dy * a - y, oz + dz * a - z), (dx, dy, dz), a, b - a,
                            rays.length[ray], slabs, least, buffers, (red, green, blue, transmittance, at_half),
                        )  # fmt: skip
                a = b
            if tx <= reached:
                x, tx = x + sx, tx + ax
            elif ty <= reached:
                y, ty = y + sy, ty + ay
            else:
                z, tz = z + sz, tz + az
        out[ray, 0], out[ray, 1], out[ray, 2], out[ray, 3] = red, green, blue, 1.0 - transmittance
        half[ray] = at_half
        work[ray, WALKED] += walked
        work[ray, COMPOSITED] += composited


@kernel
def trace_rays(voxels, rays, lookup, channels, labels, light, slabs, least, scratch, results):
    """Add one piece of single rays to ``results``: premultiplied rgba (n, 4) float32; where along them half is
    absorbed, (n,) float64, inf where less is; how many cells and empty bricks each walked through and how many cells it
    composited, (n, 2) int32.

    ``voxels``: RowVoxels; ``rays``: RayList, with ``enter`` and ``leave`` of the piece (n,); ``light``: RayLight, or
    None for rays that nothing lights, whose voxels have no codes then.  ``lookup``, ``channels``, ``least``: as
    ``splat_scalar_rows`` has them; extinctions of further ``channels`` are added to those of the volume itself.
    ``labels``: a CellField, which says where each of the ``channels`` of the volume's own values classifies in place of
    ``lookup``, or None.  ``slabs``: that a voxel's depth is cut into, at least.  ``scratch``: (n, POWERS + 1, channels
    of codes and further channels) float64.
    """
    share_out(_trace, scratch.shape[0], (voxels, rays, lookup, channels, labels, light, slabs, least, scratch, results))
