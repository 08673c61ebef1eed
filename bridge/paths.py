"""Where the extension may write: the folder Blender gives it, never its own.

Imported before anything else of the bridge: kernels choose the folder of their compiled code when their module
is imported, so the variable has to be set by then.
"""

import os
from pathlib import Path

import bpy

EXTENSION = __package__.rpartition(".")[0]
CACHE_VARIABLE = "RLE_SPLAT_CACHE"


def extension_folder() -> Path | None:
    """The user's folder of this extension, not created; None when it runs outside an installed extension."""
    try:
        return Path(bpy.utils.extension_path_user(EXTENSION))
    except ValueError:
        return None


def choose_kernel_cache() -> None:
    """Point the cache of compiled kernels at the extension's folder, unless the user chose another.

    Outside an extension the variable stays unset: the renderer then takes the user's ordinary cache folder.
    """
    folder = extension_folder()
    if folder is not None:
        os.environ.setdefault(CACHE_VARIABLE, str(folder / "cache"))


choose_kernel_cache()
