"""The paper's four tables for one principal axis, and the one that is derived from them (algorithm.md 1.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..volume.axes import AXES
from .records import record_bytes, unpack

CHUNK = 1 << 18  # voxels looked at together, so that no second copy of all of them is made
LEAST_DENSITY = 1e-37  # keeps 0 / 0 out of colour = associated colour / density
TABLES = ("scanline_pointers", "data_pointers", "runs", "voxel_data")  # the paper's four, in its order


class _OnAxis:
    """The numbers of a grid of ``shape_xyz`` seen along principal ``axis``."""

    @property
    def width(self) -> int:
        """Voxels of a scanline."""
        return self.shape_xyz[AXES[self.axis][0]]

    @property
    def n_scanlines(self) -> int:
        return self.shape_xyz[AXES[self.axis][1]]

    @property
    def n_slices(self) -> int:
        return self.shape_xyz[AXES[self.axis][2]]

    @cached_property
    def filled_slices(self) -> np.ndarray:
        """(n_slices + 2,) bool: which slices have any voxels; the first and the last stand for those outside."""
        return np.pad(np.diff(self.data_pointers) > 0, 1)


@dataclass(frozen=True, eq=False)
class RunTables(_OnAxis):
    """Where the non-transparent voxels are, for one principal axis: a RunLengthVolume without its voxel data.

    It depends on what a transfer function shows, not on how, nor on lights.
    """

    axis: int
    shape_xyz: tuple[int, int, int]
    scanline_pointers: np.ndarray
    data_pointers: np.ndarray
    runs: np.ndarray
    scanline_data_pointers: np.ndarray

    @property
    def n_voxels(self) -> int:
        return int(self.data_pointers[-1])

    @property
    def nbytes(self) -> int:
        return (
            self.scanline_pointers.nbytes + self.data_pointers.nbytes + self.runs.nbytes
            + self.scanline_data_pointers.nbytes
        )

    def with_voxels(self, model: str, voxel_data, decoding, most_color: float) -> RunLengthVolume:
        """The whole set, with records in the order of the tables."""
        return RunLengthVolume(
            self.axis, self.shape_xyz, model, self.scanline_pointers, self.data_pointers, self.runs, voxel_data,
            self.scanline_data_pointers, decoding, most_color,
        )


@dataclass(frozen=True, eq=False)
class RunLengthVolume(_OnAxis):
    """A classified, shaded volume, run-length encoded along one principal axis.

    ``axis``: 0, 1, 2 for x, y, z as the axis that counts the slices; ``axes.AXES`` tells the other two.
    ``model``: "extinction" or "opacity", the meaning of the voxel data.
    ``scanline_pointers``: (n_slices, n_scanlines) int32 or int64, index into ``runs`` of the scanline's first
    transparent run; -1 where the whole scanline is transparent.
    ``data_pointers``: (n_slices + 1,) int64, index into ``voxel_data`` of a slice's first voxel, then the total.
    ``runs``: (n_runs,) uint16 or uint32, per scanline t0, n0, t1, n1, ...: transparent and non-transparent run
    lengths in turn; t0 may be 0, no other is; a trailing transparent run is written; they sum to ``width``.
    ``voxel_data``: (m, 4) float32, scene-linear (extinction * RGB, extinction) in 1 / world length, or
    (alpha * RGB, alpha) per opacity unit distance; non-transparent voxels only.  Or the same in 8, 6 or 4 bytes, as
    codes that ``decoding`` turns into such numbers: see ``records``.
    ``scanline_data_pointers``: (n_slices, n_scanlines) int64, index into ``voxel_data`` of a scanline's first
    voxel.  Derived: it lets image bands start at any scanline, and is never stored.
    ``given_most_color``: the largest channel of any unassociated colour, where whoever made the tables knows it.
    """

    axis: int
    shape_xyz: tuple[int, int, int]
    model: str
    scanline_pointers: np.ndarray
    data_pointers: np.ndarray
    runs: np.ndarray
    voxel_data: np.ndarray
    scanline_data_pointers: np.ndarray
    decoding: np.ndarray | None = None
    given_most_color: float | None = None

    def __post_init__(self):
        for name in (*TABLES, "scanline_data_pointers"):
            getattr(self, name).setflags(write=False)
        if self.decoding is not None:
            self.decoding.setflags(write=False)

    @property
    def visible_voxels(self) -> int:
        return len(self.voxel_data)

    @property
    def record(self) -> int:
        """Bytes of a voxel's record."""
        return record_bytes(self.voxel_data)

    def decoded(self, first: int = 0, last: int | None = None) -> np.ndarray:
        """(n, 4) float32 records of voxels [first, last)."""
        return unpack(self.voxel_data[first:last], self.decoding)

    @cached_property
    def most_color(self) -> float:
        """The largest channel of any voxel's unassociated colour; NaN where damaged tables overflow."""
        if self.given_most_color is not None:
            return self.given_most_color
        most = 0.0
        for first in range(0, len(self.voxel_data), CHUNK):
            with np.errstate(over="ignore", invalid="ignore"):
                data = self.decoded(first, first + CHUNK)
                colors = data[:, :3].max(axis=1) / np.maximum(data[:, 3], LEAST_DENSITY)
            most = np.maximum(most, colors.max())
        return float(most)

    @property
    def table_bytes(self) -> dict[str, int]:
        """Bytes of each table by name, the derived one included."""
        return {name: getattr(self, name).nbytes for name in (*TABLES, "scanline_data_pointers")}

    @property
    def nbytes(self) -> int:
        return sum(self.table_bytes.values())


def run_type(shape_xyz) -> type:
    """The type of a run length: 16 bits unless a dimension needs more."""
    return np.uint16 if max(shape_xyz) <= np.iinfo(np.uint16).max else np.uint32


def pointers_from_counts(counts: np.ndarray) -> tuple[np.ndarray, int]:
    """Start of each scanline in a list from its (n_slices, n_scanlines) number of entries, and the list's length.

    int64, whatever the type of the counts: totals beyond 2^31 are ordinary.
    """
    ends = np.cumsum(counts, dtype=np.int64).reshape(counts.shape)
    return ends - counts, int(ends[-1, -1])


def scanline_pointers_from_counts(run_counts: np.ndarray) -> tuple[np.ndarray, int]:
    """The slice scanline pointer array from the number of runs per scanline (0 where all is transparent).

    int32 when every index fits, else int64.  Also returns the number of runs.
    """
    starts, n_runs = pointers_from_counts(run_counts)
    starts[run_counts == 0] = -1
    return starts.astype(np.int32 if n_runs <= np.iinfo(np.int32).max else np.int64, copy=False), n_runs


def data_pointers_from_scanlines(scanline_data_pointers: np.ndarray, n_voxels: int) -> np.ndarray:
    """The data pointer array: a slice's first voxel is its first scanline's; one more entry holds the total."""
    return np.append(scanline_data_pointers[:, 0], np.int64(n_voxels))
