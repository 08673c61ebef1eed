"""The handlers of Blender's events that are not a single module's own, and the order in which all are registered."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import follow_frames, following, images, over_render, render_scene, volumes


@persistent
def _on_save_pre(*_arguments):
    images.pack_unsaved()


@persistent
def _on_load_pre(*_arguments):
    following.stop()
    render_scene.forget_stages()
    volumes.forget_all()


HANDLERS = (
    *over_render.HANDLERS,
    *follow_frames.HANDLERS,
    ("save_pre", _on_save_pre),
    ("load_pre", _on_load_pre),
)


def register():
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister():
    for name, handler in reversed(HANDLERS):
        getattr(bpy.app.handlers, name).remove(handler)
    following.stop()
    render_scene.forget_stages()
