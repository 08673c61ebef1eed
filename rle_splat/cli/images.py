"""Pictures to files: the sRGB encoding and one writer a suffix.

Every writer takes ``path`` and a Rendering-like pair ``rgba`` (H, W, 4) float32 scene-linear premultiplied, ``depth``
(H, W) float32, row 0 on top, and ``background``, three scene-linear numbers or None.
"""

from __future__ import annotations

import zlib

import numpy as np

from ..scene import RleSplatError

# The sRGB transfer curve (IEC 61966-2-1): linear below the threshold, then an offset power.
LINEAR_LIMIT, LINEAR_SLOPE = 0.0031308, 12.92
OFFSET, EXPONENT = 0.055, 1.0 / 2.4
ROWS = 32  # made into bytes at once


def encode_srgb(linear) -> np.ndarray:
    """Scene-linear values, clamped to [0, 1], to sRGB-encoded values of the same shape, float32."""
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
    """uint8 picture, sRGB-encoded: (H, W, 3) over ``background``, or (H, W, 4) straight with linear alpha."""
    # A few rows at once, since what is made of them then stays in the processor's cache (measured: half the time).
    return np.concatenate([_to_bytes(rgba[top : top + ROWS], background) for top in range(0, len(rgba), ROWS)])


def _to_bytes(rgba, background):
    if background is not None:
        encoded = encode_srgb(over_background(rgba, background))
    else:
        straight = straight_alpha(rgba)
        encoded = np.concatenate((encode_srgb(straight[..., :3]), np.clip(straight[..., 3:], 0.0, 1.0)), axis=-1)
    return np.rint(encoded * 255.0).astype(np.uint8)


def write_png(path, rgba, depth, background=None) -> None:
    """8 bits a channel, sRGB-encoded, with the sRGB chunk that says so."""
    from PIL import Image, PngImagePlugin

    chunks = PngImagePlugin.PngInfo()
    chunks.add(b"sRGB", b"\x00")  # rendering intent 0: perceptual
    # Of what a pixel differs from its neighbors by, only runs repeat (measured: by looking for runs alone pictures of
    # scans get at most 8 % larger, and are deflated in a third of the time).
    Image.fromarray(to_bytes(rgba, background)).save(path, format="PNG", pnginfo=chunks, compress_type=zlib.Z_RLE)


def write_exr(path, rgba, depth, background=None) -> None:
    """float32 R, G, B, A premultiplied scene-linear and a ``Depth.Z`` layer; the background stays out of it."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {
        "RGBA": np.ascontiguousarray(rgba, dtype=np.float32),
        "Depth.Z": np.ascontiguousarray(depth, dtype=np.float32),
    }
    with OpenEXR.File(header, channels) as picture:
        picture.write(str(path))


def write_npy(path, rgba, depth, background=None) -> None:
    """float32 (H, W, 4), scene-linear, premultiplied; the background stays out of it."""
    with open(path, "wb") as file:
        np.save(file, np.ascontiguousarray(rgba, dtype=np.float32))


# One table: suffix -> (writer, the module it needs beyond numpy, that module's package).
WRITERS = {
    ".png": (write_png, "PIL", "Pillow"),
    ".exr": (write_exr, "OpenEXR", "OpenEXR"),
    ".npy": (write_npy, None, None),
}


def writer_for(path):
    """The writer of a path's suffix; a RleSplatError when there is none or its package is not installed."""
    from importlib.util import find_spec
    from pathlib import Path

    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise RleSplatError(f"{path} has no suffix that can be written; end its name in {', '.join(WRITERS)}.")
    writer, module, package = WRITERS[suffix]
    if module is not None and find_spec(module) is None:
        raise RleSplatError(f"Writing {suffix} needs the package {package}; install it or choose another suffix.")
    return writer
