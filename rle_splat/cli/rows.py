"""Picture files that are written a few rows at a time, so that a picture need not fit into memory.

Every class here is a context manager with ``write(rgba, depth)``, called with the rows of the picture from the top on;
the arguments are those of ``images``, which writes whole pictures by the same classes.
"""

from __future__ import annotations

import errno
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..scene import RleSplatError
from ..scene.display import ROWS, to_levels
from ..scene.png import filter_rows, png_begin, png_chunk

LEVEL = 4  # of zlib's compression: on pictures of scans a higher one takes longer and saves little
CLASSIC_MOST = 1 << 31  # bytes of voxels above which a TIFF is a BigTIFF, whose offsets have 64 bits
SHORT, LONG, LONG8 = 3, 4, 16  # types of a TIFF's tags
DEFLATE, HORIZONTAL, RGB, TOP_TO_BOTTOM, STRAIGHT_ALPHA, UNSIGNED = 8, 2, 2, 1, 2, 1


class _Rows:
    """What the writers have in common: a file, the picture's size, its background or None, whether it has depths."""

    def __init__(self, path, width: int, height: int, background=None, has_depth: bool = True):
        self._path, self._width, self._height, self._background = path, width, height, background
        self._has_depth = has_depth
        self._open()

    def __enter__(self):
        return self

    def __exit__(self, kind, problem, traceback):
        try:
            if kind is None:
                self._finish()
        finally:
            self._close()
        return False

    def write(self, rgba, depth) -> None:
        """Add rows: (H, W, 4) float32 premultiplied scene-linear, and (H, W) float32 in world units, or None for a
        picture without depths."""
        for top in range(0, len(rgba), ROWS):
            self._add(rgba[top : top + ROWS], None if depth is None else depth[top : top + ROWS])

    def _open(self) -> None:
        self._file = open(self._path, "wb")  # closed by __exit__

    def _finish(self) -> None:
        """Write what follows the last row."""

    def _close(self) -> None:
        self._file.close()


class NpyRows(_Rows):
    """(H, W, 4) float32, premultiplied scene-linear."""

    def _open(self):
        super()._open()
        header = {"descr": "<f4", "fortran_order": False, "shape": (self._height, self._width, 4)}
        np.lib.format.write_array_header_1_0(self._file, header)

    def _add(self, rgba, depth):
        self._file.write(np.ascontiguousarray(rgba, dtype="<f4"))


class ExrRows(_Rows):
    """float32 R, G, B, A, premultiplied scene-linear, and a layer ``Depth.Z`` if there are depths; the background is
    ignored."""

    def _open(self):
        import OpenEXR

        if not hasattr(OpenEXR, "OutputFile"):
            raise RleSplatError("This version of OpenEXR writes no pictures row by row; install OpenEXR 3.5.")
        header = OpenEXR.Header(self._width, self._height)
        names = (*"RGBA", "Depth.Z") if self._has_depth else "RGBA"
        header["channels"] = dict.fromkeys(names, header["channels"]["R"])
        self._file = OpenEXR.OutputFile(str(self._path), header)

    def _add(self, rgba, depth):
        planes = dict(zip("RGBA", np.moveaxis(np.asarray(rgba, np.float32), -1, 0), strict=True))
        if self._has_depth:
            planes["Depth.Z"] = np.asarray(depth, np.float32)
        try:
            self._file.writePixels({name: plane.tobytes() for name, plane in planes.items()}, len(rgba))
        except OSError:  # of the package, without a number
            raise OSError(errno.ENOSPC, "not all of it could be written", str(self._path)) from None

    def _close(self):
        with suppress(OSError):  # an incomplete file complains, and is deleted
            self._file.close()


class PngRows(_Rows):
    """8 bits per channel, sRGB-encoded, with an sRGB chunk; straight alpha without a background."""

    def _open(self):
        super()._open()
        # Z_RLE looks only for runs (measured on pictures of five scans: 9 % smaller to 13 % larger than by zlib's whole
        # search at level 3, in two thirds of its time).
        self._packer, self._above = zlib.compressobj(LEVEL, strategy=zlib.Z_RLE), None
        self._file.write(png_begin(self._width, self._height, 4 if self._background is None else 3))

    def _add(self, rgba, depth):
        levels = to_levels(rgba, self._background, np.uint8)
        self._pack(self._packer.compress(filter_rows(levels, self._above)))
        self._above = levels[-1]

    def _finish(self):
        self._pack(self._packer.flush())
        self._file.write(png_chunk(b"IEND", b""))

    def _pack(self, data: bytes) -> None:
        if data:  # the packer keeps small rows back
            self._file.write(png_chunk(b"IDAT", data))


