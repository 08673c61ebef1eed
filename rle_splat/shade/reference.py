"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

Light that reaches voxels and what they reflect (algorithm.md 4.2; the formulas of ``lighting`` and ``lights``).
"""

from __future__ import annotations

import numpy as np

from ..classify.classification import RED
from ..classify.reference import find_targets
from ..encode.reference import list_runs
from ..volume.axes import AXES
from ..volume.reference import CHUNK
from .environment import light_by_normal
from .lighting import BACK, FULL_CODE, Shadows, unit_vectors
from .lights import AREA, AXIS, CONE, EDGE, KIND, NEAREST, POSITION, RGB, SPOT, SUN

ONE = 32767.0  # of codes of components
STEPS = 1024.0  # of a voxel, in which offsets are kept
RISE = 2.0  # times what the slice before takes: more of a slice does not count at its own nodes
BOXED = 1e-9  # voxels beyond the outermost ones that still count as these, for rounding
FULL = FULL_CODE  # code of transmittance 1; codes are rounded multiples


def light_colors(falling, voxels, part, n, colors):
    """(k, 3) float32 shaded colors of voxels ``part`` (a slice) with normals ``n`` (k, 3) and own ``colors`` (k, 3)."""
    own, matrix = colors, falling.matrix
    _, diffuse, specular, shininess = falling.material[:4]
    shadows = falling.shadows or Shadows(np.empty((0, 0), np.uint16), np.full(len(falling.rows) + 1, -1))
    index = _places_of(voxels.row_start, voxels.column, voxels.shape_xyz, part)
    points = index @ matrix[:3, :3].T + matrix[:3, 3]
    view = unit_vectors(falling.eye[:3] - falling.eye[3] * points)
    everywhere, sky = falling.material[4:7], shadows.share(-1, part)
    around = np.maximum(everywhere + light_by_normal(n, falling.sky), falling.material[0])
    matt = around * np.reshape(sky, (-1, 1))
    gloss = np.zeros((len(points), 3))
    arrives, every = matt.sum(axis=1), np.full(len(points), everywhere.sum())
    for number, light in enumerate(falling.rows):
        towards, falloff = find_light(light, points)
        every += diffuse * falloff * light[RGB:NEAREST].sum()
        falloff = falloff * shadows.share(number, part)
        arrives += diffuse * falloff * light[RGB:NEAREST].sum()
        strength = falloff[:, None] * light[RGB:NEAREST]
        facing = (n * towards).sum(axis=1)
        matt += diffuse * np.maximum(-facing, falling.material[BACK] * facing)[:, None] * strength
        if specular > 0.0:
            cosine = np.abs((n * unit_vectors(towards + view)).sum(axis=1))
            if falling.material[BACK] == 0.0:
                cosine = np.where(facing < 0.0, cosine, 0.0)
            gloss += specular * cosine[:, None] ** shininess * strength
    if falling.shadows is not None:
        colors = colors * np.divide(arrives, every, out=np.ones_like(every), where=every > 0.0)[:, None]
    return np.where(n.any(axis=1)[:, None], own * matt + gloss, colors).astype(np.float32)


def _places_of(row_start, column, shape_xyz, part=slice(None)) -> np.ndarray:
    """(n, 3) float64 x, y, z of the voxels ``part`` of a list."""
    row = np.searchsorted(row_start, np.arange(len(column))[part], side="right") - 1
    return np.stack((column[part].astype(np.float64), row % shape_xyz[1], row // shape_xyz[1]), axis=1)


def find_light(light, points):
    """Unit vectors (m, 3) to a light from (m, 3) points, and its falloff (m,), as ``chunk_light._towards``."""
    if light[KIND] == SUN:
        return np.broadcast_to(-light[AXIS:RGB], points.shape), np.ones(len(points))
    way = light[POSITION:AXIS] - points
    falloff = 1.0 / np.maximum((way**2).sum(axis=1), light[NEAREST])
    towards = unit_vectors(way)
    off_axis = -(towards @ light[AXIS:RGB])
    if light[KIND] == AREA:
        falloff *= np.maximum(off_axis, 0.0)
    elif light[KIND] == SPOT:
        t = np.clip((off_axis - light[CONE]) / light[EDGE], 0.0, 1.0)
        falloff *= t * t * (3.0 - 2.0 * t)
    return towards, falloff


def write_records(positions, row_of, properties, density_column, normals, falling, records, most):
    """Lit records of voxels, as ``shading._write_records``, in chunks of voxels."""
    voxels = positions.voxels
    targets = find_targets(positions)
    first, last = positions.span
    for begin in range(first, last, CHUNK):
        part = slice(begin, min(begin + CHUNK, last))
        seen = properties[part] if row_of is None else properties[row_of[part]]
        colors = seen[:, RED:]
        if falling is not None:
            colors = light_colors(falling, voxels, part, normals[part].astype(np.float64), colors)
        made = np.empty((len(seen), 4), np.float32)
        made[:, 3] = seen[:, density_column]
        made[:, :3] = made[:, 3:] * colors
        records[targets[part.start - first : part.stop - first]] = made
        most[0] = max(most[0], colors.max(initial=0.0))


def sweep_light(sweep, tables, starts, extinction, meshes, codes) -> None:
    """Codes of the light that reaches each voxel, as ``light_sweep._sweep``: slice by slice, with dense slices."""
    depth = np.zeros((sweep.height, sweep.width))
    for n, k in enumerate(sweep.slices):
        scale, offset_x, offset_y = sweep.scale[n], sweep.offset_x[n], sweep.offset_y[n]
        i, j, data = _voxels_of(tables, starts, k)
        i0, i1, j0, j1 = sweep.spans[n]
        for_these = (i >= i0) & (i < i1) & (j >= j0) & (j < j1)
        x, y, at = scale * i[for_these] + offset_x, scale * j[for_these] + offset_y, data[for_these]
        tau = _interpolate(depth, y, x) + sweep.before[n] * extinction[at]
        c = sweep.length
        length = np.sqrt(np.maximum(c[0] + c[1] * x + c[2] * y + c[3] * x * x + c[4] * x * y + c[5] * y * y, 0.0))
        left = np.exp(-tau * length)
        if meshes is not None:
            left = left * _interpolate((meshes > np.float32(n)).mean(axis=2), y, x)
        codes[at] = (left * FULL + 0.5).astype(np.uint16)
        n -= sweep.skipped
        if n >= 0:
            depth += sweep.whole[n] * _slice_of_sheet(sweep, tables, starts, extinction, n, False)


def shade_nodes(sweep, tables, starts, extinction, meshes, place, nodes, share: int) -> None:
    """Take from nodes what a sweep blocks, as ``light_nodes._shade_bands``, with dense slices.

    ``place`` (4, 4): nodes to the sheet.
    """
    a, b, c = AXES[sweep.axis]
    last, up = len(sweep.slices) - 1, int(np.sign(place[3, c]))
    layers = np.moveaxis(nodes, (2 - c, 2 - b, 2 - a), (0, 1, 2))
    added = [_slice_of_sheet(sweep, tables, starts, extinction, n, True) for n in range(last + 1)]
    # Before the first slice there is as much less than nothing as that is nearer to the light than half a slice; it
    # counts as if the medium went on before it.
    before = (sweep.whole[0] - 1.0) * added[0]
    earlier = before - added[0]
    for n, k in enumerate([*sweep.slices, sweep.slices[-1] + up]):
        # The medium ends in the middle of the last slice, so that the layer behind has half of it.
        after = before + added[n] if n <= last else earlier
        node = np.zeros((layers.shape[1], layers.shape[2], 3))
        node[..., b], node[..., a] = np.indices(node.shape[:2]) - 1.0
        node[..., c] = k
        x, y, w = np.moveaxis(node @ place[:3, :3].T + place[:3, 3], -1, 0)
        x, y = np.clip(x / w, 0.0, sweep.width - 1.0), np.clip(y / w, 0.0, sweep.height - 1.0)
        own = np.ones(x.shape, bool)
        if sweep.source is not None:
            way = node - sweep.source
            own = np.argmax(np.abs(way), axis=2) == c
        halved = 0.5 * np.minimum(after - before, RISE * (before - earlier))
        tau = np.maximum(_interpolate(before + halved, y, x), 0.0)
        length = sweep.length
        square = length[0] + length[1] * x + length[2] * y
        square += length[3] * x * x + length[4] * x * y + length[5] * y * y
        left = np.exp(-tau * np.sqrt(np.maximum(square, 0.0)))
        if meshes is not None:
            left = left * _interpolate((meshes > np.float32(n)).mean(axis=2), y, x)
        taken = ((1.0 - left) * share + 0.5).astype(np.uint16)
        layers[k + 1][own] -= taken[own]
        earlier, before = before, after


def read_nodes(nodes, pitch: int, strength: float, voxels, points, left, known, codes, channel: int) -> None:
    """Light at points beside voxels between nodes, as ``light_nodes._read``."""
    at = _places_of(voxels.row_start, voxels.column, voxels.shape_xyz)
    at += pitch * np.rint(_towards_lamp(points, at)) / STEPS
    # The last position is one step of the offsets before the last node.
    last = np.array(nodes.shape[::-1]) - 1.0 - 1.0 / (STEPS * pitch)
    at = np.clip((at - 0.5 * (pitch - 1)) / pitch + 1.0, 0.0, last)
    cell = at.astype(np.int64)
    share, found = at - cell, np.zeros(len(at))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (cell + corner).T
        found += np.where(corner, share, 1.0 - share).prod(axis=1) * nodes[z, y, x]
    codes[:, : known.shape[1]] = known
    found = (1.0 - strength) * ONE + strength * ONE / FULL * found
    codes[:, channel] = (found * (left / FULL if len(left) else 1.0) + 0.5).astype(np.int16)


def _slice_of_sheet(sweep, tables, starts, extinction, n: int, boxed: bool) -> np.ndarray:
    """(height, width) extinction of slice ``n`` of a sweep on the rays of the sheet; ``boxed``: none beyond voxels."""
    scale, offset_x, offset_y = sweep.scale[n], sweep.offset_x[n], sweep.offset_y[n]
    i, j, data = _voxels_of(tables, starts, sweep.slices[n])
    dense = np.zeros((tables.n_scanlines + 2, tables.width + 2))  # padded with one transparent voxel
    dense[j + 1, i + 1] = extinction[data]
    v = np.clip((np.arange(sweep.height) - offset_y) / scale + 1.0, 0.0, tables.n_scanlines + 1.0)
    u = np.clip((np.arange(sweep.width) - offset_x) / scale + 1.0, 0.0, tables.width + 1.0)
    found = _interpolate(dense, v[:, None], u[None, :])
    if boxed:
        found *= _within(v - 1.0, tables.n_scanlines)[:, None] * _within(u - 1.0, tables.width)
    return found


def _within(places, count: int) -> np.ndarray:
    """Which places along an axis lie between the centers of its voxels."""
    return (places > -BOXED) & (places < count - 1.0 + BOXED)


def _voxels_of(tables, starts, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) column, scanline and list position of each voxel of a slice."""
    found = [(np.zeros(0, np.int64),) * 3]
    for j, x, at, count in list_runs(tables.scanline_pointers, starts, tables.runs, tables.width, k):
        found.append((np.arange(x, x + count), np.full(count, j), np.arange(at, at + count)))
    return tuple(map(np.concatenate, zip(*found)))


