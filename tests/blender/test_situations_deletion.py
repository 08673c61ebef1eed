"""What is deleted, hidden or elsewhere: Blender's Delete only takes an object out of its scenes."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")


def delete(*objects):
    """X in the 3D view, and what Blender does after it."""
    scenes.activate(*objects)
    assert bpy.ops.object.delete() == {"FINISHED"}
    scenes.update()


def render(tmp_path):
    return scenes.rendered(tmp_path / "out.exr")


@pytest.fixture
def followed(addon, tmp_path):
    """(volume, camera) with a backdrop that follows."""
    owner = scenes.cube_scene(tmp_path)
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    return owner, bpy.context.scene.camera


REMOVALS = {
    "by the user": delete,
    "from Python": lambda owner: bpy.data.objects.remove(owner),
    "in a batch": lambda owner: bpy.data.batch_remove([owner]),
}


@pytest.mark.parametrize("follows", [True, False])
@pytest.mark.parametrize("remove", REMOVALS.values(), ids=REMOVALS)
def test_B17_the_backdrop_of_a_deleted_volume(followed, remove, follows):
    owner, camera = followed
    bpy.context.scene.rle_splat.backdrop_follows = follows
    owner.name = "head"
    scenes.update()
    remove(owner)
    scenes.update()
    scenes.to_frame(2)
    assert not scenes.backdrops(camera)
    message = bpy.context.scene.rle_splat.message
    assert message == "The volume 'head' was deleted, so its backdrop was removed."
    bpy.context.scene.rle_splat.message = ""
    scenes.to_frame(3)
    assert bpy.context.scene.rle_splat.message == ""  # said once


def test_B18_pictures_of_the_only_volume_once_it_is_deleted(followed):
    delete(followed[0])
    for name in (
        "render_image",
        "preview_in_camera_view",
        "show_in_renders",
        "shadow_pass",
        "measure_accuracy",
        "error_map",
    ):
        operator = getattr(bpy.ops.rle_splat, name)
        assert not operator.poll(), name
        with pytest.raises(RuntimeError, match="Import a volume first"):
            operator()


def test_B19_a_purge_after_deletion_leaves_nothing(followed, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    scenes.picture_of()
    delete(followed[0])
    scenes.to_frame(2)
    render(tmp_path)
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    assert [one.name for one in bpy.data.objects] == ["Camera"]
    assert not bpy.data.meshes and not any("cube" in tree.name for tree in bpy.data.node_groups)


def test_B20_a_deletion_undone(followed):
    owner, camera = followed
    before, name = scenes.shown_at(scenes.backdrop_of(camera)), camera.name
    scenes.activate(owner)
    bpy.ops.ed.undo_push(message="backdrop")
    assert bpy.ops.object.delete("EXEC_DEFAULT", True) == {"FINISHED"}
    scenes.update()
    bpy.ops.ed.undo()
    camera = bpy.data.objects[name]
    bpy.data.objects["cube"].location.y += 2.0
    scenes.to_frame(2)
    np.testing.assert_allclose(scenes.shown_at(scenes.backdrop_of(camera)) - before, (0.0, -4.0), atol=0.1)
    assert "deleted" not in bpy.context.scene.rle_splat.message


def test_B21_the_other_of_two_volumes_is_deleted(followed, tmp_path):
    owner, camera = followed
    other = scenes.add_cube(tmp_path, "other", scenes.BLUE)
    scenes.picture_of()
    delete(other)
    owner.location.y += 2.0
    scenes.to_frame(2)
    assert scenes.shown_at(scenes.backdrop_of(camera))[1] == pytest.approx(8.0, abs=1.0)
    assert bpy.context.scene.rle_splat.message == ""
    scenes.activate(camera)
    assert bpy.ops.rle_splat.render_image.poll()  # of the scene's only volume


def test_B25_a_volume_in_an_instanced_collection_alone(followed, tmp_path):
    owner, camera = followed
    bpy.ops.rle_splat.show_in_renders()
    collection = bpy.data.collections.new("assets")
    collection.objects.link(owner)
    for holder in [one for one in owner.users_collection if one != collection]:
        holder.objects.unlink(owner)
    instancer = bpy.data.objects.new("instancer", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(instancer)
    assert not owner.users_scene
    settings = bpy.context.scene.rle_splat
    scenes.to_frame(2)
    assert "deleted" not in settings.message
    hidden = "'cube' is hidden from renders, so its backdrop is empty."
    assert settings.message == hidden and scenes.backdrop_of(camera)[..., 3].max() == 0.0
    settings.message = ""
    picture = render(tmp_path)
    assert picture[..., 3].max() > 0.9  # a render draws the instance; the message is of the backdrop
    assert settings.message == hidden


def put_into_collection(owner):
    """Move an object into a collection of its own."""
    collection = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.collection.objects.unlink(owner)
    collection.objects.link(owner)
    return collection


@pytest.mark.parametrize("how", ["object", "collection"])
def test_B26_hidden_in_the_window(addon, tmp_path, how):
    """By the eye in the outliner, which renders ignore: they and pictures show it where it is now."""
    owner = scenes.cube_scene(tmp_path)
    bpy.ops.rle_splat.show_in_renders()
    collection = put_into_collection(owner)
    scenes.activate(owner)
    before = scenes.shown_at(scenes.picture_of()[1])
    if how == "object":
        owner.hide_set(True)
    else:
        bpy.context.view_layer.layer_collection.children[collection.name].hide_viewport = True
    scenes.update()
    owner.location.x += 2.0
    scenes.update()
    bpy.context.view_layer.objects.active = owner
    for pixels in (scenes.picture_of()[1], render(tmp_path)):
        np.testing.assert_allclose(scenes.shown_at(pixels) - before, (4.0, 0.0), atol=0.1)


def test_B26_disabled_in_viewports(addon, tmp_path):
    """By the outliner's monitor, with which Blender no longer evaluates it there: never shown where it was before."""
    owner = scenes.cube_scene(tmp_path)
    bpy.ops.rle_splat.show_in_renders()
    before = scenes.shown_at(scenes.picture_of()[1])
    owner.hide_viewport = True
    scenes.update()
    owner.location.x += 2.0
    scenes.update()
    np.testing.assert_allclose(scenes.shown_at(render(tmp_path)) - before, (4.0, 0.0), atol=0.1)
    try:
        _, pixels = scenes.picture_of()
    except RuntimeError as refusal:
        assert "cube" in str(refusal) and "disabled in viewports" in str(refusal).lower()
    else:
        np.testing.assert_allclose(scenes.shown_at(pixels) - before, (4.0, 0.0), atol=0.1)


