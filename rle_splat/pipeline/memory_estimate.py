"""Estimate the memory of a picture or a file of tables before it is taken (algorithm.md 1.11).

The voxels that a transfer function shows are counted first, which takes no memory for each of them; everything else
follows from the count and from what each stage says of itself, in its module ``sizes``.  No kernels are loaded here:
what only looks at a file does not wait for a compiler.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..classify.sizes import PROPERTY_BYTES, mark_bytes, row_bytes, voxel_bytes
from ..effects.sizes import MESH_LAYERS, MESH_PIXEL
from ..encode.sizes import SCANLINE, run_bytes, scalar_record, scanlines, work_bytes
from ..raycast.sizes import AT_ONCE, RAY, STEEP_PIXEL
from ..runtime.memory import available_bytes, bytes_text
from ..scene import RECORDS, Quality, RleSplatError, TooLargeError
from ..shade.sizes import LIGHT, NORMAL, NORMAL_CODE, shadow_bytes
from ..splat.sizes import SHEET_PIXEL
from ..view.sizes import INTERVALS
from ..volume.axes import AXES
from ..volume.counts import counts_values
from ..warp.sizes import PICTURE_PIXEL, WRITTEN, filter_bytes

SPARE = 0.9  # of what is free may be asked for: the system and Python want some too


@dataclass(frozen=True)
class MemoryEstimate:
    """Bytes, by what they are for.

    ``volume``: the voxels themselves, already in memory or mapped from their file.  ``visible``: which voxels are
    shown, and their optical properties.  ``normals``: for shading.  ``runs`` and ``records``: the tables of ``axes``
    principal axes.  ``work``: while records are made.  ``picture``: sheets and finished pixels.  ``record``: bytes of a
    voxel record, 0 where scalars are kept, of which no voxel has less.

    However few voxels are shown, ``rows`` of the visible ones and their normals stays, and ``scanlines`` of each axis'
    runs.  ``alone``: the runs of a voxel without neighbors along its scanline, which is the most there are.
    """

    visible_voxels: int
    voxels: int
    volume: int
    visible: int
    normals: int
    runs: int
    records: int
    work: int
    picture: int
    axes: int
    record: int
    rows: int
    scanlines: int
    alone: int

    @property
    def needed(self) -> int:
        """Bytes that are still to be taken; the work is done when the picture is begun."""
        return self.visible + self.normals + self.runs + self.records + max(self.work, self.picture)

    @property
    def visible_fraction(self) -> float:
        return self.visible_voxels / self.voxels

    def report(self) -> dict:
        """JSON-ready."""
        named = vars(self)
        return {**{name: named[name] for name in _PARTS}, "volume": self.volume, "needed": self.needed}

    def with_axes(self, axes: int) -> MemoryEstimate:
        """The same for another number of principal axes."""
        return replace(
            self, axes=axes, runs=self.runs // self.axes * axes, records=self.records // self.axes * axes
        )

    def with_shadows(self, count: int) -> MemoryEstimate:
        """The same with what ``count`` lights leave to each voxel, the ambient light among them."""
        return replace(self, normals=self.normals + shadow_bytes(count, self.visible_voxels)) if count else self

    def with_visible(self, more: int) -> MemoryEstimate:
        """The same with ``more`` bytes beside the visible voxels, however many these are."""
        return replace(self, visible=self.visible + more, rows=self.rows + more)

    def with_work(self, work: int) -> MemoryEstimate:
        """The same where something before the records takes ``work`` bytes meanwhile."""
        return replace(self, work=max(self.work, work))

    def three_axes(self) -> MemoryEstimate:
        """The same with every principal axis held."""
        return self.with_axes(len(AXES))

    def one_axis(self) -> MemoryEstimate:
        """What is still to be taken for one more principal axis, or for the same one under another light."""
        return replace(self.with_axes(1), visible=0, normals=0, picture=0)

    def with_record(self, record: int) -> MemoryEstimate:
        """The same for records of another size, where there are any."""
        if not self.record:
            return self
        return replace(
            self, record=record, records=self.axes * self.visible_voxels * record,
            work=work_bytes(self.visible_voxels, record),
        )

    def most_voxels(self, free: float) -> int:
        """How many visible voxels fit into ``free`` bytes, wherever they are; below 0 where not even none do."""
        each = (self.visible + self.normals - self.rows + self.records) / max(self.visible_voxels, 1)
        each += self.axes * self.alone
        left = free - self.rows - self.axes * self.scanlines
        working = (left - self.work) / each, left / (each + work_bytes(1, self.record) * (self.work > 0))
        return math.floor(min((left - self.picture) / each, max(working)))


_PARTS = ("visible", "normals", "runs", "records", "work", "picture")


class Found(NamedTuple):
    """The voxels that tables hold, by their number alone.

    Attributes
    ----------
    shape_xyz : (nx, ny, nz)
    dtype : dtype
        Of its voxels.
    count, pieces, lines : int
        Voxels, connected pieces of rows, and rows with any.
    held : int
        Bytes of the volume itself.
    """

    shape_xyz: tuple[int, int, int]
    dtype: np.dtype
    count: int
    pieces: int
    lines: int
    held: int

    @classmethod
    def in_rows(cls, volume, counted, dtype=None) -> Found:
        """From ``counted``: voxels and connected pieces per row, (nz * ny,) each; ``dtype``: other than the voxels'."""
        counts, pieces = counted
        return cls(
            volume.shape_xyz, np.dtype(dtype or volume.voxels.dtype), int(counts.sum()), int(pieces.sum()),
            int(np.count_nonzero(counts)), volume.voxels.nbytes,
        )  # fmt: skip


