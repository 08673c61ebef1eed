"""The scratch memory of the sheet kernels, reused from picture to picture: the loops allocate nothing.

Only one kernel runs at a time (``jit.parallel_call``) and none relies on what the scratch held before, so all pictures
share it; a kernel clears what must be empty.  Only kernels write to it, for another thread's kernel may be using it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import islice
from typing import NamedTuple

import numpy as np

from ..runtime.jit import compiled, thread_count
from ..scene import Quality
from ..shade.sample_light import NORMAL
from ..view.base_plane import BasePlane
from ..view.depth_rules import OWN, Sheets
from ..volume.axes import AXES
from .arguments import wide_of
from .pixel_block import BLOCK, accumulator
from .sample_lamps import HELD
from .scalar_group import GROUP
from .voxel_scanline import WORD

# Rows of scratch from one worker to the next: the shortest rows are some dozen bytes, and two workers that write to
# the same cache line slow each other down (measured: two threads were no faster than one).  What is not touched costs
# no memory.
SPREAD = 4
CACHE_LINE = 64  # bytes; arrays begin at one, and the widest vectors are as long
MOST_KEPT = 1 << 28  # bytes, of which a picture touches what it needs; a larger scratch is that picture's alone
_KEPT: list[np.ndarray] = []
REACH = (CACHE_LINE // 8,)  # numbers of it
WORTH_GROUPING = 0.75  # voxels of depth that a sheet stands for, on average
BAND = 16  # rows that share the scanlines they are splatted from: few enough to stay in cache


class VoxelLine(NamedTuple):
    """One voxel scanline, and the taps by which a sheet's pixels read it.

    Attributes
    ----------
    line : (n,) float32
        Classified voxels: four channels a voxel, all zero between two scanlines.  Scalar voxels: planes of one number
        a voxel, the scalar first, which is ``NOT_KEPT`` between two scanlines.
    reach : (8,) int64
        First voxel touched on the line and the one behind the last; and, of the picture so far, how many scanlines
        were walked and how many voxels were put on a line (the picture's own counts, so the memory is too).
    live : (blocks, 2) int64
        Half-open voxel intervals under pixels that are not yet opaque.
    cells : (BLOCK * blocks,) int32
        First voxel that each sheet pixel reads.
    weights : (BLOCK * blocks * taps,) float32
        Weights of the voxels that it reads; of two voxels, the fraction towards the second alone.
    placed : (blocks,) int64
        Number of the sheet that the taps of a block of pixels were placed for.
    """

    line: np.ndarray
    reach: np.ndarray
    live: np.ndarray
    cells: np.ndarray
    weights: np.ndarray
    placed: np.ndarray


class Scanlines(NamedTuple):
    """The voxel scanlines of a sheet that a band reads, resampled along the scanline, each in a slot.

    Attributes
    ----------
    samples : (n,) float32
        Planar blocks of BLOCK pixels, slot by slot; at the end a block that stays transparent and one more to mix in.
    marks : (slots, words) uint64
        A bit for each block of a slot that is not empty.
    row_slot : (BAND,) int64
        Slot of the first scanline that a row of the band reads; ``NO_ROW`` where it reads none.
    row_line : (BAND,) int64
        Number of that scanline.
    row_position : (BAND,) float64
        Position of the row among the scanlines, in voxels.

    Where sheets are handled in groups of GROUP, each array has room for as many, one after the other.
    """

    samples: np.ndarray
    marks: np.ndarray
    row_slot: np.ndarray
    row_line: np.ndarray
    row_position: np.ndarray


class Rows(NamedTuple):
    """The rows of the intermediate image that a band consists of, in blocks of BLOCK pixels.

    Attributes
    ----------
    state : (4 * BLOCK * blocks * BAND,) float32 or float64
        Planar blocks of premultiplied color and transmittance, in numbers of ``accumulator``.
    length : (BLOCK * blocks * BAND,) float32
        World length of each pixel's ray per voxel of depth.
    alive : (BAND + 1, words) uint64
        A bit for each block that is not opaque; the last row is for the band as a whole.
    bright : (BAND, blocks) int32
        How many pixels of a block have at least half of their transmittance left.
    bounds : (BAND + 1, 6, blocks) float32
        Where the rays of a block begin and end (``interval_blocks``); empty where rays are whole.
    reached : (words,) uint64
        The blocks that have a ray inside its interval in the sheet at hand; empty where rays are whole.
    light : (planes * BLOCK * blocks * BAND,) float32
        Where samples are lit by themselves: the weight of each pixel's samples since its light was last evaluated, and
        that light and highlight; else empty.
    """

    state: np.ndarray
    length: np.ndarray
    alive: np.ndarray
    bright: np.ndarray
    bounds: np.ndarray
    reached: np.ndarray
    light: np.ndarray


class BlockScratch(NamedTuple):
    """What is known of one block of pixels while a slab is composited over it.

    Attributes
    ----------
    samples : (4 * BLOCK,) float32
        Samples of a sheet: extinction times color, and extinction.
    entries : (BLOCK,) int32
    spans : (2 * BLOCK,) int32
    shares : (5 * BLOCK,) float32
        What ``scalar_block.look_between`` writes; of several channels, what ``channel_block`` adds.
    length_inside : (BLOCK,) float32
        World lengths of the rays inside their intervals, per voxel of depth.
    before : (BLOCK * (group + 1),) float32 or float64
        Transmittance ahead of the slab; of a group, ahead of each slab and behind the last.
    colors : (3 * BLOCK,) float32 or float64
        Colors ahead of the slab.
    classified : (4 * BLOCK * group,) float32
        Samples of each sheet of a group, classified and lit.
    mixed : (8 * BLOCK,) float32
        Sums over channels (``channel_block``).
    numbers : (2 * BLOCK,) int32
        Functions of labels at both ends of the slab (``label_block``).
    parts : (BLOCK,) float32
        What of the slab the first of them has.
    looks : (7 * BLOCK,) float32
    table_rows : (2 * BLOCK,) int32
        How each pixel looks its function up (``scalar_block.look_between_each``).
    """

    samples: np.ndarray
    entries: np.ndarray
    spans: np.ndarray
    shares: np.ndarray
    length_inside: np.ndarray
    before: np.ndarray
    colors: np.ndarray
    classified: np.ndarray
    mixed: np.ndarray
    numbers: np.ndarray
    parts: np.ndarray
    looks: np.ndarray
    table_rows: np.ndarray


class WaitingBlocks(NamedTuple):
    """Blocks that were classified in all sheets of a group and are not composited yet (``waiting_blocks``).

    Attributes
    ----------
    queue : (WORD,) int64
        Numbers of the blocks.
    places : (2 * GROUP * WORD,) int64
        Where the samples of each block are, of both scanlines of each sheet.
    starts : (BLOCK * GROUP * WORD,) int32
        Where their entries of the lookup table begin, in bytes.
    downs : (GROUP,) float32
        Fraction of the row towards the second scanline, of each sheet.
    depths : (GROUP,) float32
        Thickness of each sheet, in voxels of depth.
    """

    queue: np.ndarray
    places: np.ndarray
    starts: np.ndarray
    downs: np.ndarray
    depths: np.ndarray


class Scratch(NamedTuple):
    """What each worker writes while it walks through the sheets.

    Each array has the worker times SPREAD as its first axis; ``band_walker`` takes the worker's own row of each, whose
    shape is the one that the groups describe.  ``sheet_before`` is the sheet before, which only sheets of the scalar
    keep.
    """

    line: VoxelLine
    sheet: Scanlines
    sheet_before: Scanlines
    rows: Rows
    block: BlockScratch
    waiting: WaitingBlocks


_GROUPS = (VoxelLine, Scanlines, Scanlines, Rows, BlockScratch, WaitingBlocks)  # of Scratch, in order


@lru_cache(maxsize=16)
def worth_grouping(sheets: Sheets) -> bool:
    """Whether sheets of the scalar are handled in groups.

    They are where there are several per voxel and each has a slab of its own.  The few sheets of a quick picture do
    not pay for compiling another kernel.  Kept, since most frames have the previous sheets.
    """
    return len(sheets.kind) > 0 and bool((sheets.kind == OWN).all()) and bool(sheets.thickness.mean() < WORTH_GROUPING)


def scratch_for(
    workers: int, tables, sheets, rays, wide, channels: int = 4, before: bool = False, group: int = 1,
    light: int = 0,
) -> Scratch:  # fmt: skip
    """Scratch for ``workers`` workers and so many ``channels`` of a voxel; see ``arguments`` for the rest.

    ``before``: whether the sheet before is kept as well.  ``group``: how many sheets are handled together.  ``light``:
    planes of ``Rows.light``.
    """
    # Where the sheet is coarsest, a footprint covers most voxels, and a band most scanlines.
    sizes = _sizes(
        tables.width, rays.along.size, _coarsest(sheets.scale), len(sheets.begin), wide, channels, before,
        rays.intervals.size > 0, group, light,
    )  # fmt: skip
    rows = workers * SPREAD
    layout, size = _layout(rows, sizes)
    memory = _memory(size)
    shared = (np.ndarray(shape, kind, memory, at) for shape, kind, at in layout)
    scratch = Scratch(*(group(*islice(shared, len(group._fields))) for group in _GROUPS))
    return scratch._replace(line=scratch.line._replace(reach=np.zeros((rows, *REACH), np.int64)))


def scratch_bytes(plane: BasePlane, shape_xyz, quality: Quality, scalars: bool, shortened: bool) -> int:
    """About the bytes of ``scratch_for`` that are touched, before there are tables; the reference has no scratch.

    Sheets of the scalar are taken to be lit, by a lamp that casts shadows.  ``scalars``: whether there are such.
    ``shortened``: whether rays have intervals.
    """
    if not compiled():
        return 0
    group = GROUP if scalars and not shortened and worth_grouping(plane.sheets) else 1
    sizes = _sizes(
        shape_xyz[AXES[plane.axis][0]], plane.width, _coarsest(plane.scale), len(plane.sheets),
        None if scalars else wide_of(plane, quality), 2 + NORMAL if scalars else 4, scalars, shortened, group,
        HELD if scalars else 0,
    )  # fmt: skip
    return thread_count(quality.threads) * _bytes_of(*sizes)


def _sizes(
    width: int, image_width: int, coarsest, sheets: int, wide, channels: int, before: bool, shortened: bool, group: int,
    light: int = 0,
) -> tuple:  # fmt: skip
    """What ``_shapes`` is made of.

    ``width``: voxels on a scanline.  ``image_width``: sheet pixels on a row.  ``coarsest`` (2,): sheet pixels a voxel
    along and across scanlines, of the sheet with least.
    """
    blocks = -(-image_width // BLOCK)
    stretch = [max(1.0, 1.0 / scale) if wide is not None and wide.widen else 1.0 for scale in coarsest]
    taps, lines = (max(math.ceil(2.0 * (1.0 if wide is None else wide.radius) * s), 1) for s in stretch)
    slots = min(math.ceil(BAND / coarsest[1]) + lines + 2, BAND * lines)
    return width + 2 * taps + 3, blocks, slots, taps, accumulator(sheets), channels, before, shortened, group, light


def _coarsest(scale: np.ndarray) -> list[float]:
    """Two: the least sheet pixels a voxel along and across scanlines, of sheets in order of depth: scales (n, 2)."""
    return list(map(min, scale[0].tolist(), scale[-1].tolist()))  # monotone in depth, so the ends decide


@lru_cache
def _bytes_of(*sizes) -> int:
    """Bytes of a Scratch for one worker; see ``_sizes``."""
    return sum(math.prod(shape) * np.dtype(kind).itemsize for *shape, kind in _shapes(*sizes).values())


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
    line: int, blocks: int, slots: int, taps: int, numbers, channels: int, before: bool, shortened: bool, group: int,
    light: int,
) -> dict:  # fmt: skip
    """Name -> shape and type of each array of a Scratch for one worker, in the order of its groups; see ``_sizes``."""
    words = -(-blocks // WORD)

    def scanlines(name: str, present: bool) -> dict:
        return {
            f"{name}.samples": (channels * BLOCK * (blocks * slots * group + 2) * present, np.float32),
            f"{name}.marks": (slots * group * present, words, np.uint64),
            f"{name}.row_slot": (BAND * group * present, np.int64),
            f"{name}.row_line": (BAND * group * present, np.int64),
            f"{name}.row_position": (BAND * group * present, np.float64),
        }

    return {
        "line": (channels * _whole(line, BLOCK), np.float32),
        "reach": (*REACH, np.int64), "live": (blocks, 2, np.int64),
        "cells": (BLOCK * blocks, np.int32), "weights": (BLOCK * blocks * taps, np.float32),
        "placed": (blocks, np.int64),
        **scanlines("sheet", True), **scanlines("sheet_before", before),
        "state": (4 * BLOCK * blocks * BAND, numbers), "length": (BLOCK * blocks * BAND, np.float32),
        "alive": (BAND + 1, words, np.uint64), "bright": (BAND, blocks, np.int32),
        "bounds": (BAND + 1, 6, blocks * shortened, np.float32), "reached": (words * shortened, np.uint64),
        "light": (light * BLOCK * blocks * BAND, np.float32),
        "samples": (4 * BLOCK, np.float32),
        "entries": (BLOCK, np.int32), "spans": (2 * BLOCK, np.int32), "shares": (5 * BLOCK, np.float32),
        "length_inside": (BLOCK, np.float32), "before": (BLOCK * (group + 1), numbers), "colors": (3 * BLOCK, numbers),
        "classified": (4 * BLOCK * group, np.float32), "mixed": (8 * BLOCK, np.float32),
        "numbers": (2 * BLOCK, np.int32), "parts": (BLOCK, np.float32),
        "looks": (7 * BLOCK, np.float32), "table_rows": (2 * BLOCK, np.int32),
        "queue": (WORD, np.int64), "places": (2 * group * WORD, np.int64),
        "starts": (BLOCK * group * WORD, np.int32), "downs": (group, np.float32), "depths": (group, np.float32),
    }  # fmt: skip


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
