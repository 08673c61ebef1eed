"""The paper's four run-length tables for one principal axis, and one derived table (algorithm.md 1.1)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ..volume.axes import AXES
from .records import record_bytes, unpack

TABLES = ("scanline_pointers", "data_pointers", "runs", "voxel_data")  # the paper's tables, in its order
DERIVED = "scanline_data_pointers"


class OnAxis:
    """Sizes of a grid of ``shape_xyz`` along principal ``axis``, and of its tables, ``table_bytes``."""

    @property
    def width(self) -> int:
        """Number of voxels of a scanline."""
        return self.shape_xyz[AXES[self.axis][0]]

    @property
    def n_scanlines(self) -> int:
        """Number of scanlines of a slice."""
        return self.shape_xyz[AXES[self.axis][1]]

    @property
    def n_slices(self) -> int:
        """Number of slices."""
        return self.shape_xyz[AXES[self.axis][2]]

    @cached_property
    def filled_slices(self) -> np.ndarray:
        """(n_slices + 2,) bool: whether a slice has voxels; one entry at each end stands for slices outside."""
        return np.pad(np.diff(self.data_pointers) > 0, 1)

    @property
    def nbytes(self) -> int:
        """Bytes of all tables."""
        return sum(self.table_bytes.values())


@dataclass(frozen=True, eq=False)
class RunTables(OnAxis):
    """Run-length tables of visible voxels for one principal axis, without their voxel data.

    They depend only on which voxels are visible, not on colors or lights.

    Attributes
    ----------
    axis : {0, 1, 2}
        Principal axis, across the slices; ``axes.AXES`` gives the other two.
    shape_xyz : (nx, ny, nz)
    scanline_pointers : (n_slices, n_scanlines) ndarray of int32 or int64
        Index into ``runs`` of the scanline's first transparent run; -1 if the scanline is transparent.
    data_pointers : (n_slices + 1,) ndarray of int64
        Index into the voxel data of a slice's first voxel; the last entry is the total.
    runs : (n_runs,) ndarray of uint16 or uint32
        Per scanline t0, n0, t1, n1, ...: lengths of transparent and visible runs in turn. t0 may be 0, no other length
        is; a trailing transparent run is stored; they sum to ``width``.
    scanline_data_pointers : (n_slices, n_scanlines) ndarray of int64
        Index into the voxel data of a scanline's first voxel. Derived from the other tables and not stored in files; it
        allows bands of the image to begin at any scanline.
    """

    axis: int
    shape_xyz: tuple[int, int, int]
    scanline_pointers: np.ndarray
    data_pointers: np.ndarray
    runs: np.ndarray
    scanline_data_pointers: np.ndarray

    @property
    def n_voxels(self) -> int:
        """Number of voxels."""
        return int(self.data_pointers[-1])

    @property
    def table_bytes(self) -> dict[str, int]:
        """Bytes of each table by name, including the derived one."""
        return {name: getattr(self, name).nbytes for name in (*TABLES, DERIVED) if hasattr(self, name)}

    def with_voxels(self, model: str, voxel_data, decoding, most_color: float) -> RunLengthVolume:
        """RunLengthVolume of these tables and ``voxel_data``, whose records are in the order of the tables."""
        mine = (getattr(self, entry.name) for entry in fields(RunTables))
        return RunLengthVolume(*mine, model, voxel_data, decoding, most_color)


@dataclass(frozen=True, eq=False)
class RunLengthVolume(RunTables):
    """A classified, shaded volume, run-length encoded along one principal axis.

    Attributes
    ----------
    model : {"extinction", "opacity"}
        Meaning of the voxel data.
    voxel_data : ndarray
        Records of visible voxels: (m, 4) float32, scene-linear (extinction * RGB, extinction) in 1 / world length, or
        (alpha * RGB, alpha) per opacity unit distance; or the same in 8 bytes, as codes (see ``records``).
    decoding : ndarray of float32 or None
        Scales of the codes, see ``records.decoding_of``; None for 16-byte records.
    most_color : float
        Largest channel of any voxel's unassociated color.
    """

    model: str
    voxel_data: np.ndarray
    decoding: np.ndarray | None
    most_color: float

    def __post_init__(self):
        for name in (*TABLES, DERIVED):
            getattr(self, name).setflags(write=False)
        if self.decoding is not None:
            self.decoding.setflags(write=False)

    @property
    def visible_voxels(self) -> int:
        """Number of visible voxels."""
        return len(self.voxel_data)

    @property
    def record(self) -> int:
        """Bytes of a voxel record."""
        return record_bytes(self.voxel_data)

    def decoded(self, first: int = 0, last: int | None = None) -> np.ndarray:
        """(n, 4) float32 records of voxels [first, last)."""
        return unpack(self.voxel_data[first:last], self.decoding)


def run_type(shape_xyz) -> type:
    """Dtype of a run length: 16 bits unless a dimension needs more."""
    return np.uint16 if max(shape_xyz) <= np.iinfo(np.uint16).max else np.uint32


def pointers_from_counts(counts: np.ndarray) -> tuple[np.ndarray, int]:
    """Start of each scanline in a list, from its number of entries.

    Parameters
    ----------
    counts : (n_slices, n_scanlines) ndarray of integers

    Returns
    -------
    starts : (n_slices, n_scanlines) ndarray of int64
        int64 whatever the dtype of ``counts``, because totals may exceed 2^31.
    total : int
    """
    ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
    return ends - counts, int(ends[-1, -1])


def scanline_pointers_from_counts(run_counts: np.ndarray) -> tuple[np.ndarray, int]:
    """Scanline pointers, from the number of runs of each scanline (0 if it is transparent).

    Parameters
    ----------
    run_counts : (n_slices, n_scanlines) ndarray of integers

    Returns
    -------
    pointers : (n_slices, n_scanlines) ndarray of int32, or int64 if an index needs it
    n_runs : int
    """
    starts, n_runs = pointers_from_counts(run_counts)
    starts[run_counts == 0] = -1
    return starts.astype(np.int32 if n_runs <= np.iinfo(np.int32).max else np.int64, copy=False), n_runs


def data_pointers_from_scanlines(scanline_data_pointers: np.ndarray, n_voxels: int) -> np.ndarray:
    """Data pointers: first voxel of each slice, which is that of its first scanline, and the total; int64."""
    return np.append(scanline_data_pointers[:, 0], np.int64(n_voxels))


def counts_of(tables: RunTables | RunLengthVolume) -> np.ndarray:
    """(n_slices, n_scanlines, 2) uint32: runs and voxels of each scanline, wherever it lies in the tables."""
    filled = np.flatnonzero(tables.scanline_pointers.reshape(-1) >= 0)
    counts = np.zeros((tables.scanline_pointers.size, 2), np.uint32)
    ends = (tables.scanline_pointers, len(tables.runs)), (tables.scanline_data_pointers, int(tables.data_pointers[-1]))
    for column, (pointers, end) in enumerate(ends):
        starts = pointers.reshape(-1)[filled].astype(np.int64)
        order = np.argsort(starts, kind="stable")
        counts[filled[order], column] = np.diff(np.append(starts[order], end))
    return counts.reshape(*tables.scanline_pointers.shape, 2)
