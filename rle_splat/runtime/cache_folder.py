"""The folder on disk where compiled kernels are kept."""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

RELEASE = "0.4.0"  # devtools.docs_reference copies it; a release starts with an empty folder of kernels
CACHE_VARIABLE = "RLE_SPLAT_CACHE"
NUMBA_VARIABLE = "NUMBA_CACHE_DIR"  # set by users for everything that numba compiles, so it comes first
KERNEL_PREFIX = "kernels-"
KEPT_VERSIONS = 4  # folders of kernels, for several releases side by side


def cache_folder() -> Path:
    """Return a folder for compiled kernels that the user can write to and nobody else can.

    The first of these that is usable: ``rle_splat`` in $NUMBA_CACHE_DIR, $RLE_SPLAT_CACHE, the platform's cache
    folder, a temporary folder.  In Blender, the bridge sets $RLE_SPLAT_CACHE to the extension's own user folder
    before kernels load.

    Returns
    -------
    Path
        Where no folder is usable, a path at which nothing can be written.
    """
    numbas = os.environ.get(NUMBA_VARIABLE)
    if numbas and _are_usable(Path(numbas), Path(numbas, "rle_splat")):
        return _resolve(Path(numbas, "rle_splat"))
    with suppress(RuntimeError):  # a user without a home
        preferred = _list_preferred_folders()
        if _are_usable(*preferred):
            return _resolve(preferred[-1])
    return _temporary_folder()


def _list_preferred_folders() -> tuple[Path, ...]:
    """Return the folder for kernels, preceded by the folder of the user's that contains it, if there is one."""
    if os.environ.get(CACHE_VARIABLE):
        return (Path(os.environ[CACHE_VARIABLE]),)
    if sys.platform == "win32":
        return (Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "rle_splat" / "cache",)
    if sys.platform == "darwin":
        return (Path.home() / "Library" / "Caches" / "rle_splat",)
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"]), Path(os.environ["XDG_CACHE_HOME"], "rle_splat")
    return (Path.home() / ".cache" / "rle_splat",)


def _resolve(folder: Path) -> Path:
    """Return the path without symbolic links, which somebody could redirect after the check."""
    return Path(os.path.realpath(folder))


def _are_usable(*folders: Path) -> bool:
    """Whether the user, and nobody else, can write to all of these folders; missing ones are created."""
    try:
        for folder in map(_resolve, folders):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
            if not _is_private(folder):
                return False
        return True
    except OSError:
        return False


def _is_private(folder: Path) -> bool:
    """Whether only the user can write to a folder.  Kernels loaded from it are executed, so others must not."""
    if not hasattr(os, "getuid"):  # Windows, where no users share these folders
        return True
    found = folder.lstat()
    # Many systems give each user a private group with the user's number, and let it write by default.
    others = stat.S_IWOTH | (0 if found.st_gid == found.st_uid else stat.S_IWGRP)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & others


def _temporary_folder() -> Path:
    """Return the user's own temporary folder, or an unusable path where another user has made it before."""
    with suppress(OSError):
        shared = Path(tempfile.gettempdir())
        if not hasattr(os, "getuid"):
            return shared / "rle_splat-user"
        folder = shared / f"rle_splat-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        if _is_private(folder):
            return folder
    return Path(os.devnull) / "rle_splat"  # below a file


def _last_changed(folder: Path) -> float:
    """Seconds since 1970; 0 where another process has removed the folder meanwhile."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0


def kernel_folder(*parts: str) -> Path:
    """Return the folder for the kernels of this installation, and remove those of the oldest other ones.

    Parameters
    ----------
    *parts
        What else decides over the folder, such as the version of numba.

    Returns
    -------
    Path
        In ``cache_folder()``; it may not exist yet.  It depends on the release and on the package's name.
    """
    parent = cache_folder()
    names = "\n".join((RELEASE, __package__, *parts))
    folder = parent / f"{KERNEL_PREFIX}{hashlib.blake2b(names.encode(), digest_size=8).hexdigest()}"
    if not folder.exists():
        earlier = sorted(parent.glob(f"{KERNEL_PREFIX}*"), key=_last_changed, reverse=True)
        for stale in earlier[KEPT_VERSIONS - 1 :]:
            shutil.rmtree(stale, ignore_errors=True)
    return folder