def _interpolate(table, y, x) -> np.ndarray:
    """Bilinear interpolation in ``table``."""
    row = np.minimum(np.floor(y).astype(np.int64), table.shape[0] - 2)
    column = np.minimum(np.floor(x).astype(np.int64), table.shape[1] - 2)
    down, right = y - row, x - column
    upper = table[row, column] * (1.0 - right) + table[row, column + 1] * right
    lower = table[row + 1, column] * (1.0 - right) + table[row + 1, column + 1] * right
    return upper * (1.0 - down) + lower * down


def smooth(values, first, low, _wanted, along, across, deep, found):
    """All rows of smoothed planes, as ``surface_normals._smooth``."""
    sums, weight = values.astype(np.float64), np.ones(values.shape)
    for axis, taps in enumerate((deep, across, along)):
        sums, weight = _convolved(sums, taps, axis), _convolved(weight, taps, axis)
    found[:] = (sums / weight)[low - first : low - first + len(found)]


def _convolved(values, taps, axis: int) -> np.ndarray:
    """Values convolved along an axis; nothing lies outside."""
    found, reach, count = np.zeros_like(values), len(taps) // 2, values.shape[axis]
    values, to = np.moveaxis(values, axis, 0), np.moveaxis(found, axis, 0)
    for tap in range(-min(reach, count - 1), min(reach, count - 1) + 1):
        to[max(-tap, 0) : count - max(tap, 0)] += taps[reach + tap] * values[max(tap, 0) : count + min(tap, 0)]
    return found


