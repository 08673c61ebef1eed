"""Writing pictures: sRGB encoding and one writer for each file suffix.

Every writer takes

- ``path``: the file;
- ``rgba``: (height, width, 4) float32, premultiplied scene-linear, row 0 on top;
- ``depth``: (height, width) float32, world units;
- ``background``: three scene-linear numbers, or None.
"""

from __future__ import annotations

import zlib

import numpy as np

from ..scene import RleSplatError

# The sRGB transfer curve (IEC 61966-2-1): linear below the threshold, then an offset power.
LINEAR_LIMIT, LINEAR_SLOPE = 0.0031308, 12.92
OFFSET, EXPONENT = 0.055, 1.0 / 2.4
ROWS = 32  # encoded together


def encode_srgb(linear) -> np.ndarray:
    """sRGB-encode scene-linear values.

    Parameters
    ----------
    linear : array_like
        Scene-linear values; they are clamped to [0, 1].

    Returns
    -------
    ndarray, float32
        Encoded values in [0, 1], of the same shape.
    """
    clamped = np.clip(np.asarray(linear, dtype=np.float32), 0.0, 1.0)
    power = (1.0 + OFFSET) * clamped**EXPONENT - OFFSET
    return np.where(clamped <= LINEAR_LIMIT, LINEAR_SLOPE * clamped, power).astype(np.float32)


def over_background(rgba, background) -> np.ndarray:
    """(H, W, 3) float32 scene-linear: the premultiplied picture over one background color."""
    return rgba[..., :3] + (1.0 - rgba[..., 3:4]) * np.asarray(background, dtype=np.float32)


def straight_alpha(rgba) -> np.ndarray:
    """(H, W, 4) float32: colors divided by alpha, as PNG wants them; black where alpha is zero."""
    alpha = rgba[..., 3:4]
    color = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0.0)
    return np.concatenate((color, alpha), axis=-1)


def to_bytes(rgba, background=None) -> np.ndarray:
    """(H, W, 3) uint8 sRGB over ``background``, or without one (H, W, 4) with straight linear alpha."""
    # In bands of rows, whose intermediate arrays fit into the processor's cache (measured: half the time).
    return np.concatenate([_to_bytes(rgba[top : top + ROWS], background) for top in range(0, len(rgba), ROWS)])


def _to_bytes(rgba, background):
    if background is not None:
        encoded = encode_srgb(over_background(rgba, background))
    else:
        straight = straight_alpha(rgba)
        encoded = np.concatenate((encode_srgb(straight[..., :3]), np.clip(straight[..., 3:], 0.0, 1.0)), axis=-1)
    return np.rint(encoded * 255.0).astype(np.uint8)


def write_png(path, rgba, depth, background=None) -> None:
    """Write 8 bits per channel, sRGB-encoded, with an sRGB chunk."""
    from PIL import Image, PngImagePlugin

    chunks = PngImagePlugin.PngInfo()
    chunks.add(b"sRGB", b"\x00")  # rendering intent 0: perceptual
    # Z_RLE looks only for runs (measured on pictures of scans: at most 8 % larger, a third of the compression time).
    Image.fromarray(to_bytes(rgba, background)).save(path, format="PNG", pnginfo=chunks, compress_type=zlib.Z_RLE)


def write_exr(path, rgba, depth, background=None) -> None:
    """Write float32 R, G, B, A, premultiplied scene-linear, and a layer ``Depth.Z``; the background is ignored."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {
        "RGBA": np.ascontiguousarray(rgba, dtype=np.float32),
        "Depth.Z": np.ascontiguousarray(depth, dtype=np.float32),
    }
    with OpenEXR.File(header, channels) as picture:
        picture.write(str(path))


def write_npy(path, rgba, depth, background=None) -> None:
    """Write (H, W, 4) float32, premultiplied scene-linear; the background is ignored."""
    with open(path, "wb") as file:
        np.save(file, np.ascontiguousarray(rgba, dtype=np.float32))


# Suffix -> (writer, the module that it needs besides numpy, the package of that module).
WRITERS = {
    ".png": (write_png, "PIL", "Pillow"),
    ".exr": (write_exr, "OpenEXR", "OpenEXR"),
    ".npy": (write_npy, None, None),
}


def writer_for(path):
    """The writer for a file's suffix; RleSplatError if there is none, or its package is not installed."""
    from importlib.util import find_spec
    from pathlib import Path

    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise RleSplatError(f"{path} has no suffix of a format that can be written; use {', '.join(WRITERS)}.")
    writer, module, package = WRITERS[suffix]
    if module is not None and find_spec(module) is None:
        raise RleSplatError(f"Writing {suffix} needs the package {package}; install it or choose another suffix.")
    return writer
