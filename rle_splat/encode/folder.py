"""The folder form of `.rle`: run-length tables of a volume that is larger than memory, appended slab by slab.

A folder holds a header and a few files of bare numbers. A slab of planes z is encoded as a volume of its own, and its
tables are appended to the files; so nothing that is on disk is ever written again, and a job that was killed goes on
behind the last slab that its journal names. The pointers of the whole volume follow from the number of runs and voxels
of each scanline when a folder is opened; a scanline may lie anywhere in the files.

    rows      scanlines along x, in the order of the planes: the tables of principal z, and of y, whose scanlines are
              the same
    across    scanlines along y, slab by slab: the tables of principal x

Files are mapped, not read. Each slab of each file has a checksum, which is compared, and its runs are validated, before
a kernel reads it.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import zlib
from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.file_lock import only_one
from ..runtime.memory import bytes_text
from ..runtime.whole_files import writing
from ..scene import RleSplatError
from .tables import RunTables

FORMAT, VERSION = "rle-splat folder", 1
HEADER, JOURNAL = "header.json", "journal"
COARSE = "coarse"  # a folder of tables inside: the same volume in larger voxels
COUNTS, RUNS = "counts", "runs"  # tables of each order; the others hold one entry for each voxel
ROWS, ACROSS = "rows", "across"  # orders
ORDER_OF = {2: ROWS, 1: ROWS, 0: ACROSS}  # principal axis -> order of its scanlines
LITTLE = "<"
MOST_HEADER = 1 << 28  # bytes
STOPS = KeyboardInterrupt, GeneratorExit


def unfinished(path: Path) -> Path:
    """Where a folder is written until it is complete."""
    return path.with_name(f".{path.name}.unfinished")


def can_go_on(path) -> bool:
    """Whether a job that was stopped before it had written the folder ``path`` has left its slabs."""
    return (unfinished(Path(path)) / JOURNAL).is_file()


def is_folder_form(path) -> bool:
    """Whether a path is a folder of tables."""
    return os.path.isfile(Path(path) / HEADER)


def _check_output(path: Path) -> None:
    """RleSplatError if a folder of tables cannot be written to ``path``; another folder of tables may be there."""
    if path.exists() and not is_folder_form(path):
        raise RleSplatError(f"Cannot write {path}: something else has this name; choose another name, or remove it.")
    if not path.parent.is_dir():
        raise RleSplatError(f"Cannot write {path}: the folder {path.parent} does not exist; make it first.")


@dataclass(frozen=True)
class Slab:
    """What the journal says of a slab.

    Attributes
    ----------
    planes : int
        One past its last plane.
    tables : dict of str to (int, int)
        Name of a table -> bytes and checksum of the slab's part.
    facts : dict
        JSON-compatible, for the header.
    """

    planes: int
    tables: dict
    facts: dict


class FolderWriter:
    """Writes a folder of tables; as a context manager, it leaves nothing behind after an error.

    A job that the user stops leaves the slabs that are done, as one that was killed does, and as one does whose folder
    another program holds. While one writes, another one for the same folder is refused.

    Parameters
    ----------
    path : str or Path
        The folder. It appears under this name when it is complete.

    Raises
    ------
    RleSplatError
        On entering, if nothing can be written there.
    """

    def __init__(self, path):
        self.path = Path(path)
        self.folder = unfinished(self.path)
        self._aside = self.path.with_name(f".{self.path.name}.replaced")  # where the folder that is replaced is moved
        self.slabs: list[Slab] = []
        self._job: str | None = None  # whose folder it is, from begin on
        self._sizes: Counter[str] = Counter()  # bytes of each file
        self._open = ExitStack()
        self._is_held_up = False  # whether all is done but for the folder that is replaced

    def __enter__(self) -> FolderWriter:
        _check_output(self.path)
        with ExitStack() as held, writing(self.path):
            if not held.enter_context(only_one(self.path.with_name(f".{self.path.name}.lock"))):
                raise self._other()
            if self._aside.exists() and not self.path.exists():  # of a command that was killed while it replaced it
                os.replace(self._aside, self.path)
            self._open = held.pop_all()
        return self

    def __exit__(self, kind, _problem, _traceback):
        goes_on = self._is_held_up or (kind is not None and issubclass(kind, STOPS))
        with self._open:
            if kind is not None and self._job and not (goes_on and can_go_on(self.path) and self.slabs):
                shutil.rmtree(self.folder, ignore_errors=True)

    def begin(self, job: dict) -> None:
        """Begin a job, or go on with it if it was killed.

        ``job``: JSON-compatible, all that the tables depend on.
        """
        self._job = json.dumps({**job, "version": VERSION}, sort_keys=True)
        with writing(self.path):
            self.slabs = self._left_behind() or []
            if not self.slabs:
                self._begin_anew()

    def _begin_anew(self) -> None:
        """Make the folder anew; after an error there is none."""
        self._sizes.clear()
        shutil.rmtree(self.folder, ignore_errors=True)
        try:
            self.folder.mkdir()
            self._append(JOURNAL, (self._job + "\n").encode())
        except OSError:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise

    def _other(self) -> RleSplatError:
        return RleSplatError(
            f"Cannot write {self.path}: another command is writing there; wait until it has ended, or choose another "
            "name."
        )

    @property
    def planes(self) -> int:
        """Planes that are done."""
        return self.slabs[-1].planes if self.slabs else 0

    def _left_behind(self) -> list[Slab] | None:
        """The slabs that the same job has written before it was killed, with nothing behind them in any file."""
        try:
            first, *lines = (self.folder / JOURNAL).read_text(encoding="utf-8").splitlines(keepends=True)
            lines = [line for line in lines if line.endswith("\n")]  # the last one may be cut
            slabs = [Slab(**json.loads(line)) for line in lines]
        except (OSError, ValueError, TypeError):
            return None
        if first != self._job + "\n":
            return None
        sizes: Counter[str] = Counter()
        for slab in slabs:
            sizes.update({name: size for name, (size, _) in slab.tables.items()})
        for name, size in sizes.items():
            file = self.folder / name
            if not file.is_file() or file.stat().st_size < size:
                return None
            os.truncate(file, size)
        sizes[JOURNAL] = len("".join([first, *lines]).encode())
        os.truncate(self.folder / JOURNAL, sizes[JOURNAL])
        self._sizes = sizes
        return slabs

    def append(self, planes: int, tables: dict, facts: dict) -> None:
        """Append a slab up to plane ``planes``; ``tables``: name -> array."""
        written = {}
        with writing(self.path):
            for name, array in tables.items():
                content = _bytes(array.astype(array.dtype.newbyteorder(LITTLE), copy=False))
                self._append(name, content)
                written[name] = len(content), zlib.crc32(content)
            slab = Slab(planes, written, facts)
            self._append(JOURNAL, (json.dumps(vars(slab)) + "\n").encode())
        self.slabs.append(slab)

    def _append(self, name: str, content) -> None:
        with open(self.folder / name, "ab") as file:
            if file.tell() != self._sizes[name]:  # on a disk without locks
                self._job = None  # the folder is the other command's
                raise self._other()
            file.write(content)
        self._sizes[name] += len(content)

    def finish(self, header: dict, joined=()) -> int:
        """Write the header and give the folder its name; return its bytes.

        ``joined``: tables whose parts NAME.0, NAME.1, ... become one file, one part after the other.
        """
        with writing(self.path):
            shutil.rmtree(self._aside, ignore_errors=True)
            self._check_is_replaceable()
            for name in joined:
                self._join(name)
            slabs = [[slab.planes, slab.tables] for slab in self.slabs]
            content = json.dumps({"format": FORMAT, "version": VERSION, **header, "slabs": slabs})
            (self.folder / HEADER).write_text(f"{zlib.crc32(content.encode()):08x}{content}", encoding="utf-8")
            (self.folder / JOURNAL).unlink()
            size = 0
            for file in filter(Path.is_file, self.folder.rglob("*")):
                with open(file, "rb+") as stream:
                    os.fsync(stream.fileno())
                size += file.stat().st_size
            if self.path.exists():
                os.replace(self.path, self._aside)
            os.replace(self.folder, self.path)
            shutil.rmtree(self._aside, ignore_errors=True)
        return size

    def _check_is_replaceable(self) -> None:
        """RleSplatError that leaves the slabs, if the folder that is there cannot be renamed: Windows holds mapped
        files."""
        if not self.path.exists():
            return
        try:
            os.replace(self.path, self._aside)
        except PermissionError:
            self._is_held_up = True
            raise RleSplatError(
                f"Cannot replace {self.path}, because a program shows it; close it there, and run this again, which "
                "goes on where it ended."
            ) from None
        os.replace(self._aside, self.path)

    def _join(self, name: str) -> None:
        parts = sorted(self.folder.glob(f"{name}.*"))
        with open(self.folder / name, "wb") as target:
            for part in parts:
                with open(part, "rb") as source:
                    shutil.copyfileobj(source, target, 1 << 24)
        for part in parts:
            part.unlink()


def _bytes(array: np.ndarray) -> memoryview:
    """The bytes of an array."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def counts_of(tables: RunTables) -> np.ndarray:
    """(n_slices, n_scanlines, 2) uint32: runs and voxels of each scanline."""
    pointers = tables.scanline_pointers.reshape(-1)
    counts = np.zeros((len(pointers), 2), np.uint32)
    filled = pointers >= 0
    counts[filled, 0] = np.diff(np.append(pointers[filled].astype(np.int64), len(tables.runs)))
    counts[:, 1] = np.diff(np.append(tables.scanline_data_pointers.reshape(-1), tables.n_voxels))
    return counts.reshape(*tables.scanline_pointers.shape, 2)


