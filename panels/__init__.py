"""The panels, one file each.  A draw function reads properties only: it opens no file and touches no voxel."""

import bpy

from . import (
    accuracy,
    channels,
    clip_objects,
    effects,
    labels,
    live_view,
    picture,
    playback,
    presets,
    quality,
    report,
    shading,
    transfer,
    volume,
)

MODULES = (
    volume, playback, transfer, presets, shading, labels, channels, clip_objects, quality, picture, effects, report,
    accuracy,
)  # fmt: skip


def register():
    for module in MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
    live_view.register()


def unregister():
    live_view.unregister()
    for module in reversed(MODULES):
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)
