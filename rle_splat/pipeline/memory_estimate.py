"""Estimate the memory of a picture or a file of tables before it is taken (algorithm.md 1.11).

``memory_table`` is the one table of what each stage takes.  The voxels that a transfer function shows are counted
first, which takes no memory for each of them; the table tells the rest.  No kernels are loaded here: what only looks at
a file does not wait for a compiler.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..runtime.memory import COARSER, available_bytes, bytes_text
from ..runtime.work_sizes import (
    BRICK_SIDE,
    MESH_SAMPLES,
    MIXED_AT_ONCE,
    RAYS_AT_ONCE,
    RECORDS_AT_ONCE,
    SMOOTHED_AT_ONCE,
)
from ..scene import RECORDS, Quality, RleSplatError, TooLargeError
from ..volume.axes import AXES
from ..volume.counts import counts_values
from ..warp.filters import FILTERS

SPARE = 0.9  # of what is free may be asked for: the system and Python want some too
PARTS = ("visible", "normals", "runs", "records", "work", "picture")
# Bytes of a pixel of an intermediate image: color, transmittance and half depth; and of its filter's coefficients.
SHEET_PIXEL, COEFFICIENTS = 20, 16
# Bytes of a finished pixel, color and depth; and while it is put into a file.
PICTURE_PIXEL, WRITTEN = 20, 48


class VoxelCount(NamedTuple):
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
    def in_rows(cls, volume, counted, dtype=None) -> VoxelCount:
        """From ``counted``: voxels and connected pieces per row, (nz * ny,) each; ``dtype``: other than the voxels'."""
        count, pieces = (int(n.sum(dtype=np.int64)) for n in counted)  # numpy 1 on Windows sums int32 as int32
        return cls(
            volume.shape_xyz, np.dtype(dtype or volume.voxels.dtype), count, pieces,
            int(np.count_nonzero(counted[0])), volume.voxels.nbytes,
        )  # fmt: skip


MOST_CORNERS = ((BRICK_SIDE + 1) / BRICK_SIDE) ** 3  # of bricks of extinction, for each voxel of a volume


class MemoryRow(NamedTuple):
    """A row of the table: a stage, a part of the estimate, how many things the stage makes, and bytes of each."""

    stage: str
    part: str
    count: int
    each: float


@dataclass(frozen=True)
class PlannedTables:
    """What becomes of voxels: the tables of one picture or file.

    Attributes
    ----------
    record : int
        Bytes of the record of a classified voxel; 0 where tables hold scalars.
    axes : int
        How many principal axes are held, mostly one.
    lit : bool
        Whether something shines.
    shadows : int
        How many lights, the ambient light among them, leave something to each voxel.
    mixed : bool
        Whether labels or channels take part.
    thinned : bool
        Of scalars: whether each has a factor of extinction, as where labels take part.
    labeled : bool
        Of scalars: whether samples look up their labels.
    channels : int
        Of scalars: further channels that are classified where they are interpolated.
    traced : bool
        Of scalars: whether what the lights leave is traced beside each voxel.
    """

    record: int = 0
    axes: int = 1
    lit: bool = True
    shadows: int = 0
    mixed: bool = False
    thinned: bool = False
    channels: int = 0
    labeled: bool = False
    traced: bool = False


