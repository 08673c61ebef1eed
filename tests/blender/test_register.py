"""Registering twice works, and unregistering leaves nothing behind."""

import gc
import os
import re
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import layout_recorder, scenes

# A class of the sources that Blender registers.  (A tool is none in its data.)
WRITTEN = re.compile(r"^class (\w+)\(.*\bbpy\.types\.(?!WorkSpaceTool)\w+", re.MULTILINE)
OPERATOR = "RLE_SPLAT_OT_"
HANDLES = "RLE_SPLAT_GGT_clip_box", "RLE_SPLAT_GGT_clip_plane"
# Event -> the modules of the bridge that subscribed to it, in the order in which they are called.
SUBSCRIBERS = {
    "blend_import_post": ["source_paths", "index", "migration"],
    "depsgraph_update_post": [
        "index", "image_changes", "meshes", "slice_pictures", "update", "shown", "live", "work", "store"],
    "frame_change_post": ["meshes", "slice_pictures", "over_render", "update", "shown", "work"],
    "load_post": ["source_paths", "index", "migration", "slice_pictures", "update", "picture_files", "shown"],
    "load_pre": ["events"], "redo_post": ["index", "meshes", "slice_pictures", "update", "shown", "store"],
    "render_cancel": ["over_render"], "render_complete": ["over_render"],
    "render_init": ["world_render", "over_render"], "render_post": ["over_render"],
    "render_pre": ["world_render", "over_render"], "render_write": ["over_render"],
    "save_post": ["source_paths", "mesh_shadows", "picture_files"],
    "save_post_fail": ["source_paths", "mesh_shadows", "picture_files"],
    "save_pre": ["segments", "source_paths", "over_render", "mesh_shadows", "update", "picture_files"],
    "undo_post": ["index", "meshes", "slice_pictures", "update", "shown", "store"],
}  # fmt: skip


def listeners() -> dict:
    """Event -> how many handlers of the add-on Blender calls."""
    found = {}
    for event in dir(bpy.app.handlers):
        functions = getattr(bpy.app.handlers, event)
        if isinstance(functions, list):
            count = sum("rle_splat" in f.__module__ for f in functions)
            found |= {event: count} if count else {}
    return found


def class_names() -> list:
    """Every registered class of the add-on, whatever its base."""
    gc.collect()
    found = layout_recorder.subclasses(bpy.types.bpy_struct)
    return sorted(cls.__name__ for cls in found if "rle_splat" in cls.__module__)


def written(addon) -> list:
    """Every class for Blender in the sources of the installed extension."""
    root = Path(addon.__file__).parent
    folders = [root / part for part in ("bridge", "operators", "panels")]
    files = [root / "__init__.py", *(path for folder in folders for path in folder.rglob("*.py"))]
    return sorted(name for path in files for name in WRITTEN.findall(path.read_text(encoding="utf-8")))


def menu_entries() -> list:
    places = bpy.types.TOPBAR_MT_file_import, bpy.types.VIEW3D_MT_volume_add, bpy.types.VIEW3D_PT_overlay
    functions = [function for place in places for function in getattr(place.draw, "_draw_funcs", [])]
    return [f.__name__ for f in functions if "rle_splat" in f.__module__]


def traces() -> dict:
    return {
        "listeners": listeners(),
        "classes": class_names(),
        "handles": [name for name in HANDLES if bpy.types.GizmoGroup.bl_rna_get_subclass_py(name) is not None],
        "menu": menu_entries(),
        "properties": [name for name in dir(bpy.types) if hasattr(getattr(bpy.types, name), "rle_splat")],
        "operators": dir(bpy.ops.rle_splat),
    }


