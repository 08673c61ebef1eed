"""All handlers of Blender's events, in the order in which they are registered."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import live
from .data import migration
from .live import slice_pictures
from .look import thumbnails
from .loop import store, work
from .pictures import backdrop_work, outdated, picture_files, update
from .render import mesh_shadows, over_render
from .scene import image_changes, render_scene, world_nodes, world_render
from .volumes import series, volumes


@persistent
def _on_load_pre(*_arguments):
    live.stop()
    slice_pictures.stop()
    thumbnails.stop()
    backdrop_work.stop()
    series.forget()
    update.stop()
    work.stop()
    outdated.forget()
    render_scene.forget_stages()
    volumes.forget_all()
    _forget_worlds()


def _forget_worlds() -> None:
    image_changes.forget()
    world_nodes.forget()
    world_render.forget()


HANDLERS = (
    *image_changes.HANDLERS,
    *world_render.HANDLERS,  # before over_render.HANDLERS, which read the world's light
    *over_render.HANDLERS,
    *mesh_shadows.HANDLERS,
    *migration.HANDLERS,  # before update.HANDLERS, which need the rows that it adds on load
    *update.HANDLERS,
    *slice_pictures.HANDLERS,
    *picture_files.HANDLERS,
    *live.HANDLERS,
    *store.HANDLERS,
    ("load_pre", _on_load_pre),
)


def register():
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister():
    for name, handler in reversed(HANDLERS):
        getattr(bpy.app.handlers, name).remove(handler)
    slice_pictures.stop()
    backdrop_work.stop()
    series.forget()
    update.stop()
    work.stop()
    outdated.forget()
    render_scene.forget_stages()
    volumes.forget_all()
    _forget_worlds()
