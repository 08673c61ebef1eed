"""Reference implementation of ``sheet_buffer``, in numpy: whole sheets at a time, the same sums."""

from __future__ import annotations

import numpy as np

from ...encode.reference import list_runs
from ...view.footprints import FOOTPRINTS, TENT, footprint_weights
from ..intermediate_image import note_filled
from ..mist_block import LINEAR, QUADRATIC, MistRays
from ..pixel_block import BLOCK, accumulator

ONE = np.float32(1.0)
TINY = np.float32(1e-37)  # keeps 0/0 out of color = associated color / extinction
ALMOST_ONE = np.float32(1.0 - 2.0**-24)
LONGEST = np.float32(1e30)  # reference distances; keeps infinity times log1p(-0) out of transparent pixels


def _dense_slice(tables, k: int) -> np.ndarray | None:
    """(n_scanlines, width, 4) float32: slice ``k``; None if it is empty."""
    voxels, dense = tables.voxels.bytes16.reshape(-1, 4), None
    for j, x, voxel, count in list_runs(tables.pointers, tables.data_starts, tables.runs, tables.width, k):
        if dense is None:
            dense = np.zeros((tables.pointers.shape[1], tables.width, 4), np.float32)
        dense[j, x : x + count] = voxels[voxel : voxel + count]
    return dense


def _spread(voxels, count: int, scale: float, offset: float, footprint, widen: bool):
    """Resample the first axis of ``voxels`` at ``count`` sheet pixels by the footprint."""
    stretch = max(1.0, 1.0 / scale) if widen else 1.0
    first, weights = footprint_weights(footprint, (np.arange(count) - offset) / scale, stretch)
    total = np.zeros((count, *voxels.shape[1:]), np.float32)
    for tap in range(weights.shape[1]):
        voxel = first + tap
        inside = (voxel >= 0) & (voxel < len(voxels))
        weight = np.where(inside, weights[:, tap], 0.0).astype(np.float32)
        total += weight.reshape(-1, *(1,) * (voxels.ndim - 1)) * voxels[np.clip(voxel, 0, len(voxels) - 1)]
    return total


def slab_numpy(samples, depth):
    """What homogeneous slabs absorb and let pass, and what their color is weighted by: extinction."""
    sigma = samples[..., 3]
    tau = sigma * depth
    absorbed = -np.expm1(-tau)
    # float32's exp may be a rounding off, which next to 1 is as much as a thin sheet absorbs.
    return absorbed, np.where(tau < 0.5, ONE - absorbed, np.exp(-tau)), np.maximum(sigma, TINY)


def _opacity(samples, exponent):
    added = samples[..., 3]
    opacity = np.minimum(added, ONE)
    raised = -np.expm1(np.minimum(exponent, LONGEST) * np.log1p(-np.minimum(opacity, ALMOST_ONE)))
    opacity = np.where(exponent == ONE, opacity, raised).astype(samples.dtype)
    return opacity, ONE - opacity, np.maximum(added, TINY)


def composite_numpy(absorb, samples, depth, least, state, slab, half):
    """One sheet (H, W, 4) of associated color and density over ``state``, by ``absorb(samples, depth)``.

    ``slab``: where it begins and ends along the viewing direction, numbers or (H, W); ``half`` as in ``splat_rows``.
    """
    before = state[..., 3].copy()
    alive = before >= least
    opacity, transmittance, divisor = absorb(samples, depth)
    weight = np.where(alive, before * opacity / divisor, 0.0).astype(state.dtype)
    state[..., :3] += weight[..., None] * samples[..., :3]
    state[..., 3] = np.where(alive, before * transmittance, before)
    crossed = (before >= 0.5) & (state[..., 3] < 0.5)
    if crossed.any():
        ahead, behind = before[crossed].astype(np.float64), state[..., 3][crossed].astype(np.float64)
        part = np.zeros_like(ahead)
        some = behind > 0.0
        part[some] = np.log(2.0 * ahead[some]) / np.log(ahead[some] / behind[some])
        begin, end = (np.broadcast_to(side, half.shape)[crossed] for side in slab)
        half[crossed] = begin + part * (end - begin)