def find_surfaces(smoothed, low, n_z, first, last, _wanted, lists, slopes, floor, per_mm, vectors, steep):
    """Vectors and steepness of the voxels of planes [first, last), as ``surface_normals._find``."""
    (row_start, column), (noise, error, middle) = lists, floor
    values, (_, n_y, _) = smoothed.astype(np.float64), smoothed.shape
    by_voxel = [_differences(values, axis) for axis in (2, 1, 0)]
    if low > 0:
        by_voxel[2][0] = 0.0  # its neighbor is not at hand, and it is not asked for
    gradient = np.stack(by_voxel, axis=-1) @ np.reshape(slopes, (3, 3)).T
    size = (gradient**2).sum(axis=-1)
    around, count = size[max(first - 1, 0) - low : min(last + 1, n_z) - low], 1.0
    own = slice(first - max(first - 1, 0), last - max(first - 1, 0))
    for axis in range(3):
        count = count * _convolved(np.ones(around.shape), np.ones(3), axis)
        around = _convolved(around, np.ones(3), axis)
    begin, end = row_start[first * n_y], row_start[last * n_y]
    row = np.searchsorted(row_start, np.arange(begin, end), side="right") - 1
    at = row // n_y - first, row % n_y, column[begin:end].astype(np.int64)
    mean, there = (around / count)[own][at], (at[0] + first - low, at[1], at[2])
    least = noise + error * np.abs(np.nan_to_num(values[there]) + middle)
    whole = np.maximum(mean + least**2, size[there])
    usable = (whole > 0.0) & (whole < np.inf)
    scale = np.divide(32767.0, np.sqrt(whole), out=np.zeros(len(whole)), where=usable)
    found, length = gradient[there], np.sqrt(size[there])
    found[:, 0] += np.maximum(0.04 * np.sqrt(mean) - length, 0.0)
    vectors[begin:end] = np.rint(found * scale[:, None])
    steep[begin:end] = length / per_mm


