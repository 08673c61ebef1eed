"""Resampling of the intermediate image at the rays of the picture's pixels."""

from __future__ import annotations

import numpy as np

from ..runtime.jit import kernel, parallel_call
from ..runtime.parallel import share_out
from ..scene import NO_DEPTH
from .reference import CLEAR, SAME_SURFACE
from .taps import tap2x2, tap4x4

ROWS = 8  # rows of the picture per band
STRETCH = 64  # pixels of a row whose sheet positions are computed together, as vectors


@kernel(inner=True)
def _half_depth(half_depths, width, at, across, down):
    """Half depth at fractions ``across`` and ``down`` beyond sheet pixel ``at``.

    Bilinear on one surface, the nearest pixel's value across an edge.
    """
    half = np.float32(0.5)
    nearest = half_depths[at + (across >= half) + width * (down >= half)]
    a, b = half_depths[at], half_depths[at + 1]
    c, d = half_depths[at + width], half_depths[at + width + 1]
    least, most = a if a < b else b, b if a < b else a
    least, most = c if c < least else least, c if c > most else most
    least, most = d if d < least else least, d if d > most else most
    upper, lower = a + across * (b - a), c + across * (d - c)
    mixed = upper + down * (lower - upper)
    return mixed if most - least <= SAME_SURFACE else nearest


@kernel(inner=True)
def _is_clear(half_depths, width, at):
    """Whether all four sheet pixels from ``at`` on are transparent."""
    a, b = half_depths[at] == CLEAR, half_depths[at + 1] == CLEAR
    return a and b and half_depths[at + width] == CLEAR and half_depths[at + width + 1] == CLEAR


@kernel(inner=True)
def _find_positions(maps, first_column, row, sheet_size, sheet_origin, at, across, down):
    """Sheet positions of the pixels from ``first_column`` on; returns how many are inside the sheet.

    Writes ``at``, the flat index of the sheet pixel at or before the position (-1 where a filter's taps would leave the
    sheet), and the fractions ``across`` and ``down`` beyond it.
    """
    width, height = sheet_size
    at_u = maps[0, 1] * row + maps[0, 2]
    at_v = maps[1, 1] * row + maps[1, 2]
    at_w = maps[2, 1] * row + maps[2, 2]
    step_u, step_v, step_w = maps[0, 0], maps[1, 0], maps[2, 0]
    least_u, least_v = sheet_origin[0] + 1.0, sheet_origin[1] + 1.0
    most_u, most_v = sheet_origin[0] + width - 2.0, sheet_origin[1] + height - 2.0
    count = 0
    for i in range(len(at)):
        column = first_column + i + 0.5
        scale = 1.0 / (step_w * column + at_w)
        u, v = (step_u * column + at_u) * scale, (step_v * column + at_v) * scale
        found = (u >= least_u) & (v >= least_v) & (u < most_u) & (v < most_v)
        whole_u, whole_v = np.floor(u), np.floor(v)
        across[i], down[i] = u - whole_u, v - whole_v
        first = (np.int64(whole_v) - sheet_origin[1]) * width + (np.int64(whole_u) - sheet_origin[0])
        at[i] = first if found else -1
        count += found
    return count


@kernel(inner=True)
def _sees_any(maps, first_column, row, filled, reach, sheet_origin):
    """Whether any pixel of a stretch may read within ``reach`` of a filled sheet pixel.

    ``filled`` (2, h): see ``IntermediateImage``.
    """
    begin, end = first_column + 0.5, first_column + STRETCH - 0.5
    w_here = maps[2, 1] * row + maps[2, 2]
    w_begin, w_end = maps[2, 0] * begin + w_here, maps[2, 0] * end + w_here
    if not (w_begin > 0.0 and w_end > 0.0):  # the horizon crosses the stretch
        return True
    # Positions between two pixels lie on the line between their positions.
    u_here, v_here = maps[0, 1] * row + maps[0, 2], maps[1, 1] * row + maps[1, 2]
    u, further_u = (maps[0, 0] * begin + u_here) / w_begin, (maps[0, 0] * end + u_here) / w_end
    v, further_v = (maps[1, 0] * begin + v_here) / w_begin, (maps[1, 0] * end + v_here) / w_end
    first = min(u, further_u) - sheet_origin[0] - reach
    last = max(u, further_u) - sheet_origin[0] + reach
    top = max(min(v, further_v) - sheet_origin[1] - reach, 0.0)
    bottom = min(max(v, further_v) - sheet_origin[1] + reach + 1.0, float(filled.shape[1]))
    if top < bottom:
        for sheet_row in range(int(top), int(bottom)):
            if filled[0, sheet_row] <= last and filled[1, sheet_row] > first:
                return True
    return False