def test_everything_is_there_once(addon):
    """Each class that is written is registered; docs/reference lists the operators and panels by name."""
    classes = written(addon)
    operators = [name.removeprefix(OPERATOR) for name in classes if name.startswith(OPERATOR)]
    assert len(operators) > 40 and not set(HANDLES) - set(classes)
    assert traces() == {
        "listeners": dict.fromkeys(SUBSCRIBERS, 1),
        "classes": [name for name in classes if name not in HANDLES],
        "handles": list(HANDLES),
        "menu": ["draw_menu_entry", "draw_add_entry", "_draw_overlay"],
        "properties": ["Object", "Scene"],
        "operators": operators,
    }


def test_subscribers_are_called_in_a_fixed_order(bridge):
    found = {}
    for event, function in bridge("loop.events").SUBSCRIBERS:
        found.setdefault(event, []).append(function.__module__.split(".")[-1])
    assert found == SUBSCRIBERS


def test_unregistering_leaves_no_trace_and_registering_again_works(addon):
    before = traces()
    for _ in range(2):
        addon.unregister()
        left = traces()
        assert not any(left.values()), left
        addon.register()
        assert traces() == before


def test_disabling_with_a_volume_in_the_file_and_enabling_again_keeps_it(volume_object, bridge, addon):
    key = volume_object.rle_splat.data_key
    addon.unregister()
    addon.register()
    again = bpy.data.objects[volume_object.name]
    assert again.rle_splat.is_volume and again.rle_splat.data_key == key
    assert bridge("volumes.volumes").load_volume(again).shape_xyz == (7, 6, 5)


@pytest.mark.parametrize("leave", ["disable", "load"])
def test_disabling_and_another_file_leave_no_voxels_labels_and_stages(
    leave, volume_object, bridge, core, addon, tmp_path
):
    labels = np.zeros((5, 6, 7), np.uint8)
    labels[2:] = 3
    labels.tofile(tmp_path / "labels.raw")
    volume_object.rle_splat.label_file = str(tmp_path / "labels.raw")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    scenes.add_camera((3.0, 5.0, 40.0), type="ORTHO", ortho_scale=14.0)
    bpy.context.scene.render.resolution_x = bpy.context.scene.render.resolution_y = 24
    scenes.activate(volume_object)
    with core("runtime.jit").use_reference():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    store, stages = bridge("loop.store"), bridge("scene.render_scene").KEPT
    assert len(store._entries) == 2 and stages.contents, "voxels, labels and stages"
    if leave == "disable":
        addon.unregister()
        addon.register()
    else:
        bpy.ops.wm.read_homefile(use_empty=True)
    assert not store._entries and not store._wanted and not stages.contents


def test_operators_and_properties_are_described(addon):
    for name in dir(bpy.ops.rle_splat):
        kind = getattr(bpy.ops.rle_splat, name).get_rna_type()
        assert kind.description and not kind.description.endswith("."), name
        for entry in kind.properties:
            hidden = entry.is_hidden or entry.identifier in ("rna_type", "filepath", "check_existing")
            assert hidden or (entry.name and entry.description), (name, entry.identifier)
    for bearer in (bpy.data.objects.new("any", None), bpy.context.scene):
        for entry in bearer.rle_splat.bl_rna.properties:
            if entry.identifier not in ("rna_type", "name"):
                assert entry.name, entry.identifier
                assert not entry.description.endswith("."), entry.identifier


def test_kernels_are_kept_in_the_extensions_user_folder_or_where_the_user_says(addon, bridge, core, monkeypatch):
    with monkeypatch.context() as patch:
        patch.delenv("RLE_SPLAT_CACHE", raising=False)
        bridge("paths").choose_kernel_cache()
        chosen = Path(os.environ.pop("RLE_SPLAT_CACHE"))
    assert Path(addon.__file__).parent not in chosen.parents and ".user" in chosen.parts
    jit = core("runtime.jit")
    if jit.numba is not None and not os.environ.get("NUMBA_CACHE_DIR"):
        assert Path(os.environ["RLE_SPLAT_CACHE"]) in jit.KERNELS.parents
