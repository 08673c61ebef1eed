"""Registering twice works, and unregistering leaves nothing behind."""

import gc
import os
from pathlib import Path

import bpy

PREFIX = "RLE_SPLAT_"


def handler_names() -> list:
    lists = [getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if not name.startswith("_")]
    functions = [f for entries in lists if isinstance(entries, list) for f in entries]
    return [f.__module__ for f in functions if "rle_splat" in f.__module__]


def class_names() -> list:
    bases = (bpy.types.Operator, bpy.types.Panel, bpy.types.Menu, bpy.types.PropertyGroup, bpy.types.FileHandler)
    gc.collect()
    return [cls.__name__ for base in bases for cls in base.__subclasses__() if cls.is_registered and ours(cls)]


def ours(cls) -> bool:
    return "rle_splat" in cls.__module__


def menu_entries() -> list:
    functions = getattr(bpy.types.TOPBAR_MT_file_import.draw, "_draw_funcs", [])
    return [f for f in functions if "rle_splat" in f.__module__]


def traces() -> dict:
    return {
        "handlers": handler_names(),
        "classes": class_names(),
        "menu": menu_entries(),
        "properties": [t.__name__ for t in (bpy.types.Object, bpy.types.Scene) if hasattr(t, "rle_splat")],
        "operators": list(dir(bpy.ops.rle_splat)),
    }


def test_everything_is_there_once(addon):
    found = traces()
    assert len(found["handlers"]) >= 5
    assert len(found["menu"]) == 1
    assert found["properties"] == ["Object", "Scene"]
    wanted = {"import_volume", "relocate", "apply_preset", "render_image", "set_backdrop", "composite"}
    assert wanted <= set(found["operators"])


def test_unregistering_leaves_no_trace_and_registering_again_works(addon):
    before = traces()
    for _ in range(2):
        addon.unregister()
        left = traces()
        assert not any(left.values()), left
        addon.register()
        assert {k: len(v) for k, v in traces().items()} == {k: len(v) for k, v in before.items()}


def test_disabling_with_a_volume_in_the_file_and_enabling_again_keeps_it(volume_object, bridge, addon):
    key = volume_object.rle_splat.data_key
    addon.unregister()
    addon.register()
    again = bpy.data.objects[volume_object.name]
    assert again.rle_splat.is_volume and again.rle_splat.data_key == key
    assert bridge("volumes").load_volume(again).shape_xyz == (7, 6, 5)


def test_every_class_carries_our_prefix(addon):
    names = [name for name in class_names() if not name.endswith(("Properties", "Settings"))]
    assert names and all(name.startswith(PREFIX) for name in names)


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


def test_nothing_is_written_into_the_extension(addon, core):
    own = Path(addon.__file__).parent
    cache = Path(os.environ["RLE_SPLAT_CACHE"])
    assert own not in cache.parents and ".user" in cache.parts
    jit = core("runtime.jit")
    if jit.numba is not None and not os.environ.get("NUMBA_CACHE_DIR"):
        assert cache in jit.KERNELS.parents
