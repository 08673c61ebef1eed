"""The folder where the extension may write, the one that Blender assigns to it, and file names that no system can have.

This module is imported first.  Kernel modules choose the folder of their compiled code when they are imported, so the
environment variable must be set before.
"""

import os
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


choose_kernel_cache()
