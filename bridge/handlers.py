"""All handlers of Blender's events, in the order in which they are registered."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from . import (
    follow_slices,
    following,
    freshness,
    image_state,
    live,
    mesh_shadows,
    migration,
    over_render,
    picture_files,
    render_scene,
    series,
    thumbnails,
    volumes,
    watch,
    world_nodes,
    world_render,
)
from .loop import store, work


@persistent
def _on_load_pre(*_arguments):
    live.stop()
    follow_slices.stop()
    thumbnails.stop()
    following.stop()
    series.forget()
    watch.stop()
    work.stop()
    freshness.forget()
    render_scene.forget_stages()
    volumes.forget_all()
    _forget_worlds()


def _forget_worlds() -> None:
    image_state.forget()
    world_nodes.forget()
    world_render.forget()


HANDLERS = (
    *image_state.HANDLERS,
    *world_render.HANDLERS,  # before over_render.HANDLERS, which read the world's light
    *over_render.HANDLERS,
    *mesh_shadows.HANDLERS,
    *migration.HANDLERS,  # before watch.HANDLERS, which need the rows that it adds on load
    *watch.HANDLERS,
    *follow_slices.HANDLERS,
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
    follow_slices.stop()
    following.stop()
    series.forget()
    watch.stop()
    work.stop()
    freshness.forget()
    render_scene.forget_stages()
    volumes.forget_all()
    _forget_worlds()
