"""Reader and writer of raw voxels, x fastest, then y, then z. The file size is checked before anything is read."""

from __future__ import annotations

import gzip
import math
import os
from pathlib import Path

import numpy as np

from ..runtime.memory import refuse_beyond
from ..scene import RleSplatError
from ..volume.volume import Volume
from .guess import guess_raw
from .layout import (
    CHUNK_BYTES,
    DEFAULT_COUNT_LIMIT,
    UNREADABLE,
    RawLayout,
    checked_scale,
    checked_spacing,
    content_bytes,
    fitting,
    is_gzip,
    unreadable,
)  # fmt: skip

COUNT_AT_LEAST = 1 << 28  # bytes; counting the unpacked size stops beyond this and beyond four times the expected size
DEFLATE_LIMIT = 1032  # deflate cannot expand data more than this many times


def _wrong_size(path, layout: RawLayout, actual: int | None, limit: int = 0) -> RleSplatError:
    """Error that names both sizes and the layouts that fit. ``actual`` None: more than ``limit`` bytes."""
    name, unpacked = Path(path).name, " unpacked" if is_gzip(path) else ""
    needs = f"{layout} need {layout.total_bytes} bytes"
    if actual is None:
        return RleSplatError(f"{name} holds more than {limit} bytes{unpacked}, but {needs}; check shape and type.")
    fits = list(fitting(layout, actual))[:3]
    fits += [other for other in guess_raw(path).candidates if other not in fits][: 4 - len(fits)]
    text = "; or ".join(str(other) for other in fits)
    return RleSplatError(
        f"{name} holds {actual} bytes{unpacked}, but {needs}; "
        + (f"these would fit: {text}." if text else "check the shape, the type and the header's length.")
    )


def _wrong_gzip_size(path, layout: RawLayout) -> RleSplatError:
    """As ``_wrong_size``, for a gzip file whose size is not known yet."""
    limit = max(COUNT_AT_LEAST, 4 * min(layout.total_bytes, DEFAULT_COUNT_LIMIT))
    return _wrong_size(path, layout, content_bytes(path, limit), limit)


def read_raw(
    path, shape, dtype, byte_order="little", header_bytes=0, spacing=None, slope=1.0, intercept=0.0,
    unit="mm", value_unit=None, modality=None, name=None, remarks=(),
) -> Volume:
    """Read raw voxels.

    Parameters
    ----------
    path : str or Path
        Unpacked while reading if the name ends in .gz.
    shape : (nx, ny, nz)
    dtype : str
        One of STORED_TYPES.
    byte_order : {"little", "big"}
    header_bytes : int
        Bytes before the first voxel.
    spacing : (sx, sy, sz) or None
        Distance between voxel centers in ``unit``. None is taken as 1 x 1 x 1, with a remark.
    slope, intercept : float
        Physical value = slope * stored + intercept.
    unit : str
        Unit of length.
    value_unit, modality : str or None
        See Volume.
    name : str or None
        Name of the volume; None for the file's name.
    remarks : sequence of str

    Returns
    -------
    Volume
        Its affine is the spacing alone: the center of voxel (0, 0, 0) is at the origin. An unpacked file in this
        machine's byte order is memory-mapped read-only; other files are copied.

    Raises
    ------
    RleSplatError
        If the file does not have the size of the layout, or does not fit into memory. The size is checked first, and
        no more memory is allocated than the layout needs.
    """
    layout = RawLayout(shape, dtype, byte_order, header_bytes)
    remarks = tuple(remarks)
    if spacing is None:
        remarks += (f"No spacing was given; 1 x 1 x 1 {unit} is assumed.",)
        spacing = (1.0, 1.0, 1.0)
    spacing = checked_spacing(spacing)
    slope, intercept = checked_scale(slope, intercept)
    read = _read_gzip if is_gzip(path) else _read_plain
    try:
        voxels = read(path, layout)
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None
    except MemoryError:
        raise RleSplatError(f"{layout} do not fit into memory; crop or downsample the volume.") from None
    return Volume(
        voxels=voxels, affine=np.diag((*spacing, 1.0)), unit=unit, slope=slope, intercept=intercept,
        value_unit=value_unit, modality=modality, name=name or _plain_name(path), remarks=remarks,
    )


