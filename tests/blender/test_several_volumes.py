"""Several volumes and instances of them in one render, against transmittances on paper.

Cubes of N voxels a side at unit spacing; with its ramps each is N units deep, from z = -1/2 to N - 1/2.
"""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("classified_first")

N, SIZE, VIEW = 9, 24, 12.0
RED, BLUE = (0.9, 0.3, 0.1), (0.1, 0.4, 0.8)
ALPHA = {"red": 0.06, "blue": 0.1}  # per unit


@pytest.fixture
def cubes(bridge, core, tmp_path):
    """A red and a blue cube in the same place, seen from above; included in renders."""
    found = {}
    for name, color in (("blue", BLUE), ("red", RED)):
        found[name] = owner = scenes.import_raw(tmp_path, np.full((N, N, N), 100, np.uint8), name=name)
        owner.location = (0.0, 0.0, 0.0)
        alpha = ALPHA[name]
        scenes.give_transfer(
            bridge("transfer").write_transfer, core("classify.transfer_function").TransferFunction, owner,
            ((0.0, 0.0), (50.0, alpha), (255.0, alpha)), color)
    scenes.use_cycles((SIZE, SIZE))
    middle = (N - 1) / 2
    scenes.add_camera((middle, middle, 40.0), type="ORTHO", ortho_scale=VIEW)
    settings = bpy.context.scene.rle_splat
    settings.quality, settings.backend = "fine", "numpy"  # a small scene, for which no kernel is to be compiled
    bpy.context.view_layer.objects.active = found["red"]
    assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    return found


def depth(name, length):
    return -np.log1p(-ALPHA[name]) * length


def over(*layers):
    """RGBA of layers from near to far, each a list of (optical depth, color) in the same place."""
    rgb, left = np.zeros(3), 1.0
    for layer in layers:
        whole = sum(tau for tau, _ in layer)
        rgb += left * (1.0 - np.exp(-whole)) * sum(tau * np.array(color) for tau, color in layer) / whole
        left *= np.exp(-whole)
    return np.array((*rgb, 1.0 - left))


def middle_of(picture):
    return picture[SIZE // 2 - 4 : SIZE // 2 + 4, SIZE // 2 - 4 : SIZE // 2 + 4]


def agree(picture, rgba):
    np.testing.assert_allclose(middle_of(picture), np.broadcast_to(rgba, (8, 8, 4)), atol=2.5 / 255.0)


def move_to_collection(one, name):
    """Take an object out of the scene into a collection of its own, and show an instance of that."""
    collection = bpy.data.collections.new(name)
    for holder in one.users_collection:
        holder.objects.unlink(one)
    collection.objects.link(one)
    instancer = bpy.data.objects.new(f"{name} instance", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(instancer)
    return instancer


def test_cubes_that_overlap_are_mixed(cubes, tmp_path):
    cubes["red"].location.z = 5.0
    expected = over(
        [(depth("red", 5.0), RED)], [(depth("red", 4.0), RED), (depth("blue", 4.0), BLUE)], [(depth("blue", 5.0), BLUE)]
    )
    picture = scenes.rendered(tmp_path / "out.exr")
    agree(picture, expected)
    assert "mixed" in bpy.context.scene.rle_splat.last_report_json
    cubes["red"].name = "a first"  # read in another order
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr"), picture, atol=1e-6)


def test_cubes_apart_and_one_that_is_hidden(cubes, tmp_path):
    cubes["red"].location.z = 12.0
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("red", N), RED)], [(depth("blue", N), BLUE)]))
    cubes["red"].location.z = -12.0
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)], [(depth("red", N), RED)]))
    cubes["red"].hide_render = True
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)]))
    cubes["blue"].hide_render = True
    assert not scenes.rendered(tmp_path / "out.exr")[..., 3].any()
    assert "'red' is not in the picture: it is hidden from renders" in bpy.context.scene.rle_splat.render_problem


def test_an_instance_is_the_volume_moved_there(cubes, tmp_path):
    cubes["blue"].hide_render = True
    red = cubes["red"]
    red.location, red.rotation_euler = (2.0, -1.0, 3.0), (0.1, 0.2, 0.3)
    bpy.context.view_layer.update()
    moved = scenes.rendered(tmp_path / "out.exr")
    red.location = (0.0, 1.0, 1.0)
    instancer = move_to_collection(red, "asset")
    instancer.location = (2.0, -2.0, 2.0)
    bpy.context.view_layer.update()
    picture = scenes.rendered(tmp_path / "out.exr")
    assert moved[..., 3].max() > 0.3
    np.testing.assert_allclose(picture, moved, atol=1e-5)
    red.hide_viewport = True  # counts in viewports alone
    np.testing.assert_array_equal(scenes.rendered(tmp_path / "out.exr"), picture)
    for one in (red, instancer):
        one.hide_render = True
        assert not scenes.rendered(tmp_path / "out.exr")[..., 3].any()
        one.hide_render = False
    instancer.hide_render = True
    assert not scenes.rendered(tmp_path / "out.exr")[..., 3].any()


def test_two_instances_and_their_clip_objects(cubes, bridge):
    cubes["blue"].hide_render = True
    red = cubes["red"]
    plane = bridge("clip_objects").add_clip(bpy.context.scene, red, "PLANE", "INSIDE", np.eye(4))
    instancer = move_to_collection(red, "asset")
    instancer.location.z = 20.0
    other = instancer.copy()
    bpy.context.scene.collection.objects.link(other)
    other.location.z = 40.0
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    placed = bridge("placements").shown(depsgraph)
    assert [one.stands_for.name for one in placed] == sorted((instancer.name, other.name)) and plane.parent == red
    plain, _ = bridge("render_scene").read_scenes(placed, depsgraph, with_meshes=True)
    heights = sorted((scene.volume_matrix[2, 3], scene.clips[0].matrix_world[2, 3]) for scene in plain)
    np.testing.assert_allclose(heights, ((20.0, 20.0), (40.0, 40.0)), atol=1e-6)


def test_the_volume_left_is_rendered_after_the_other_was_deleted(cubes, tmp_path):
    settings = bpy.context.scene.rle_splat
    assert settings.composite_object == cubes["red"]
    with bpy.context.temp_override(selected_objects=[cubes["red"]]):
        bpy.ops.object.delete()
    agree(scenes.rendered(tmp_path / "out.exr"), over([(depth("blue", N), BLUE)]))
    assert settings.render_problem == "" and settings.composite_object == cubes["blue"]
