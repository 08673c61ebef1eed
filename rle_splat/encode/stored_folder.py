"""A volume whose run-length tables lie in a folder (``encode.folder``): opened at once, checked axis by axis."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np

from ..scene import RleSplatError
from ..volume.volume import Volume
from .folder import COARSE, COUNTS, ORDER_OF, ROWS, RUNS, MappedTables, damaged, read_header
from .records import WORDS
from .tables import (
    RunTables,
    data_pointers_from_scanlines,
    pointers_from_counts,
    scanline_pointers_from_counts,
)
from .validate import (
    DAMAGE,
    OF_VOXELS,
    Values,
    check_records,
    check_scalars,
    checked_color,
    checked_header,
    checked_layout,
    checked_values,
    reason_of,
    scanline_starts,
)


class _SlabCounts(NamedTuple):
    """What a slab on the disk has of an order.

    Attributes
    ----------
    runs, voxels : ndarray of uint32
        Of each scanline, (planes, scanlines) or (scanlines, planes).
    n_runs, n_voxels : int
        Of all of them.
    """

    runs: np.ndarray
    voxels: np.ndarray
    n_runs: int
    n_voxels: int


@dataclass(frozen=True, eq=False)
class FolderVolume:
    """Content of a folder of tables.

    Attributes
    ----------
    path : Path
    classification : {"pre", "post"}
    shape_xyz : (nx, ny, nz)
    principal_axes : tuple of int
    model, record, affine, unit, unit_length, transfer_function, lighting, source, remarks, space
        See StoredVolume.
    visible_voxels, nan_voxels : int
    values : Values or None
        Of post-classified tables.
    most_color : float
        Largest channel of any color of pre-classified tables.
    decoding : ndarray or None
        See RunLengthVolume.
    mapped : MappedTables
    key : str
        Hash of the header, which holds the checksums of all tables.
    opened : dict
        What was checked already.
    planes : (int, int) or None
        First plane z and the end of those that pictures along z are made of; None for all.
    coarse : FolderVolume or None
        The same volume in larger voxels, for drafts; None of a small one, and in folders of earlier versions.
    """

    path: Path
    classification: str
    shape_xyz: tuple
    principal_axes: tuple
    model: str
    record: int
    affine: np.ndarray
    unit: str
    unit_length: float
    transfer_function: object
    lighting: object
    source: str
    remarks: tuple
    space: str | None
    visible_voxels: int
    nan_voxels: int
    values: Values | None
    most_color: float
    decoding: np.ndarray | None
    mapped: MappedTables
    key: str
    opened: dict = field(default_factory=dict)
    planes: tuple[int, int] | None = None
    coarse: FolderVolume | None = None

    holds_values: ClassVar[bool] = False

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: distance between the centers of neighboring voxels along x, y, z, in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    def held(self, used: dict) -> dict:
        """Principal axis -> tables that are in use, of those that a picture uses: all others stay on the disk."""
        return used

    @property
    def holds_normals(self) -> bool:
        """Whether light is made of the voxels' normals, for any view."""
        return self.mapped.has(f"{ROWS}.normals")

    @property
    def stand_in(self) -> Volume:
        """A volume of one voxel with the type and the meaning of the values, for the lookup table."""
        dtype, slope, intercept, *_ = self.values
        return Volume(np.zeros((1, 1, 1), dtype), self.affine, self.unit, slope, intercept)

    def of_planes(self, first: int, last: int) -> FolderVolume:
        """The folder for pictures along z of the planes [``first``, ``last``): nothing else is read for them.

        Along x and y each slab on the disk has voxels of every slice, and is read for its checksum.
        """
        return replace(self, planes=(first, last))

    def tables_steps(self, axis: int):
        """Generator of fractions done: the tables of a principal axis, checked the first time.

        Returns
        -------
        tables : RunLengthVolume, or RunTables of post-classified voxels
        of_voxels : dict
            Name -> array of the tables of voxels.

        Raises
        ------
        RleSplatError
            If a file is missing, cut short or damaged.
        """
        wanted = self.planes if axis == 2 else None
        if axis in self.opened and self.opened[axis][0] == wanted:
            self.mapped.check_sizes()
        else:
            try:
                slabs = yield from self._slabs_steps(ORDER_OF[axis], wanted or (0, self.shape_xyz[2]))
                self.opened[axis] = wanted, self._of_axis(axis, slabs)
            except DAMAGE as problem:
                raise damaged(self.path, f"they do not fit together ({problem})") from None
        yield 1.0
        return self.opened[axis][1]

    def _names(self, order: str) -> dict:
        """Name -> file of the tables of voxels of an order."""
        names = {name: f"{order}.{name}" for name in OF_VOXELS[self.classification]}
        return {name: file for name, file in names.items() if self.mapped.has(file)}

    def _slabs_steps(self, order: str, wanted):
        """Generator of fractions done: the _SlabCounts of each slab; those with planes ``wanted`` are checked."""
        found = []
        for number, (first, last) in enumerate(zip(self.mapped.ends, self.mapped.ends[1:])):
            yield first / self.shape_xyz[2]
            if last <= wanted[0] or wanted[1] <= first:
                found.append(self._unread(order, number))
                continue
            if (order, number) not in self.opened:
                self.opened[order, number] = self._checked(order, number)
            found.append(self.opened[order, number])
        return found

    def _unread(self, order: str, number: int) -> _SlabCounts:
        """Of a slab that is taken for empty; how much of the files it takes is known from their header."""
        first, last = self.mapped.ends[number : number + 2]
        none = np.zeros(self._slab_shape(order, first, last), np.uint32)
        of_voxels = next(iter(self._names(order).values()))
        return _SlabCounts(none, none, *(self.mapped.entries(name, number) for name in (f"{order}.{RUNS}", of_voxels)))

    def _checked(self, order: str, number: int) -> _SlabCounts:
        """Of a slab whose checksums and tables are checked."""
        of_voxels = self._names(order)
        names = [f"{order}.{COUNTS}", f"{order}.{RUNS}", *of_voxels.values()]
        first, last, parts = self.mapped.slab_parts(number, names)
        axis, shape = 2 if order == ROWS else 0, (*self.shape_xyz[:2], last - first)
        counts = np.asarray(parts[f"{order}.{COUNTS}"]).reshape(*self._slab_shape(order, first, last), 2)
        runs, voxels = counts[..., 0], counts[..., 1]
        pointers, n_runs = scanline_pointers_from_counts(runs)
        starts, n_voxels = pointers_from_counts(voxels)
        ends = data_pointers_from_scanlines(starts, n_voxels)
        made = scanline_starts(axis, shape, pointers, ends, parts[f"{order}.{RUNS}"], n_voxels)
        table = next(iter(of_voxels.values()))
        counted = n_runs, n_voxels
        if counted != (self.mapped.entries(f"{order}.{RUNS}", number), self.mapped.entries(table, number)):
            raise damaged(self.path, "the counts do not fit the tables")
        if not np.array_equal(made, starts):
            raise damaged(self.path, "the counts of voxels do not fit the runs")
        if self.classification == "pre":
            check_records(axis, self._records(parts[of_voxels["records"]]), self.decoding)
        else:
            check_scalars(axis, parts[of_voxels["scalars"]])
        return _SlabCounts(runs, voxels, n_runs, n_voxels)

    def _slab_shape(self, order: str, first: int, last: int) -> tuple[int, int]:
        """Slices and scanlines of the planes [``first``, ``last``) in an order."""
        nx, ny, _ = self.shape_xyz
        return (last - first, ny) if order == ROWS else (nx, last - first)

    def _records(self, stored: np.ndarray) -> np.ndarray:
        """Records as RunLengthVolume has them."""
        return stored.reshape(-1, *WORDS[self.record])

    def _of_axis(self, axis: int, slabs: list[_SlabCounts]):
        """The tables of a principal axis from the counts of its order's slabs, one behind the other in the files."""
        order = ORDER_OF[axis]
        all_pointers, all_starts, n_runs, n_voxels = [], [], 0, 0
        for slab in slabs:
            pointers, _ = scanline_pointers_from_counts(slab.runs)
            starts, _ = pointers_from_counts(slab.voxels)
            all_pointers.append(np.where(pointers < 0, -1, pointers.astype(np.int64) + n_runs))
            all_starts.append(starts + n_voxels)
            n_runs, n_voxels = n_runs + slab.n_runs, n_voxels + slab.n_voxels
        kind = np.int32 if n_runs <= np.iinfo(np.int32).max else np.int64
        columns = all_pointers, all_starts, [slab.voxels for slab in slabs]
        pointers, starts, voxels = (np.concatenate(parts, axis=0 if order == ROWS else 1) for parts in columns)
        if axis == 1:  # the scanlines of z, slice by slice
            pointers, starts, voxels = (np.ascontiguousarray(part.T) for part in (pointers, starts, voxels))
        data_pointers = np.append(np.int64(0), np.cumsum(voxels.sum(axis=1, dtype=np.int64)))
        runs = self.mapped.table(f"{order}.{RUNS}")
        tables = RunTables(axis, self.shape_xyz, pointers.astype(kind), data_pointers, runs, starts)
        of_voxels = {name: self.mapped.table(file) for name, file in self._names(order).items()}
        if self.classification == "pre":
            records = self._records(of_voxels["records"])
            return tables.with_voxels(self.model, records, self.decoding, self.most_color), of_voxels
        return tables, of_voxels


