"""The panels, one file each.  A draw function reads properties only: it opens no file and touches no voxel."""

from importlib import import_module

import bpy

from ..bridge.classes import classes_of
from . import live_view, window_tool

MODULES = [import_module(f".{name}", __name__) for name in (
    "volume volume_menu preset_menu display presets transfer shading material clip_objects slices labels channels "
    "picture scan playback advanced diagnostics effects report accuracy about clip_gizmos"
).split()]  # fmt: skip
CLASSES = classes_of(MODULES)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    live_view.register()
    window_tool.register()


def unregister():
    window_tool.unregister()
    live_view.unregister()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