def read_header(path) -> dict:
    """The header of a folder; RleSplatError if it is missing or damaged."""
    file = Path(path) / HEADER
    try:
        with open(file, "rb") as stream:  # a buffer of so many bytes is made whatever the size of the file
            text = stream.read(min(os.fstat(stream.fileno()).st_size, MOST_HEADER)).decode()
    except OSError as problem:
        if os.path.isfile(Path(path) / JOURNAL):  # False without rights, where Path.is_file raises
            raise RleSplatError(
                f"{path} is not complete: its encoding was interrupted. Encode the volume again with the same command, "
                "which goes on where it was."
            ) from None
        raise RleSplatError(f"Cannot read {path}: {problem.strerror}; check the path and its permissions.") from None
    except ValueError:
        raise damaged(path, "its header is not text") from None
    try:
        header = json.loads(text[8:]) if int(text[:8], 16) == zlib.crc32(text[8:].encode()) else None
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise damaged(path, "its header is not complete")
    if header.get("version") != VERSION:
        raise RleSplatError(
            f"The folder {path} has the format version {header.get('version')}, and this program reads version "
            f"{VERSION}; encode the volume again."
        )
    return header


def damaged(path, what: str) -> RleSplatError:
    """The error for a folder whose files do not fit together; ``what``: a clause."""
    return RleSplatError(f"The tables in {Path(path).name} are damaged: {what}; encode the volume again.")