def estimate_of(
    volume, counted, quality: Quality, *, axes: int = 1, shaded: bool = True, picture: int = 0, dtype=None
) -> MemoryEstimate:
    """What tables of classified voxels take.

    Parameters
    ----------
    volume : Volume
    counted : (counts, pieces)
        Visible voxels and connected pieces per row, (nz * ny,) each.
    quality : Quality
    axes : int
        How many principal axes are held, mostly one.
    shaded : bool
        Whether something shines.
    picture : int
        See ``picture_bytes``.
    dtype : dtype, optional
        As if the voxels were of that type.

    Returns
    -------
    MemoryEstimate
    """
    return estimate_classified(Found.in_rows(volume, counted, dtype), quality.record, axes, shaded, picture)


@lru_cache(maxsize=16)
def estimate_scalars(
    found: Found, axes: int, lit: bool, picture: int, *, by_normal: bool = False
) -> MemoryEstimate:  # fmt: skip
    """As ``estimate_of``, for tables of scalars: ``found`` are the voxels that matter to post-classified sheets.

    ``by_normal``: whether light is made of coded normals where it is read, and no light of voxels is kept.
    Kept, since most frames have the previous one's.
    """
    needs = estimate_classified(found, RECORDS[-1], axes, lit, picture)
    dtype, count = found.dtype, found.count
    properties = 0 if counts_values(dtype) else PROPERTY_BYTES * count  # the lookup table stands for them
    light, marks = LIGHT * lit, mark_bytes(found.shape_xyz)
    visible = needs.visible - properties + marks + (0 if by_normal else light * count)
    records = axes * scalar_record(dtype.itemsize, NORMAL_CODE if by_normal else light) * count
    work = NORMAL_CODE * count if by_normal else 0  # while codes are put in the order of scanlines
    return replace(needs, visible=visible, records=records, record=0, work=work, rows=needs.rows + marks)


def estimate_classified(found: Found, record: int, axes: int, shaded: bool, picture: int) -> MemoryEstimate:
    """As ``estimate_of``, from a Found and the bytes of a voxel record."""
    shape, dtype, count = found.shape_xyz, found.dtype, found.count
    rows = row_bytes(shape)
    visible = count * voxel_bytes(shape, dtype.itemsize) + rows
    if not counts_values(dtype):
        visible += PROPERTY_BYTES * count
    # Runs along x stand for those along the other axes too: two for each connected piece, and a trailing one.
    run = run_bytes(shape)
    runs, most_scanlines = (2 * found.pieces + found.lines) * run, scanlines(shape)
    return MemoryEstimate(
        visible_voxels=count, voxels=math.prod(shape), volume=found.held, visible=visible,
        normals=NORMAL * count if shaded else 0, runs=axes * (runs + SCANLINE * most_scanlines),
        records=axes * record * count, work=work_bytes(count, record), picture=picture, axes=axes, record=record,
        rows=rows, scanlines=(SCANLINE + run) * most_scanlines, alone=2 * run,
    )


