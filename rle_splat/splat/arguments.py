"""What the sheet-buffer loop is given, in named groups that kernels and their reference implementations share."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..encode.records import TYPES
from ..runtime.jit import read_only
from ..scene import Quality
from ..view.base_plane import BasePlane
from ..view.footprints import FOOTPRINTS, TENT
from ..view.ray_intervals import box_intervals
from ..volume.axes import AXES
from ..volume.stored_scalars import StoredScalars
from ..volume.triples import dot
from .sample_lamps import SampleLamps


class Records(NamedTuple):
    """Voxel records in the flat array of their length; the array of the other length is empty (``encode.records``).

    So one kernel serves both lengths, and a run of voxels has one branch more.

    Attributes
    ----------
    bytes16 : (4 * m,) float32
        Four channels each: extinction (or opacity) times linear RGB, and extinction per world length (or opacity).
    bytes8 : (m,) uint64
        Codes.
    decoding : (4,) float32
        What turns codes into channels; empty for 16 bytes.
    """

    bytes16: np.ndarray
    bytes8: np.ndarray
    decoding: np.ndarray

    @classmethod
    def of(cls, voxels, decoding):
        """Of records as ``encode.records`` makes them, and their decoding, None for 16 bytes."""
        arrays = (voxels.reshape(-1) if voxels.dtype == TYPES[size] else np.empty(0, TYPES[size]) for size in TYPES)
        scales = np.empty(0, np.float32) if decoding is None else decoding
        return cls(*map(read_only, arrays), read_only(scales))


class Tables(NamedTuple):
    """The run-length tables of one principal axis (``encode.tables.RunLengthVolume``).

    Attributes
    ----------
    pointers : (slices, scanlines) int
        Number of the first run of each scanline in ``runs``, -1 for an empty scanline.
    data_starts : (slices, scanlines) int
        Number of the first voxel record of each scanline.
    runs : (n,) uint
        Lengths in voxels, transparent and non-transparent in turn; those of a scanline sum to ``width``.
    width : int
        Voxels of a scanline.
    """

    pointers: np.ndarray
    data_starts: np.ndarray
    runs: np.ndarray
    voxels: Records
    width: int


class SheetList(NamedTuple):
    """The sheets, front to back: one entry of each array per sheet.

    Attributes
    ----------
    first_slice : (n,) int64
        The first slice whose footprint reaches the sheet.
    slice_weights : (n, taps) float32
        Weights of that slice and the next ones.
    thickness : (n,) float64
        Depth that the sheet stands for, in voxels.
    begin, end : (n,) float64
        The sheet's slab along the viewing direction of the axis, in voxels.
    scale, offset : (n, 2) float64
        Sheet pixel = scale * voxel + offset, along the scanline [0] and across scanlines [1].
    far : (n,) float64
        Up to where the sheet's samples are of use, in voxels (``view.depth_rules.Sheets``).
    kind : (n,) int64
        OWN, BEGINS, BETWEEN or ALONE of ``view.depth_rules``.
    """

    first_slice: np.ndarray
    slice_weights: np.ndarray
    thickness: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    scale: np.ndarray
    offset: np.ndarray
    far: np.ndarray
    kind: np.ndarray


# In place of what a picture does not have stands an empty array of the same type: a kernel that branches on it serves
# both, where each combination of what is there would take another ten seconds to compile.
WHOLE = np.empty((0, 0, 0), np.float32)  # ray intervals of whole rays


class Rays(NamedTuple):
    """The rays through sheet pixels, by column and by row: a length for each pixel would cost as much as the splat.

    The length of the ray through pixel (u, v) per voxel of depth is
    ``sqrt(along[u] + across[v] + along_slope[u] * across_slope[v])``, in world units (extinction) or reference
    distances (opacity).

    Attributes
    ----------
    along, along_slope : (W,) float64
    across, across_slope : (H,) float64
    seen : (2, H) int
        First column of each row that the picture sees, and the one behind the last (``view.base_plane.BasePlane``).
    intervals : (2 + 2 * holes, H, W) float32
        Where each ray begins and ends along the viewing direction of the axis, in voxels, and where it enters and
        leaves each hole.  Holes do not overlap; an empty one has begin = end.  WHOLE where rays are whole.
    """

    along: np.ndarray
    along_slope: np.ndarray
    across: np.ndarray
    across_slope: np.ndarray
    seen: np.ndarray
    intervals: np.ndarray

    def lengths(self) -> np.ndarray:
        """(H, W) float32: every pixel's length."""
        squares = self.along + self.across[:, None] + self.along_slope * self.across_slope[:, None]
        return np.sqrt(np.maximum(squares, 0.0)).astype(np.float32)

    def unseen(self, block: int) -> np.ndarray:
        """(H, W) bool: the pixels in blocks of ``block`` of which nothing is seen."""
        number = np.arange(len(self.along)) // block
        first, last = self.seen[:, :, None]
        return (number < first // block) | (number > (last - 1) // block) | (first >= last)


def rays_of(plane: BasePlane, length_unit: float, corrected: bool, intervals=None) -> Rays:
    """The rays of a base plane, their lengths counted in ``length_unit``; all of length one if not ``corrected``.

    A ray advances (dx, dy, 1) voxels a slice, dx by its column and dy by its row (algorithm.md 1.4, 5); its world
    length is the square root of a quadratic form of that.
    """
    intervals = WHOLE if intervals is None else np.ascontiguousarray(intervals, np.float32)
    if not corrected:
        none = np.zeros(plane.height)
        return Rays(np.ones(plane.width), np.zeros(plane.width), none, none, plane.seen, intervals)
    dx, dy = plane.ray_slopes
    to_world = (plane.view.to_world / length_unit).T.tolist()
    x, y, z = (to_world[axis] for axis in AXES[plane.axis])
    xx, xy, xz, yy, yz, zz = dot(x, x), dot(x, y), dot(x, z), dot(y, y), dot(y, z), dot(z, z)
    along, across = dx * (xx * dx + 2.0 * xz) + zz, dy * (yy * dy + 2.0 * yz)
    return Rays(along, 2.0 * xy * dx, across, np.array(dy), plane.seen, intervals)


class Wide(NamedTuple):
    """A footprint other than the plain tent.

    Attributes
    ----------
    kind : int
        Of ``view.footprints``.
    radius : float
        In voxels.
    widen : bool
        Whether it is widened where sheets are minified.
    """

    kind: int
    radius: float
    widen: bool


def wide_of(plane: BasePlane, quality: Quality) -> Wide | None:
    """The footprint of classified voxels on a base plane; None for the plain tent."""
    footprint = FOOTPRINTS[quality.kernel]
    widen = quality.minification != "off" and bool(plane.scale.min() < 1.0)
    return Wide(footprint.kind, footprint.radius, widen) if footprint.kind != TENT or widen else None


class ScalarTables(NamedTuple):
    """The run-length tables of one principal axis of a scalar volume (``encode.scalars.ScalarVolume``).

    Attributes
    ----------
    pointers, data_starts, runs, width
        See ``Tables``.
    scalars : StoredScalars
        Stored values of the kept voxels.
    codes : (m, channels) int16
        See ``encode.scalars.ScalarVolume``; without any, of no channels.
    values : (m, channels) float32 or None
        Those of further channels.  None where neither channels nor labels classify.
    """

    pointers: np.ndarray
    data_starts: np.ndarray
    runs: np.ndarray
    scalars: StoredScalars
    codes: np.ndarray
    values: np.ndarray | None
    width: int


class Lookup(NamedTuple):
    """The transfer function as sheets of the scalar look it up (``classify.lookup_table``).

    Stored values are those of the volume less ``ScalarVolume.center``.

    Attributes
    ----------
    table : (4 * (last + 1),) float32
        Extinction times linear RGB, and extinction, per world length, of each entry; of one column where only optical
        depths are wanted.  The last entry is transparent.
    sums : (4 * (last + 1),) float32
        Sums of all entries before each entry.
    origin, rate : float32
        Stored value where the first entry begins; entries per stored value.
    least : float32
        Stored value below which a voxel is no sample.
    low, high : float32
        Stored values outside of which nothing is visible.
    nearest, furthest : float32
        Stored values that stand for what lies beyond them.
    last : int32
        Number of the last entry.
    """

    table: np.ndarray
    sums: np.ndarray
    origin: np.float32
    rate: np.float32
    least: np.float32
    low: np.float32
    high: np.float32
    nearest: np.float32
    furthest: np.float32
    last: np.int32


class ChannelLookups(NamedTuple):
    """The Lookups of several channels; one entry of each array per Lookup.

    Attributes
    ----------
    own : int
        How many there are of the volume's own values, which come first: one, or one for each function of labels.
    planes : (n,) int64
        The plane of a sheet that holds the values.
    begins : (n + 1,) int64
        Where its rows begin in ``tables`` and ``sums``, counted in numbers, and the last one ends.
    tables, sums : (begins[n],) float32
    numbers : (n, 7) float32
        origin, rate, least, low, high, nearest and furthest.
    """

    own: int
    planes: np.ndarray
    begins: np.ndarray
    tables: np.ndarray
    sums: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, own, further, first: int) -> ChannelLookups:
        """Of the volume's ``own`` Lookups and those of ``further`` channels, whose planes begin with ``first``."""
        lookups = [*own, *further]
        begins = np.cumsum([0, *(len(each.table) for each in lookups)], dtype=np.int64)
        planes = np.concatenate((np.zeros(len(own), np.int64), np.arange(first, first + len(further), dtype=np.int64)))
        tables, sums = (np.concatenate(each) for each in zip(*((one.table, one.sums) for one in lookups)))
        numbers = np.array([each[2:9] for each in lookups], np.float32)
        return cls(len(own), *map(read_only, (planes, begins, tables, sums, numbers)))


