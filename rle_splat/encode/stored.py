"""A volume that is run-length encoded: in memory, or in stored members (``encode.members``), checked axis by axis."""

from __future__ import annotations

import hashlib
import json
import zlib
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from ..runtime.memory import bytes_text
from ..runtime.steps import drain
from ..scene import RleSplatError
from ..volume.volume import Volume
from . import validate
from .members import (
    COARSE,
    COUNTS,
    DAMAGE,
    LITTLE,
    ORDER_OF,
    ROWS,
    RUNS,
    SURFACE,
    bytes_of,
    find_members,
    make_damage_error,
    read_header,
    reason_of,
    unreadable,
)
from .records import WORDS
from .tables import (
    RunLengthVolume,
    RunTables,
    pointers_from_counts,
    scanline_pointers_from_counts,
)

if TYPE_CHECKING:
    from ..classify.transfer_function import TransferFunction


class MappedTables:
    """The tables in stored members, mapped read-only.

    Parameters
    ----------
    members : FolderMembers or FileMembers
    header : dict
        With ``chunks`` and ``dtypes`` (name of a table -> dtype and words of an entry).
    """

    def __init__(self, members, header: dict):
        self._members, self._dtypes = members, header["dtypes"]
        self.ends = [0, *(int(planes) for planes, _ in header["slabs"])]
        self._chunks = [tables for _, tables in header["slabs"]]
        self._mapped: dict[str, np.ndarray] = {}

    def has(self, name: str) -> bool:
        """Whether there is such a table."""
        return name in self._dtypes

    def table(self, name: str) -> np.ndarray:
        """A table: (n,) or (n, words)."""
        if name not in self._mapped:
            kind, words, _ = self._dtypes[name]
            self._mapped[name] = self._map(name, np.dtype(LITTLE + kind)).reshape((-1, words) if words else (-1,))
        return self._mapped[name]

    def check_sizes(self) -> None:
        """RleSplatError if a mapped member was removed or cut since: a read beyond its end would end the program."""
        for name in tuple(self._mapped):  # another thread may map one meanwhile
            with self._reading(name):
                self._check_size(name)

    def _check_size(self, name: str) -> int:
        """Bytes of a member, which are those of its chunks."""
        size, held = sum(int(chunk[name][0]) for chunk in self._chunks), self._members.size(name)
        if held != size:
            raise make_damage_error(self._members.path, f"{name} has {bytes_text(held)} instead of {bytes_text(size)}")
        return size

    def _map(self, name: str, dtype: np.dtype) -> np.ndarray:
        with self._reading(name):
            if self._check_size(name) == 0:  # an empty file cannot be mapped
                return np.empty(0, dtype)
            return self._members.array(name, dtype)

    @contextmanager
    def _reading(self, name: str):
        """Context manager: a failure of the system becomes a RleSplatError."""
        path = self._members.path
        try:
            yield
        except FileNotFoundError:
            raise make_damage_error(path, f"{name} is missing") from None
        except OSError as problem:
            raise RleSplatError(f"Cannot read {path / name}: {problem.strerror}; check its permissions.") from None

    def entries(self, name: str, number: int) -> int:
        """Entries of chunk ``number`` in a table."""
        kind, words, _ = self._dtypes[name]
        return int(self._chunks[number][name][0]) // (np.dtype(kind).itemsize * max(words, 1))

    def chunk_parts(self, number: int, names):
        """(first plane, end, name -> the chunk's part of that table) of chunk ``number``, its checksums compared."""
        first, last = self.ends[number : number + 2]
        parts = {}
        for name in names:
            begin = sum(self.entries(name, before) for before in range(number))
            parts[name] = self.table(name)[begin : begin + self.entries(name, number)]
            if zlib.crc32(bytes_of(parts[name])) != self._chunks[number][name][1]:
                what = f"the checksum of {name} does not fit in planes {first} to {last - 1}"
                raise make_damage_error(self._members.path, what)
        return first, last, parts