def test_B27_a_collection_hidden_from_renders(addon, tmp_path):
    owner = scenes.cube_scene(tmp_path)
    bpy.ops.rle_splat.show_in_renders()
    collection = put_into_collection(owner)
    for hidden in (False, True, False):
        collection.hide_render = hidden
        assert (render(tmp_path)[..., 3].max() == 0.0) == hidden


def test_B28_local_view_of_a_mesh(addon, tmp_path):
    owner = scenes.cube_scene(tmp_path)
    bpy.ops.rle_splat.show_in_renders()
    _, before = scenes.picture_of()
    aside = scenes.add_mesh([(8, 8, 0), (9, 8, 0), (8, 9, 0)], [(0, 1, 2)])
    area = next(one for one in bpy.context.screen.areas if one.type == "VIEW_3D")
    region = next(one for one in area.regions if one.type == "WINDOW")
    with bpy.context.temp_override(area=area, region=region):
        scenes.activate(aside)
        bpy.ops.view3d.localview(frame_selected=False)
        assert area.spaces.active.local_view is not None
        np.testing.assert_array_equal(scenes.picture_of()[1], before)
        np.testing.assert_allclose(render(tmp_path)[..., 3].max(), before[..., 3].max(), atol=0.01)
        scenes.activate(owner)
        bpy.ops.view3d.localview(frame_selected=False)
