"""Saves our pictures with the .blend, as EXR files in a folder beside it or packed into it.

Before that, pictures are only in memory, so that making one adds nothing to Blender's undo memory.  Their paths are
relative only while a .blend is written, as those of volumes (see source_paths.py).
"""

import os

import bpy
from bpy.app.handlers import persistent

from .. import messages
from ..data import preferences
from ..paths import free_name, usable_name
from ..render import compositor
from ..volumes.source_paths import kept_path
from . import images, outdated, pictures

FOLDER = "_rle_splat"  # the folder's name is that of the .blend with this suffix

_of_this_file: set = set()  # absolute paths of the pictures of the open file; no others are replaced


@persistent
def _before_save(blend_file, *_):
    _make_absolute()  # those of a file that was opened while the add-on was disabled
    pictures.settle_copies()
    taken: set[str] = set()
    composited = {image for scene in bpy.data.scenes for image in compositor.images_of(scene)}  # see over_render.py
    made = [one for one in _own_images() if one not in composited]
    # Reading the size loads an image.  That must happen before the file that a user's copy shows is overwritten.
    for image in [one for one in made if one.size[0] > 0]:
        outdated.store(image)
        _keep(image, blend_file, taken)
    if blend_file and bpy.data.filepath:  # Blender adapts relative paths to the file that it writes
        for image in [one for one in made if one.filepath_raw]:
            image.filepath_raw = kept_path(image.filepath_raw, bpy.data.filepath)


@persistent
def _make_absolute(*_):
    for image in [one for one in _own_images() if one.filepath_raw]:
        image.filepath_raw = os.path.normpath(bpy.path.abspath(image.filepath_raw))
        _of_this_file.add(image.filepath_raw)


@persistent
def _after_load(*_):
    _of_this_file.clear()
    _make_absolute()


HANDLERS = (
    ("save_pre", _before_save), ("save_post", _make_absolute), ("save_post_fail", _make_absolute),
    ("load_post", _after_load),
)  # fmt: skip


def _own_images() -> list:
    return [one for one in bpy.data.images if images.MARK in one and one.library is None]


def _keep(image, blend_file: str, taken: set[str]) -> None:
    """Write one picture beside the .blend that is being saved, or pack it; ``taken``: used file names, lower case."""
    if not blend_file or preferences.value("pictures") == preferences.PACKED:
        if image.is_dirty or image.packed_file is None:
            image.pack()
        return
    folder = os.path.join(
        os.path.dirname(os.path.abspath(blend_file)), os.path.splitext(os.path.basename(blend_file))[0] + FOLDER
    )
    path = os.path.join(folder, _file_name(image.name, folder, taken))
    is_there = image.source == "FILE" and image.packed_file is None and not image.is_dirty and os.path.isfile(path)
    if not (is_there and os.path.normpath(bpy.path.abspath(image.filepath_raw)) == path):
        try:
            os.makedirs(folder, exist_ok=True)
            images.write_file(image, path)
        except (OSError, RuntimeError) as problem:
            image.pack()
            for scene in bpy.data.scenes:
                if pictures.owned_by(image, scene):
                    messages.complain(
                        scene.rle_splat, f"{image.name!r} could not be written to the folder beside the .blend "
                        f"({_reason(problem)}), so it was packed into the .blend.")  # fmt: skip
            return
    image.filepath_raw = path


def _file_name(name: str, folder: str, taken: set[str]) -> str:
    """A file name for a picture, unused on file systems that ignore case too, and not that of another .blend.

    A file that is there may be of a .blend that was renamed without its folder.
    """

    def is_free(found: str) -> bool:
        path = os.path.join(folder, found)
        return found.lower() not in taken and (path in _of_this_file or not os.path.exists(path))

    found = free_name(usable_name(name, "picture"), ".exr", is_free)
    taken.add(found.lower())
    return found


def _reason(problem: Exception) -> str:
    """The system's error message without the path."""
    return problem.strerror if isinstance(problem, OSError) and problem.strerror else "Blender could not write it"