class _ChunkCounts(NamedTuple):
    """What a chunk on the disk has of an order.

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
class StoredVolume:
    """A volume that is run-length encoded: what a `.rle` file or folder holds, or the result of ``encode``.

    Attributes
    ----------
    path : Path or None
        The file or folder; None in memory.
    classification : {"pre", "post"}
        Whether voxels hold colors, or values that are classified in each picture.
    shape_xyz : (nx, ny, nz)
        Number of voxels along x, y, z.
    principal_axes : tuple of int
        The principal axes that pictures can be made along.
    model : {"extinction", "opacity"}
        As ``Quality.model`` when it was encoded.
    record : {16, 8}
        Bytes of a voxel record of pre-classified tables.
    affine : (4, 4) ndarray of float64
        Voxel index (x, y, z, 1) to the volume's own space, in ``unit``.
    unit : str
        Unit of length of the volume's own space.
    unit_length : float
        World length of one unit to which the extinctions refer.
    transfer_function, lighting
        JSON-compatible descriptions of how the colors were made.
    source : str
        Name of the file from which the volume was read.
    remarks : tuple of str
        Those of the volume that was encoded.
    space : {"patient"} or None
        See Volume.
    visible_voxels, nan_voxels : int
        Number of voxels that are not transparent, and that are not a number.
    key : str or None
        Hash of what is stored; None of what was not read from a file or folder.
    """

    path: Path | None
    classification: str
    shape_xyz: tuple[int, int, int]
    principal_axes: tuple[int, ...]
    model: str
    record: int
    affine: np.ndarray
    unit: str
    unit_length: float
    transfer_function: TransferFunction
    lighting: object
    source: str
    remarks: tuple[str, ...]
    space: str | None
    visible_voxels: int
    nan_voxels: int
    values: validate.Values | None  # of post-classified tables
    most_color: float  # largest channel of any color of pre-classified tables
    decoding: np.ndarray | None  # see RunLengthVolume
    mapped: MappedTables | None  # the stored members; None in memory
    key: str | None
    opened: dict = field(default_factory=dict)  # principal axis -> the tables checked already, and the planes read
    planes: tuple[int, int] | None = None  # first plane z and the end of those that pictures along z are made of
    coarse: StoredVolume | None = None  # the same volume in larger voxels, for drafts; only of a large one

    holds_values: ClassVar[bool] = False

    def __repr__(self) -> str:
        voxels, axes = " x ".join(map(str, self.shape_xyz)), ", ".join("xyz"[axis] for axis in self.principal_axes)
        return f"<StoredVolume {self.source!r}, {voxels}, {self.classification}-classified, along {axes}>"

    @classmethod
    def of(
        cls, axes: dict, affine, unit: str = "mm", unit_length: float = 1.0, transfer_function=None, lighting=None,
        source: str = "", remarks=(), space: str | None = None,
    ) -> StoredVolume:  # fmt: skip
        """A volume in memory; RleSplatError if the encodings do not match.

        Parameters
        ----------
        axes : dict of int to RunLengthVolume
            By principal axis; at least one, all of the same shape, model, record size and scales.
        affine, unit, unit_length, transfer_function, lighting, source, remarks, space
            As the attributes.

        Returns
        -------
        StoredVolume
        """
        kinds = {
            (one.shape_xyz, one.model, one.record, one.decoding is not None and one.decoding.tobytes())
            for one in axes.values()
        }
        if len(kinds) != 1:
            raise RleSplatError(
                "Stored tables need at least one encoding, and all of the same volume, model and record size; encode "
                "again."
            )
        one = next(iter(axes.values()))
        return cls(
            None, "pre", one.shape_xyz, tuple(axes), one.model, one.record, affine, unit, unit_length,
            transfer_function, lighting, source, tuple(remarks), space, one.visible_voxels, 0, None,
            max(tables.most_color for tables in axes.values()), one.decoding, None, None,
            {axis: (None, (tables, {})) for axis, tables in axes.items()},
        )  # fmt: skip

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: distance between the centers of neighboring voxels along x, y, z, in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def axes(self) -> dict[int, RunLengthVolume | RunTables]:
        """Principal axis -> its tables; stored ones are checked now. RleSplatError if one is damaged."""
        whole = replace(self, planes=None)
        return {axis: drain(whole.tables_steps(axis))[0] for axis in self.principal_axes}

    @property
    def nbytes(self) -> int:
        """Bytes of tables in memory."""
        return sum(tables.nbytes for tables in self.axes.values()) if self.mapped is None else 0

    @property
    def holds_normals(self) -> bool:
        """Whether light is made of the voxels' normals, for any view."""
        return self.mapped.has(f"{ROWS}.{SURFACE}")

    @property
    def stand_in(self) -> Volume:
        """A volume of one voxel with the type and the meaning of the values, for the lookup table."""
        dtype, slope, intercept, *_ = self.values
        return Volume(np.zeros((1, 1, 1), dtype), self.affine, self.unit, slope, intercept)

    def of_planes(self, first: int, last: int) -> StoredVolume:
        """The volume for pictures along z of the planes [``first``, ``last``): nothing else is read for them.

        Along x and y each chunk on the disk has voxels of every slice, and is read for its checksum.
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
        wanted = self.planes if axis == 2 and self.mapped is not None else None
        planes, made = self.opened.get(axis, (None, None))
        if made is None or planes != wanted:
            try:
                chunks = yield from self._chunks_steps(ORDER_OF[axis], wanted or (0, self.shape_xyz[2]))
                made = self._of_axis(axis, chunks)
            except DAMAGE as problem:
                raise make_damage_error(self.path, f"they do not fit together ({problem})") from None
            self.opened[axis] = wanted, made  # shared with ``of_planes``, which other threads may draw meanwhile
        elif self.mapped is not None:
            self.mapped.check_sizes()
        yield 1.0
        return made

    def _names(self, order: str) -> dict:
        """Name -> file of the tables of voxels of an order."""
        names = {name: f"{order}.{name}" for name in validate.OF_VOXELS[self.classification]}
        return {name: file for name, file in names.items() if self.mapped.has(file)}

    def _chunks_steps(self, order: str, wanted):
        """Generator of fractions done: the _ChunkCounts of each chunk; those with planes ``wanted`` are checked."""
        found = []
        for number, (first, last) in enumerate(zip(self.mapped.ends, self.mapped.ends[1:])):
            yield first / self.shape_xyz[2]
            if last <= wanted[0] or wanted[1] <= first:
                found.append(self._unread(order, number))
                continue
            if (order, number) not in self.opened:
                self.opened[order, number] = self._check_chunk(order, number)
            found.append(self.opened[order, number])
        return found

    def _unread(self, order: str, number: int) -> _ChunkCounts:
        """Of a chunk that is taken for empty; how much of the files it takes is known from their header."""
        first, last = self.mapped.ends[number : number + 2]
        none = np.zeros(self._chunk_shape(order, first, last), np.uint32)
        of_voxels = next(iter(self._names(order).values()))
        return _ChunkCounts(none, none, *(self.mapped.entries(name, number) for name in (f"{order}.{RUNS}", of_voxels)))

    def _check_chunk(self, order: str, number: int) -> _ChunkCounts:
        """Of a chunk whose checksums and tables are checked."""
        of_voxels = self._names(order)
        names = [f"{order}.{COUNTS}", f"{order}.{RUNS}", *of_voxels.values()]
        first, last, parts = self.mapped.chunk_parts(number, names)
        counts = np.asarray(parts[f"{order}.{COUNTS}"]).reshape(*self._chunk_shape(order, first, last), 2)
        runs, voxels = counts[..., 0], counts[..., 1]
        n_runs, n_voxels = (int(of_each.sum(dtype=np.int64)) for of_each in (runs, voxels))
        table = next(iter(of_voxels.values()))
        if (n_runs, n_voxels) != (self.mapped.entries(f"{order}.{RUNS}", number), self.mapped.entries(table, number)):
            raise make_damage_error(self.path, "the counts do not fit the tables")
        axis, width = (2, self.shape_xyz[0]) if order == ROWS else (0, self.shape_xyz[1])
        validate.check_runs(axis, counts, parts[f"{order}.{RUNS}"], width)
        if self.classification == "pre":
            validate.check_records(axis, self._records(parts[of_voxels["records"]]), self.decoding)
        else:
            validate.check_scalars(axis, parts[of_voxels["scalars"]])
        return _ChunkCounts(runs, voxels, n_runs, n_voxels)

    def _chunk_shape(self, order: str, first: int, last: int) -> tuple[int, int]:
        """Slices and scanlines of the planes [``first``, ``last``) in an order."""
        nx, ny, _ = self.shape_xyz
        return (last - first, ny) if order == ROWS else (nx, last - first)

    def _records(self, stored: np.ndarray) -> np.ndarray:
        """Records as RunLengthVolume has them."""
        return stored.reshape(-1, *WORDS[self.record])

    def _of_axis(self, axis: int, chunks: list[_ChunkCounts]):
        """The tables of a principal axis from the counts of its order's chunks, one behind the other in the files."""
        order = ORDER_OF[axis]
        all_pointers, all_starts, n_runs, n_voxels = [], [], 0, 0
        for chunk in chunks:
            pointers, _ = scanline_pointers_from_counts(chunk.runs)
            starts, _ = pointers_from_counts(chunk.voxels)
            all_pointers.append(np.where(pointers < 0, -1, pointers.astype(np.int64) + n_runs))
            all_starts.append(starts + n_voxels)
            n_runs, n_voxels = n_runs + chunk.n_runs, n_voxels + chunk.n_voxels
        kind = np.int32 if n_runs <= np.iinfo(np.int32).max else np.int64
        columns = all_pointers, all_starts, [chunk.voxels for chunk in chunks]
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
    """The classification of a `.rle` file or folder: "pre" for all but one whose header says "post"."""
    try:
        return "post" if read_header(find_members(path)).get("classification") == "post" else "pre"
    except RleSplatError:  # opening it gives the error
        return "pre"


