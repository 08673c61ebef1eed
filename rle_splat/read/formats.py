"""The one table of volume formats: the command line, the import dialog and the docs all read it.

Another format is one more row: its suffixes, a reader that takes a path and named options, perhaps a writer.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..scene import RleSplatError
from ..volume.volume import Volume
from .guess import layout_for
from .raw import read_raw, write_raw
from .vdb import read_vdb, write_vdb

MEANING_OPTIONS = ("slope", "intercept", "unit", "value_unit", "modality")  # what numbers mean, for every format
LAYOUT_OPTIONS = ("shape", "dtype", "byte_order", "header_bytes")


@dataclass(frozen=True)
class Format:
    """One row: ``reader(path, **options) -> Volume``; ``writer(volume, path) -> dict`` of the options with which to
    read the file back, or None where we only read.  ``options`` are the reader's names, as in ``read_volume``."""

    name: str
    suffixes: tuple
    description: str
    options: tuple
    reader: Callable
    writer: Callable | None = None


def _read_raw(path, shape=None, dtype=None, byte_order=None, header_bytes=None, spacing=None, **meaning) -> Volume:
    layout, remarks, named_spacing = layout_for(path, shape, dtype, byte_order, header_bytes)
    return read_raw(
        path, layout.shape, layout.dtype, layout.byte_order, layout.header_bytes,
        spacing=named_spacing if spacing is None else spacing, remarks=remarks, **meaning,
    )  # fmt: skip


FORMATS = (
    Format(
        "raw", (".raw", ".raw.gz", ".bin", ".bin.gz", ".dat", ".dat.gz"),
        "bare voxels, x fastest, any number type and byte order, gzip if the name ends in .gz",
        (*LAYOUT_OPTIONS, "spacing", *MEANING_OPTIONS), _read_raw, write_raw,
    ),
    Format(
        "OpenVDB", (".vdb",), "one grid of numbers of an OpenVDB file, with its transform and background",
        ("grid", *MEANING_OPTIONS), read_vdb, write_vdb,
    ),
)  # fmt: skip
OPTIONS = tuple(dict.fromkeys(name for entry in FORMATS for name in entry.options))


def suffixes(writable: bool = False) -> tuple:
    """Every suffix that is read (or written), in the table's order."""
    return tuple(s for entry in FORMATS if entry.writer or not writable for s in entry.suffixes)


def format_of(path) -> Format | None:
    """The row whose suffix ends the file's name (the longest that does), or None."""
    name = Path(path).name.lower()
    fits = [(len(s), entry) for entry in FORMATS for s in entry.suffixes if name.endswith(s)]
    return max(fits, key=lambda pair: pair[0])[1] if fits else None


def read_volume(path, **options) -> Volume:
    """Read the volume at ``path``; an option that is None counts as not given.

    For raw: ``shape`` (nx, ny, nz), ``dtype``, ``byte_order``, ``header_bytes``, ``spacing`` (sx, sy, sz).  For
    OpenVDB: ``grid``.  For all: ``slope`` and ``intercept`` (physical = slope * stored + intercept), ``unit`` of
    length, ``value_unit`` ("HU"), ``modality``.  A file with an unknown suffix is raw when its shape is given.
    Raises RleSplatError with one sentence on anything that does not fit.
    """
    path = Path(path)
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in OPTIONS:
            raise RleSplatError(f"There is no volume option {name!r}; there are {', '.join(OPTIONS)}.")
    if not path.exists():
        raise RleSplatError(f"There is no file {path}; check the path.")
    if path.is_dir():
        raise RleSplatError(f"{path} is a folder; give a volume file ({', '.join(suffixes())}).")
    chosen = format_of(path)
    if chosen is None and "shape" in given:
        chosen = FORMATS[0]
    if chosen is None:
        raise RleSplatError(
            f"{path.name} is of no format that is read ({', '.join(suffixes())}); "
            "to read it as raw voxels give its shape and dtype."
        )
    for name in given:
        if name not in chosen.options:
            raise RleSplatError(f"The option {name} does not apply to {chosen.name} files; leave it out.")
    return chosen.reader(path, **given)


def write_volume(volume: Volume, path) -> dict:
    """Write ``volume`` in the format of the path's suffix; returns the options with which to read it back.

    The file appears under its name only when it is complete: a stopped or failed run leaves nothing half-made.
    """
    path = Path(path)
    chosen = format_of(path)
    if chosen is None or chosen.writer is None:
        raise RleSplatError(
            f"{path.name} is of no format that is written; end its name in {', '.join(suffixes(writable=True))}."
        )
    with staged(path) as unfinished:
        return chosen.writer(volume, unfinished)


@contextmanager
def staged(path: Path):
    """A temporary name beside ``path`` with the same suffixes, moved onto it on success and removed otherwise."""
    unfinished = path.with_name(f".{secrets.token_hex(4)}-{path.name}")
    try:
        yield unfinished
        os.replace(unfinished, path)
    except OSError as problem:
        raise RleSplatError(f"Cannot write {path}: {problem.strerror or problem}; choose another place.") from None
    finally:
        unfinished.unlink(missing_ok=True)
