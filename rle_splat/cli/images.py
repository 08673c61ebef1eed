"""Writing pictures: one writer for each file suffix.

Every writer takes

- ``path``: the file;
- ``rgba``: (height, width, 4) float32, premultiplied scene-linear, row 0 on top;
- ``depth``: (height, width) float32, world units, or None for a picture without depth;
- ``background``: three scene-linear numbers, or None.
"""

from __future__ import annotations

import zlib

import numpy as np

from ..scene import RleSplatError
from ..scene.display import to_bytes


def write_png(path, rgba, depth, background=None) -> None:
    """Write 8 bits per channel, sRGB-encoded, with an sRGB chunk."""
    from PIL import Image, PngImagePlugin

    chunks = PngImagePlugin.PngInfo()
    chunks.add(b"sRGB", b"\x00")  # rendering intent 0: perceptual
    # Z_RLE looks only for runs (measured on pictures of scans: at most 8 % larger, a third of the compression time).
    Image.fromarray(to_bytes(rgba, background)).save(path, format="PNG", pnginfo=chunks, compress_type=zlib.Z_RLE)


def write_exr(path, rgba, depth, background=None) -> None:
    """Write float32 R, G, B, A, premultiplied scene-linear, and a layer ``Depth.Z`` if there is a depth.

    The background is ignored.
    """
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    channels = {"RGBA": np.ascontiguousarray(rgba, dtype=np.float32)}
    if depth is not None:
        channels["Depth.Z"] = np.ascontiguousarray(depth, dtype=np.float32)
    with OpenEXR.File(header, channels) as picture:
        try:
            picture.write(str(path))
        except RuntimeError as problem:  # what the package makes of an error of the system
            raise OSError(str(problem)) from None


def read_exr(path) -> np.ndarray:
    """(H, W, 3) float32 scene-linear colors of an EXR file, row 0 on top; RleSplatError where there are none."""
    try:
        import OpenEXR
    except ImportError:
        raise RleSplatError(f"Reading {path} needs the package OpenEXR; install it.") from None
    try:
        with OpenEXR.File(str(path)) as picture:
            channels = picture.channels()
            found = next((channels[name].pixels for name in ("RGB", "RGBA") if name in channels), None)
    except Exception as problem:  # the package raises types of its own
        raise RleSplatError(f"Cannot read {path} as an EXR picture: {problem}; check the file.") from None
    if found is None:
        raise RleSplatError(f"{path} has the channels {', '.join(channels)}, but no R, G and B; give a color picture.")
    colors = np.asarray(found, np.float32)[..., :3]
    if not np.isfinite(colors).all():
        raise RleSplatError(f"{path} holds colors that are not finite; replace them in the picture.")
    return colors


def write_npy(path, rgba, depth, background=None) -> None:
    """Write (H, W, 4) float32, premultiplied scene-linear; the background is ignored."""
    with open(path, "wb") as file:
        np.save(file, np.ascontiguousarray(rgba, dtype=np.float32))


def write_tiff(path, rgba, depth, background=None) -> None:
    """Write 16 bits per channel, sRGB-encoded as a PNG is."""
    from .rows import TiffRows

    with TiffRows(path, rgba.shape[1], len(rgba), background) as rows:
        rows.write(rgba, depth)


# Suffix -> (writer, the module that it needs besides numpy, the package of that module).
WRITERS = {
    ".png": (write_png, "PIL", "Pillow"),
    ".exr": (write_exr, "OpenEXR", "OpenEXR"),
    ".npy": (write_npy, None, None),
    ".tif": (write_tiff, None, None),
    ".tiff": (write_tiff, None, None),
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
