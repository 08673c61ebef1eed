"""Write a folder of run-length tables (``encode.members``), of a volume that is larger than memory, chunk by chunk.

The tables of a chunk are appended to the files; so nothing that is on disk is ever written again, and a job that was
killed goes on behind the last chunk that its journal names.
"""

from __future__ import annotations

import json
import os
import shutil
import zlib
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from ..runtime.file_lock import only_one
from ..runtime.whole_files import rename, writing
from ..scene import RleSplatError
from .members import HEADER, JOURNAL, VERSION, bytes_of, make_header

STOPS = KeyboardInterrupt, GeneratorExit


def unfinished_path(path: Path) -> Path:
    """Where a folder is written until it is complete."""
    return path.with_name(f".{path.name}.unfinished")


def can_go_on(path) -> bool:
    """Whether a job that was stopped before it had written the folder ``path`` has left its chunks."""
    return (unfinished_path(Path(path)) / JOURNAL).is_file()


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
class Chunk:
    """What the journal says of a chunk.

    Attributes
    ----------
    planes : int
        One past its last plane.
    tables : dict of str to (int, int)
        Name of a table -> bytes and checksum of the chunk's part.
    facts : dict
        JSON-compatible, for the header.
    """

    planes: int
    tables: dict
    facts: dict


class FolderWriter:
    """Writes a folder of tables; as a context manager, it leaves nothing behind after an error.

    A job that the user stops leaves the chunks that are done, as one that was killed does, and as one does whose folder
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
        self.folder = unfinished_path(self.path)
        self._aside = self.path.with_name(f".{self.path.name}.replaced")  # where the folder that is replaced is moved
        self.chunks: list[Chunk] = []
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
            if kind is not None and self._job and not (goes_on and can_go_on(self.path) and self.chunks):
                shutil.rmtree(self.folder, ignore_errors=True)

    def begin(self, job: dict) -> None:
        """Begin a job, or go on with it if it was killed.

        ``job``: JSON-compatible, all that the tables depend on.
        """
        self._job = json.dumps({**job, "version": VERSION}, sort_keys=True)
        with writing(self.path):
            self.chunks = self._read_left_behind() or []
            if not self.chunks:
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
        return self.chunks[-1].planes if self.chunks else 0

    def _read_left_behind(self) -> list[Chunk] | None:
        """The chunks that the same job has written before it was killed, with nothing behind them in any file."""
        try:
            first, *lines = (self.folder / JOURNAL).read_text(encoding="utf-8").splitlines(keepends=True)
            lines = [line for line in lines if line.endswith("\n")]  # the last one may be cut
            chunks = [Chunk(**json.loads(line)) for line in lines]
        except (OSError, ValueError, TypeError):
            return None
        if first != self._job + "\n":
            return None
        sizes: Counter[str] = Counter()
        for chunk in chunks:
            sizes.update({name: size for name, (size, _) in chunk.tables.items()})
        for name, size in sizes.items():
            file = self.folder / name
            if not file.is_file() or file.stat().st_size < size:
                return None
            os.truncate(file, size)
        sizes[JOURNAL] = len("".join([first, *lines]).encode())
        os.truncate(self.folder / JOURNAL, sizes[JOURNAL])
        self._sizes = sizes
        return chunks

    def append(self, planes: int, tables: dict, facts: dict) -> None:
        """Append a chunk up to plane ``planes``; ``tables``: name -> array."""
        written = {}
        with writing(self.path):
            for name, array in tables.items():
                content = bytes_of(array)
                self._append(name, content)
                written[name] = len(content), zlib.crc32(content)
            chunk = Chunk(planes, written, facts)
            self._append(JOURNAL, (json.dumps(vars(chunk)) + "\n").encode())
        self.chunks.append(chunk)

    def _append(self, name: str, content) -> None:
        with open(self.folder / name, "ab") as file:
            if file.tell() != self._sizes[name]:  # on a disk without locks
                self._job = None  # the folder is the other command's
                raise self._other()
            file.write(content)
        self._sizes[name] += len(content)

    def finish(self, header: dict) -> int:
        """Write the header and give the folder its name; return its bytes."""
        with writing(self.path):
            shutil.rmtree(self._aside, ignore_errors=True)
            chunks = [[chunk.planes, chunk.tables] for chunk in self.chunks]
            (self.folder / HEADER).write_bytes(make_header({**header, "slabs": chunks}))
            size = 0
            for file in filter(Path.is_file, self.folder.rglob("*")):
                with open(file, "rb+") as stream:
                    os.fsync(stream.fileno())
                size += file.stat().st_size if file.name != JOURNAL else 0
            self._give_name()
            (self.path / JOURNAL).unlink()
            shutil.rmtree(self._aside, ignore_errors=True)
        return size

    def _give_name(self) -> None:
        """Rename the folder; RleSplatError that leaves the chunks where Windows refuses, because a file is open."""
        try:
            if self.path.exists():
                rename(self.path, self._aside)
            rename(self.folder, self.path)
        except PermissionError:
            self._is_held_up = True
            if not self.path.exists() and self._aside.exists():
                os.replace(self._aside, self.path)
            raise RleSplatError(
                f"Cannot write {self.path}, because a program shows it or reads its files; close it there, and run "
                "this again, which goes on where it ended."
            ) from None
