"""Estimate the memory of a picture or a file of tables before it is taken (algorithm.md 1.11).

The voxels that a transfer function shows are counted first, which takes no memory for each of them; everything else
follows from the count and from what each stage says of itself, in its module ``sizes``.  No kernels are loaded here:
what only looks at a file does not wait for a compiler.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np

from ..classify.sizes import (
    PROPERTY_BYTES,
    TYPICAL_NEAR,
    TYPICAL_PIECE,
    fine_block_bytes,
    fine_work_bytes,
    mark_bytes,
    row_bytes,
    voxel_bytes,
)
from ..effects.sizes import MESH_LAYERS, MESH_PIXEL
from ..encode.sizes import SCANLINE, run_bytes, scalar_record, scanlines, work_bytes
from ..raycast.sizes import AT_ONCE, RAY, STEEP_PIXEL
from ..runtime.memory import available_bytes, bytes_text
from ..scene import RECORDS, Quality, RleSplatError
from ..shade.sizes import LIGHT, LIT, NORMAL, lit_voxels, shadow_bytes
from ..splat.sizes import SHEET_PIXEL
from ..view.sizes import INTERVALS
from ..volume.axes import AXES
from ..volume.counts import counts_values, stored_values
from ..warp.sizes import PICTURE_PIXEL, WRITTEN, filter_bytes

SAMPLED_PLANES = 32
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
    refinement: int = 1

    @property
    def needed(self) -> int:
        """Bytes that are still to be taken; the work is done when the picture is begun."""
        return self.visible + self.normals + self.runs + self.records + max(self.work, self.picture)

    @property
    def visible_fraction(self) -> float:
        return self.visible_voxels / self.voxels

    def report(self) -> dict:
        """JSON-ready."""
        named = asdict(self)
        return {**{name: named[name] for name in _PARTS}, "volume": self.volume, "needed": self.needed}

    def with_axes(self, axes: int) -> MemoryEstimate:
        """The same for another number of principal axes."""
        return replace(
            self, axes=axes, runs=self.runs // self.axes * axes, records=self.records // self.axes * axes
        )

    def with_shadows(self, count: int) -> MemoryEstimate:
        """The same with what ``count`` lights leave to each voxel, the ambient light among them."""
        return replace(self, normals=self.normals + shadow_bytes(count, self.visible_voxels))

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

    def with_refinement(self, refinement: int) -> MemoryEstimate:
        """At most the same on another finer grid, 1 for that of the scan: thin shells shrink least, as the square."""
        share = (refinement / self.refinement) ** 2
        parts = {
            name: round(share * getattr(self, name))
            for name in (*_PARTS[:5], "visible_voxels", "rows", "scanlines")
        }
        return replace(self, refinement=refinement, voxels=round(share**1.5 * self.voxels), **parts)

    def most_voxels(self, free: float) -> int:
        """How many visible voxels fit into ``free`` bytes on the scan's own grid, wherever they are; below 0 where
        not even none do."""
        each = (self.visible + self.normals - self.rows + self.records) / max(self.visible_voxels, 1)
        each += self.axes * self.alone
        left = free - self.rows - self.axes * self.scanlines
        working = (left - self.work) / each, left / (each + work_bytes(1, self.record) * (self.work > 0))
        return math.floor(min((left - self.picture) / each, max(working)))


_PARTS = ("visible", "normals", "runs", "records", "work", "picture")


def estimate(
    volume, tf, quality: Quality | None = None, *, axes: int = 1, shaded: bool | None = None, picture: int = 0
) -> MemoryEstimate:
    """What tables of ``volume`` under ``tf`` take, of classified voxels where no ``quality`` is given, quickly: counted
    for 8- and 16-bit volumes, else, and for the number of runs, from a few planes.

    ``axes``: how many principal axes are held, mostly one.  ``shaded``: whether something shines; left out, as the
    transfer function has it.  ``picture``: see ``picture_bytes``.
    """
    quality = quality or Quality(classification="pre")
    planes = volume.voxels[:: max(len(volume.voxels) // SAMPLED_PLANES, 1)]
    count = pieces = lines = 0
    for plane in planes:
        seen = tf.alpha_at(volume.physical(plane)) > 0.0
        count += int(seen.sum())
        pieces += int((seen[:, 1:] & ~seen[:, :-1]).sum() + seen[:, 0].sum())
        lines += int(seen.any(axis=1).sum())
    share = len(volume.voxels) / len(planes)
    count, pieces, lines = round(share * count), round(share * pieces), round(share * lines)
    if counts_values(volume.voxels.dtype):
        values = volume.physical(stored_values(volume.voxels.dtype))
        count = int(volume.value_counts[tf.alpha_at(values) > 0.0].sum())
    shaded = tf.shade is not None if shaded is None else shaded
    held = volume.voxels.nbytes
    return _reckon_scan(
        volume.shape_xyz, volume.voxels.dtype, count, pieces, lines, quality, axes, shaded, picture, held
    )


def estimate_from_histogram(
    shape_xyz, dtype, values, counts, tf, quality: Quality, *, shaded: bool = True, picture: int = 0
) -> MemoryEstimate:
    """As ``estimate`` for one principal axis, roughly, without the voxels: from ``counts`` (n,) of the physical
    ``values`` (n,) of a volume of ``shape_xyz`` and ``dtype``."""
    _, ny, nz = shape_xyz
    count = int(counts[tf.alpha_at(values) > 0.0].sum())
    pieces = count // TYPICAL_PIECE
    dtype, lines = np.dtype(dtype), min(pieces, ny * nz)
    held = math.prod(shape_xyz) * dtype.itemsize
    return _reckon_scan(shape_xyz, dtype, count, pieces, lines, quality, 1, shaded, picture, held)


def estimate_of(
    volume, counted, quality: Quality, *, axes: int = 1, shaded: bool = True, picture: int = 0, dtype=None
) -> MemoryEstimate:
    """As ``estimate``, from ``counted``: visible voxels and connected pieces per row, (nz * ny,) each.

    ``volume``: a RefinedVolume for a classification that is refined.
    ``picture``: see ``picture_bytes``.  ``dtype``: as if the voxels were of that type; None for their own.
    """
    counts, pieces = counted
    lines = int(np.count_nonzero(counts))
    return _reckon(
        volume.shape_xyz, np.dtype(dtype or volume.voxels.dtype), int(counts.sum()), int(pieces.sum()), lines, quality,
        axes, shaded, picture, volume.voxels.nbytes,
    )  # fmt: skip


def _refinement_of(quality: Quality) -> int:
    return quality.refinement if quality.classification == "refined" else 1


def _reckon_scan(shape, dtype, count, pieces, lines, quality, axes, shaded, picture, held) -> MemoryEstimate:
    """From the visible voxels, pieces and lines of the scan itself, whatever grid they will be classified on.  Where
    scalars are kept, of which there are more than visible voxels, the estimate still tells how many are visible."""
    if quality.classification == "post":
        near = min(round(TYPICAL_NEAR * count), math.prod(shape))
        needs = _reckon_scalars(shape, dtype, near, pieces, lines, axes, shaded, picture, held)
        return replace(needs, visible_voxels=count)
    s = _refinement_of(quality)
    if s > 1:
        # Of values that are interpolated the same share is shown, so that the count grows as the grid does.
        shape, count, pieces, lines = (s * (n - 1) + 1 for n in shape), s**3 * count, s**2 * pieces, s**2 * lines
        dtype = np.dtype("u2" if counts_values(dtype) else "f4" if dtype == np.float32 else "f8")
    return _reckon(tuple(shape), dtype, count, pieces, lines, quality, axes, shaded, picture, held)


def scalar_estimate(volume, counted, *, axes: int = 1, lit: bool = True, picture: int = 0) -> MemoryEstimate:
    """As ``estimate_of``, for tables of scalars: ``counted`` are the voxels that matter to post-classified sheets.

    ``lit``: whether something shines.
    """
    counts, pieces = counted
    return _reckon_scalars(
        volume.shape_xyz, volume.voxels.dtype, int(counts.sum()), int(pieces.sum()), int(np.count_nonzero(counts)),
        axes, lit, picture, volume.voxels.nbytes,
    )  # fmt: skip


def _reckon_scalars(shape, dtype, count, pieces, lines, axes, lit, picture, held) -> MemoryEstimate:
    least = Quality(classification="pre", record=RECORDS[-1])
    needs = _reckon(tuple(shape), dtype, count, pieces, lines, least, axes, lit, picture, held)
    properties = 0 if counts_values(dtype) else PROPERTY_BYTES * count  # the lookup table stands for them
    light, marks = LIGHT * lit, mark_bytes(shape)
    visible = needs.visible - properties + marks + light * count
    records = axes * scalar_record(dtype.itemsize, light) * count
    return replace(needs, visible=visible, records=records, record=0, work=0, rows=needs.rows + marks)


def _reckon(shape, dtype, count, pieces, lines, quality, axes, shaded, picture, held) -> MemoryEstimate:
    refinement = _refinement_of(quality)
    rows = row_bytes(shape)
    visible = count * voxel_bytes(shape, dtype.itemsize) + rows
    if not counts_values(dtype):
        visible += PROPERTY_BYTES * count
    # Runs along x stand for those along the other axes too: two for each connected piece, and a trailing one.
    run = run_bytes(shape)
    runs, most_scanlines = (2 * pieces + lines) * run, scanlines(shape)
    normals, work = NORMAL * count, work_bytes(count, quality.record)
    if refinement > 1:
        scan = [(n - 1) // refinement + 1 for n in shape]
        lit = min(lit_voxels(count, pieces, refinement), math.prod(scan))
        blocks = fine_block_bytes(shape, dtype.itemsize)
        normals = LIT * lit + row_bytes(scan)
        visible += blocks
        rows += blocks + shaded * row_bytes(scan)
        work = max(work, fine_work_bytes(shape, dtype.itemsize))
    return MemoryEstimate(
        visible_voxels=count, voxels=math.prod(shape), volume=held, visible=visible,
        normals=normals if shaded else 0, runs=axes * (runs + SCANLINE * most_scanlines),
        records=axes * quality.record * count, work=work, picture=picture, axes=axes, record=quality.record,
        rows=rows, scanlines=(SCANLINE + run) * most_scanlines, alone=2 * run, refinement=refinement,
    )


class SheetSides(NamedTuple):
    """Sheet pixels along each side."""

    width: int
    height: int


def likely_sides(shape_xyz, quality: Quality, width: int, height: int) -> SheetSides:
    """Of the sheets of a volume that fills a frame of so many pixels, seen along z."""
    density = quality.sheet_density
    return SheetSides(*((int(density * side) for side in (width, height)) if density else shape_xyz[:2]))


def picture_bytes(
    planes, width: int, height: int, quality: Quality, *, limited: bool = False, meshes: bool = False, scratch: int = 0,
    traced: bool = False,
) -> int:
    """What the sheets and the finished pixels of a picture take.

    ``planes``: its base planes, each with a width and a height.  ``limited``: whether clip distances or meshes
    shorten rays.  ``meshes``: whether there are any; behind their silhouettes all may be splatted twice.
    ``scratch``: of the splat, which is kept.  ``traced``: whether steep pixels have rays of their own.
    """
    pixels = width * height
    sheets = [plane.width * plane.height for plane in planes]
    largest = max(sheets, default=0)
    splatting = (1 + meshes) * SHEET_PIXEL * sum(sheets) + MESH_LAYERS * meshes * pixels
    splatting += (filter_bytes(quality.warp_filter) + INTERVALS * limited) * largest
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
    """RleSplatError, with what would fit, when more memory is wanted than there is."""
    free = SPARE * available_bytes()
    if wanted.needed <= free:
        return
    which = "that the transfer function shows" if wanted.record else "that are shown, and their neighbors,"
    raise RleSplatError(
        f"The {wanted.visible_voxels} voxels {which} need about {bytes_text(wanted.needed)} of memory and "
        f"{bytes_text(free)} are free; {_what_fits(wanted, free)}."
    )


def _what_fits(wanted: MemoryEstimate, free: float) -> str:
    """The least sacrifice that brings a job within ``free`` bytes, in words."""
    short = [record for record in RECORDS if record < wanted.record]
    for record in short:
        if wanted.with_record(record).needed <= free:
            return f"voxel records of {record} bytes would fit"
    for refinement in range(wanted.refinement - 1, 0, -1):
        if wanted.with_refinement(refinement).needed <= free:
            coarser = f"a refinement of {refinement}" if refinement > 1 else "classifying on the grid of the scan"
            return f"{coarser} would fit"
    one_by_one = () if wanted.picture else range(wanted.axes - 1, 0, -1)  # a picture needs all of its axes
    for axes in one_by_one:
        for record in (wanted.record, *short):
            if wanted.with_axes(axes).with_record(record).needed <= free:
                named = f" with voxel records of {record} bytes" if record != wanted.record else ""
                return f"{'one principal axis' if axes == 1 else 'two principal axes'} at a time{named} would fit"
    least = (wanted if wanted.picture else wanted.with_axes(1)).with_refinement(1).with_record(RECORDS[-1])
    parts = [f"voxel records of {RECORDS[-1]} bytes"] if short else []
    parts += ["classifying on the grid of the scan"] if wanted.refinement > 1 else []
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
