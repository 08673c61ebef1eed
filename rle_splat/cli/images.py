"""Writing whole pictures, by the classes of ``rows``; reading EXR files.

Every writer takes

- ``path``: the file;
- ``rgba``: (height, width, 4) float32, premultiplied scene-linear, row 0 on top;
- ``depth``: (height, width) float32, world units, or None for a picture without depth;
- ``background``: three scene-linear numbers, or None.
"""

from functools import partial
from importlib.util import find_spec
from os import PathLike
from pathlib import Path

import numpy as np

from ..scene import Background, Environment, Rendering, RleSplatError, as_background
from ..scene.checks import check_first
from ..shade.environment import panorama_moments
from .rows import ROW_WRITERS


def read_environment(path: str | PathLike) -> tuple[tuple[float, float, float], Environment]:
    """Read a picture of the light from all directions, for ``world`` and ``environment`` of ``Scene``.

    Parameters
    ----------
    path : str or Path
        Equirectangular EXR file of scene-linear radiance, as of Blender's environment texture: row 0 is +Z, the middle
        +X. Needs the package OpenEXR.

    Returns
    -------
    world : (3,) tuple of float
        Scene-linear RGB, the mean radiance.
    environment : Environment
        How the light differs by direction.

    Raises
    ------
    RleSplatError
        If the file cannot be read, or has no finite colors.
    """
    return panorama_moments(np.maximum(_read_exr(path), 0.0), np.eye(3))


def _read_exr(path) -> np.ndarray:
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


def write_picture(rendering: Rendering, path: str | PathLike, background: Background = "transparent") -> None:
    """Write a picture to a file.

    Parameters
    ----------
    rendering : Rendering
        The picture and its depth.
    path : str or Path
        Its suffix is that of a format: .png (8 bits, sRGB), .tif (16 bits, sRGB), .exr (float32, scene-linear, with the
        layer ``Depth.Z``; needs the package OpenEXR) or .npy (float32, scene-linear).
    background : {"white", "black", "transparent"} or (3,) sequence of float
        Below the picture in PNG and TIFF; a color is scene-linear RGB. A transparent picture keeps its alpha.

    Raises
    ------
    RleSplatError
        If the suffix is unknown, OpenEXR is missing or the background is no color.
    """
    check_first(rendering, Rendering, "write_picture(rendering, path)")
    writer_for(path)(path, rendering.rgba, rendering.depth, as_background(background))


def writer_for(path):
    """The writer for a file's suffix; RleSplatError if there is none, or its package is not installed."""
    suffix = Path(path).suffix.lower()
    if suffix not in ROW_WRITERS:
        raise RleSplatError(f"{path} has no suffix of a format that can be written; use {', '.join(ROW_WRITERS)}.")
    if suffix == ".exr" and find_spec("OpenEXR") is None:
        raise RleSplatError(f"Writing {suffix} needs the package OpenEXR; install it or choose another suffix.")
    return partial(write_whole, ROW_WRITERS[suffix])


def write_whole(rows_of, path, rgba, depth, background=None) -> None:
    """Write a picture by a class of ``rows``."""
    with rows_of(path, rgba.shape[1], len(rgba), background, depth is not None) as rows:
        rows.write(rgba, depth)
