"""Thumbnails kept on disk, in the folder of the user's cache.

A file's name is a hash of voxels and transfer function; it holds pixels and nothing about the volume.
"""

from __future__ import annotations

import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...rle_splat.pipeline.thumbnail import SIDE
from ...rle_splat.runtime.cache_folder import cache_folder
from ...rle_splat.runtime.whole_files import whole_files

FOLDER = "thumbnails"
MOST = 600  # files, about 10 kB each
PIXELS = "pixels"


def folder() -> Path:
    """Where they are; it may not exist yet."""
    return cache_folder() / FOLDER


def load(key: str) -> np.ndarray | None:
    """A thumbnail.

    Parameters
    ----------
    key : str
        See ``thumbnail_key``.

    Returns
    -------
    (SIDE, SIDE, 3) ndarray of uint8, or None
        None if it is not there, or damaged.
    """
    try:
        with np.load(folder() / f"{key}.npz", allow_pickle=False) as stored:
            pixels = stored[PIXELS]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return pixels if pixels.shape == (SIDE, SIDE, 3) and pixels.dtype == np.uint8 else None


def save(key: str, pixels: np.ndarray) -> None:
    """Keep a thumbnail, and forget the oldest beyond MOST; where nothing can be written it is not kept."""
    place = folder()
    with suppress(OSError):
        place.mkdir(exist_ok=True)
        with whole_files([place / f"{key}.npz"]) as (part,):
            np.savez_compressed(part, **{PIXELS: pixels})
        _forget_oldest(place)


def _forget_oldest(place: Path) -> None:
    files = sorted(place.glob("*.npz"), key=lambda file: file.stat().st_mtime, reverse=True)
    for file in files[MOST:]:
        file.unlink(missing_ok=True)
