"""The add-on preferences: Edit > Preferences > Add-ons > RLE Splat."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty

from . import kernel_preparation
from .paths import EXTENSION

BESIDE, PACKED = "BESIDE", "PACKED"


def _prepare_kernels_changed(_preferences, _context):
    kernel_preparation.begin()


class RLE_SPLAT_AP_preferences(bpy.types.AddonPreferences):
    bl_idname = EXTENSION

    pictures: EnumProperty(
        name="Pictures", description="Where pictures are saved with the .blend", default=BESIDE,
        items=[(BESIDE, "Beside the .blend", "Save EXR files in a folder beside it, or pack them if that fails"),
               (PACKED, "In the .blend", "Pack all pictures into the .blend, which makes the file larger")])

    prepare_kernels: BoolProperty(
        name="Prepare Kernels in the Background", default=True, update=_prepare_kernels_changed,
        description="Compile what a first picture needs ahead, once for each version, in a process of low priority")

    def draw(self, _context):
        self.layout.use_property_split = True
        self.layout.prop(self, "pictures")
        self.layout.prop(self, "prepare_kernels")


def pictures_are_packed() -> bool:
    """Whether the user prefers pictures packed into the .blend."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon is not None and addon.preferences is not None and addon.preferences.pictures == PACKED


def register():
    bpy.utils.register_class(RLE_SPLAT_AP_preferences)


def unregister():
    bpy.utils.unregister_class(RLE_SPLAT_AP_preferences)