class TiffRows(_Rows):
    """16 bits per channel, sRGB-encoded, in deflated strips; straight alpha without a background.

    The layout is that of TIFF 6.0, and of BigTIFF where offsets of 32 bits may not do.
    """

    def _open(self):
        super()._open()
        self._samples = 4 if self._background is None else 3
        big = 2 * self._samples * self._width * self._height > CLASSIC_MOST
        # The words of a header, of a count of tags, of a tag, and of the offset that follows the tags.
        self._header, self._count, self._tag, self._next = (
            ("<2sHHHQ", "<Q", "<HHQ", "<Q") if big else ("<2sHI", "<H", "<HHI", "<I")
        )
        self._offset_type, self._first = (LONG8, (b"II", 43, 8, 0)) if big else (LONG, (b"II", 42))
        self._file.write(struct.pack(self._header, *self._first, 0))
        self._left = np.empty((0, self._width, self._samples), np.uint16)
        self._strips: list[tuple[int, int]] = []

    def _add(self, rgba, depth):
        self._left = np.concatenate((self._left, to_levels(rgba, self._background, np.uint16)))
        while len(self._left) >= ROWS:
            self._strip(self._left[:ROWS])
            self._left = self._left[ROWS:]

    def _strip(self, levels) -> None:
        """Write a strip of ROWS rows, of the last rows fewer, as differences between neighboring columns."""
        differences = levels.copy()
        differences[:, 1:] -= levels[:, :-1]
        packed = zlib.compress(differences.astype("<u2", copy=False), LEVEL)
        self._strips.append((self._file.tell(), len(packed)))
        self._file.write(packed)

    def _finish(self):
        if len(self._left):
            self._strip(self._left)
        offsets, sizes = zip(*self._strips, strict=True)
        each, where = [1] * self._samples, self._offset_type
        tags = [
            (256, LONG, [self._width]), (257, LONG, [self._height]), (258, SHORT, [16 * one for one in each]),
            (259, SHORT, [DEFLATE]), (262, SHORT, [RGB]), (273, where, offsets), (274, SHORT, [TOP_TO_BOTTOM]),
            (277, SHORT, [self._samples]), (278, LONG, [ROWS]), (279, where, sizes), (284, SHORT, [1]),
            (317, SHORT, [HORIZONTAL]), (339, SHORT, [UNSIGNED * one for one in each]),
        ]  # fmt: skip
        if self._samples == 4:
            tags.insert(-1, (338, SHORT, [STRAIGHT_ALPHA]))
        self._write_tags(tags)

    def _write_tags(self, tags) -> None:
        """Write the values that do not fit into their tags, the tags, and their offset into the header."""
        letters, room = {SHORT: "H", LONG: "I", LONG8: "Q"}, struct.calcsize(self._next)
        directory = struct.pack(self._count, len(tags))
        for number, kind, values in tags:
            packed = struct.pack(f"<{len(values)}{letters[kind]}", *values)
            if len(packed) > room:
                packed, data = struct.pack(self._next, self._align()), packed
                self._file.write(data)
            directory += struct.pack(self._tag, number, kind, len(values)) + packed.ljust(room, b"\0")
        begin = self._align()
        self._file.write(directory + struct.pack(self._next, 0))
        self._file.seek(0)
        self._file.write(struct.pack(self._header, *self._first, begin))

    def _align(self) -> int:
        """The end of the file, which begins at a multiple of 8 bytes."""
        self._file.write(b"\0" * (-self._file.tell() % 8))
        return self._file.tell()


# Suffix -> writer.
ROW_WRITERS = {".png": PngRows, ".exr": ExrRows, ".npy": NpyRows, ".tif": TiffRows, ".tiff": TiffRows}


def row_writer_for(path) -> type[_Rows]:
    """The class that writes a file by its suffix, which ``images.writer_for`` knows."""
    return ROW_WRITERS[Path(path).suffix.lower()]
