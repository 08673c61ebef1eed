"""The panels, one file each.  A draw function reads properties only: it opens no file and touches no voxel."""

from importlib import import_module

import bpy

from . import live_view, window_tool

MODULES = [import_module(f".{name}", __name__) for name in (
    "volume volume_menu preset_menu display presets transfer shading clip_objects slices labels channels picture "
    "whole_scene scan playback advanced diagnostics effects report accuracy about clip_gizmos"
).split()]  # fmt: skip


def register():
    for module in MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
    live_view.register()
    window_tool.register()


def unregister():
    window_tool.unregister()
    live_view.unregister()
    for module in reversed(MODULES):
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)
