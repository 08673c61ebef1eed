"""The panels, one file each.  A draw function reads properties only: it opens no file and touches no voxel."""

import bpy

from . import (
    about,
    accuracy,
    advanced,
    channels,
    clip_gizmos,
    clip_objects,
    diagnostics,
    display,
    effects,
    labels,
    live_view,
    picture,
    playback,
    preset_menu,
    presets,
    report,
    scan,
    shading,
    slices,
    transfer,
    volume,
    volume_menu,
    whole_scene,
    window_tool,
)

MODULES = (
    volume, volume_menu, preset_menu, display, presets, transfer, shading, clip_objects, slices, labels, channels,
    picture, whole_scene, scan, playback, advanced, diagnostics, effects, report, accuracy, about, clip_gizmos,
)  # fmt: skip


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
