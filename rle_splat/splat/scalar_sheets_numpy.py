"""Sheets of the scalar without numba: whole sheets at a time, the same sums.  Slow, for machines without numba."""

from __future__ import annotations

import numpy as np

from .pixel_block import accumulator
from .scalar_scanline import NOT_KEPT
from .sheet_buffer_numpy import composite_numpy, slab_numpy

ONE = np.float32(1.0)


def _dense_slice(tables, k: int) -> np.ndarray | None:
    """(n_scanlines, width, channels) float32: scalar and light of slice ``k``; None if nothing of it is kept."""
    channels = 1 if tables.lights is None else 1 + tables.lights.shape[1]
    dense = None
    for j in range(tables.pointers.shape[1]):
        run = int(tables.pointers[k, j])
        if run < 0:
            continue
        if dense is None:
            dense = np.zeros((tables.pointers.shape[1], tables.width, channels), np.float32)
            dense[..., 0] = NOT_KEPT
        x, voxel = 0, int(tables.data_starts[k, j])
        while x < tables.width:
            x += int(tables.runs[run])
            if x >= tables.width:
                break
            count = int(tables.runs[run + 1])
            dense[j, x : x + count, 0] = tables.scalars[voxel : voxel + count]
            if tables.lights is not None:
                bits = tables.lights[voxel : voxel + count].astype(np.uint32) << np.uint32(12)
                dense[j, x : x + count, 1:] = bits.view(np.float32) * np.float32(tables.light_unit)
            x, voxel, run = x + count, voxel + count, run + 2
    return dense


def _between(slices, first: int, weights) -> np.ndarray | None:
    """Two slices mixed, (n_scanlines, width, channels); None where either of them, if it counts, is empty."""
    near, far = slices.get(first), slices.get(first + 1)
    if weights[1] == 0.0:
        return near
    if weights[0] == 0.0:
        return far
    if near is None or far is None:
        return None
    both = (near[..., :1] > NOT_KEPT) & (far[..., :1] > NOT_KEPT)
    mixed = weights[0] * near + weights[1] * far
    mixed[..., :1] = np.where(both, mixed[..., :1], NOT_KEPT)
    return mixed


def _resampled(samples, count: int, scale: float, offset: float) -> np.ndarray:
    """The first axis of ``samples`` at ``count`` sheet pixels, linearly, none beyond its ends."""
    last = len(samples) - 1
    place = np.clip((np.arange(count) - offset) / scale, 0.0, last)
    cell = np.clip(place.astype(np.int64), 0, max(last - 1, 0))
    share = (place - cell).astype(np.float32).reshape(-1, *(1,) * (samples.ndim - 1))
    after = np.minimum(cell + 1, last)
    return samples[cell] * (ONE - share) + samples[after] * share


def splat_scalar_sheets_numpy(tables, sheets, rays, box, look, matt, gloss, least, pixels, half):
    """Generator over sheets: yields fractions done; fills ``pixels`` and ``half`` as ``splat_scalar_rows`` does."""
    height, width = half.shape
    table, origin, rate, low, high, last = look
    table = table.reshape(-1, 4)
    length = rays.lengths()
    enter = np.maximum(box.columns[0], box.rows[0][:, None]).astype(np.float64)
    leave = np.minimum(box.columns[1], box.rows[1][:, None]).astype(np.float64)
    if rays.limits is not None:
        enter, leave = np.maximum(enter, rays.limits[0]), np.minimum(leave, rays.limits[1])
    numbers = accumulator(len(sheets.begin))
    state = np.zeros(pixels.shape, numbers)
    state[..., 3] = 1.0
    slices: dict = {}
    n_slices = tables.pointers.shape[0]
    for sheet in range(len(sheets.first_slice)):
        yield sheet / len(sheets.first_slice)
        first = int(sheets.first_slice[sheet])
        slices = {
            k: slices[k] if k in slices else _dense_slice(tables, k) for k in (first, first + 1) if 0 <= k < n_slices
        }
        mixed = _between(slices, first, sheets.slice_weights[sheet])
        if mixed is None:
            continue
        (scale_u, scale_v), (offset_u, offset_v) = sheets.scale[sheet], sheets.offset[sheet]
        along = _resampled(mixed.transpose(1, 0, 2), width, scale_u, offset_u)
        samples = _resampled(along.transpose(1, 0, 2), height, scale_v, offset_v)
        value = samples[..., 0]
        inside = (value >= low) & (value <= high)
        if not inside.any():
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            index = np.clip((value - origin) * rate, 0.0, last - 1).astype(np.int64)
        found = table[np.where(inside, index, last)]
        color, sigma = found[..., :3], found[..., 3]
        if matt:
            color = color * samples[..., list(matt)]
        if gloss:
            color = color + sigma[..., None] * samples[..., list(gloss)]
        begin, end = sheets.begin[sheet], sheets.end[sheet]
        inside_slab = np.clip((np.minimum(end, leave) - np.maximum(begin, enter)) / (end - begin), 0.0, 1.0)
        depth = length * inside_slab.astype(np.float32) * np.float32(sheets.thickness[sheet])
        classified = np.concatenate((color, sigma[..., None]), axis=-1).astype(numbers, copy=False)
        slab = np.maximum(begin, enter), np.minimum(end, leave)
        composite_numpy(slab_numpy, classified, depth.astype(numbers, copy=False), least, state, slab, half)
    pixels[...] = state
