"""Add Lights: where the lights of each recipe stand, what a second click replaces, and that they light the volume."""

import math
from dataclasses import asdict
from importlib import import_module

import bpy
import numpy as np
import pytest
from mathutils import Vector

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

KINDS = ("THREE", "BONE", "SOFT", "SKIN", "SMOKE", "SPECIMEN")
LIGHTS = {
    "THREE": {"Key": "AREA", "Fill": "AREA", "Rim": "AREA"},
    "BONE": {"Sun": "SUN", "Rim": "AREA"},
    "SOFT": {"Key": "AREA", "Fill": "AREA"},
    "SKIN": {"Key": "AREA", "Fill": "AREA", "Rim": "AREA"},
    "SMOKE": {"Warm Sun": "SUN", "Cold Sun": "SUN"},
    "SPECIMEN": {"Sun": "SUN", "Rim": "AREA"},
}
SIDE = 12.0  # between the outermost of 13 voxels


@pytest.fixture
def owner(addon, tmp_path):
    """A ball in an empty block of 13 voxels, above and right of its middle; its middle is (8, 6, 8)."""
    z, y, x = np.indices((13, 13, 13))
    voxels = np.uint8(200) * np.uint8((x - 8) ** 2 + (y - 6) ** 2 + (z - 8) ** 2 <= 9)
    found = scenes.import_raw(tmp_path, voxels, name="ball")
    scenes.load_color(tmp_path, (0.8, 0.8, 0.8), alpha=0.9, shade={"ambient": 0.0})
    return found


def add(kind: str = "THREE") -> dict:
    """Run the operator; the lights by name, without numbers that Blender has given them."""
    assert bpy.ops.rle_splat.add_lights(kind=kind) == {"FINISHED"}
    bpy.context.view_layer.update()
    return {one.name.split(".")[0]: one for one in bpy.data.collections["Lights of ball"].objects}


def toward(light) -> np.ndarray:
    """From the middle of the ball to the light, in sides of the volume."""
    return (np.array(light.matrix_world.translation) - (8.0, 6.0, 8.0)) / SIDE


