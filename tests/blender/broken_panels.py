"""Panels that a window refuses or complains of, each with one flaw: a check of panels must notice every one."""

from contextlib import contextmanager

import bpy

from tests.blender.real_blender import MODULE


def _with_value(layout):
    layout.operator("rle_splat.window_level").preset = "NO SUCH WINDOW"


# What a draw function does wrong, and words of what the recorder says of it.
BROKEN = {
    "icon": (lambda layout: layout.label(text="A", icon="NO_SUCH_ICON"), "NO_SUCH_ICON"),
    "keyword": (lambda layout: layout.label(text="A", size=2), "no argument size"),
    "missing argument": (lambda layout: layout.prop(bpy.context.scene), "needs the argument property"),
    "method": (lambda layout: layout.rows(), "a layout has no rows"),
    "attribute": (lambda layout: setattr(layout, "disabled", True), "no attribute disabled"),
    "enum value": (lambda layout: setattr(layout, "alignment", "MIDDLE"), "'MIDDLE'"),
    "type": (lambda layout: layout.label(text=7), "text is 7"),
    "property": (lambda layout: layout.prop(bpy.context.scene.rle_splat, "nothing"), "no property nothing"),
    "no data": (lambda layout: layout.prop(None, "name"), "data is None"),
    "no struct": (lambda layout: layout.prop("scene", "name"), "is a str"),
    "item": (lambda layout: layout.prop_enum(bpy.context.scene.rle_splat, "quality", "best"), "never best"),
    "operator": (lambda layout: layout.operator("rle_splat.nothing"), "no operator rle_splat.nothing"),
    "operator's property": (lambda layout: setattr(layout.operator("rle_splat.render_image"), "n", 1), "no property n"),
    "operator's value": (_with_value, "NO SUCH WINDOW"),
    "menu": (lambda layout: layout.menu("RLE_SPLAT_MT_nothing"), "no menu RLE_SPLAT_MT_nothing"),
    "panel for a menu": (lambda layout: layout.menu("RLE_SPLAT_PT_volume"), "no menu RLE_SPLAT_PT_volume"),
    "curve": (lambda layout: layout.template_curve_mapping(bpy.context.scene.rle_splat, "quality"), "holds none"),
    "exception": (lambda layout: 1 // 0, "division"),
}


@contextmanager
def broken_panel(flaw: str):
    """A panel with this flaw, in the add-on's tab and with its name."""
    wrong = BROKEN[flaw][0]
    broken = type("RLE_SPLAT_PT_broken", (bpy.types.Panel,), {
        "__module__": f"{MODULE}.panels.broken", "bl_label": "Broken", "bl_idname": "RLE_SPLAT_PT_broken",
        "bl_space_type": "VIEW_3D", "bl_region_type": "UI", "bl_category": "RLE Splat",
        "draw": lambda self, _context: wrong(self.layout.column())})  # fmt: skip
    bpy.utils.register_class(broken)
    try:
        yield
    finally:
        bpy.utils.unregister_class(broken)
