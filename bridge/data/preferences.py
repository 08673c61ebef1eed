"""The add-on preferences: Edit > Preferences > Add-ons > RLE Splat."""

from __future__ import annotations

import os
import shutil
import time
from contextlib import suppress

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty

from ...rle_splat.runtime import memory
from ...rle_splat.runtime.jit import KERNELS, cache_folder
from ..paths import EXTENSION
from ..translations import filled
from .automatic import draw_number, switch

BESIDE, PACKED = "BESIDE", "PACKED"
GIBIBYTE = 1 << 30
FAILED_FRAME_ITEMS = [
    ("PLACEHOLDER", "Continue", "Show magenta stripes instead of the volume and continue"),
    ("STOP", "Stop", "Show magenta stripes instead of the volume and end the animation. Blender still "
     "reports it as finished"),
]  # fmt: skip
DRAFT_ITEMS = [
    ("AUTO", "Automatic", "Every pixel, or every second one where the view would not move smoothly"),
    ("HALF", "Half Resolution", "Every second pixel along each side, which leaves more of the processor to other work"),
]


def _memory_limit_changed(preferences, _context):
    memory.limit_to(round(preferences.memory_limit * GIBIBYTE) or None)


def _live_changed(_preferences, context):
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            area.tag_redraw()


class RLE_SPLAT_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = EXTENSION

    pictures: EnumProperty(
        name="Pictures",
        description="Where pictures are saved with the .blend",
        default=BESIDE,
        items=[
            (BESIDE, "Beside the .blend", "Save EXR files in a folder beside it, or pack them if that fails"),
            (PACKED, "In the .blend", "Pack all pictures into the .blend, which makes the file larger"),
        ],
    )
    failed_frame: EnumProperty(
        name="If a Frame Fails", description="What renders do if the volume cannot be drawn in a frame; for scenes in "
        "which Show in Renders is pressed from now on", items=FAILED_FRAME_ITEMS)  # fmt: skip
    show_live: BoolProperty(
        name="Show Volumes Live", default=True, update=_live_changed,
        description="Draw volumes in all 3D viewports whose eye is open in the RLE Splat tab")  # fmt: skip
    show_imported: BoolProperty(
        name="Show Imported Volumes",
        default=True,
        description="Show volumes live in the window's viewports when one is imported. If off, the first volume of a "
        "scene is not shown live",
    )
    refine_live: BoolProperty(
        name="Refine When Still",
        default=True,
        update=_live_changed,
        description="Render a view with the scene's Quality once nothing changes. If off, viewports show drafts only",
    )
    live_pixels: EnumProperty(
        name="Resolution While Moving", items=DRAFT_ITEMS, update=_live_changed,
        description="Resolution of the drafts that viewports show while anything changes")  # fmt: skip
    memory_limit: FloatProperty(
        name="Memory Limit", description="Most memory that one volume or picture may take, in GiB",
        default=0.0, min=0.0, soft_max=256.0, precision=1, update=_memory_limit_changed)  # fmt: skip
    use_free_memory: BoolProperty(
        name="All Free Memory", description="Let a volume or a picture take all memory that is free",
        **switch("memory_limit", 0.0, 8.0))  # fmt: skip
    threads: IntProperty(
        name="Threads", description="Number of threads, for scenes that do not set their own", default=0, min=0,
        soft_max=64)  # fmt: skip
    use_all_cores: BoolProperty(
        name="All Cores", description="Use as many threads as the processor has cores",
        **switch("threads", 0, os.cpu_count() or 1))  # fmt: skip
    has_shown_tab: BoolProperty(
        name="Tab Shown", description="The tab was opened once after the extension was installed", default=False,
        options={"HIDDEN"})  # fmt: skip

    def draw(self, _context):
        layout = self.layout
        layout.use_property_split = True
        for name in ("pictures", "failed_frame", "show_live"):
            layout.prop(self, name)
        column = layout.column()
        column.active = self.show_live
        for name in ("show_imported", "refine_live", "live_pixels"):
            column.prop(self, name)
        for name, automatic in (("memory_limit", "use_free_memory"), ("threads", "use_all_cores")):
            draw_number(layout, self, name, automatic)
        row = layout.row()
        row.label(text=filled("Compiled code and thumbnails: {size}", size=memory.bytes_text(kernels_size())))
        row.operator("rle_splat.clear_cache", icon="TRASH")
        layout.label(text=str(cache_folder()), icon="FILE_FOLDER")


FRESH = 10.0  # seconds for which a size counts, because the preferences draw often


class _FolderSize:
    """The size of the folder as last looked up, and when."""

    size, at = 0, -FRESH


def kernels_size() -> int:
    """Bytes of the files in the folder; looked up again after FRESH seconds."""
    now = time.monotonic()
    if now - _FolderSize.at > FRESH:
        _FolderSize.size, _FolderSize.at = sum(map(_bytes_of, cache_folder().rglob("*"))), now
    return _FolderSize.size


def clear_kernels() -> int:
    """Delete all kernels on disk, and return their bytes; those that are loaded stay in use until Blender ends.

    The folders of this version stay, because loaded kernels are saved to them.
    """
    _FolderSize.at = -FRESH
    before = kernels_size()
    with suppress(OSError):
        for other in cache_folder().glob("kernels-*"):
            if other != KERNELS:
                shutil.rmtree(other, ignore_errors=True)
    for file in [path for path in KERNELS.rglob("*") if path.is_file()]:
        with suppress(OSError):  # another Blender has it open
            file.unlink()
    _FolderSize.at = -FRESH
    return max(before - kernels_size(), 0)


def _bytes_of(path) -> int:
    try:
        return path.stat().st_size if path.is_file() else 0
    except OSError:
        return 0


def current():
    """The preferences; None while the extension is not enabled."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return None if addon is None else addon.preferences


def value(name: str):
    """A preference of the user; its default while the extension is not enabled."""
    found = current()
    return RLE_SPLAT_AP_preferences.bl_rna.properties[name].default if found is None else getattr(found, name)


def register():
    bpy.utils.register_class(RLE_SPLAT_AP_preferences)
    found = current()
    if found is not None:
        _memory_limit_changed(found, bpy.context)


def unregister():
    bpy.utils.unregister_class(RLE_SPLAT_AP_preferences)
    memory.limit_to(None)