def classification_of(path) -> str:
    """The classification of a `.rle` file or folder: "pre" for all but a folder whose header says "post"."""
    if not Path(path).is_dir():
        return "pre"
    found = read_header(path).get("classification")
    return found if found in OF_VOXELS else "pre"


def load_folder(path) -> FolderVolume:
    """Open a folder of tables; what it holds is checked when it is needed.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    FolderVolume

    Raises
    ------
    RleSplatError
        If it is not a folder of tables, or its header is damaged.
    """
    volume, has_coarse = _opened(Path(path))
    return replace(volume, coarse=_opened(volume.path / COARSE)[0]) if has_coarse else volume


def _opened(path: Path) -> tuple[FolderVolume, bool]:
    """The FolderVolume of a folder, whose header is checked, and whether there is a coarse one in it."""
    header = read_header(path)
    try:
        facts = checked_header(header)
        dtypes = checked_layout(header, facts)
        is_pre, decoding = header["classification"] == "pre", header.get("decoding")
        volume = FolderVolume(
            path, header["classification"], principal_axes=facts.pop("axes"), **facts,
            visible_voxels=header["visible"], nan_voxels=int(header["nan_voxels"]),
            values=None if is_pre else checked_values(header, dtypes),
            most_color=checked_color(header["most_color"] if is_pre else 0.0),
            decoding=None if decoding is None else np.array(decoding, np.float32),
            mapped=MappedTables(path, {**header, "dtypes": dtypes}),
            key=hashlib.blake2b(json.dumps(header, sort_keys=True).encode(), digest_size=16).hexdigest(),
        )  # fmt: skip
    except RleSplatError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem}") from None
    except DAMAGE as problem:
        raise damaged(path, f"its header says something impossible{reason_of(problem)}") from None
    return volume, bool(header.get(COARSE))