def _differences(values, axis: int) -> np.ndarray:
    """Central differences per voxel, one-sided at the ends; a neighbor that is not finite counts as the voxel itself,
    and such a voxel has none."""
    own, last = np.moveaxis(values, axis, 0), values.shape[axis] - 1
    index = np.arange(last + 1)
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, last)
    steps = np.maximum(after - before, 1).reshape(-1, 1, 1)
    around = [np.where(np.isfinite(own[which]), own[which], own) for which in (before, after)]
    found = np.where(np.isfinite(own), around[1] - around[0], 0.0) / steps
    return np.ascontiguousarray(np.moveaxis(np.nan_to_num(found), 0, axis))


def place_surfaces(
    vectors, steepness, stored, slope, intercept, ranges, row_start, column, shape_xyz, covector, matrix, to_index,
    world_per_mm, faces, box, codes, offsets,
):  # fmt: skip
    """Codes and offsets of kept voxels, as ``surface_points._place``, of all of them at a time."""
    matrix, to_index = np.reshape(matrix, (3, 4)), np.reshape(to_index, (3, 3))
    index = _places_of(row_start, column, shape_xyz)
    m = vectors.astype(np.float64) / ONE
    side, away = _sides(stored.astype(np.float64) * slope + intercept, ranges)
    m = unit_vectors(m @ np.reshape(covector, (3, 3)).T) * (side * np.linalg.norm(m, axis=1))[:, None]
    keep, part, nearest = np.ones(len(m)), np.zeros(m.shape), np.full(len(m), np.inf)

    def meet(distance, share, normal):
        nonlocal keep, part, nearest
        keep, part = keep * (1.0 - share), part + share[:, None] * normal
        nearest = np.where(share > 0.0, np.minimum(nearest, distance), nearest)

    for axis in range(3):
        for sign in (-1.0, 1.0):
            layers = index[:, axis] if sign < 0.0 else shape_xyz[axis] - 1.0 - index[:, axis]
            meet(layers * box[axis, 3], (layers <= 1.0) * float(shape_xyz[axis] > 1), sign * box[axis, :3])
    points = index @ matrix[:, :3].T + matrix[:, 3]
    for normal, offset, width in zip(faces.normals, faces.offsets, faces.widths):
        distance = np.abs(offset - points @ normal)
        meet(distance, 1.0 - smoothstep(distance / width - 1.0), normal)
    for own, back in faces.removed:
        at = points @ own[:3, :3].T + own[:3, 3]
        towards = (np.clip(at, -1.0, 1.0) - at) @ back[:3, :3].T
        distance, normal = np.linalg.norm(towards, axis=1), unit_vectors(towards)
        width = np.maximum(np.abs(normal @ matrix[:, :3]).sum(axis=1), 1e-300)
        meet(distance, np.where(distance > 0.0, 1.0 - smoothstep(distance / width - 1.0), 0.0), normal)
    m = keep[:, None] * m + part
    size = np.linalg.norm(m, axis=1)
    m, size = m / np.maximum(size, 1.0)[:, None], np.minimum(size, 1.0)
    codes[:] = np.rint(m * ONE)
    if not len(offsets):
        return
    n = unit_vectors(m)
    width = np.abs(n @ matrix[:, :3]).sum(axis=1)
    steep = steepness.astype(np.float64) * abs(slope) / world_per_mm
    depth = np.divide(away, steep, out=np.where(away > 0.0, np.inf, 0.0), where=steep > 0.0)
    inside = np.where(keep < 1.0, nearest, 0.0)
    depth = keep * np.minimum(depth, 3.0 * width) + (1.0 - keep) * np.where(np.isfinite(inside), inside, 0.0)
    b = 1.125 * smoothstep(size / 0.3) * np.minimum(depth + width, 3.0 * width)
    offsets[:] = np.rint(np.clip((b[:, None] * n) @ to_index.T * STEPS, -32767.0, 32767.0))