class MappedTables:
    """The files of a folder, mapped read-only.

    Parameters
    ----------
    path : Path
    header : dict
        With ``slabs`` and ``dtypes`` (name of a table -> dtype and words of an entry).
    """

    def __init__(self, path, header: dict):
        self.path, self._dtypes = Path(path), header["dtypes"]
        self.ends = [0, *(int(planes) for planes, _ in header["slabs"])]
        self._slabs = [tables for _, tables in header["slabs"]]
        self._mapped: dict[str, np.ndarray] = {}

    def has(self, name: str) -> bool:
        """Whether there is such a table."""
        return name in self._dtypes

    def table(self, name: str) -> np.ndarray:
        """A table: (n,) or (n, words); the joined parts of one, (parts, n)."""
        if name not in self._mapped:
            kind, words, parts = self._dtypes[name]
            mapped = self._map(name, np.dtype(LITTLE + kind))
            shape = (parts, -1) if parts else (-1, words) if words else (-1,)
            self._mapped[name] = mapped.reshape(shape)
        return self._mapped[name]

    def check_sizes(self) -> None:
        """RleSplatError if a mapped file was removed or cut since: a read beyond its end would end the program."""
        for name in self._mapped:
            with self._reading(name):
                self._checked_size(name)

    def _checked_size(self, name: str) -> int:
        """Bytes of a file, which are those of its slabs."""
        names = [f"{name}.{part}" for part in range(self._dtypes[name][2])] or [name]
        size = sum(int(slab[one][0]) for slab in self._slabs for one in names)
        held = (self.path / name).stat().st_size
        if held != size:
            raise damaged(self.path, f"{name} has {bytes_text(held)} instead of {bytes_text(size)}")
        return size

    def _map(self, name: str, dtype: np.dtype) -> np.ndarray:
        with self._reading(name):
            if self._checked_size(name) == 0:  # an empty file cannot be mapped
                return np.empty(0, dtype)
            return np.asarray(np.memmap(self.path / name, dtype=dtype, mode="r"))

    @contextmanager
    def _reading(self, name: str):
        """Context manager: a failure of the system becomes a RleSplatError."""
        try:
            yield
        except FileNotFoundError:
            raise damaged(self.path, f"{name} is missing") from None
        except OSError as problem:
            raise RleSplatError(
                f"Cannot read {self.path / name}: {problem.strerror}; check its permissions."
            ) from None

    def entries(self, name: str, number: int) -> int:
        """Entries of slab ``number`` in a table."""
        kind, words, _ = self._dtypes[name]
        return self._slab_bytes(name, number) // (np.dtype(kind).itemsize * max(words, 1))

    def _slab_bytes(self, name: str, number: int) -> int:
        """Bytes of a slab in a table, of one piece of a joined one."""
        return int(self._slabs[number][f"{name}.0" if self._dtypes[name][2] else name][0])

    def slab_parts(self, number: int, names):
        """(first plane, end, name -> the slab's part of that table) of slab ``number``, its checksums compared."""
        first, last = self.ends[number : number + 2]
        parts = {}
        for name in names:
            table, (_, words, pieces) = self.table(name), self._dtypes[name]
            begin = sum(self._slab_bytes(name, before) for before in range(number)) // table.itemsize
            end = begin + self._slab_bytes(name, number) // table.itemsize
            for piece, row in enumerate(table.reshape(max(pieces, 1), -1)):
                part = row[begin:end]
                if zlib.crc32(_bytes(part)) != self._slabs[number][f"{name}.{piece}" if pieces else name][1]:
                    raise damaged(self.path, f"the checksum of {name} does not fit in planes {first} to {last - 1}")
            parts[name] = part.reshape(-1, words) if words else part
        return first, last, parts


def words_of_entry(array: np.ndarray) -> list:
    """[dtype, words of an entry (0 for one number), parts] of a table, for the header."""
    return [array.dtype.str[1:], math.prod(array.shape[1:]) if array.ndim > 1 else 0, 0]