def picture_bytes(
    planes, width: int, height: int, quality: Quality, *, shortened: bool = False, meshes: bool = False,
    scratch: int = 0, traced: bool = False,
) -> int:
    """What the sheets and the finished pixels of a picture take.

    ``planes``: its base planes, each with a width and a height.  ``shortened``: whether clip distances or meshes
    shorten rays.  ``meshes``: whether there are any; behind their silhouettes all may be splatted twice.
    ``scratch``: of the splat, which is kept.  ``traced``: whether steep pixels have rays of their own.
    """
    pixels = width * height
    sheets = [plane.width * plane.height for plane in planes]
    largest = max(sheets, default=0)
    splatting = (1 + meshes) * SHEET_PIXEL * sum(sheets) + MESH_LAYERS * meshes * pixels
    splatting += (filter_bytes(quality.warp_filter) + INTERVALS * shortened) * largest
    tracing = (STEEP_PIXEL * pixels + AT_ONCE * RAY) * traced
    after = PICTURE_PIXEL * pixels + max(splatting, WRITTEN * pixels, tracing)
    return scratch + max(MESH_PIXEL * meshes * pixels, after)


def refuse_too_large(picture: int, width: int, height: int) -> None:
    """RleSplatError when the pixels of a picture alone, ``picture`` bytes, are more than there is memory for."""
    free = SPARE * available_bytes()
    if picture <= free:
        return
    fits = (free / picture) ** 0.5
    raise RleSplatError(
        f"A picture of {width} x {height} pixels needs about {bytes_text(picture)} of memory and {bytes_text(free)} "
        f"are free; {max(int(width * fits), 1)} x {max(int(height * fits), 1)} pixels would fit."
    )


def refuse_too_much(wanted: MemoryEstimate) -> None:
    """TooLargeError, with what would fit, when more memory is wanted than there is."""
    free = SPARE * available_bytes()
    if wanted.needed <= free:
        return
    which = "that the transfer function shows" if wanted.record else "that are shown, and their neighbors,"
    raise TooLargeError(
        f"The {wanted.visible_voxels} voxels {which} need about {bytes_text(wanted.needed)} of memory and "
        f"{bytes_text(free)} are free; {_what_fits(wanted, free)}."
    )


def _what_fits(wanted: MemoryEstimate, free: float) -> str:
    """The least sacrifice that brings a job within ``free`` bytes, in words."""
    short = [record for record in RECORDS if record < wanted.record]
    for record in short:
        if wanted.with_record(record).needed <= free:
            return f"voxel records of {record} bytes would fit"
    one_by_one = () if wanted.picture else range(wanted.axes - 1, 0, -1)  # a picture needs all of its axes
    for axes in one_by_one:
        for record in (wanted.record, *short):
            if wanted.with_axes(axes).with_record(record).needed <= free:
                named = f" with voxel records of {record} bytes" if record != wanted.record else ""
                return f"{'one principal axis' if axes == 1 else 'two principal axes'} at a time{named} would fit"
    least = (wanted if wanted.picture else wanted.with_axes(1)).with_record(RECORDS[-1])
    parts = [f"voxel records of {RECORDS[-1]} bytes"] if short else []
    parts += ["one principal axis at a time"] if least.axes < wanted.axes else []
    if least.needed > free:
        share = min(100.0 * least.most_voxels(free) / least.voxels, 99.0)
        if share < 0.05:
            return "crop or downsample the volume, or free some memory"
        counted = "" if wanted.record else ", their neighbors counted"
        narrower = f"one that shows at most {_two_figures_down(share)} % of the voxels{counted},"
        parts.append(f"a narrower transfer function, {narrower}")
    *first, last = parts
    return f"{', '.join(first)}{' and ' if first else ''}{last} would fit"


def _two_figures_down(number: float) -> str:
    """A number above 0 in two figures, never more than it is."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return f"{math.floor(number / unit) * unit:.2g}"
