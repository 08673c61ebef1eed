"""No control of the panels, at any of its values, needs a kernel that the extension's zip does not bring."""

import contextlib
import zipfile
from functools import partial

import bpy
import pytest

from tests.blender import layout_recorder, panel_states
from tests.blender.real_blender import MODULE

# The state with most knobs with each stored type, the others with one: most kernels serve all types.
STATES = [
    *(("custom", stored) for stored in ("uint8", "int16", "uint16", "float32")),
    ("one", "int16"), ("labels", "uint16"), ("channels", "float32"), ("clip_objects", "uint8"),
    ("encoded", "uint8"),
]  # fmt: skip
LEFT_OUT = {"threads"}  # on a machine with few cores it would only take time


class Compiles(BaseException):
    """A kernel would be compiled; a picture ends there, which takes no time."""


def stop():
    raise Compiles


def values_of(entry, value) -> list:
    """The values that a control is given: all that have names, or the ends and the middle of a slider."""
    if entry.type == "ENUM" and not entry.is_enum_flag:
        return [item.identifier for item in entry.enum_items]
    if entry.type == "BOOLEAN" and not entry.is_array:
        return [not value]
    if entry.type in ("INT", "FLOAT") and not entry.is_array:
        low, high = entry.soft_min, min(entry.soft_max, 1000)
        return list(dict.fromkeys(map(type(value), (low, 0.5 * (low + high), high))))
    return []


def controls() -> list[tuple]:
    """(data, property) of every control that panels show now and that can be changed, each once."""
    found = {}
    for kind, shown in layout_recorder.draw_all(MODULE, bpy.context):
        if kind == "control" and isinstance(shown[0].id_data, bpy.types.ID) and shown[1] not in LEFT_OUT:
            data, name = shown
            if not data.bl_rna.properties[name].is_readonly:
                found[data.as_pointer(), name] = shown
    return list(found.values())


def picture(jit) -> bool:
    """Render the picture; whether a kernel would be compiled.  A refusal is as good as a picture."""
    compiling = []
    with jit.while_compiling(lambda: (compiling.append(1), stop())), contextlib.suppress(RuntimeError, Compiles):
        bpy.ops.rle_splat.render_image()
    return bool(compiling)


def jit_of(extension_zip, core):
    """The module that compiles; a skip where the zip leaves all kernels to it."""
    with zipfile.ZipFile(extension_zip) as archive:
        if not any(name.startswith("rle_splat/kernels/") for name in archive.namelist()):
            pytest.skip("this zip brings no kernels")
    return core("runtime.jit")


def add_lamp():
    """A lamp beside the ball, so that controls of shadows count."""
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "POINT"))
    lamp.data.energy, lamp.location = 1e5, (-20.0, 10.0, 30.0)
    bpy.context.scene.collection.objects.link(lamp)


@pytest.mark.parametrize(("state", "stored"), STATES)
def test_no_control_compiles(state, stored, extension_zip, core, tmp_path, monkeypatch):
    jit = jit_of(extension_zip, core)
    monkeypatch.setattr(panel_states, "add_volume", partial(panel_states.add_volume, stored=stored))
    panel_states.STATES[state](tmp_path)
    add_lamp()
    compiling, count = [state] if picture(jit) else [], 0
    for data, name in controls():
        before = getattr(data, name)
        for value in values_of(data.bl_rna.properties[name], before):
            count += 1
            setattr(data, name, value)
            if picture(jit):
                compiling.append(f"{name} = {value}")
        with contextlib.suppress(TypeError):
            setattr(data, name, before)
    assert count > 100
    assert compiling == []


def test_no_grid_compiles(extension_zip, core, tmp_path):
    """The grid that mirrors and shadow rays of other engines see has the light of a scene with meshes."""
    jit = jit_of(extension_zip, core)
    panel_states.STATES["one"](tmp_path)
    add_lamp()
    bpy.ops.mesh.primitive_plane_add(size=60.0, location=(0.0, 0.0, 0.0))  # through the ball
    owner = next(one for one in bpy.context.scene.objects if one.rle_splat.is_volume)
    bpy.context.view_layer.objects.active = owner
    settings = bpy.context.scene.rle_splat
    settings.lighting, settings.use_shadows = "SCENE", True
    compiling = []
    with jit.while_compiling(lambda: (compiling.append(1), stop())), contextlib.suppress(Compiles):
        assert bpy.ops.rle_splat.bake_volume(filepath=str(tmp_path / "grid.vdb")) == {"FINISHED"}
    assert compiling == []
