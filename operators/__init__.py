"""The operators, one file for each action, or for a few on the same thing."""

from importlib import import_module

import bpy

from ..bridge.classes import classes_of
from . import import_volume, show_tab

MODULES = [import_module(f".{name}", __name__) for name in (
    "import_volume choose_series relocate_volume apply_preset transfer_function_files window_level single_user "
    "render_image preview_in_camera_view show_in_renders list_effects accuracy add_cutting_object load_segments "
    "channels shadow_pass frame_volume live_view objects clear_cache reload_volume cut_along_view add_slice "
    "drag_window use_window_tool value_at_surface own_presets choose_transfer_function segment_rows turntable "
    "extract_surface save_figure bake_volume hide_table keep_connected threshold_segment change_segment "
    "export_segments scroll_slice four_up_view plain_background fit_cutting_object show_tab update_world_light "
    "add_letters add_names name_structure add_lights gray_values_on_cut"
).split()]  # fmt: skip
CLASSES = classes_of(MODULES)


def _describe(cls) -> None:
    """Give a class the tooltip that its docstring is, in one line: Python versions differ in how they indent it."""
    if "bl_description" not in vars(cls) and cls.__doc__:
        cls.bl_description = " ".join(cls.__doc__.split())


def register():
    for cls in CLASSES:
        _describe(cls)
        bpy.utils.register_class(cls)
    bpy.types.TOPBAR_MT_file_import.append(import_volume.draw_menu_entry)
    bpy.types.VIEW3D_MT_volume_add.append(import_volume.draw_add_entry)
    show_tab.register()


def unregister():
    bpy.types.VIEW3D_MT_volume_add.remove(import_volume.draw_add_entry)
    bpy.types.TOPBAR_MT_file_import.remove(import_volume.draw_menu_entry)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