def settings_of(owner) -> tuple:
    scene, volume = bpy.context.scene.rle_splat, owner.rle_splat
    return (
        *(round(getattr(scene, name), 3) for name in ("use_shadows", "ambient_occlusion", "indirect_light")),
        *(round(getattr(volume, name), 3) for name in ("smoothness", "specular", "use_shading", "ambient", "diffuse")),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_adds_lights_that_point_to_what_is_visible(owner, kind):
    lights = add(kind)
    assert {name: one.data.type for name, one in lights.items()} == LIGHTS[kind]
    for one in lights.values():
        forward = one.matrix_world.to_3x3() @ Vector((0.0, 0.0, -1.0))
        np.testing.assert_allclose(np.array(forward), -toward(one) / np.linalg.norm(toward(one)), atol=1e-5)
        assert 1.5 < np.linalg.norm(toward(one)) < 2.5
    assert owner.rle_splat.lighting == "SCENE" and bpy.context.view_layer.objects.active == owner
    collection = bpy.data.collections["Lights of ball"]
    assert bpy.context.scene.collection.children[:] == [collection]


def test_the_kinds_of_the_operator_are_the_recipes(core):
    kinds = bpy.ops.rle_splat.add_lights.get_rna_type().properties["kind"].enum_items
    recipes = core("shade.light_recipes").RECIPES
    assert tuple(one.identifier for one in kinds) == tuple(map(str.upper, recipes)) == KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_python_lights_a_scene_as_the_operator_does(owner, bridge, core, kind):
    def scene():
        bpy.context.view_layer.update()
        depsgraph = bpy.context.evaluated_depsgraph_get()
        return bridge("scene.render_scene").read_scene(owner, depsgraph, with_meshes=False)[0]

    scenes.add_camera((3.0, -40.0, 5.0), (1.2, 0.1, -0.5))
    owner.scale = (0.5, 0.5, 0.5)
    owner.rle_splat.lighting, owner.rle_splat.use_shading = "HEADLIGHT", kind != "SMOKE"
    made = core("shade.light_recipes").add_lights(scene(), kind.lower())
    add(kind)
    wanted = scene()
    assert len(made.lights) == len(wanted.lights) == len(LIGHTS[kind])
    for one, other in zip(*(sorted(lit.lights, key=lambda light: light.energy) for lit in (made, wanted))):
        assert (one.type, one.casts_shadow) == (other.type, other.casts_shadow)
        np.testing.assert_allclose(one.matrix_world, other.matrix_world, atol=1e-5)
        np.testing.assert_allclose(one.color, other.color, atol=1e-6)
        size = "angle" if one.type == "SUN" else "size"
        assert one.energy == pytest.approx(other.energy, rel=1e-5)
        assert getattr(one, size) == pytest.approx(getattr(other, size), rel=1e-5)
    for name in ("headlight", "volume_shadows", "ambient_occlusion", "indirect_light"):
        assert getattr(made, name) == pytest.approx(getattr(wanted, name)), name
    assert asdict(made.transfer_function.shade) == pytest.approx(asdict(wanted.transfer_function.shade))


def test_without_a_camera_the_key_is_at_the_upper_left_of_the_front(owner):
    lights = add()
    np.testing.assert_allclose(toward(lights["Key"]), (-1.85, -0.72, 1.19), atol=1e-5)
    np.testing.assert_allclose(toward(lights["Rim"]), (1.73, 1.16, 1.13), atol=1e-5)


@pytest.mark.parametrize("angles", [(math.pi / 2, 0.0, math.pi / 2), (0.0, 0.0, 0.0), (0.7, 0.4, -2.0)])
def test_the_key_is_at_the_upper_left_of_the_cameras_picture(owner, angles):
    camera = scenes.add_camera((3.0, -40.0, 5.0), angles)
    camera.scale = (2.0, 2.0, 2.0)
    right, up, back = np.array(camera.rotation_euler.to_matrix()).T
    lights = add()
    np.testing.assert_allclose(toward(lights["Key"]), -1.85 * right + 1.19 * up + 0.72 * back, atol=1e-5)
    np.testing.assert_allclose(toward(lights["Rim"]), 1.73 * right + 1.13 * up - 1.16 * back, atol=1e-5)


@pytest.mark.parametrize("factor", [1.0, 0.25])
def test_sizes_and_watts_grow_with_the_volume_and_suns_stay(owner, factor):
    owner.scale = (factor,) * 3
    side = factor * SIDE
    lights = add()
    key, fill = lights["Key"].data, lights["Fill"].data
    assert (key.energy, key.size, key.use_shadow) == (pytest.approx(60.0 * side**2), pytest.approx(side), True)
    assert (fill.energy, fill.size, fill.use_shadow) == (pytest.approx(6.0 * side**2), pytest.approx(2 * side), False)
    rim = add("SKIN")["Rim"].data
    assert (rim.energy, rim.size) == (pytest.approx(60.0 * side**2), pytest.approx(0.7 * side))
    sun = add("BONE")["Sun"].data
    assert (sun.energy, sun.angle) == (pytest.approx(4.2), pytest.approx(0.05))


def test_where_the_file_is_gone_the_middle_of_the_box_counts(owner, bridge, tmp_path):
    (tmp_path / "ball.raw").unlink()
    scenes.save_and_reload(tmp_path / "scene.blend")
    scenes.activate(bpy.data.objects["ball"])
    key = add()["Key"]
    place = (np.array(key.matrix_world.translation) - (6.0, 6.0, 6.0)) / SIDE
    np.testing.assert_allclose(place, (-1.85, -0.72, 1.19), atol=1e-5)


def test_a_second_run_replaces_its_own_lights_and_nothing_else(owner):
    first = add("THREE")
    own = bpy.data.objects.new("Own", bpy.data.lights.new("Own", "POINT"))
    bpy.data.collections["Lights of ball"].objects.link(own)
    elsewhere = bpy.data.objects.new("Key", bpy.data.lights.new("Key", "SUN"))
    bpy.context.scene.collection.objects.link(elsewhere)
    shared = first["Rim"].data
    keeper = bpy.data.objects.new("Keeper", shared)
    bpy.context.scene.collection.objects.link(keeper)
    lights = add("SMOKE")
    assert set(lights) == {"Own", "Warm Sun", "Cold Sun"}
    assert lights["Own"] == own and elsewhere.name in bpy.context.scene.objects and keeper.data == shared
    assert {one.name for one in bpy.data.lights} == {"Own", elsewhere.data.name, shared.name, "Warm Sun", "Cold Sun"}
    assert len(bpy.data.collections["Lights of ball"].objects) == 3


def test_lights_of_another_volume_and_a_collection_of_that_name_stay(owner, tmp_path):
    foreign = bpy.data.collections.new("Lights of other")
    bpy.context.scene.collection.children.link(foreign)
    add()
    other = scenes.import_raw(tmp_path, scenes.ball(), name="other")
    scenes.activate(other)
    assert bpy.ops.rle_splat.add_lights(kind="BONE") == {"FINISHED"}
    assert len(bpy.data.collections["Lights of ball"].objects) == 3 and not foreign.objects
    assert len(bpy.data.collections["Lights of other.001"].objects) == 2
    assert bpy.ops.rle_splat.add_lights(kind="THREE") == {"FINISHED"}
    assert len(bpy.data.collections["Lights of other.001"].objects) == 3


def test_settings_depend_on_the_kind_and_not_on_the_one_before(owner):
    owner.rle_splat.lighting = "HEADLIGHT"
    before = settings_of(owner)
    add("SKIN")
    smoothness = 0.015 * SIDE  # less than the 3.5 mm of a head
    assert settings_of(owner) == (True, 0.7, 0.5, round(smoothness, 3), 0.15, *before[5:])
    add("SMOKE")
    assert settings_of(owner) == (True, 0.0, 0.0, *before[3:5], True, 0.1, 1.0)
    add("BONE")
    assert settings_of(owner) == (True, 0.7, 0.0, *before[3:])
    add("SOFT")
    assert settings_of(owner) == (True, 0.6, 0.0, *before[3:])


@pytest.mark.parametrize(("first", "then"), [("SKIN", "BONE"), ("SMOKE", "SOFT"), ("SMOKE", "SKIN"), ("SKIN", "SKIN")])
def test_a_recipe_after_another_equals_that_recipe_alone(owner, first, then):
    volume = owner.rle_splat
    volume.use_shading, volume.specular, volume.ambient, volume.smoothness = False, 0.35, 0.3, 0.7  # by hand
    before = settings_of(owner)
    add(then)
    alone = settings_of(owner)
    add("THREE")
    assert settings_of(owner)[3:] == before[3:]
    add(first)
    add(then)
    assert settings_of(owner) == alone


def test_what_the_user_or_a_preset_changed_since_stays(owner, tmp_path):
    add("SKIN")
    owner.rle_splat.specular = 0.35
    add("BONE")
    assert owner.rle_splat.specular == pytest.approx(0.35) and owner.rle_splat.use_automatic_smoothness
    add("SKIN")
    scenes.load_color(tmp_path, (0.8, 0.8, 0.8), shade={"specular": 0.6})
    add("SOFT")
    assert owner.rle_splat.specular == pytest.approx(0.6)


def test_undo_brings_back_lights_and_settings(owner):
    bpy.context.scene.rle_splat.ambient_occlusion = 0.2
    owner.rle_splat.lighting = "HEADLIGHT"
    bpy.ops.ed.undo_push(message="before")
    add("THREE")
    bpy.ops.ed.undo_push(message="three")
    add("SMOKE")
    bpy.ops.ed.undo_push(message="smoke")
    bpy.ops.ed.undo()
    assert {one.name for one in bpy.data.collections["Lights of ball"].objects} == {"Key", "Fill", "Rim"}
    assert bpy.context.scene.rle_splat.ambient_occlusion == pytest.approx(0.7)
    bpy.ops.ed.undo()
    assert "Lights of ball" not in bpy.data.collections and not bpy.data.lights
    assert bpy.context.scene.rle_splat.ambient_occlusion == pytest.approx(0.2)
    assert bpy.data.objects["ball"].rle_splat.lighting == "HEADLIGHT"


@pytest.mark.parametrize("kind", KINDS)
def test_the_volume_is_brighter_than_without_lights(owner, kind):
    scenes.add_camera((8.0, -40.0, 8.0), (math.pi / 2, 0.0, 0.0), type="ORTHO", ortho_scale=10.0)
    scene = scenes.use_cycles((24, 24))
    scene.rle_splat.quality = "draft"
    dark = bpy.data.objects.new("Dark", bpy.data.lights.new("Dark", "SUN"))
    dark.data.energy = 1e-6  # without any light there is a headlight
    scene.collection.objects.link(dark)
    before = scenes.picture()[..., :3].mean()
    add(kind)
    scenes.update()
    picture = scenes.picture()
    assert picture[..., :3].mean() > before + 0.02 and np.isfinite(picture).all()
    assert picture[..., :3].max() < 4.0  # and is not burnt out


def test_the_picture_is_brighter_at_the_upper_left(owner):
    scenes.add_camera((8.0, -40.0, 8.0), (math.pi / 2, 0.0, 0.0), type="ORTHO", ortho_scale=8.0)
    scenes.use_cycles((24, 24)).rle_splat.quality = "draft"
    add("SOFT")
    light = scenes.picture()[..., :3].sum(axis=-1)
    assert light[4:12, 4:12].sum() > 1.3 * light[12:20, 12:20].sum()


def test_in_a_mode_without_light_a_warning_says_so(owner, bridge, monkeypatch):
    said = []
    operator = import_module(f"{scenes.MODULE}.operators.add_lights")
    monkeypatch.setattr(operator, "filled", lambda template, **_: said.append(template) or template)
    add()
    owner.rle_splat.mode = "mip"
    add()
    assert [one.partition(" ")[0] for one in said] == ["Added", "The"] and "no effect in this mode" in said[1]


def test_without_a_volume_it_says_what_to_do(addon, refused):
    refused(bpy.ops.rle_splat.add_lights, "Import a volume first")


def test_a_volume_without_size_or_box_is_refused(owner, refused):
    owner.scale = (0.0, 0.0, 0.0)
    refused(bpy.ops.rle_splat.add_lights, "has a scale of 0; set it above 0")
    owner.scale = (1.0, 1.0, 1.0)
    owner.instance_collection = None
    refused(bpy.ops.rle_splat.add_lights, "import the volume again")
