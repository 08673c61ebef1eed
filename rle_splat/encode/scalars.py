"""The tables of a scalar volume for one principal axis: what post-classified sheets are splatted from.

The paper's scanline pointers, data pointers and runs, of the voxels that matter to the transfer function's range of
values (``classify.relevant``); a voxel's record is its scalar, in the volume's own type where that is a small one,
and the light that falls on it where anything shines.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..classify.visible import VisibleVoxels
from .encode import place_slabs, run_tables
from .tables import RunTables

OWN_TYPES = ("uint8", "int8", "uint16", "int16", "float32")  # kept as they are; others become float32
AT_ONCE = 1 << 16  # voxels of other types that are made float32 together
NOT_A_NUMBER = np.float32(-3e38)  # of voxels that are none: like those that are not kept


@dataclass(frozen=True, eq=False)
class ScalarVolume:
    """The voxels that matter, run-length encoded along one principal axis, with their scalars and light.

    ``tables``: where they are.  ``scalars``: (m,) in the tables' order, stored values less ``centre``.  ``lights``:
    (m, channels) uint16 codes of ``voxel_light``, or None where nothing shines; ``light_unit`` makes numbers of them.
    ``thinned``: whether the last channel is a factor of extinction instead.
    """

    tables: RunTables
    scalars: np.ndarray
    centre: float
    lights: np.ndarray | None = None
    light_unit: float = 1.0
    thinned: bool = False

    def __post_init__(self):
        for array in (self.scalars, self.lights):
            if array is not None:
                array.setflags(write=False)

    @property
    def axis(self) -> int:
        return self.tables.axis

    @property
    def width(self) -> int:
        return self.tables.width

    @property
    def n_slices(self) -> int:
        return self.tables.n_slices

    @property
    def data_pointers(self) -> np.ndarray:
        return self.tables.data_pointers

    @property
    def filled_slices(self) -> np.ndarray:
        return self.tables.filled_slices

    @property
    def record(self) -> int:
        """Bytes of a voxel's record."""
        return self.scalars.itemsize + (0 if self.lights is None else 2 * self.lights.shape[1])

    @property
    def table_bytes(self) -> dict[str, int]:
        """Bytes of each table by the paper's names, and of the derived one."""
        tables = self.tables
        return {
            "scanline_pointers": tables.scanline_pointers.nbytes, "data_pointers": tables.data_pointers.nbytes,
            "runs": tables.runs.nbytes, "voxel_data": len(self.scalars) * self.record,
            "scanline_data_pointers": tables.scanline_data_pointers.nbytes,
        }  # fmt: skip

    @property
    def nbytes(self) -> int:
        return sum(self.table_bytes.values())


def scalars_of(voxels: VisibleVoxels, kind, infinite, centre: float) -> np.ndarray:
    """(m,) scalars in the voxels' own order: stored values of type ``kind``, less ``centre``.

    ``infinite``: what stands for minus and plus infinity; no numbers where nothing is infinite.
    """
    stored = voxels.stored.view(kind) if np.dtype(kind).itemsize == voxels.stored.itemsize else voxels.stored
    if np.dtype(kind).name in OWN_TYPES[:-1]:
        return stored
    if stored.dtype == np.float32 and centre == 0.0 and np.isfinite(stored).all():
        return stored
    found = np.empty(len(stored), np.float32)
    for first in range(0, len(stored), AT_ONCE):
        values = stored[first : first + AT_ONCE].astype(np.float64)
        if infinite:
            values = np.where(np.isinf(values), np.clip(values, *infinite), values)
        values = np.where(np.isnan(values), NOT_A_NUMBER, np.clip(values - centre, -1e37, 1e37))
        found[first : first + AT_ONCE] = values
    return found


def is_shared(axis: int) -> bool:
    """Whether a principal axis has the records in the voxels' own order: scanlines of y and z are rows along x."""
    return axis != 0


def scalar_tables(voxels: VisibleVoxels, axis: int, *, backend: str = "auto", threads: int = 0) -> RunTables:
    """Where the voxels are, for principal ``axis``: as ``encode.run_tables``, but y takes its records from where z has
    them, row by row, so that the two share one list."""
    tables = run_tables(voxels, axis, backend=backend, threads=threads)
    if axis != 1:
        return tables
    _, ny, nz = voxels.shape_xyz
    rows = voxels.row_start[:-1].reshape(nz, ny)
    return replace(tables, scanline_data_pointers=np.ascontiguousarray(rows.T))


def in_scanlines(tables: RunTables, voxels: VisibleVoxels, words, *, backend: str = "auto", threads: int = 0):
    """Generator: yields the fraction done; returns records (m,) or (m, w) of the voxels, which come in the voxels' own
    order, in the order of ``tables``, which are of ``scalar_tables``."""
    if is_shared(tables.axis):
        return words
    rows = np.ascontiguousarray(words).reshape(len(words), math.prod(words.shape[1:]))
    target = np.empty_like(rows)
    yield from place_slabs(tables, voxels, rows, target, backend=backend, threads=threads)
    return target.reshape(words.shape)
