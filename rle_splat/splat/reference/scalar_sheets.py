"""Reference implementation of ``scalar_sheets``, in numpy: whole sheets at a time, the same sums."""

from __future__ import annotations

import numpy as np

from ...encode.reference import list_runs
from ...shade.lighting import unit_vectors
from ...shade.sample_light import ONE as CODE_OF_ONE
from ...shade.sample_light import light_of_samples
from ...view.depth_rules import BEGINS, BETWEEN, OWN
from ...volume.axes import AXES
from ..intermediate_image import note_filled
from ..pixel_block import accumulator
from ..ray_sums import HALF
from ..scalar_block import SPAN
from ..scalar_scanline import NOT_KEPT
from .label_parts import label_parts
from .sheet_buffer import composite_numpy, fade_added_numpy, leave_unseen, slab_numpy, within_holes

ONE = np.float32(1.0)


def dense_slice(tables, k: int) -> np.ndarray | None:
    """(n_scanlines, width, planes) float32: scalar, codes and values of slice ``k``; None if nothing of it is kept."""
    scalars = tables.scalars.array()
    dense = None
    for j, x, voxel, count in list_runs(tables.pointers, tables.data_starts, tables.runs, tables.width, k):
        if dense is None:
            dense = np.tile(_nothing(tables), (tables.pointers.shape[1], tables.width, 1))
        dense[j, x : x + count, 0] = scalars[voxel : voxel + count]
        codes = tables.codes[voxel : voxel + count] / CODE_OF_ONE
        dense[j, x : x + count, 1 : 1 + codes.shape[1]] = codes
        if tables.values is not None:
            dense[j, x : x + count, -tables.values.shape[1] :] = tables.values[voxel : voxel + count]
    return dense


def _nothing(tables) -> np.ndarray:
    """(planes,) float32 of a voxel that is not kept."""
    codes, values = tables.codes.shape[1], 0 if tables.values is None else tables.values.shape[1]
    return np.array([NOT_KEPT, *[0.0] * codes, *[NOT_KEPT] * values], np.float32)


def _between(slices, first: int, weights, nothing) -> np.ndarray | None:
    """Two slices mixed, (n_scanlines, width, planes); None where either of them, if it counts, is empty.

    ``nothing``: a voxel that is not kept.
    """
    near, far = slices.get(first), slices.get(first + 1)
    if weights[1] == 0.0:
        return near
    if weights[0] == 0.0:
        return far
    if near is None or far is None:
        return None
    mixed = weights[0] * near + weights[1] * far
    empty = nothing == NOT_KEPT
    both = (near[..., empty] > NOT_KEPT) & (far[..., empty] > NOT_KEPT)
    mixed[..., empty] = np.where(both, mixed[..., empty], NOT_KEPT)
    return mixed


def _resample(samples, count: int, scale: float, offset: float) -> np.ndarray:
    """The first axis of ``samples`` at ``count`` sheet pixels, linearly, none beyond its ends."""
    last = len(samples) - 1
    position = np.clip((np.arange(count) - offset) / scale, 0.0, last)
    cell = np.clip(position.astype(np.int64), 0, max(last - 1, 0))
    share = (position - cell).astype(np.float32).reshape(-1, *(1,) * (samples.ndim - 1))
    after = np.minimum(cell + 1, last)
    return samples[cell] * (ONE - share) + samples[after] * share


def _own_samples(here, lookup):
    """(H, W, channels) classified samples of one sheet, the share of the slab that counts (all of it), and planes."""
    table, _, origin, rate, _, low, high, _, _, last = lookup
    value = here[..., 0]
    inside = (value >= low) & (value <= high)
    return table.reshape(last + 1, -1)[_entry(value, inside, origin, rate, last)], ONE, here[..., 1:]


def _entry(value, inside, origin, rate, last):
    with np.errstate(over="ignore", invalid="ignore"):
        index = np.clip((value - origin) * rate, 0.0, last - 1).astype(np.int64)
    return np.where(inside, index, last)


