"""No control of the panels, at any of its values, needs a kernel that the extension's zip does not bring, and no scene
with many of them changed at once.
"""

import contextlib
import os
import random
import zipfile
from functools import partial

import bpy
import pytest

from tests.blender import layout_recorder, panel_states
from tests.blender.real_blender import MODULE

TYPES = ("uint8", "int16", "uint16", "float32")
# The state with most knobs with each stored type, each control with one of them in turn; the others with one: most
# kernels serve all types, and random scenes have any.
STATES = [
    *(("custom", stored) for stored in TYPES),
    ("one", "int16"), ("labels", "uint16"), ("channels", "float32"), ("clip_objects", "uint8"),
    ("encoded", "uint8"),
]  # fmt: skip
LEFT_OUT = {"threads"}  # on a machine with few cores it would only take time
SCENES = int(os.environ.get("RLE_SPLAT_RANDOM_SCENES", "40"))


class Compiles(BaseException):
    """A kernel would be compiled; a picture ends there, which takes no time."""


def stop():
    raise Compiles


def values_of(entry, value) -> list:
    """The values that a control is given: all that have names, or the ends of a slider, then its middle."""
    if entry.type == "ENUM" and not entry.is_enum_flag:
        return [item.identifier for item in entry.enum_items]
    if entry.type == "BOOLEAN" and not entry.is_array:
        return [not value]
    if entry.type in ("INT", "FLOAT") and not entry.is_array:
        low, high = entry.soft_min, min(entry.soft_max, 1000)
        return list(dict.fromkeys(map(type(value), (low, high, 0.5 * (low + high)))))
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


def picture(jit) -> str:
    """Render the picture: "made"; "refused", which is as good for most tests; or "compiles"."""
    compiling, done = [], {"CANCELLED"}
    with jit.while_compiling(lambda: (compiling.append(1), stop())), contextlib.suppress(RuntimeError, Compiles):
        done = bpy.ops.rle_splat.render_image()
    return "compiles" if compiling else "made" if done == {"FINISHED"} else "refused"


def jit_of(extension_zip, core):
    """The module that compiles; a skip where the zip leaves all kernels to it."""
    with zipfile.ZipFile(extension_zip) as archive:
        if not any(name.startswith("rle_splat/kernels/") for name in archive.namelist()):
            pytest.skip("this zip brings no kernels")
    return core("runtime.jit")


def add_lamp(kind="POINT"):
    """A lamp beside the ball, so that controls of shadows count."""
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", kind))
    lamp.data.energy, lamp.location = (1.0 if kind == "SUN" else 1e5), (-20.0, 10.0, 30.0)
    bpy.context.scene.collection.objects.link(lamp)


@pytest.mark.parametrize(("state", "stored"), STATES)
def test_no_control_compiles(state, stored, extension_zip, core, tmp_path, monkeypatch):
    jit = jit_of(extension_zip, core)
    monkeypatch.setattr(panel_states, "add_volume", partial(panel_states.add_volume, stored=stored))
    panel_states.STATES[state](tmp_path)
    add_lamp()
    compiling, count = [state] if picture(jit) == "compiles" else [], 0
    turn = TYPES.index(stored) if state == "custom" else None
    for number, (data, name) in enumerate(controls()):
        if turn is not None and (number + turn) % len(TYPES):
            continue
        before = getattr(data, name)
        values = values_of(data.bl_rna.properties[name], before)
        for value in values[:2] if isinstance(before, float) else values:
            count += 1
            setattr(data, name, value)
            if picture(jit) == "compiles":
                compiling.append(f"{name} = {value}")
        with contextlib.suppress(TypeError):
            setattr(data, name, before)
    assert count > (80 if turn is None else 20)
    assert compiling == []


def build_scene(folder, draw) -> list[str]:
    """A volume with some of what panels add to one, before a camera and lamps of any kind; the words for it."""
    stored, words = draw.choice(TYPES), []

    def chance(word, share):
        words.extend([word] * (drawn := draw.random() < share))
        return drawn

    others = [panel_states.add_volume(folder, "PET", stored)] if chance("channels", 0.35) else []
    owner = panel_states.add_volume(folder, stored=stored)
    if chance("labels", 0.35):
        panel_states.add_labels(folder, owner)
    if others:
        panel_states.add_channels(owner, others)
    if chance("clips", 0.3):
        panel_states.add_clips(owner)
    for kind in ("POINT", "SUN", "AREA", "SPOT"):
        if chance(kind, 0.3):
            add_lamp(kind)
    if chance("mesh", 0.4):
        bpy.ops.mesh.primitive_plane_add(size=60.0, location=(0.0, 0.0, 4.0))  # through the ball
    camera = bpy.context.scene.camera.data
    if chance("perspective", 0.5):
        camera.type = "PERSP"
    camera.dof.use_dof = chance("depth of field", 0.15)
    panel_states.make_active(owner)
    return [stored, *words]


def change_controls(draw) -> list[str]:
    """Give some controls of the panels any of their values; the words for it.  A choice can show further controls."""
    words, seen = [], set()
    scene, volume = bpy.context.scene.rle_splat, bpy.context.object.rle_splat
    for data, name in ((scene, "quality"), (scene, "classification"), (volume, "lighting"), (volume, "mode")):
        setattr(data, name, draw.choice(values_of(data.bl_rna.properties[name], getattr(data, name))))
        words.append(f"{name} = {getattr(data, name)}")
    for _ in range(2):
        for data, name in controls():
            key = data.as_pointer(), name
            if key in seen or seen.add(key) or draw.random() > 0.15:
                continue
            values = values_of(data.bl_rna.properties[name], getattr(data, name))
            values = [value for value in values if value != "on"]  # an effect that the scene lacks is refused
            if values:
                value = draw.choice(values)
                setattr(data, name, value)
                words.append(f"{name} = {value}")
    return words


def test_no_scene_with_many_controls_changed_compiles(extension_zip, core, tmp_path):
    jit, compiling, made = jit_of(extension_zip, core), [], 0
    for seed in range(SCENES):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        draw = random.Random(seed)
        words = build_scene(tmp_path, draw) + change_controls(draw)
        done = picture(jit)
        made += done == "made"
        compiling.extend([f"{seed}: {', '.join(words)}"] if done == "compiles" else [])
    assert compiling == []
    assert made > 0.5 * SCENES


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
