"""Write and read `.rle` files: run-length tables with their position in space and their origin (``encode.members``)."""

import zlib
from os import PathLike

import numpy as np

from ..runtime.whole_files import whole_file
from ..scene import RleSplatError
from ..scene.checks import check_first
from .members import (
    ACROSS,
    COUNTS,
    HEADER,
    ROWS,
    RUNS,
    bytes_of,
    describe_tables,
    find_members,
    make_header,
    words_of_entry,
    write_file,
)
from .records import words_of
from .stored import StoredVolume, open_volume
from .tables import RunLengthVolume, counts_of, pointers_from_counts


def write_encoded(stored: StoredVolume, path: str | PathLike) -> None:
    """Write a `.rle` file. An existing file is replaced only when the new one is complete.

    Parameters
    ----------
    stored : StoredVolume
        Pre-classified voxels, such as ``encode`` returns.
    path : str or Path
        The file, which should end in .rle.

    Raises
    ------
    RleSplatError
        If the voxels are post-classified, the tables are damaged, or the file cannot be written.
    """
    check_first(stored, StoredVolume, "write_encoded(stored, path)")
    with whole_file(path) as part:
        write(part, stored)


def write(path, stored: StoredVolume) -> None:
    """As ``write_encoded``, in place; raises OSError."""
    if stored.classification != "pre":
        raise RleSplatError(f"Post-classified tables are not saved again; copy {stored.path} instead.")
    axes, tables = stored.axes, {}
    for order, number in ((ROWS, 2 if 2 in axes else 1), (ACROSS, 0)):
        if number in axes:
            tables |= {f"{order}.{name}": array for name, array in _in_order(axes[number]).items()}
    members = {name: bytes_of(array) for name, array in tables.items()}
    header = describe_tables(
        stored, classification="pre", model=stored.model, record=stored.record, axes=axes,
        unit_length=stored.unit_length, transfer_function=stored.transfer_function, lighting=stored.lighting,
        source=stored.source,
    )  # fmt: skip
    header |= {
        "visible": stored.visible_voxels, "nan_voxels": stored.nan_voxels, "most_color": stored.most_color,
        "decoding": None if stored.decoding is None else stored.decoding.tolist(),
        "dtypes": {name: words_of_entry(array) for name, array in tables.items()},
        "slabs": [
            [stored.shape_xyz[2], {name: (len(content), zlib.crc32(content)) for name, content in members.items()}]
        ],
    }  # fmt: skip
    write_file(path, {HEADER: make_header(header), **members})


def _in_order(tables: RunLengthVolume) -> dict[str, np.ndarray]:
    """The tables of an order by name, from those of a principal axis: scanlines follow each other in the planes."""
    counts = counts_of(tables)
    places = tables.scanline_pointers, tables.scanline_data_pointers
    if tables.axis == 1:
        counts, *places = (np.ascontiguousarray(array.swapaxes(0, 1)) for array in (counts, *places))
    runs, records = (
        _gather(array, starts, counts[..., number])
        for number, (array, starts) in enumerate(zip((tables.runs, words_of(tables.voxel_data)), places))
    )
    return {COUNTS: counts.reshape(-1, 2), RUNS: runs, "records": records}


def _gather(array: np.ndarray, starts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Entries of scanlines that begin at ``starts``, one scanline after the other."""
    begins, total = pointers_from_counts(counts)
    filled = counts > 0
    if total == len(array) and np.array_equal(starts[filled], begins[filled]):
        return array
    shift = (starts.astype(np.int64) - begins)[filled]
    return array[np.repeat(shift, counts[filled]) + np.arange(total)]


def read_encoded(path: str | PathLike) -> StoredVolume:
    """Open a `.rle` file or folder. Its header is checked now, its tables when they are needed.

    Parameters
    ----------
    path : str or Path
        What ``write_encoded``, ``encode_folder`` or the command ``encode`` has written.

    Returns
    -------
    StoredVolume
        Can be the volume of a Scene.

    Raises
    ------
    RleSplatError
        If the file cannot be read or is not a `.rle` file.
    """
    return open_volume(find_members(path))
