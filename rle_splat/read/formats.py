"""The table of volume formats, used by the command line, the import dialog and the docs.

To add a format, add a row: its suffixes, a reader that takes a path and named options, and optionally a writer.
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

MEANING_OPTIONS = ("slope", "intercept", "unit", "value_unit", "modality")  # meaning of values, for every format
LAYOUT_OPTIONS = ("shape", "dtype", "byte_order", "header_bytes")


@dataclass(frozen=True)
class Format:
    """One row of the table.

    Attributes
    ----------
    name : str
    suffixes : tuple of str
        With the leading dot, lower case.
    description : str
    options : tuple of str
        Options of ``read_volume`` that the reader takes.
    reader : callable
        ``reader(path, **options) -> Volume``.
    writer : callable or None
        ``writer(volume, path) -> dict``, the options that are needed to read the file back; None if the format
        cannot be written.
    """

    name: str
    suffixes: tuple
    description: str
    options: tuple
    reader: Callable
    writer: Callable | None = None


def _read_raw(path, shape=None, dtype=None, byte_order=None, header_bytes=None, spacing=None, **meaning) -> Volume:
    """Read raw voxels; options that are None are guessed (``guess.layout_for``)."""
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
    """All suffixes that can be read (or written, with ``writable``), in the table's order."""
    return tuple(s for entry in FORMATS if entry.writer or not writable for s in entry.suffixes)


def format_of(path) -> Format | None:
    """The row with the longest suffix that ends the file's name; None if there is none."""
    name = Path(path).name.lower()
    fits = [(len(s), entry) for entry in FORMATS for s in entry.suffixes if name.endswith(s)]
    return max(fits, key=lambda pair: pair[0])[1] if fits else None


def read_volume(path, **options) -> Volume:
    """Read a volume file.

    Parameters
    ----------
    path : str or Path
        The format follows from the suffix. A file with an unknown suffix is read as raw voxels if ``shape`` is given.
    **options
        An option that is None counts as not given.

        Raw voxels: ``shape`` (nx, ny, nz), ``dtype``, ``byte_order``, ``header_bytes``, ``spacing`` (sx, sy, sz).
        OpenVDB: ``grid``, the name of a grid.
        All formats: ``slope`` and ``intercept`` (physical = slope * stored + intercept), ``unit`` of length,
        ``value_unit`` ("HU"), ``modality``.

    Returns
    -------
    Volume

    Raises
    ------
    RleSplatError
        If the file cannot be read, or an option is unknown or does not apply to the format.
    """
    path = Path(path)
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in OPTIONS:
            raise RleSplatError(f"There is no volume option {name!r}; use one of {', '.join(OPTIONS)}.")
    if not path.exists():
        raise RleSplatError(f"There is no file {path}; check the path.")
    if path.is_dir():
        raise RleSplatError(f"{path} is a folder; give a volume file ({', '.join(suffixes())}).")
    chosen = format_of(path)
    if chosen is None and "shape" in given:
        chosen = FORMATS[0]
    if chosen is None:
        raise RleSplatError(
            f"{path.name} has no suffix of a known format ({', '.join(suffixes())}); "
            "to read it as raw voxels, give its shape and dtype."
        )
    for name in given:
        if name not in chosen.options:
            raise RleSplatError(f"The option {name} does not apply to {chosen.name} files; leave it out.")
    return chosen.reader(path, **given)


def write_volume(volume: Volume, path) -> dict:
    """Write a volume file.

    Parameters
    ----------
    volume : Volume
    path : str or Path
        The format follows from the suffix. The file appears under this name only when it is complete.

    Returns
    -------
    dict
        Options of ``read_volume`` that are needed to read the file back.

    Raises
    ------
    RleSplatError
        If the suffix is of no writable format or the file cannot be written.
    """
    path = Path(path)
    chosen = format_of(path)
    if chosen is None or chosen.writer is None:
        raise RleSplatError(
            f"{path.name} has no suffix of a writable format; end its name in {', '.join(suffixes(writable=True))}."
        )
    with staged(path) as unfinished:
        return chosen.writer(volume, unfinished)


@contextmanager
def staged(path: Path):
    """Context manager: a temporary path beside ``path`` with the same suffixes.

    It is renamed to ``path`` on success and removed otherwise.
    """
    unfinished = path.with_name(f".{secrets.token_hex(4)}-{path.name}")
    try:
        yield unfinished
        os.replace(unfinished, path)
    except OSError as problem:
        raise RleSplatError(f"Cannot write {path}: {problem.strerror or problem}; choose another location.") from None
    finally:
        unfinished.unlink(missing_ok=True)