def _towards_lamp(points, index) -> np.ndarray:
    """(m, 3) STEPS times x' - x of voxels at (m, 3), as ``surface_points.towards_lamp``."""
    normals, offsets, (kind, place, way, matrix, to_index) = points
    if kind == 0:
        return offsets.astype(np.float64)
    matrix, to_index = np.reshape(matrix, (3, 4)), np.reshape(to_index, (3, 3))
    direction, p = np.broadcast_to(place, index.shape), np.broadcast_to(way, index.shape)
    if kind == 2:
        away = place - index @ matrix[:, :3].T - matrix[:, 3]
        direction, far = unit_vectors(away), np.linalg.norm(away, axis=1)
        reach = np.minimum(3.375 * np.abs(direction @ matrix[:, :3]).sum(axis=1), far)
        p = STEPS * reach[:, None] * (direction @ to_index.T)
    m = normals / ONE
    square = np.minimum((m * m).sum(axis=1), 1.0)
    facing = smoothstep(0.5 + 2.0 * np.einsum("ni,ni->n", m, direction))
    t = smoothstep(625.0 * square) * (1.0 - facing * square)
    return np.clip(offsets + t[:, None] * (p - offsets), -32767.0, 32767.0)


def block_light(meshes, voxels, points, place, pyramid, share: int, beside: bool, left) -> None:
    """Take from voxels what meshes block, as ``mesh_light._block``."""
    up, source, (*_, c) = pyramid
    at = _places_of(voxels.row_start, voxels.column, voxels.shape_xyz)
    at += beside * points.offsets / STEPS
    x, y, w, reached = np.reshape(place, (4, 4)) @ np.vstack((at.T, np.ones(len(at))))
    own = w > 0.0
    if up:
        way = np.abs(at - source)
        own &= (up * (at[:, c] - source[c]) > 0.0) & (np.argmax(way, axis=1) == c)
    x, y, w, reached = (part[own] for part in (x, y, w, reached))
    x, y = np.clip(x / w, 0.0, meshes.shape[1] - 1.0), np.clip(y / w, 0.0, meshes.shape[0] - 1.0)
    i, j = (np.minimum(at.astype(int), n - 2) for at, n in ((x, meshes.shape[1]), (y, meshes.shape[0])))
    blocked = np.zeros(len(x))
    for far, beyond in np.ndindex(2, 2):
        met = (meshes[j + far, i + beyond] < reached[:, None]).mean(axis=1)
        blocked += met * np.where(far, y - j, 1.0 - (y - j)) * np.where(beyond, x - i, 1.0 - (x - i))
    left[own] -= (blocked * share + 0.5).astype(np.uint16)