def _plain_name(path) -> str:
    """The file's name without its suffixes."""
    name = Path(path).name
    return name.split(".")[0] or name


def _refuse_beyond_memory(layout: RawLayout) -> None:
    """Refuse a layout that does not fit into free memory."""
    refuse_beyond(layout.voxel_bytes, f"{layout} need", "crop or downsample the volume")


def _read_plain(path, layout: RawLayout) -> np.ndarray:
    """Voxels (nz, ny, nx) of a file that is not packed."""
    actual = os.path.getsize(path)
    if actual != layout.total_bytes:
        raise _wrong_size(path, layout, actual)
    grid = layout.shape[::-1]
    native = layout.file_dtype.isnative
    aligned = layout.header_bytes % layout.file_dtype.alignment == 0
    if native and aligned:  # kernels need aligned arrays; other headers cost a copy
        mapped = np.memmap(path, dtype=layout.file_dtype, mode="r", offset=layout.header_bytes, shape=grid)
        return np.asarray(mapped)  # a plain array; it keeps the mapping alive
    _refuse_beyond_memory(layout)
    with open(path, "rb") as stream:
        stream.seek(layout.header_bytes)
        voxels = np.fromfile(stream, dtype=layout.file_dtype, count=math.prod(grid)).reshape(grid)
    return _native(voxels)


def _read_gzip(path, layout: RawLayout) -> np.ndarray:
    """Voxels (nz, ny, nx) of a gzip file."""
    if layout.total_bytes > os.path.getsize(path) * DEFLATE_LIMIT:  # impossible; report the true size, allocate nothing
        raise _wrong_gzip_size(path, layout)
    _refuse_beyond_memory(layout)
    voxels = np.empty(layout.shape[::-1], dtype=layout.file_dtype)
    target = memoryview(voxels.reshape(-1).view(np.uint8))
    with gzip.open(path, "rb") as stream:
        skipped = 0
        while skipped < layout.header_bytes:
            chunk = stream.read(min(CHUNK_BYTES, layout.header_bytes - skipped))
            if not chunk:
                raise _wrong_size(path, layout, skipped)
            skipped += len(chunk)
        filled = 0
        while filled < len(target):
            count = stream.readinto(target[filled : filled + CHUNK_BYTES])
            if not count:
                raise _wrong_size(path, layout, skipped + filled)
            filled += count
        if stream.read(1):
            raise _wrong_gzip_size(path, layout)
    return _native(voxels)


def _native(voxels: np.ndarray) -> np.ndarray:
    """Convert to this machine's byte order, in place."""
    if voxels.dtype.isnative:
        return voxels
    return voxels.byteswap(inplace=True).view(voxels.dtype.newbyteorder("="))


def write_raw(volume: Volume, path) -> dict:
    """Write the stored voxels, little-endian, x fastest; packed with gzip if the name ends in .gz.

    Parameters
    ----------
    volume : Volume
    path : str or Path

    Returns
    -------
    dict
        Options of ``read_volume`` that are needed to read the file back, since a raw file stores none of them.
    """
    opener = gzip.open if is_gzip(path) else open
    little = volume.voxels.dtype.newbyteorder("<")
    with opener(path, "wb") as stream:
        for plane in volume.voxels:
            stream.write(np.ascontiguousarray(plane, dtype=little).data)
    options = dict(
        shape=volume.shape_xyz, dtype=volume.voxels.dtype.name, byte_order="little",
        spacing=tuple(float(s) for s in volume.spacing), slope=volume.slope, intercept=volume.intercept,
    )
    return {**options, "unit": volume.unit, "value_unit": volume.value_unit, "modality": volume.modality}