def memory_table(found: VoxelCount, tables: PlannedTables) -> tuple[MemoryRow, ...]:
    """What each stage takes for voxels and their tables; ``picture_bytes`` has the stages after them.

    The rows of a part add up, except for those of ``work``, which follow each other in time.
    """
    (nx, ny, nz), voxels, value = found.shape_xyz, math.prod(found.shape_xyz), found.dtype.itemsize
    count, scalars, axes = found.count, not tables.record, tables.axes
    scanlines = max(found.shape_xyz[across] * found.shape_xyz[principal] for _, across, principal in AXES.values())
    own = not scalars and not counts_values(found.dtype)  # else a lookup table holds the optical properties
    shaded, thinned = tables.shadows > 0, tables.mixed or tables.thinned
    traced, swept = tables.traced and shaded, not tables.traced
    codes = 6 * tables.lit + 2 * (tables.shadows + thinned)  # bytes of the codes of a scalar's normal and planes
    record = min(value, 4) + codes + 4 * tables.channels if scalars else tables.record
    return (
        MemoryRow("classify", "visible", ny * nz, 28),  # where a row starts, its pieces, and what counting these takes
        MemoryRow("classify", "visible", count, 2 if nx <= 65536 else 4),  # a voxel's column
        MemoryRow("classify", "visible", count, value),
        MemoryRow("classify", "visible", tables.channels * count, 4),  # values of further channels
        MemoryRow("classify", "visible", own * count, 20),  # extinction, opacity and color
        MemoryRow("classify", "visible", voxels, 1 / 8 + 1 / 64),  # bits of kept voxels and their bricks
        MemoryRow("mix", "visible", scalars * tables.mixed * voxels, value),  # a copy without the hidden segments
        # The function and the lead of each voxel; 44 bytes of each at a boundary, of which 20 organs have one in eight.
        MemoryRow("mix", "visible", tables.labeled * voxels, 3 + 44 / 8),
        # Measured: 95 with lookup tables, 178 without.
        MemoryRow("mix", "work", tables.mixed * min(max(MIXED_AT_ONCE, nx * ny), voxels), 180),
        # Normals; of scalars the codes of a vector in the volume and in the world, and how steep values are.
        MemoryRow("shade", "normals", tables.lit * count, 6 + 4 + 6 if scalars else 12),
        # Of all channels, as above and the values around; and the means of normals and points while they are summed up.
        MemoryRow("shade", "normals", (tables.lit * tables.channels) * count, 10 + 2 * 8),
        MemoryRow("shade", "work", (tables.lit and tables.channels > 0) * count, 56),
        # Planes that are smoothed: as float32, smoothed, and squares of gradients.
        MemoryRow("shade", "work", (scalars and tables.lit) * min(max(SMOOTHED_AT_ONCE, 5 * nx * ny), voxels), 16),
        # What arrives of each light: at voxels, or at the nodes of a grid with a layer around it.
        MemoryRow("shade", "normals", (not scalars) * tables.shadows * count, 4),
        MemoryRow("shade", "normals", (scalars and swept) * tables.shadows * (nx + 2) * (ny + 2) * (nz + 2), 2),
        # Bricks of extinction, whose corners were 1.8 to 2.8 times the kept voxels of three scans; and what is traced.
        MemoryRow("shade", "normals", traced * int(min(3 * count, MOST_CORNERS * voxels)), 4),
        MemoryRow("shade", "normals", traced * tables.shadows * count, 2),
        MemoryRow("shade", "work", traced * count, 8 + 4),
        MemoryRow("shade", "normals", (scalars and shaded) * count, 6),  # where its shadows begin
        MemoryRow("shade", "normals", shaded * count, 10),  # while shadows are made
        MemoryRow("shade", "visible", (scalars and (shaded or thinned)) * count, codes),  # all planes of a voxel joined
        MemoryRow("shade", "visible", (scalars and thinned) * count, 4),  # factors of extinction
        MemoryRow("encode", "runs", axes * scanlines, 72),  # pointers, and what making them takes meanwhile
        # Runs along x stand for those along the other axes too: two for each connected piece, and a trailing one.
        MemoryRow("encode", "runs", axes * (2 * found.pieces + found.lines), 2 if max(found.shape_xyz) <= 65535 else 4),
        MemoryRow("encode", "records", axes * count, record),
        # Full records, and those that are packed beside them.
        MemoryRow("encode", "work", (not scalars) * min(count, RECORDS_AT_ONCE), 16 + (record if record != 16 else 0)),
    )  # fmt: skip


