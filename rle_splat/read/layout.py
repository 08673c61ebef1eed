"""Layout of raw files: shape, stored type, byte order and header, and the file sizes that fit them."""

import gzip
import math
import os
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..scene import RleSplatError, as_float
from ..volume.volume import STORED_TYPES

BYTE_ORDERS = ("little", "big")
CHUNK_BYTES = 1 << 20
DEFAULT_COUNT_LIMIT = 1 << 32  # 4 GiB: counting stops here, so that a small file that unpacks endlessly does not block
SMALL_HEADER = 1 << 16  # bytes; a surplus of up to this size may be a header
TYPE_OF_EACH_SIZE = ("uint8", "uint16", "float32", "float64")  # the most common type of each voxel size
EDGE_LIMIT = 65536  # voxels along an edge
DEFLATE_LIMIT = 1032  # deflate cannot expand data more than this many times


def is_gzip(path) -> bool:
    """Whether the file name ends in .gz."""
    return str(path).lower().endswith(".gz")


def open_bytes(path):
    """Open the file as a binary stream; content is unpacked if the name ends in .gz."""
    return gzip.open(path, "rb") if is_gzip(path) else open(path, "rb")


@dataclass(frozen=True)
class RawLayout:
    """How the bytes of a raw file become voxels; RleSplatError if a value is out of range.

    Parameters
    ----------
    shape : (nx, ny, nz)
    dtype : str
        One of STORED_TYPES.
    byte_order : {"little", "big"}
    header_bytes : int
        Bytes before the first voxel.
    """

    shape: tuple
    dtype: str
    byte_order: str = "little"
    header_bytes: int = 0

    def __post_init__(self):
        object.__setattr__(self, "shape", check_shape(self.shape))
        object.__setattr__(self, "dtype", check_type(self.dtype))
        if self.byte_order not in BYTE_ORDERS:
            raise RleSplatError(f"The byte order must be little or big, not {self.byte_order!r}.")
        header = self.header_bytes
        if isinstance(header, bool) or not isinstance(header, (int, np.integer)) or header < 0:
            raise RleSplatError(f"The header's length must be a whole number of bytes, 0 or more, not {header!r}.")

    @property
    def file_dtype(self) -> np.dtype:
        """The stored type in the file's byte order."""
        return np.dtype(self.dtype).newbyteorder("<" if self.byte_order == "little" else ">")

    @property
    def voxel_bytes(self) -> int:
        """Bytes of all voxels."""
        return math.prod(self.shape) * self.file_dtype.itemsize

    @property
    def total_bytes(self) -> int:
        """Bytes of the header and all voxels."""
        return self.header_bytes + self.voxel_bytes

    def __str__(self):
        header = f" after a header of {self.header_bytes} bytes" if self.header_bytes else ""
        return f"{' x '.join(map(str, self.shape))} voxels of {self.dtype}{header}"


def check_shape(shape) -> tuple:
    """Check a shape; return (nx, ny, nz) as ints."""
    try:
        entries = tuple(shape)
        whole = tuple(int(n) for n in entries)
    except (TypeError, ValueError, OverflowError):
        entries, whole = (), ()
    if len(whole) != 3 or any(n != e for n, e in zip(whole, entries)):
        raise RleSplatError(f"The shape must be three whole numbers, NX NY NZ, not {shape!r}.")
    if not all(1 <= n <= EDGE_LIMIT for n in whole):
        given = " ".join(map(str, whole))
        raise RleSplatError(f"Each number of the shape must be from 1 to {EDGE_LIMIT}, not {given}.")
    return whole


def check_type(dtype) -> str:
    """Check a voxel type; return its name, one of STORED_TYPES."""
    name = dtype if isinstance(dtype, str) else getattr(dtype, "name", getattr(dtype, "__name__", repr(dtype)))
    if name not in STORED_TYPES:
        raise RleSplatError(f"There is no voxel type {name!r}; choose one of {', '.join(STORED_TYPES)}.")
    return name


def check_spacing(spacing) -> tuple:
    """Check a voxel spacing; return (sx, sy, sz) as positive floats."""
    try:
        lengths = tuple(as_float(s) for s in spacing)
    except TypeError:
        lengths = ()
    if len(lengths) != 3:
        raise RleSplatError(f"The spacing must be three numbers, SX SY SZ, not {spacing!r}.")
    if not all(math.isfinite(s) and s > 0.0 for s in lengths):
        raise RleSplatError(f"Each spacing must be finite and above zero, not {' '.join(f'{s:g}' for s in lengths)}.")
    return lengths


def check_scale(slope, intercept) -> tuple:
    """Check a value mapping; return (slope, intercept) as finite floats with slope != 0."""
    slope, intercept = as_float(slope), as_float(intercept)
    if not (math.isfinite(slope) and slope != 0.0 and math.isfinite(intercept)):
        raise RleSplatError(
            f"The slope must be finite and not zero, and the intercept finite, not {slope:g} and {intercept:g}."
        )
    return slope, intercept


def unreadable(path, problem) -> RleSplatError:
    """The error for a file that cannot be opened or unpacked because of the exception ``problem``."""
    name = Path(path).name
    if isinstance(problem, EOFError):
        return RleSplatError(f"{name} is a gzip file that ends too early; copy or download it again.")
    if isinstance(problem, gzip.BadGzipFile):
        return RleSplatError(f"{name} is named .gz but is not a valid gzip file; rename it, or copy it again.")
    if isinstance(problem, zlib.error):
        return RleSplatError(f"{name} is a damaged gzip file; copy or download it again.")
    reason = getattr(problem, "strerror", None) or problem
    return RleSplatError(f"Cannot read {path}: {reason}; check the path and its permissions.")


UNREADABLE = (OSError, EOFError, zlib.error)  # BadGzipFile is an OSError


def content_bytes(path, limit: int = DEFAULT_COUNT_LIMIT) -> int | None:
    """Size of a file in bytes, unpacked, counted while streaming; None if it exceeds ``limit``.

    The length at the end of a gzip file is not used, because it is modulo 4 GiB and wrong for concatenated files.
    """
    try:
        if not is_gzip(path):
            return os.path.getsize(path)
        count = 0
        with open_bytes(path) as stream:
            while count <= limit:
                chunk = stream.read(CHUNK_BYTES)
                if not chunk:
                    return count
                count += len(chunk)
        return None
    except UNREADABLE as problem:
        raise unreadable(path, problem) from None


def fitting(layout: RawLayout, actual: int) -> tuple:
    """Layouts similar to ``layout`` that take exactly ``actual`` bytes, the least changed first."""
    (nx, ny, nz), size = layout.shape, layout.file_dtype.itemsize
    payload = actual - layout.header_bytes
    found = []
    if payload > 0:
        for dtype in dict.fromkeys((layout.dtype, *TYPE_OF_EACH_SIZE)):
            itemsize = np.dtype(dtype).itemsize
            if itemsize * nx * ny * nz == payload:
                found.append(RawLayout(layout.shape, dtype, layout.byte_order, layout.header_bytes))
        slices, rest = divmod(payload, nx * ny * size)
        if rest == 0 and 1 <= slices <= EDGE_LIMIT:
            found.append(RawLayout((nx, ny, slices), layout.dtype, layout.byte_order, layout.header_bytes))
    surplus = actual - layout.voxel_bytes
    if 0 <= surplus <= SMALL_HEADER:
        found.append(RawLayout(layout.shape, layout.dtype, layout.byte_order, surplus))
    return tuple(dict.fromkeys(found))