def smoothstep(t) -> np.ndarray:
    """3 t^2 - 2 t^3 of numbers that are limited to [0, 1]."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _sides(values, ranges) -> tuple[np.ndarray, np.ndarray]:
    """See ``surface_points._side``."""
    ends = np.concatenate(([-np.inf], np.where(np.abs(ranges.ravel()) < 1e299, ranges.ravel(), np.nan), [np.inf]))
    at = np.searchsorted(ranges.ravel(), values, side="left")
    inside = at % 2 == 1
    if len(ranges):
        starts = np.isin(values, ranges[:, 0]) & ~inside
        at, inside = at + starts, inside | starts
    down, up = (np.where(np.isfinite(d), d, np.inf) for d in (values - ends[at], ends[at + 1] - values))
    rises, falls = np.where(inside, up, down), np.where(inside, down, up)
    with np.errstate(invalid="ignore"):
        balance = (rises - falls) / (rises + falls)
    balance = np.where(np.isinf(rises) | (rises + falls == 0.0), 1.0, np.where(np.isinf(falls), -1.0, balance))
    side = 2.0 * smoothstep(balance + 0.5) - 1.0
    away = np.where(side >= 0.0, down, up)
    return side, np.where(inside & np.isfinite(away), away, 0.0)


def _dense(row_start, column, extinction, shape_xyz, bricks_zyx) -> np.ndarray:
    """Extinction of all corners of bricks, by z, y and x."""
    found = np.zeros([8 * count + 1 for count in bricks_zyx], np.float32)
    x, y, z = _places_of(row_start, column, shape_xyz).astype(np.int64).T
    found[z, y, x] = extinction
    return found


def _corners_of_bricks(dense):
    """(bz, by, bx, 9, 9, 9): the corners of each brick."""
    return np.lib.stride_tricks.sliding_window_view(dense, (9, 9, 9))[::8, ::8, ::8]


def mark_bricks(row_start, column, extinction, shape_xyz, numbers):
    """Mark bricks that have any extinction by 1, as ``light_rays._fill`` without corners."""
    dense = _dense(row_start, column, extinction, shape_xyz, numbers.shape)
    numbers[:] = (_corners_of_bricks(dense) > 0.0).any(axis=(3, 4, 5))


def fill_bricks(row_start, column, extinction, shape_xyz, numbers, corners):
    """The corners of the bricks with a number, as ``light_rays._fill``."""
    dense = _dense(row_start, column, extinction, shape_xyz, numbers.shape)
    corners.reshape(-1, 9, 9, 9)[:] = _corners_of_bricks(dense)[numbers >= 0]


RAYS_AT_ONCE = 4096


def trace_light(lists, medium, lamp, limits, free, sums):
    """Add what arrives of a point of a light, as ``light_rays._trace``.

    All crossings of a ray with the faces of cells and with what cuts are sorted; the piece between two of them lies in
    one cell, and is kept or cut away as its middle is.
    """
    row_start, column, points, shape_xyz = lists
    numbers, corners = medium
    dense = np.zeros([8 * count + 1 for count in numbers.shape])
    for number, (k, j, i) in enumerate(np.argwhere(numbers >= 0) * 8):
        dense[k : k + 9, j : j + 9, i : i + 9] = corners.reshape(-1, 9, 9, 9)[number]
    is_sun, point, metric, weight, scattered, _ = lamp
    start = _places_of(row_start, column, shape_xyz)
    start = np.clip(start + _towards_lamp(points, start) / STEPS, -1.0, shape_xyz)
    left = weight * (free / np.float32(FULL) if len(free) else np.ones(len(start), np.float32))
    for first in range(0, len(start), RAYS_AT_ONCE):
        part = slice(first, first + RAYS_AT_ONCE)
        o = start[part]
        d = np.broadcast_to(np.array(point), o.shape) if is_sun else np.array(point) - o
        length = np.sqrt(np.einsum("ni,ij,nj->n", d, np.reshape(metric, (3, 3)), d))
        passed = np.exp(-length * _integrate_extinction(dense, o, d, np.inf if is_sun else 1.0, shape_xyz, limits))
        sums[part] += left[part] * ((2.0 * passed**0.5 + passed**0.25) / 3.0 if scattered else passed)


def _integrate_extinction(dense, o, d, end, shape_xyz, limits) -> np.ndarray:
    """(N,) integrals over t of extinction along o + t d, t from 0 to ``end``, in the box, without what is cut away."""
    planes, boxes = limits
    if min(shape_xyz) < 2:
        return np.zeros(len(o))
    faces = [(np.eye(3)[axis], float(k)) for axis in range(3) for k in range(shape_xyz[axis])]
    faces += [(plane[:3], plane[3]) for plane in planes]
    faces += [(row[:3], side - row[3]) for box in boxes for row in box for side in (-1.0, 1.0)]
    normals, at = np.array([normal for normal, _ in faces]), np.array([distance for _, distance in faces])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = (at - o @ normals.T) / (d @ normals.T)
    ahead = np.clip(np.nan_to_num(crossings, nan=0.0, posinf=0.0, neginf=0.0), 0.0, end)
    ends = np.full((len(o), 1), 0.0 if np.isinf(end) else end)
    t = np.sort(np.concatenate((np.zeros((len(o), 1)), ahead, ends), axis=1), axis=1)
    piece, high = np.diff(t, axis=1), np.array(shape_xyz) - 1.0

    def points(share):
        return o[:, None] + d[:, None] * (t[:, :-1] + share * piece)[..., None]

    middle = points(0.5)
    kept = ((middle >= 0.0) & (middle <= high)).all(axis=2)
    for plane in planes:
        kept &= middle @ plane[:3] <= plane[3]
    for box in boxes:
        kept &= (np.abs(middle @ box[:, :3].T + box[:, 3]) > 1.0).any(axis=2)
    cell = np.clip(np.floor(middle), 0.0, high - 1.0).astype(np.int64)
    x, y, z = np.moveaxis(cell, 2, 0)
    total = np.zeros(piece.shape)
    for share in 0.5 + np.sqrt(1.0 / 12.0) * np.array((-1.0, 1.0)):
        right, down, deep = np.moveaxis(np.clip(points(share) - cell, 0.0, 1.0), 2, 0)
        for far in np.ndindex(2, 2, 2):
            of_x, of_y, of_z = (w if one else 1.0 - w for one, w in zip(far, (right, down, deep)))
            total += 0.5 * of_x * of_y * of_z * dense[z + far[2], y + far[1], x + far[0]]
    return np.where(kept, total * piece, 0.0).sum(axis=1)
