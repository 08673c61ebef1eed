"""Reader and writer of raw voxels, x fastest, then y, then z. The file size is checked before anything is read."""

import os
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..volume.volume import Volume
from . import streaming
from .guess import guess_raw, layout_steps
from .layout import (
    DEFAULT_COUNT_LIMIT,
    UNREADABLE,
    RawLayout,
    check_spacing,
    content_bytes,
    fitting,
    is_gzip,
    unreadable,
)  # fmt: skip

LAYOUT_OPTIONS = ("shape", "dtype", "byte_order", "header_bytes")
COUNT_AT_LEAST = 1 << 28  # bytes; counting the unpacked size stops beyond this and beyond four times the expected size


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


def read_raw_steps(
    path, shape=None, dtype=None, byte_order=None, header_bytes=None, spacing=None, unit="mm",
):  # fmt: skip
    """Generator of Progress: read raw voxels; return the Volume.

    Parameters
    ----------
    path : str or Path
        Unpacked while reading if the name ends in .gz.
    shape : (nx, ny, nz) or None
    dtype : str or None
        One of STORED_TYPES.
    byte_order : {"little", "big"} or None
    header_bytes : int or None
        Bytes before the first voxel. What is None is guessed (``guess.layout_steps``).
    spacing : (sx, sy, sz) or None
        Distance between voxel centers in ``unit``. None for the spacing in the file's name, or 1 x 1 x 1 with a
        remark.
    unit : str
        Unit of length.

    Returns
    -------
    Volume
        Its affine is the spacing alone: the center of voxel (0, 0, 0) is at the origin. A large unpacked file
        in this machine's byte order is memory-mapped read-only; other files are copied.

    Raises
    ------
    RleSplatError
        If the file does not have the size of the layout, or does not fit into memory. The size is checked first, and
        no more memory is allocated than the layout needs.
    """
    layout, remarks, named = yield from layout_steps(path, shape, dtype, byte_order, header_bytes)
    spacing = named if spacing is None else spacing
    if spacing is None:
        remarks += (f"No spacing was given; 1 × 1 × 1 {unit} is assumed.",)
        spacing = (1.0, 1.0, 1.0)
    spacing = check_spacing(spacing)
    doing = f"reading {Path(path).name} ({streaming.grid_text(layout.shape, layout.file_dtype)})"
    yield Progress(0.0, doing)
    try:
        voxels = yield from (_gzip_steps if is_gzip(path) else _plain_steps)(path, layout, doing)
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None
    return Volume(
        voxels=voxels, affine=np.diag((*spacing, 1.0)), unit=unit, name=streaming.plain_name(path), remarks=remarks,
    )  # fmt: skip


def _plain_steps(path, layout: RawLayout, doing: str):
    """Generator of Progress: voxels (nz, ny, nx) of a file that is not packed."""
    actual = os.path.getsize(path)
    if actual != layout.total_bytes:
        raise _wrong_size(path, layout, actual)
    return (
        yield from streaming.voxel_steps(
            path, layout.shape, layout.file_dtype, [streaming.Part(path, layout.header_bytes)]
        )
    )


def _gzip_steps(path, layout: RawLayout, doing: str):
    """Generator of Progress: voxels (nz, ny, nx) of a gzip file."""
    if layout.total_bytes > streaming.bytes_held(path, 0, "gzip"):  # impossible; report the true size, allocate nothing
        raise _wrong_gzip_size(path, layout)
    voxels = streaming.allocate(path, layout.shape, layout.file_dtype)
    with streaming.open_stream(path, 0, "gzip") as source:
        try:
            yield from streaming.skip_steps(path, source, layout.header_bytes, doing)
            yield from streaming.fill_steps(path, source, voxels, doing)
        except streaming.EndsEarly:
            raise _wrong_gzip_size(path, layout) from None
        if source.readinto(memoryview(bytearray(1))):
            raise _wrong_gzip_size(path, layout)
    return (yield from streaming.storable_steps(voxels, doing))


def write_raw_steps(volume: Volume, path: str | Path):
    """Generator of Progress: write the stored voxels, little-endian, x fastest, packed if the name ends in .gz.

    Returns
    -------
    dict
        Options of ``read_volume`` that are needed to read the file back, since a raw file stores none of them.
    """
    with streaming.open_to_write(path) as stream:
        yield from streaming.write_voxel_steps(volume.voxels, stream)
    options = dict(
        shape=volume.shape_xyz, dtype=volume.voxels.dtype.name, byte_order="little",
        spacing=tuple(float(s) for s in volume.spacing), slope=volume.slope, intercept=volume.intercept,
    )  # fmt: skip
    return {**options, "unit": volume.unit, "value_unit": volume.value_unit, "modality": volume.modality}


def lost_in_raw(volume: Volume) -> list[str]:
    """Sentences on what a raw file does not store."""
    lost = ["A raw file holds only voxels; give shape, type, spacing and scaling again when you read it."]
    if not np.allclose(volume.affine, np.diag((*volume.spacing, 1.0))):
        lost.append("The rotation, mirroring or offset of the affine is lost; only the spacing can be given again.")
    return lost