@kernel(inner=True)
def _keep_own(directions, first_column, row, axis, sign, at):
    """Set ``at`` to -1 for pixels whose rays have another principal axis or direction; return how many are left.

    Ties go to the first axis, as in ``principal_axis.dominant_axis``.
    """
    one, two = (axis + 1) % 3, (axis + 2) % 3
    here = directions[axis, 1] * row + directions[axis, 2]
    here_one = directions[one, 1] * row + directions[one, 2]
    here_two = directions[two, 1] * row + directions[two, 2]
    count = 0
    for i in range(len(at)):
        column = first_column + i + 0.5
        along = sign * (directions[axis, 0] * column + here)
        sideways_one = abs(directions[one, 0] * column + here_one)
        sideways_two = abs(directions[two, 0] * column + here_two)
        own = (along > 0.0) & (sideways_one <= along) & (sideways_two <= along)
        own &= ((sideways_one < along) | (axis < one)) & ((sideways_two < along) | (axis < two))
        at[i] = at[i] if own else -1
        count += at[i] >= 0
    return count


@kernel(inner=True)
def _resample_rows(
    samples, half_depths, filled, reach, sheet_size, sheet_origin, maps, directions, axis, sign, taps, table,
    most_color, picture_size, picture_origin, first, window, first_row, picture, depths,
):  # fmt: skip
    """``resample`` for ROWS rows from ``first_row`` on.

    Arrays are flat; sizes are (width, height). ``maps`` (5, 3): rows that map a pixel of the picture to u, v, w, and
    to w times the depth at axis position 0 and per voxel. ``window``: (left, top, right, bottom) outside which no pixel
    reads the sheet.
    """
    width, picture_width = sheet_size[0], picture_size[0]
    parallel_rays = directions[axis, 0] == 0.0 and directions[axis, 1] == 0.0 and directions[axis, 2] == 0.0
    at, across, down = np.empty(STRETCH, np.int64), np.empty(STRETCH, np.float32), np.empty(STRETCH, np.float32)
    halves = np.empty(STRETCH, np.float32)
    for r in range(first_row, first_row + ROWS):
        if r >= picture_size[1]:
            break
        if first:
            picture[4 * r * picture_width : 4 * (r + 1) * picture_width] = np.float32(0.0)
            depths[r * picture_width : (r + 1) * picture_width] = np.float32(NO_DEPTH)
        if r < window[1] or r >= window[3]:
            continue
        row = r + picture_origin[1] + 0.5
        for c in range(window[0], window[2], STRETCH):
            column = c + picture_origin[0]
            if not _sees_any(maps, column, row, filled, reach, sheet_origin):
                continue
            wanted = _find_positions(maps, column, row, sheet_size, sheet_origin, at, across, down)
            if wanted and not parallel_rays:
                wanted = _keep_own(directions, column, row, axis, sign, at)
            if not wanted:
                continue
            count = min(STRETCH, picture_width - c)
            first_pixel = r * picture_width + c
            for i in range(count):
                halves[i] = np.inf
                if at[i] < 0 or _is_clear(half_depths, width, at[i]):
                    continue
                to = first_pixel + i
                if taps == 2:
                    tap2x2(samples, 4 * at[i], 4 * width, across[i], down[i], most_color, picture, 4 * to)
                else:
                    first_tap = 4 * (at[i] - width - 1)
                    tap4x4(samples, first_tap, 4 * width, across[i], down[i], table, most_color, picture, 4 * to)
                halves[i] = _half_depth(half_depths, width, at[i], across[i], down[i])
            w_here = maps[2, 1] * row + maps[2, 2]
            at_zero_here, per_voxel_here = maps[3, 1] * row + maps[3, 2], maps[4, 1] * row + maps[4, 2]
            found = depths[first_pixel : first_pixel + count]
            for i in range(count):
                center = column + i + 0.5
                w = maps[2, 0] * center + w_here
                at_zero, per_voxel = maps[3, 0] * center + at_zero_here, maps[4, 0] * center + per_voxel_here
                depth = np.float32((halves[i] * per_voxel + at_zero) / w)
                found[i] = depth if halves[i] < CLEAR else found[i]


