"""Run-length tables of a scalar volume for one principal axis, from which post-classified sheets are splatted.

These are the paper's scanline pointers, data pointers and runs of the voxels that the transfer function needs
(``classify.relevant``). A voxel record is the scalar, in the volume's own type if that is small, and the light on the
voxel if there is any light.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..classify.visible import VisibleVoxels
from ..runtime.buffer_pool import empty
from ..runtime.steps import map_steps
from .encode import place_chunks, table_steps, touch_steps
from .encode_kernels import MOST_BYTES
from .tables import OnAxis, RunTables

OWN_TYPES = ("uint8", "int8", "uint16", "int16", "float32")  # stored unchanged; other types become float32
MOST = 1e37  # larger values that become float32 are taken for it, so that their differences stay finite
AT_ONCE = 1 << 16  # voxels of other types that are converted at once
NOT_A_NUMBER = np.float32(-3e38)  # replaces NaN; treated like a voxel that is not kept


@dataclass(frozen=True, eq=False)
class ScalarVolume(OnAxis):
    """The kept voxels of a volume, run-length encoded along one principal axis, with their scalars and light.

    Attributes
    ----------
    scalars : (m,) ndarray
        Stored values minus ``center``, in the order of ``tables``.
    codes : (m, channels) ndarray of int16 or None
        ``shade.sample_light.ONE`` times the planes of ``light``, and a factor of extinction after them if it is
        ``thinned``; in the order of ``tables``.
    light : shade.sample_light.SampleLight or None
        None where nothing shines.
    thinned : bool
        Whether the last channel of ``codes`` is a factor of the extinction.
    values : (m, channels) ndarray of float32 or None
        Stored values of further channels minus their ``centers``, in the order of ``tables``; None without any.
    """

    tables: RunTables
    scalars: np.ndarray
    center: float
    codes: np.ndarray | None = None
    light: object | None = None
    thinned: bool = False
    values: np.ndarray | None = None
    centers: tuple[float, ...] = ()

    def __post_init__(self):
        for array in (self.scalars, self.codes, self.values):
            if array is not None:
                array.setflags(write=False)

    @property
    def axis(self) -> int:
        """Principal axis."""
        return self.tables.axis

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Number of voxels along x, y, z."""
        return self.tables.shape_xyz

    @property
    def data_pointers(self) -> np.ndarray:
        """See RunLengthVolume."""
        return self.tables.data_pointers

    @property
    def record(self) -> int:
        """Bytes of a voxel record."""
        codes = 0 if self.codes is None else 2 * self.codes.shape[1]
        return self.scalars.itemsize + codes + 4 * len(self.centers)

    @property
    def table_bytes(self) -> dict[str, int]:
        """Bytes of each table by the paper's names, and of the derived table."""
        return {**self.tables.table_bytes, "voxel_data": len(self.scalars) * self.record}


def center_of(kind, ends) -> float:
    """What is subtracted from stored values before they become float32, so that none is less exact than as float32.

    The middle of the values if the largest is less than twice the smallest in size, else 0: one value far from the
    others must not cost these their digits.

    Parameters
    ----------
    kind : dtype
        Type of the stored values.
    ends : (low, high)
        Smallest and largest of them.
    """
    low, high = ends
    near = low <= high < 2.0 * low or 2.0 * high < low <= high
    return 0.5 * (low + high) if near and np.dtype(kind).name not in OWN_TYPES else 0.0


def scalars_of(voxels: VisibleVoxels, kind, infinite, center: float) -> np.ndarray:
    """Scalars of voxels.

    Parameters
    ----------
    kind : dtype
        Type of the stored values.
    infinite : (low, high) or ()
        Values that replace minus and plus infinity, if any.
    center : float
        Subtracted from the values, unless the type is a small integer.

    Returns
    -------
    (m,) ndarray
        In the order of the voxels.
    """
    stored = voxels.stored.view(kind) if np.dtype(kind).itemsize == voxels.stored.itemsize else voxels.stored
    if np.dtype(kind).name in OWN_TYPES[:-1]:
        return stored
    if stored.dtype == np.float32 and center == 0.0 and np.isfinite(stored).all():
        return stored
    found = np.empty(len(stored), np.float32)
    for first in range(0, len(stored), AT_ONCE):
        values = stored[first : first + AT_ONCE].astype(np.float64)
        if infinite:
            values = np.where(np.isinf(values), np.clip(values, *infinite), values)
        values = np.where(np.isnan(values), NOT_A_NUMBER, np.clip(values - center, -MOST, MOST))
        found[first : first + AT_ONCE] = values
    return found


def is_shared(axis: int) -> bool:
    """Whether records stay in the order of the voxels: true for y and z, whose scanlines are rows along x."""
    return axis != 0


def scalar_table_steps(voxels: VisibleVoxels, axis: int, *, threads: int = 0):
    """Generator of fractions: as ``encode.table_steps``, but principal y uses the records of principal z, so that both
    share one list."""
    tables = yield from table_steps(voxels, axis, threads=threads)
    if axis != 1:
        return tables
    _, ny, nz = voxels.shape_xyz
    rows = voxels.row_start[:-1].reshape(nz, ny)
    return replace(tables, scanline_data_pointers=np.ascontiguousarray(rows.T))


def in_scanlines(tables: RunTables, voxels: VisibleVoxels, words, *, threads: int = 0):
    """Generator: yield the fraction done, return the records of the voxels in the order of ``tables``.

    ``tables``: of ``scalar_table_steps``; ``words`` (m,) or (m, w): records in the order of the voxels.
    """
    if is_shared(tables.axis):
        return words
    rows = np.ascontiguousarray(words).reshape(len(words), math.prod(words.shape[1:]))
    target, at_once = empty(rows.shape, rows.dtype), MOST_BYTES // rows.itemsize
    yield from map_steps(touch_steps(target), lambda _: 0.0)
    for first in range(0, rows.shape[1], at_once):  # codes of many lamps are longer than a record can be
        part = np.ascontiguousarray(rows[:, first : first + at_once])
        moved = target if part.shape == target.shape else np.empty_like(part)
        yield from place_chunks(tables, voxels, part, moved, threads=threads)
        if moved is not target:
            target[:, first : first + at_once] = moved
    return target.reshape(words.shape)
