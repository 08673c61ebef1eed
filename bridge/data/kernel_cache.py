"""The folder of compiled kernels: how large it is, and emptying it."""

from __future__ import annotations

import shutil
import time
from contextlib import suppress

from ...rle_splat.runtime.jit import KERNELS, cache_folder

FRESH = 10.0  # seconds for which a size counts, because the preferences draw often


class _FolderSize:
    """The size of the folder as last looked up, and when."""

    size, at = 0, -FRESH


def size() -> int:
    """Bytes of the files in the folder; looked up again after FRESH seconds."""
    now = time.monotonic()
    if now - _FolderSize.at > FRESH:
        _FolderSize.size, _FolderSize.at = sum(map(_bytes_of, cache_folder().rglob("*"))), now
    return _FolderSize.size


def clear() -> int:
    """Delete all kernels on disk; those that are loaded stay in use until Blender ends.

    Returns
    -------
    int
        Bytes that were deleted.

    Notes
    -----
    The folders of this version stay, because loaded kernels are saved to them.
    """
    _FolderSize.at = -FRESH
    before = size()
    with suppress(OSError):
        for other in cache_folder().glob("kernels-*"):
            if other != KERNELS:
                shutil.rmtree(other, ignore_errors=True)
    for file in [path for path in KERNELS.rglob("*") if path.is_file()]:
        with suppress(OSError):  # another Blender has it open
            file.unlink()
    _FolderSize.at = -FRESH
    return max(before - size(), 0)


def _bytes_of(path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except OSError:
        return 0