@kernel(inner=True)
def _resample_bands(
    first_band, last_band, samples, half_depths, filled, reach, sheet_size, sheet_origin, maps, directions, axis, sign,
    taps, table, most_color, picture_size, picture_origin, first, window, picture, depths,
):  # fmt: skip
    """``resample`` for bands [first_band, last_band) of ROWS rows; arguments as of ``_resample_rows``."""
    for band in range(first_band, last_band):
        _resample_rows(
            samples, half_depths, filled, reach, sheet_size, sheet_origin, maps, directions, axis, sign, taps, table,
            most_color, picture_size, picture_origin, first, window, band * ROWS, picture, depths,
        )  # fmt: skip


def shown_in(from_sheet, sheet_shape, sheet_origin, picture_shape, picture_origin) -> tuple[int, int, int, int]:
    """Part of the picture outside which no pixel reads a sheet.

    Parameters
    ----------
    from_sheet : (3, 3) ndarray of float64
        Homogeneous sheet pixel to homogeneous picture pixel.
    sheet_shape, picture_shape : (rows, columns)
    sheet_origin, picture_origin : (column, row)
        Number of the first pixel of each array.

    Returns
    -------
    (left, top, right, bottom)
    """
    (u, v), (rows, columns), (height, width) = sheet_origin, sheet_shape, picture_shape
    corners = (u, v), (u + columns, v), (u + columns, v + rows), (u, v + rows)
    # Plain Python arithmetic, because numpy's overhead per call is larger for four corners.
    projected = [[a * x + b * y + c for a, b, c in from_sheet.tolist()] for x, y in corners]
    if not all(w > 0.0 for *_, w in projected):  # partly behind the eye: the corners give no bounds
        return 0, 0, width, height
    sides = []
    for n, count in enumerate((width, height)):
        seen = [corner[n] / corner[2] - picture_origin[n] for corner in projected]
        sides.append((int(min(max(min(seen) - 1.0, 0.0), count)), int(max(min(max(seen) + 2.0, count), 0.0))))
    (left, right), (top, bottom) = sides
    return left, top, right, bottom


@kernel
def _resample(bands, arguments):
    """Kernel of ``resample``; ``arguments``: of ``_resample_bands``."""
    share_out(_resample_bands, bands, arguments)


def resample(
    window, filled, reach, pixels, half, sheet_origin, to_sheet, directions, axis, sign, taps, table, most_color,
    depth_map, picture_origin, first, rgba, depth, threads=0,
):  # fmt: skip
    """Fill the pixels of the picture that belong to one base plane.

    Positions are computed with pixel numbers of the whole sheet and picture, so that windows of them get the same bits.

    Parameters
    ----------
    window : (left, top, right, bottom)
        As of ``shown_in``.
    filled : (2, h) ndarray
        See ``IntermediateImage``.
    reach : int
        Pixels farther than this from all filled sheet pixels are transparent.
    pixels : (h, w, 4) ndarray of float32
        Color and transmittance, or spline coefficients of color and alpha, as the filter needs.
    half : (h, w) ndarray of float32
        Half depths along the viewing direction, inf for none, CLEAR for none in a transparent pixel.
    sheet_origin, picture_origin : (column, row)
        Numbers of the first pixels of the arrays.
    to_sheet : (3, 3) ndarray of float64
        Homogeneous picture pixel to homogeneous sheet pixel.
    directions : (3, 3) ndarray of float64
        Picture pixel to index-space ray direction; all zero for parallel rays.
    axis, sign : int
        Principal axis and direction of the base plane.
    taps : {2, 4}
        Taps of the filter along each axis.
    table : (96,) ndarray of float32
        As of ``filters.WarpFilter``; not used for two taps.
    most_color : float32
        Color is clamped to ``most_color`` times alpha.
    depth_map : (2, 3) ndarray of float64
        Sheet pixel to planar depth at axis position 0, and per voxel.
    first : bool
        Whether this is the first base plane of the picture, which is then cleared.
    rgba : (H, W, 4) ndarray of float32
        Output.
    depth : (H, W) ndarray of float32
        Output; NO_DEPTH where there is none.
    threads : int
        0 for one per core.
    """
    arguments = (
        pixels.reshape(-1), half.reshape(-1), filled, reach, half.shape[::-1], sheet_origin,
        np.concatenate((to_sheet, depth_map @ to_sheet)), directions, axis, sign, taps, table, most_color,
        depth.shape[::-1], picture_origin, first, window, rgba.reshape(-1), depth.reshape(-1),
    )  # fmt: skip
    with parallel_call(threads):
        _resample(-(-len(depth) // ROWS), arguments)