def open_volume(members) -> StoredVolume:
    """The StoredVolume of members, whose header is checked; RleSplatError if it is damaged."""
    volume, has_coarse = _open(members)
    return replace(volume, coarse=_open(members.inside(COARSE))[0]) if has_coarse else volume


def _open(members) -> tuple[StoredVolume, bool]:
    """The StoredVolume of members, without a coarse one, and whether there is a coarse one inside."""
    path, header = members.path, read_header(members)
    try:
        facts = validate.check_header(header)
        dtypes = validate.check_layout(header, facts)
        is_pre, decoding = header["classification"] == "pre", header.get("decoding")
        volume = StoredVolume(
            path, header["classification"], principal_axes=facts.pop("axes"), **facts,
            visible_voxels=header["visible"], nan_voxels=int(header["nan_voxels"]),
            values=None if is_pre else validate.check_values(header, dtypes),
            most_color=validate.check_color(header["most_color"] if is_pre else 0.0),
            decoding=None if decoding is None else np.array(decoding, np.float32),
            mapped=MappedTables(members, {**header, "dtypes": dtypes}),
            key=hashlib.blake2b(json.dumps(header, sort_keys=True).encode(), digest_size=16).hexdigest(),
        )  # fmt: skip
    except RleSplatError as problem:
        raise RleSplatError(f"Cannot read {path}: {problem}") from None
    except OSError as problem:
        raise unreadable(path, problem) from None
    except DAMAGE as problem:
        raise make_damage_error(path, f"its header says something impossible{reason_of(problem)}") from None
    return volume, bool(header.get(COARSE))