class CodePlanes(NamedTuple):
    """The planes of a sheet of the scalar that hold what codes of voxels stand for.

    Attributes
    ----------
    count : int
        All planes of a sheet, the scalar's and those of further channels included.
    stride : int
        Numbers from one plane of a voxel scanline to the next.
    thinning : int
        The plane of a factor of extinction, the last one; 0, the scalar's, for none.
    lamps : SampleLamps or None
        What samples are lit by, where light is wanted.
    """

    count: int
    stride: int
    thinning: int
    lamps: SampleLamps | None


class Box(NamedTuple):
    """Where rays are inside the box of the voxel centers, in voxels along the viewing direction.

    Attributes
    ----------
    columns : (2, W) float32
    rows : (2, H) float32
        Entry and exit sideways, along and across scanlines (``view.ray_intervals.box_intervals``).
    blocks : (4, blocks) float32
        First and last entry, first and last exit of each block of columns.
    overhang : float
        Voxels by which a ray that is inside somewhere in a sheet's slab may be beside the box at the sheet itself.
        Such samples are taken at the face of the box.
    """

    columns: np.ndarray
    rows: np.ndarray
    blocks: np.ndarray
    overhang: float


def box_of(plane: BasePlane, shape_xyz, block: int) -> Box:
    """The Box of a base plane, its columns in blocks of ``block``."""
    columns, rows = box_intervals(plane, shape_xyz)
    starts = np.arange(0, columns.shape[1], block)
    ends = np.empty((4, len(starts)), np.float32)
    np.minimum.reduceat(columns, starts, axis=1, out=ends[0::2])
    np.maximum.reduceat(columns, starts, axis=1, out=ends[1::2])
    steepest = max(abs(float(slope[end])) for slope in plane.ray_slopes for end in (0, -1))  # linear in its place
    return Box(columns, rows, ends, math.ceil(plane.sheets.deepest * steepest) + 1.0)
