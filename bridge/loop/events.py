"""All that listens to Blender's events: one handler for each event calls those who subscribed, in a fixed order.

In a file without anything of ours an update and a frame change call nobody but the index.
"""

import traceback

import bpy
from bpy.app.handlers import persistent

from .. import live
from ..data import migration
from ..live import slice_pictures
from ..look import thumbnails
from ..pictures import outdated, picture_files, update
from ..render import mesh_shadows, over_render
from ..scene import image_changes, meshes, render_scene, world_render
from ..volumes import segments, series, source_paths, volumes
from . import index, store, timer, work

OFTEN = "depsgraph_update_post", "frame_change_post"  # events that come while nothing of ours is in the file


def forget_all(*_arguments) -> None:
    """Drop all work and all data in memory: before another file is opened, and when the extension is disabled."""
    timer.stop_all()
    live.stop()
    slice_pictures.stop()
    thumbnails.stop()
    series.forget()
    work.stop()
    outdated.forget()
    render_scene.forget_stages()
    meshes.forget()
    volumes.forget_all()
    image_changes.forget()
    index.forget()


SUBSCRIBERS = (
    *segments.HANDLERS,  # before source_paths.HANDLERS, which make paths relative
    *source_paths.HANDLERS,
    *index.HANDLERS,  # before all that ask it
    *image_changes.HANDLERS,
    *meshes.HANDLERS,
    *world_render.HANDLERS,  # before over_render.HANDLERS, which read the world's light
    *migration.HANDLERS,  # before slice_pictures and update.HANDLERS, which need the rows that it adds on load
    *slice_pictures.HANDLERS,  # before over_render.HANDLERS, which read the outlines of slices with all pixels
    *over_render.HANDLERS,
    *mesh_shadows.HANDLERS,
    *update.HANDLERS,
    *picture_files.HANDLERS,
    *live.HANDLERS,
    *work.HANDLERS,
    *store.HANDLERS,
    ("load_pre", forget_all),
)
_registered: dict = {}  # event -> its handler
_had_any = [False]  # whether the file had volumes or slices at the last event


def _is_idle() -> bool:
    """Whether the file has nothing of ours; the stages of the last volume are dropped once it is gone."""
    had, _had_any[0] = _had_any[0], index.has_any()
    if _had_any[0] or any(one.rle_splat.scene_id or one.rle_splat.use_composite for one in bpy.data.scenes):
        return False
    if had:
        render_scene.forget_stages()
        meshes.forget()
    return not had


def _handler_of(event: str):
    functions = [function for name, function in SUBSCRIBERS if name == event]
    first = [function for name, function in index.HANDLERS if name == event and event in OFTEN]

    @persistent
    def handle(*arguments):
        for function in first:
            function(*arguments)
        if event in OFTEN and _is_idle():
            return
        for function in functions[len(first) :]:
            try:
                function(*arguments)
            except Exception:  # the others are called all the same
                traceback.print_exc()

    return handle


def register():
    for event in dict.fromkeys(name for name, _ in SUBSCRIBERS):
        _registered[event] = _handler_of(event)
        getattr(bpy.app.handlers, event).append(_registered[event])


def unregister():
    for event, handle in _registered.items():
        getattr(bpy.app.handlers, event).remove(handle)
    _registered.clear()
    forget_all()