def _classify(kind, here, there, lookup, cut):
    """Classified samples (H, W, 4) of a slab, the share of it that counts, and planes; ``cut``: of ``cut_ends_numpy``,
    which makes values where rays begin and end in it of those of two sheets, or None."""
    if kind == OWN:
        return _own_samples(here, lookup)
    first, last = there[..., 0], here[..., 0]
    if cut is not None:
        first, last = cut_ends_numpy(*cut, last, first, lookup[4])
    return _samples_between(here, there, lookup, first, last)


def _classify_channels(kind, here, there, channels, cut, parts=None):
    """As ``_classify``, by several channels; and where what is shown begins and ends (H, W) each: see
    ``channel_block``.  ``parts``: what of each slab belongs to each function of labels, (own, H, W), which
    then classify the volume itself, or None."""
    mixed = np.zeros((*here.shape[:2], 4), np.float32)
    counts, begin, end = np.zeros((3, *here.shape[:2]), np.float32)
    shine = here[..., 1:]
    ends = zip(channels.planes, channels.begins, channels.begins[1:], channels.numbers)
    for number, (plane, first, last, numbers) in enumerate(ends):
        labeled = parts is not None and number < channels.own
        if labeled and not parts[number].any():
            continue
        lookup = (channels.tables[first:last], channels.sums[first:last], *numbers, (last - first) // 4 - 1)
        own, own_before = (np.concatenate((one[..., [plane]], one[..., 1:]), axis=-1) for one in (here, there))
        sampled, counted, planes = _classify(kind, own, own_before, lookup, cut)
        sampled = sampled * np.broadcast_to(counted, counts.shape)[..., None]
        if labeled:
            sampled = sampled * parts[number][..., None]
        mixed += sampled
        part = np.divide(sampled[..., 3], mixed[..., 3], out=np.zeros_like(counts), where=mixed[..., 3] > 0.0)
        more = counted > counts
        shine = np.where(more[..., None], planes, shine)
        counts = np.where(more, counted, counts)
        for total, own_end in zip((begin, end), span_shown(own[..., 0], own_before[..., 0], *lookup[5:7])):
            total += part * (own_end.astype(np.float32) - total)
    return mixed / counts[..., None], counts, shine, (begin, end)


def _samples_between(here, there, lookup, first, second):
    """As ``_own_samples``, for the slab between two sheets, where the scalar goes from ``first`` to ``second``; see
    ``scalar_block.look_between`` and what follows."""
    table, sums, origin, rate, least, low, high, nearest, furthest, last = lookup
    is_here, is_there = second >= least, first >= least
    both, some = is_here & is_there, is_here | is_there
    first, second = np.where(is_there, first, second), np.where(is_here, second, first)
    first, second = np.clip(first, nearest, furthest), np.clip(second, nearest, furthest)
    smallest, largest = np.minimum(first, second), np.maximum(first, second)
    shown = (largest >= low) & (smallest <= high) & some
    with np.errstate(over="ignore"):
        middle = (smallest + largest) * np.float32(0.5)
    inside = (middle >= low) & (middle <= high) & some
    sampled = table.reshape(last + 1, -1)[_entry(middle, inside, origin, rate, last)]
    with np.errstate(over="ignore", invalid="ignore"):
        width = (largest - smallest) * rate
        wide = (width >= SPAN) & shown
        from_, to = (
            np.clip((end - origin) * rate + np.float32(0.5), 0.0, last).astype(np.int64)[wide]
            for end in (smallest, largest)
        )
    total = sums.reshape(last + 1, -1)
    sampled[wide] = np.maximum((total[to] - total[from_]) / np.maximum(width[wide], ONE)[:, None], 0.0)
    light = np.where(both, np.float32(0.5), is_here.astype(np.float32))[..., None]
    return sampled, np.where(both, ONE, np.float32(0.5)), here[..., 1:] * light + there[..., 1:] * (ONE - light)


def _gather_numpy(value, length, sign, origin, least, depth, ends, state, half):
    """See ``ray_sums.gather_values``: ``value`` and ``length`` (H, W); ``ends``: of the rays."""
    kept = value >= least
    if sign == 0.0:
        weight = np.where(kept, length, np.float32(0.0))
        state[..., 0] += (value - origin) * weight
        state[..., 1] += weight
        state[..., 3] = np.where(weight > 0.0, 0.0, state[..., 3])
        return
    counts = kept & (length > 0.0)
    over = sign * value - origin
    more = counts & (over > state[..., 0])
    state[..., 0] = np.where(more, over, state[..., 0])
    state[..., 3] = np.where(counts, 0.0, state[..., 3])
    half[...] = np.where(more, np.clip(depth, *ends), half)


def _add_depths_numpy(depth, slab, state, half):
    """See ``ray_sums.add_depths``: optical ``depth`` (H, W) of a slab between the ends ``slab``."""
    before = state[..., 0].copy()
    state[..., 0] += depth
    after = state[..., 0]
    crossed = (before < HALF) & (after >= HALF)
    part = (HALF - before[crossed]) / (after - before)[crossed]
    half[crossed] = slab[0][crossed] + part * (slab[1] - slab[0])[crossed]


def cut_ends_numpy(intervals, begin, end, here, there, least):
    """(H, W) values of the scalar where rays begin in a slab and where they end; see ``cut_slab.cut_ends``."""
    from_, to = np.maximum(begin, intervals[0]), np.minimum(end, intervals[1])
    for into, out in zip(intervals[2::2], intervals[3::2]):
        at_front = (into <= from_) & (from_ < out)
        at_back = ~at_front & (into < to) & (to <= out)
        from_ = np.where(at_front, np.minimum(out, to), from_)
        to = np.where(at_back, np.maximum(into, from_), to)
    counts = (here >= least) & (there >= least) & (from_ < to)
    with np.errstate(over="ignore", invalid="ignore"):
        first, last = (
            there + (here - there) * ((position - begin) / (end - begin)).astype(np.float32) for position in (from_, to)
        )
    return np.where(counts, first, there), np.where(counts, last, here)


def span_shown(here, there, low, high) -> tuple[np.ndarray, np.ndarray]:
    """See ``sample_block._span_shown``; all (H, W), but the ends ``low`` and ``high`` of what is shown."""
    here, there = here.astype(np.float64), there.astype(np.float64)
    apart, least = np.maximum(np.abs(here - there), 1e-30), np.minimum(here, there)
    ends = [np.clip((end - least) / apart, 0.0, 1.0) for end in (low, high)]
    return tuple(np.where(here >= there, one, 1.0 - other) for one, other in (ends, ends[::-1]))


def share_here(first, last, depth) -> np.ndarray:
    """See ``sample_block._share_here``; all (H, W)."""
    return (first + (last - first) / (2.0 + 0.5 * depth)).astype(np.float32)


def _light_numpy(light, plane, position, planes):
    """Light and highlights, (H, W, 3) each, of ``planes`` (H, W, channels) at ``position`` along the viewing
    direction."""
    i, j, k = AXES[plane.axis]
    (x, y), (dx, dy) = (np.meshgrid(*both) for both in (plane.points, plane.ray_slopes))
    steps = np.empty((*x.shape, 3))
    steps[..., i], steps[..., j], steps[..., k] = dx, dy, 1.0
    away = plane.sign * position - plane.reference
    at = away * steps
    at[..., i], at[..., j], at[..., k] = x + at[..., i], y + at[..., j], plane.sign * position
    matrix = light.falling.matrix
    to_eye = unit_vectors((-plane.sign * steps @ matrix[:3, :3].T).reshape(-1, 3))
    points = (at @ matrix[:3, :3].T + matrix[:3, 3]).reshape(-1, 3)
    found = light_of_samples(light, planes[..., : light.planes].reshape(-1, light.planes), to_eye, points)
    return [each.reshape(*x.shape, 3) for each in found]


def splat_scalar_sheets_numpy(
    tables, sheets, rays, box, lookup, sign, absorbs, thinned, light, plane, mist, channels, labels, least, pixels,
    half, filled,
):  # fmt: skip
    """Generator over sheets: yields fractions done; fills ``pixels``, ``half`` and ``filled`` as ``splat_scalar_rows``
    does.

    ``thinned``: whether the last plane is a factor of extinction.  ``light``: a SampleLight or None, on the samples of
    the BasePlane ``plane``, of which each is lit by its own light.
    """
    height, width = half.shape
    half[...] = np.inf
    length = rays.lengths()
    enter = np.maximum(box.columns[0], box.rows[0][:, None]).astype(np.float64)
    leave = np.minimum(box.columns[1], box.rows[1][:, None]).astype(np.float64)
    if rays.intervals.size:
        enter, leave = np.maximum(enter, rays.intervals[0]), np.minimum(leave, rays.intervals[1])
    numbers = accumulator(len(sheets.begin))
    state = np.zeros(pixels.shape, numbers)
    state[..., 3] = 1.0
    n_slices = tables.pointers.shape[0]
    nothing = _nothing(tables)
    absent = np.broadcast_to(nothing, (height, width, len(nothing)))
    slices: dict = {}
    here = absent
    for sheet in range(len(sheets.first_slice)):
        yield sheet / len(sheets.first_slice)
        there = here if sheets.kind[sheet] == BETWEEN else absent
        first = int(sheets.first_slice[sheet])
        slices = {
            k: slices[k] if k in slices else dense_slice(tables, k) for k in (first, first + 1) if 0 <= k < n_slices
        }
        mixed = _between(slices, first, sheets.slice_weights[sheet], nothing)
        here = absent
        if mixed is not None:
            (scale_u, scale_v), (offset_u, offset_v) = sheets.scale[sheet], sheets.offset[sheet]
            along = _resample(mixed.transpose(1, 0, 2), width, scale_u, offset_u)
            here = _resample(along.transpose(1, 0, 2), height, scale_v, offset_v)
        if sheets.kind[sheet] == BEGINS or (here is absent and there is absent):
            continue
        slab = np.maximum(sheets.begin[sheet], enter), np.minimum(sheets.end[sheet], leave)
        deep = slab[1] - slab[0]
        if rays.intervals.size:
            deep = deep - within_holes(rays.intervals, *slab)
        inside = np.clip(deep / (sheets.end[sheet] - sheets.begin[sheet]), 0.0, 1.0)
        in_slab = length * inside.astype(np.float32) * np.float32(sheets.thickness[sheet])
        if sign is not None:
            position = first + sheets.slice_weights[sheet, 1]
            position = position if sheets.begin[sheet] <= position <= sheets.end[sheet] else -position
            _gather_numpy(here[..., 0], in_slab, sign, lookup[2], lookup[4], position, (enter, leave), state, half)
            continue
        cut = (rays.intervals, sheets.begin[sheet], sheets.end[sheet]) if rays.intervals.size else None
        if channels is None:
            sampled, counted, shine = _classify(sheets.kind[sheet], here, there, lookup, cut)
            span = None
        else:
            parts = None if labels is None else label_parts(labels, *slab, channels.own)
            sampled, counted, shine, span = _classify_channels(sheets.kind[sheet], here, there, channels, cut, parts)
        if thinned:
            in_slab = in_slab * shine[..., -1]
        if absorbs is not None:
            _add_depths_numpy(sampled[..., 0] * (in_slab * counted), slab, state, half)
            continue
        color, sigma = sampled[..., :3], sampled[..., 3]
        if light is not None:
            if sheets.kind[sheet] != OWN:
                both = counted == ONE
                span = span or span_shown(here[..., 0], there[..., 0], *lookup[5:7])
                share = share_here(*span, sigma * in_slab)[..., None]
                shine = np.where(both[..., None], here[..., 1:] * share + there[..., 1:] * (ONE - share), shine)
            middle = 0.5 * (sheets.begin[sheet] + sheets.end[sheet])
            shining, highlight = _light_numpy(light, plane, middle, shine)
            color = color * shining + sigma[..., None] * highlight
        depth = in_slab * counted
        classified = np.concatenate((color, sigma[..., None]), axis=-1).astype(numbers, copy=False)
        kept = state.copy() if mist.place.size else None
        composite_numpy(slab_numpy, classified, depth.astype(numbers, copy=False), least, state, slab, half)
        if mist.place.size:
            fade_added_numpy(mist, state, kept, 0.5 * (sheets.begin[sheet] + sheets.end[sheet]))
    pixels[...] = state
    leave_unseen(rays, pixels, half)
    note_filled(pixels, filled)
