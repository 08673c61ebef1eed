"""PNG files without any package: 8 bits per channel, sRGB, with the size at which they are printed."""

import struct
import zlib

import numpy as np

from .checks import as_color
from .display import to_bytes

SIGNATURE = b"\x89PNG\r\n\x1a\n"
COLOR_TYPES = {3: 2, 4: 6}  # channels -> the format's number for truecolor, and for truecolor with alpha
PERCEPTUAL = b"\x00"  # rendering intent
LEVEL = 6  # of the compression
INCH = 0.0254  # m


def png_bytes(rgba: np.ndarray, dpi: float = 300.0, background=None) -> bytes:
    """A picture as the content of a PNG file.

    Chunks as in the PNG specification (W3C, third edition).

    Parameters
    ----------
    rgba : (H, W, 4) ndarray of float32
        Scene-linear, premultiplied, row 0 at the top.
    dpi : float
        Pixels per inch.
    background : (3,) sequence of float, optional
        Scene-linear RGB below the picture; without it, the file has straight alpha.

    Returns
    -------
    bytes
        Without times or names, so that equal pictures have equal files.
    """
    pixels = to_bytes(rgba, background if background is None else as_color(background, "The background"))
    height, width, channels = pixels.shape
    per_meter = round(dpi / INCH)
    return b"".join((
        png_begin(width, height, channels),
        png_chunk(b"pHYs", struct.pack(">IIB", per_meter, per_meter, 1)),
        png_chunk(b"IDAT", zlib.compress(filter_rows(pixels).tobytes(), LEVEL)),
        png_chunk(b"IEND", b""),
    ))  # fmt: skip


def png_begin(width: int, height: int, channels: int) -> bytes:
    """The begin of a PNG file of 3 channels, or of 4 with straight alpha, 8 bits each, sRGB."""
    header = struct.pack(">IIBBBBB", width, height, 8, COLOR_TYPES[channels], 0, 0, 0)
    return SIGNATURE + png_chunk(b"IHDR", header) + png_chunk(b"sRGB", PERCEPTUAL)


def filter_rows(pixels: np.ndarray, above: np.ndarray | None = None) -> np.ndarray:
    """Rows (H, W, channels) as they are compressed, (H, 1 + W channels) uint8.

    Each is preceded by its filter type: "Up", the difference from the row above, or "None" for the first row of a
    picture, which has no row ``above``, (W, channels).
    """
    flat = pixels.reshape(len(pixels), -1)
    rows = np.empty((len(flat), 1 + flat.shape[1]), np.uint8)
    rows[:, 0] = 2
    rows[0, 0] = 0 if above is None else 2
    rows[0, 1:] = flat[0] if above is None else flat[0] - above.reshape(-1)  # modulo 256
    rows[1:, 1:] = flat[1:] - flat[:-1]
    return rows


def png_chunk(name: bytes, content: bytes) -> bytes:
    """A chunk of a PNG file, with its length and checksum."""
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
