"""The folder where the extension may write, the one that Blender assigns to it, and file names that no system can have.

This module is imported first.  Kernel modules choose the folder of their compiled code when they are imported, so the
environment variable must be set before.
"""

import os
import re
from itertools import count
from pathlib import Path

import bpy

EXTENSION = __package__.rpartition(".")[0]
CACHE_VARIABLE = "RLE_SPLAT_CACHE"
RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{port}{n}" for port in ("COM", "LPT") for n in "123456789¹²³")}


def extension_folder() -> Path | None:
    """The extension's user folder, which may not exist yet; None outside an installed extension."""
    try:
        return Path(bpy.utils.extension_path_user(EXTENSION))
    except ValueError:
        return None


def choose_kernel_cache() -> None:
    """Set the cache folder of compiled kernels to the extension's folder, unless the user has set one.

    Outside an installed extension the variable stays unset, and the renderer uses the user's cache folder.
    """
    folder = extension_folder()
    if folder is not None:
        os.environ.setdefault(CACHE_VARIABLE, str(folder / "cache"))


def is_reserved(name: str) -> bool:
    """Whether Windows takes a file name for a device, whatever its suffixes."""
    return name.split(".")[0].strip().upper() in RESERVED


def usable_name(name: str, otherwise: str) -> str:
    """An object's name as that of a file without suffix; an empty one is ``otherwise``, a reserved one begins so."""
    plain = re.sub(r"[^\w .-]", "_", name).strip(" .") or otherwise
    return f"{otherwise} {plain}" if is_reserved(plain) else plain


def free_name(name: str, suffix: str, is_free) -> str:
    """The first of ``name``, ``name 2``, ``name 3`` and so on, with a suffix, that is free."""
    return next(filter(is_free, (f"{name}{f' {n}' if n > 1 else ''}{suffix}" for n in count(1))))


choose_kernel_cache()
