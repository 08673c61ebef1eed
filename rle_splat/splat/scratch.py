"""The scratch memory of the sheet-buffer loop, kept between pictures: nothing is allocated inside the loops.

It holds nothing between two calls of a kernel, of which only one runs at a time (``jit.parallel_call``), so all
pictures share it; a kernel clears what it relies on.  Nobody else writes to it: another thread's kernel may be using
it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..runtime.jit import compiled, thread_count
from ..scene import Quality
from ..view.base_plane import BasePlane
from ..view.depth_rules import OWN
from ..volume.axes import AXES
from .arguments import wide_of
from .pixel_block import BLOCK, accumulator
from .scalar_group import GROUP
from .voxel_scanline import WORD

# Rows of scratch from one worker to the next: the shortest rows are some dozen bytes, and two workers that write to
# the same cache line slow each other down (measured: two threads were no faster than one).  What is not touched costs
# no memory.
SPREAD = 4
CACHE_LINE = 64  # bytes; arrays begin at one, and the widest vectors are as long
MOST_KEPT = 1 << 28  # bytes, of which a picture touches what it needs; a larger scratch is that picture's alone
_KEPT: list[np.ndarray] = []
WHITE = 2  # channels of a voxel's light and highlight, all colours alike
REACH = (CACHE_LINE // 8,)  # numbers of it
WORTH_GROUPING = 0.75  # voxels of depth that a sheet stands for, on average
BAND = 16  # rows that share the scanlines they are splatted from: few enough to stay in cache


class Scratch(NamedTuple):
    """What each worker writes on while it walks through the sheets: arrays with the worker (times SPREAD) as
    their first axis, flat behind it unless a shape is given.

    ``line``: one voxel scanline, float32, four channels a voxel; all zero between two scanlines.  (Of sheets of the
    scalar: planes of one number a voxel.)  ``sheet``: scanlines of the sheet in blocks of pixels, one ``slot`` each,
    and at the end a block that stays transparent and one to mix others in.  ``marks`` (slots, words): a bit for each of
    their blocks that is not empty.
    ``row_slot``: (BAND,) slot of the first scanline that a row is splatted from, ``row_line`` that scanline's number,
    and ``row_place`` float64 the row's own position among scanlines.
    ``reach``: first and last shifted voxel touched, and, of the picture so far, how many scanlines were walked and
    voxels put on a line, which is why it is the picture's own; ``live`` (n, 2) voxel intervals under pixels not yet
    opaque.
    Rows in blocks of pixels: ``state`` colour and transmittance, in numbers of ``accumulator``, ``length`` of rays,
    ``alive`` (BAND + 1, words) a bit for each block that is not opaque, the last row for the band as a whole,
    ``bright`` (BAND, blocks) pixels above one half.
    Taps of the sheet's pixels: ``cells`` and ``weights`` (the tent: fractions only), and the sheet they were
    ``placed`` for, per block.
    Sheets of the scalar keep the sheet before, too: ``sheet_before``, ``marks_before``, ``slot_before``,
    ``line_before`` and ``place_before``.
    Where rays have limits: ``bounds`` (BAND + 1, 6, blocks) of ``limited_blocks``, and the blocks that are ``reached``
    by a sheet, bits as of ``alive``.
    Where sheets of the scalar are handled in groups of GROUP, ``sheet``, ``marks`` and the three of rows have room for
    as many, one after the other; ``before`` for a group and one more; and, of the blocks that wait
    (``waiting_blocks``), at most WORD: their number in ``queue``, ``places``, and ``starts`` of their entries; and
    ``downs`` and ``depths`` of a group's sheets.
    One block: ``samples``; ``entries``, ``spans`` and ``shares`` of ``scalar_block``; ``length_inside`` the limits;
    ``before`` the sheet in numbers of ``state``, and so ``colors``, of a block ahead of it.
    """

    line: np.ndarray
    sheet: np.ndarray
    marks: np.ndarray
    row_slot: np.ndarray
    row_line: np.ndarray
    row_place: np.ndarray
    reach: np.ndarray
    live: np.ndarray
    state: np.ndarray
    length: np.ndarray
    alive: np.ndarray
    bright: np.ndarray
    cells: np.ndarray
    weights: np.ndarray
    placed: np.ndarray
    samples: np.ndarray
    entries: np.ndarray
    spans: np.ndarray
    shares: np.ndarray
    sheet_before: np.ndarray
    marks_before: np.ndarray
    slot_before: np.ndarray
    line_before: np.ndarray
    place_before: np.ndarray
    length_inside: np.ndarray
    before: np.ndarray
    colors: np.ndarray
    bounds: np.ndarray
    reached: np.ndarray
    queue: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    downs: np.ndarray
    depths: np.ndarray


def worth_grouping(sheets) -> bool:
    """Whether sheets of the scalar, ``kind`` and ``thickness`` of each as ``view.depth_rules`` has them, are worth
    handling in groups: several a voxel, each with a slab of its own.  What few there are in a quick picture is not
    worth another kernel."""
    return len(sheets.kind) > 0 and sheets.thickness.mean() < WORTH_GROUPING and bool((sheets.kind == OWN).all())


def scratch_for(
    workers: int, tables, sheets, rays, wide, channels: int = 4, before: bool = False, group: int = 1
) -> Scratch:
    """Scratch for ``workers`` workers and so many ``channels`` of a voxel; see ``arguments`` for the rest.

    ``before``: whether the sheet before is kept as well.  ``group``: how many sheets are handled together.
    """
    # Where the sheet is coarsest, a footprint covers most voxels, and a band most scanlines.
    sizes = _sizes(
        tables.width, rays.along.size, sheets.scale.min(axis=0), len(sheets.begin), wide, channels, before,
        rays.limits is not None, group,
    )
    rows = workers * SPREAD
    layout, size = _layout(rows, sizes)
    memory = _memory(size)
    shared = (np.ndarray(shape, kind, memory, at) for shape, kind, at in layout)
    return Scratch(*shared)._replace(reach=np.zeros((rows, *REACH), np.int64))


def scratch_bytes(plane: BasePlane, shape_xyz, quality: Quality, limited: bool) -> int:
    """About the bytes of ``scratch_for`` that are touched, known before there are tables: of white light, which mostly
    it is.  ``limited``: whether rays have limits.  The numpy twin has no scratch."""
    if not compiled(quality.backend):
        return 0
    scalars = quality.classification == "post"
    group = GROUP if scalars and not limited and worth_grouping(plane.sheets) else 1
    sizes = _sizes(
        shape_xyz[AXES[plane.axis][0]], plane.width, plane.scale.min(axis=0), len(plane.sheets),
        None if scalars else wide_of(plane, quality), 1 + WHITE if scalars else 4, scalars, limited, group,
    )
    each = sum(math.prod(shape) * np.dtype(kind).itemsize for *shape, kind in _shapes(*sizes).values())
    return thread_count(quality.threads) * each


def _sizes(
    width: int, image_width: int, coarsest, sheets: int, wide, channels: int, before: bool, limited: bool, group: int
) -> tuple:
    """What ``_shapes`` is made of.

    ``width``: voxels on a scanline.  ``image_width``: sheet pixels on a row.  ``coarsest`` (2,): sheet pixels a voxel
    along and across scanlines, of the sheet with least.
    """
    blocks = -(-image_width // BLOCK)
    stretch = np.maximum(1.0, 1.0 / coarsest) if wide is not None and wide.widen else np.ones(2)
    taps, lines = (max(math.ceil(2.0 * (1.0 if wide is None else wide.radius) * s), 1) for s in stretch)
    slots = min(math.ceil(BAND / coarsest[1]) + lines + 2, BAND * lines)
    return width + 2 * taps + 3, blocks, slots, taps, accumulator(sheets), channels, before, limited, group


@lru_cache
def _layout(rows: int, sizes: tuple) -> tuple[list, int]:
    """Shape, type and place, counted in bytes, of each array of a Scratch of so many rows; and the bytes of all.

    Kept, like ``_shapes``: they take longer to reckon than the arrays to make, and a moving picture asks for few.
    """
    layout, size = [], 0
    for *shape, kind in _shapes(*sizes).values():
        layout.append(((rows, *shape), kind, size))
        size += _whole(rows * math.prod(shape) * np.dtype(kind).itemsize, CACHE_LINE)
    return layout, size


@lru_cache
def _shapes(
    line: int, blocks: int, slots: int, taps: int, numbers, channels: int, before: bool, limited: bool, group: int
) -> dict:
    """Name -> the shape of each array of a Scratch for one worker, and its type; see ``_sizes``."""
    words = -(-blocks // WORD)
    return {
        "line": (channels * _whole(line, BLOCK), np.float32),
        "sheet": (channels * BLOCK * (blocks * slots * group + 2), np.float32),
        "marks": (slots * group, words, np.uint64),
        "row_slot": (BAND * group, np.int64), "row_line": (BAND * group, np.int64),
        "row_place": (BAND * group, np.float64),
        "reach": (*REACH, np.int64), "live": (blocks, 2, np.int64),
        "state": (4 * BLOCK * blocks * BAND, numbers), "length": (BLOCK * blocks * BAND, np.float32),
        "alive": (BAND + 1, words, np.uint64), "bright": (BAND, blocks, np.int32),
        "cells": (BLOCK * blocks, np.int32), "weights": (BLOCK * blocks * taps, np.float32),
        "placed": (blocks, np.int64), "samples": (4 * BLOCK, np.float32),
        "entries": (BLOCK, np.int32), "spans": (2 * BLOCK, np.int32), "shares": (3 * BLOCK, np.float32),
        "sheet_before": (channels * BLOCK * (blocks * slots * group + 2) * before, np.float32),
        "marks_before": (slots * group * before, words, np.uint64), "slot_before": (BAND * group * before, np.int64),
        "line_before": (BAND * group * before, np.int64), "place_before": (BAND * group * before, np.float64),
        "length_inside": (BLOCK, np.float32), "before": (BLOCK * (group + 1), numbers), "colors": (3 * BLOCK, numbers),
        "bounds": (BAND + 1, 6, blocks * limited, np.float32), "reached": (words * limited, np.uint64),
        "queue": (WORD, np.int64), "places": (2 * group * WORD, np.int64),
        "starts": (BLOCK * group * WORD, np.int32), "downs": (group, np.float32), "depths": (group, np.float32),
    }


def _whole(count: int, unit: int) -> int:
    """``count`` rounded up to whole units."""
    return -(-count // unit) * unit


def _memory(size: int) -> np.ndarray:
    """At least ``size`` bytes, from the beginning of a cache line on: what was there before, or more."""
    held = _KEPT[-1] if _KEPT else np.empty(0, np.uint8)
    if held.size >= size:
        return held
    memory = np.empty(size + CACHE_LINE, np.uint8)
    memory = memory[-memory.ctypes.data % CACHE_LINE :]
    if size <= MOST_KEPT:
        _KEPT[:] = [memory]
    return memory