@dataclass(frozen=True)
class MemoryEstimate:
    """Memory that a picture takes.

    Attributes
    ----------
    visible_voxels, voxels : int
        Number of voxels that are not transparent, and of all.
    volume : int
        Bytes of the voxels themselves, already in memory or mapped from their file.
    visible : int
        Bytes for which voxels are shown, and their optical properties.
    normals : int
        Bytes for shading.
    runs, records : int
        Bytes of the tables of all principal axes.
    work : int
        Bytes while records are made.
    picture : int
        Bytes of sheets and finished pixels.
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
    tables: PlannedTables  # what they hold

    @property
    def needed(self) -> int:
        """Bytes still to be allocated; ``work`` is freed before ``picture`` is allocated."""
        return self.visible + self.normals + self.runs + self.records + max(self.work, self.picture)

    @property
    def visible_fraction(self) -> float:
        return self.visible_voxels / self.voxels

    def report(self) -> dict:
        """JSON-ready."""
        return {**{name: getattr(self, name) for name in PARTS}, "volume": self.volume, "needed": self.needed}

    def one_axis(self) -> MemoryEstimate:
        """What is still to be taken for one more principal axis, or for the same one under another light."""
        axes = self.tables.axes
        return replace(
            self, runs=self.runs // axes, records=self.records // axes, visible=0, normals=0, picture=0,
            tables=replace(self.tables, axes=1),
        )  # fmt: skip


@lru_cache(maxsize=16)
def estimate_tables(found: VoxelCount, tables: PlannedTables, picture: int = 0) -> MemoryEstimate:
    """Sum the table up.

    Kept, since most frames have the previous one's.

    Parameters
    ----------
    found : VoxelCount
        The voxels that the tables hold.
    picture : int
        See ``picture_bytes``.
    """
    sums, works = Counter(dict.fromkeys(PARTS, 0)), []
    for row in memory_table(found, tables):
        size = int(row.count * row.each)
        works.append(size * (row.part == "work"))
        sums[row.part] += size
    parts = {**sums, "work": max(works), "picture": picture}
    return MemoryEstimate(found.count, math.prod(found.shape_xyz), found.held, **parts, tables=tables)


def picture_bytes(
    planes, width: int, height: int, quality: Quality, *, shortened: bool = False, meshes: bool = False,
    scratch: int = 0, traced: bool = False,
) -> int:  # fmt: skip
    """What the sheets and the finished pixels of a picture take.

    ``planes``: its base planes, each with a width and a height.  ``shortened``: whether clip distances or meshes
    shorten rays.  ``meshes``: whether there are any; behind their silhouettes all may be splatted twice.
    ``scratch``: of the splat, which is kept.  ``traced``: whether steep pixels have rays of their own.
    """
    pixels = width * height
    sheets = [plane.width * plane.height for plane in planes]
    # Of the largest sheet: its filter's coefficients; where its rays begin and end, and what finding that takes.
    filtered = (COEFFICIENTS * FILTERS[quality.warp_filter].is_prefiltered + 40 * shortened) * max(sheets, default=0)
    drawn = PICTURE_PIXEL * pixels
    at_a_time = {
        # Depths on all samples of a pixel, its layers, and what finding those takes.
        "meshes": meshes * (4 * MESH_SAMPLES + 12 + 9) * pixels,
        "splat, warp": drawn + (1 + meshes) * SHEET_PIXEL * sum(sheets) + meshes * 12 * pixels + filtered,
        # How steep a pixel is, which ones are, where if all of them are, and the picture once more with a border.
        "rays": traced * (drawn + (4 + 1 + 8 + 20) * pixels + 480 * RAYS_AT_ONCE),
        "write": drawn + WRITTEN * pixels,
    }
    return scratch + max(at_a_time.values())


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
    """TooLargeError, with what to do, when more memory is wanted than there is."""
    free = SPARE * available_bytes()
    if wanted.needed <= free:
        return
    tables = wanted.tables
    which = "that the transfer function shows" if tables.record else "that are shown, and their neighbors,"
    less = [f"use voxel records of {RECORDS[-1]} bytes, "] if tables.record > RECORDS[-1] else []
    # A picture needs all of its axes at once.
    less += ["encode one principal axis at a time, "] if tables.axes > 1 and not wanted.picture else []
    raise TooLargeError(
        f"The {wanted.visible_voxels} voxels {which} need about {bytes_text(wanted.needed)} of memory and "
        f"{bytes_text(free)} are free; to need less, {''.join(less)}narrow the transfer function, or "
        f"{COARSER}."
    )