def fade_added_numpy(mist: MistRays, state, ahead, middle) -> None:
    """Fade what a slab added to ``state`` (H, W, 4) since it was ``ahead``; see ``mist_block.fade_added``."""
    share = np.clip(mist.place[0] + mist.place[1] * np.float32(middle), 0.0, 1.0)
    if mist.falloff == QUADRATIC:
        share = share * share
    elif mist.falloff != LINEAR:
        share = np.sqrt(share)
    fog = (share * (ahead[..., 3] - state[..., 3]))[..., None] * np.array(mist[2:], np.float32)
    added = state[..., :3] - ahead[..., :3]
    state[..., :3] = ahead[..., :3] + (1.0 - share)[..., None] * added + fog


def within_holes(intervals, begin, end):
    """How much of a slab from ``begin`` to ``end``, numbers or (H, W), lies in the holes of ``intervals``."""
    gone = 0.0
    for enter, leave in zip(intervals[2::2], intervals[3::2]):
        gone = gone + np.maximum(np.minimum(end, leave) - np.maximum(begin, enter), 0.0)
    return gone


def leave_unseen(rays, pixels, half):
    """Blocks of which nothing is seen as ``band.begin_band`` leaves them: no color, all light."""
    unseen = rays.unseen(BLOCK)
    pixels[unseen] = 0.0, 0.0, 0.0, 1.0
    half[unseen] = np.inf


def splat_sheets_numpy(tables, sheets, rays, wide, least, additive_opacity, mist, pixels, half, filled):
    """Generator over sheets: yields fractions done; fills ``pixels``, ``half``, ``filled`` as ``splat_rows`` does."""
    height, width = half.shape
    half[...] = np.inf
    n_slices = tables.pointers.shape[0]
    length = rays.lengths()
    intervals = rays.intervals
    numbers = accumulator(len(sheets.begin))
    state = np.zeros(pixels.shape, numbers)
    state[..., 3] = 1.0
    kind, _, widen = wide or (TENT, 1.0, False)
    footprint = next(f for f in FOOTPRINTS.values() if f.kind == kind)
    slices: dict = {}
    for sheet in range(len(sheets.first_slice)):
        yield sheet / len(sheets.first_slice)
        near = sheets.first_slice[sheet] + np.arange(sheets.slice_weights.shape[1])
        slices = {k: slices[k] if k in slices else _dense_slice(tables, k) for k in near if 0 <= k < n_slices}
        blend = None
        for k, weight in zip(near, sheets.slice_weights[sheet], strict=True):
            if weight > 0.0 and slices.get(k) is not None:
                part = weight * slices[k]
                blend = part if blend is None else blend + part
        if blend is None:
            continue
        (scale_u, scale_v), (offset_u, offset_v) = sheets.scale[sheet], sheets.offset[sheet]
        across = _spread(blend, height, scale_v, offset_v, footprint, widen)
        along = _spread(across.transpose(1, 0, 2), width, scale_u, offset_u, footprint, widen)
        samples = along.transpose(1, 0, 2).astype(numbers, copy=False)
        depth = length * np.float32(sheets.thickness[sheet])
        slab = sheets.begin[sheet], sheets.end[sheet]
        if intervals.size:
            thick = sheets.end[sheet] - sheets.begin[sheet]
            begin, end = slab
            outside = np.maximum(intervals[0] - begin, 0.0) + np.maximum(end - intervals[1], 0.0)
            outside += within_holes(intervals, begin, end)
            depth = depth * np.clip(1.0 - outside / thick, 0.0, 1.0).astype(np.float32)
            slab = np.maximum(begin, intervals[0]), np.minimum(end, intervals[1])
        absorb = slab_numpy if additive_opacity is None else _opacity
        kept = state.copy() if mist.place.size else None
        composite_numpy(absorb, samples, depth.astype(numbers, copy=False), least, state, slab, half)
        if mist.place.size:
            fade_added_numpy(mist, state, kept, 0.5 * (sheets.begin[sheet] + sheets.end[sheet]))
    pixels[...] = state
    leave_unseen(rays, pixels, half)
    note_filled(pixels, filled)
