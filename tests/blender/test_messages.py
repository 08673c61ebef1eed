"""What a render says when the volume is not in it: kept through an animation, one sentence for each silent cause, and a
placeholder where a frame could not be drawn."""

import json
import shutil
import subprocess
import sys

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

N = 9
ALPHA = 0.1
FULL = 1.0 - (1.0 - ALPHA) ** N  # opacity of the whole cube along an axis
STRIPES = ((1.0, 0.0, 0.6, 1.0), (0.02, 0.02, 0.02, 1.0))


@pytest.fixture
def volume(tmp_path):
    owner = scenes.even_cube(tmp_path, N, ALPHA, (1.0, 0.5, 0.25))
    scene = scenes.use_cycles((16, 16))
    scene.frame_start, scene.frame_end = 1, 3
    scenes.add_camera((4.0, 4.0, 30.0), type="ORTHO", ortho_scale=4.0)
    scene.rle_splat.quality = "fine"
    return owner


@pytest.fixture
def at_frame():
    """``at_frame(act)``: call ``act(frame)`` before each frame is rendered."""
    acts = []

    def handler(scene, *_):
        for act in acts:
            act(scene.frame_current)

    bpy.app.handlers.render_pre.append(handler)
    yield acts.append
    bpy.app.handlers.render_pre.remove(handler)


def composite():
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    return bpy.context.scene.rle_splat


def animated(folder):
    """Render the animation; frame number -> picture, (H, W, 4), of the frames that were written."""
    scenes.write_exr(folder / "frame_####.exr")
    bpy.ops.render.render(animation=True)
    return {int(path.stem[-4:]): scenes.load_pixels(path) for path in sorted(folder.glob("frame_*.exr"))}


def is_placeholder(picture):
    """Whether it is all stripes, of both colors."""
    colors = np.unique(picture.reshape(-1, 4).round(4), axis=0)
    return np.array_equal(colors, np.array(sorted(STRIPES), np.float32))


def away_at(path, *frames):
    """For ``at_frame``: the file is elsewhere at these frames."""
    aside = path.with_suffix(".aside")

    def act(frame):
        present, wanted = (aside, path) if frame not in frames else (path, aside)
        if present.exists():
            shutil.move(present, wanted)

    return act


def test_B31_a_file_missing_at_one_frame_of_three(volume, tmp_path, at_frame, capfd):
    """A placeholder at the second, right pictures at the others, and the error is still there at the end."""
    settings = composite()
    at_frame(away_at(tmp_path / "cube.raw", 2))
    frames = animated(tmp_path)
    for number in (1, 3):
        np.testing.assert_allclose(frames[number][8, 8, 3], FULL, atol=1 / 255)
    assert is_placeholder(frames[2])
    sentence = f"The file of 'cube' is not at {tmp_path / 'cube.raw'}"
    assert settings.render_problem.startswith(f"1 of 3 frames could not be drawn: 2. {sentence}")
    assert settings.message == settings.render_problem and settings.failed_frames == "2"
    report = json.loads(settings.last_report_json)
    assert report["failed_frames"] == [2] and report["first_problem"].startswith(sentence)
    assert settings.last_report.startswith(settings.render_problem)
    printed = [line for line in capfd.readouterr().out.splitlines() if "RLE Splat: " in line]
    assert len(printed) == 2 and f"Frame 2: {sentence}" in printed[0] and settings.render_problem in printed[1]


def test_the_next_render_starts_without_the_errors_of_the_last(volume, tmp_path, at_frame):
    settings = composite()
    at_frame(away_at(tmp_path / "cube.raw", 2))
    animated(tmp_path)
    assert settings.failed_frames
    bpy.context.scene.frame_set(1)
    scenes.rendered(tmp_path / "still.exr")
    assert settings.message == settings.render_problem == settings.failed_frames == ""
    assert json.loads(settings.last_report_json)["failed_frames"] == []


def test_the_first_of_several_errors_and_every_failed_frame(volume, tmp_path, at_frame, capfd):
    """Each sentence is printed once, and not once a frame."""
    scene = bpy.context.scene
    scene.frame_end = 6
    settings = composite()
    at_frame(away_at(tmp_path / "cube.raw", 2, 3))
    at_frame(lambda frame: setattr(volume, "scale", (1.0, 1.0, 0.0 if frame == 5 else 1.0)))
    animated(tmp_path)
    assert settings.failed_frames == "2-3, 5"
    assert settings.message.startswith("3 of 6 frames could not be drawn: 2-3, 5. The file of 'cube' is not at ")
    out = capfd.readouterr().out
    assert out.count("RLE Splat: Frame") == 2 and "Frame 2: The file" in out and "Frame 5: " in out


def test_B32_a_failed_still(volume, tmp_path, capfd):
    settings = composite()
    (tmp_path / "cube.raw").unlink()
    assert is_placeholder(scenes.rendered(tmp_path / "out.exr"))
    assert settings.message.startswith("The file of 'cube' is not at ") and settings.failed_frames == "1"
    report = json.loads(settings.last_report_json)
    assert report["first_problem"] == settings.message and "image" not in report  # nothing of an earlier picture
    printed = capfd.readouterr()
    assert printed.out.count(settings.message) == 1 and "Traceback" not in printed.out + printed.err


def test_the_placeholder_has_the_size_of_the_region(volume, tmp_path):
    composite()
    (tmp_path / "cube.raw").unlink()
    render = bpy.context.scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.0, 1.0
    picture = scenes.rendered(tmp_path / "out.exr")
    assert picture.shape == (16, 8, 4) and is_placeholder(picture)


def test_B33_an_animation_stops_after_a_failed_frame_if_that_is_wished(volume, tmp_path, at_frame):
    """The frame is written with its placeholder, no later one is rendered, and the scene's frame is put back."""
    scene, settings = bpy.context.scene, composite()
    scene.frame_end, scene.frame_current = 5, 4
    settings.on_failed_frame = "STOP"
    away = [2]
    at_frame(lambda frame: away_at(tmp_path / "cube.raw", *away)(frame))
    frames = animated(tmp_path)
    assert list(frames) == [1, 2] and is_placeholder(frames[2])
    assert scene.frame_current == 4
    assert settings.message.startswith("1 of 2 frames could not be drawn: 2. The file of 'cube'")
    assert settings.message.endswith("The render was stopped after frame 2.")
    away.clear()
    assert list(animated(tmp_path)) == [1, 2, 3, 4, 5] and settings.message == ""


def test_a_failed_still_stays_at_its_frame(volume, tmp_path):
    settings = composite()
    bpy.context.scene.frame_set(2)
    settings.on_failed_frame = "STOP"
    (tmp_path / "cube.raw").unlink()
    scenes.rendered(tmp_path / "out.exr")
    assert bpy.context.scene.frame_current == 2 and "stopped" not in settings.message


def test_nothing_is_stopped_where_all_is_well(volume, tmp_path):
    composite().on_failed_frame = "STOP"
    assert list(animated(tmp_path)) == [1, 2, 3]


def test_a_render_that_had_no_end_is_forgotten(volume, bridge, tmp_path):
    """Blender announces an animation before it opens the movie file, and says nothing more where it cannot."""
    settings = composite()
    bridge("render.over_render")._on_render_init(bpy.data.scenes.new("other"))
    path = tmp_path / "cube.raw"
    away_at(path, 1)(1)
    scenes.rendered(tmp_path / "out.exr")
    assert settings.failed_frames == "1"
    away_at(path)(1)
    scenes.rendered(tmp_path / "out.exr")
    assert settings.message == settings.failed_frames == ""


def test_a_scene_strip_keeps_the_errors_of_all_its_frames(volume, tmp_path, at_frame, capfd):
    """The sequencer renders a scene strip frame by frame, each as a render of its own within the render."""
    settings = composite()
    edit = bpy.data.scenes.new("edit")
    editor = edit.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strips.new_scene("strip", bpy.context.scene, 1, 1)
    edit.frame_start, edit.frame_end = 1, 3
    edit.render.resolution_x = edit.render.resolution_y = 16
    edit.render.filepath = str(tmp_path / "edit_")
    away = away_at(tmp_path / "cube.raw", 2)
    at_frame(away)
    bpy.ops.render.render(animation=True, scene="edit")
    assert settings.failed_frames == "2"
    assert settings.message.startswith("1 of 3 frames could not be drawn: 2. The file of 'cube'")
    assert edit.rle_splat.message == ""
    assert capfd.readouterr().out.count("RLE Splat: ") == 2


# --- what makes a picture empty -----------------------------------------------------------------------------------


def nodes_of(tree):
    over = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeAlphaOver")
    picture = next(node for node in tree.nodes if node.bl_idname == "CompositorNodeImage")
    return over, picture


def unlink_picture(tree, over, picture):
    tree.links.remove(picture.outputs[0].links[0])


def unlink_over(tree, over, picture):
    background = next(socket for socket in over.inputs if socket.type == "RGBA")
    tree.links.new(background.links[0].from_socket, over.outputs[0].links[0].to_socket)


def mute_link(tree, over, picture):
    picture.outputs[0].links[0].is_muted = True


def mute_over(tree, over, picture):
    over.mute = True


def mute_picture(tree, over, picture):
    picture.mute = True


def empty_picture(tree, over, picture):
    picture.image = None


def replace_picture(tree, over, picture):
    picture.image = bpy.data.images.new("mine", 4, 4)


def factor_zero(tree, over, picture):
    next(socket for socket in over.inputs if socket.type == "VALUE").default_value = 0.0


def switch_compositing_off(tree, over, picture):
    bpy.context.scene.render.use_compositing = False


def take_the_tree_away(tree, over, picture):
    if bpy.app.version >= (5, 0):
        bpy.context.scene.compositing_node_group = None
    else:
        bpy.context.scene.use_nodes = False


def remove_nodes(tree, over, picture):
    unlink_over(tree, over, picture)
    tree.nodes.remove(picture)
    tree.nodes.remove(over)


ABSENT = "so the volume is not in the render"
AGAIN = "turn Show in Renders off and on."
REMOVE = "or turn Show in Renders off."
UNLINKED = (
    f"The volume's picture is not linked to the compositor's output, so it is not in the render; link it, or {AGAIN}"
)
EMPTY = (
    (unlink_picture, UNLINKED),
    (unlink_over, UNLINKED),
    (mute_link, UNLINKED),
    (mute_over, f"The compositor's node 'RLE Splat over Render' is muted, {ABSENT}; unmute it, {REMOVE}"),
    (mute_picture, f"The compositor's node 'RLE Splat' is muted, {ABSENT}; unmute it, {REMOVE}"),
    (empty_picture, f"The image of the compositor's node 'RLE Splat' was deleted or removed; {AGAIN}"),
    (replace_picture, "The compositor's node 'RLE Splat' holds the image 'mine', which is not the volume's picture; "
                      f"{AGAIN}"),
    (factor_zero, f"The factor of the compositor's node 'RLE Splat over Render' is 0, {ABSENT}; raise it, {REMOVE}"),
    (switch_compositing_off,
     f"Compositing is switched off in the output properties, {ABSENT}; switch it on, {REMOVE}"),
    (take_the_tree_away, f"The scene's compositor is switched off, {ABSENT}; {AGAIN}"),
    (remove_nodes, f"The volume's nodes were removed from the compositor; {AGAIN}"),
)  # fmt: skip


@pytest.mark.parametrize(("act", "sentence"), EMPTY, ids=[act.__name__ for act, _ in EMPTY])
def test_B35_B36_B37_a_compositor_without_the_picture_is_told(volume, bridge, tmp_path, capfd, act, sentence):
    """One sentence in the panel, on the console and in the report; the user's own image is left as it was."""
    settings = composite()
    assert scenes.rendered(tmp_path / "seen.exr")[8, 8, 3] > 0.5
    tree = bridge("versions").compositor_tree(bpy.context.scene)
    act(tree, *nodes_of(tree))
    capfd.readouterr()
    picture = scenes.rendered(tmp_path / "out.exr")
    assert picture[..., 3].max() == 0.0 or act is replace_picture
    assert settings.message == settings.render_problem == sentence and settings.failed_frames == "1"
    assert json.loads(settings.last_report_json)["first_problem"] == sentence
    assert capfd.readouterr().out.count(sentence) == 1
    if act is replace_picture:
        assert tuple(bpy.data.images["mine"].size) == (4, 4)
        assert scenes.image_pixels(bpy.data.images["mine"])[..., :3].max() == 0.0
    if AGAIN in sentence or "is muted" in sentence:
        composite()
        assert settings.message == ""
        np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[8, 8, 3], FULL, atol=1 / 255)
        assert settings.message == ""


def test_nodes_that_the_user_moved_into_a_group_are_still_found(volume, bridge, tmp_path):
    """Our Alpha Over and its picture in a node group: drawn as before, and no complaint."""
    settings = composite()
    tree = bridge("versions").compositor_tree(bpy.context.scene)
    over, picture = nodes_of(tree)
    background = next(socket for socket in over.inputs if socket.type == "RGBA")
    source, target = background.links[0].from_socket, over.outputs[0].links[0].to_socket
    group = bpy.data.node_groups.new("group", "CompositorNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket(name="Image", in_out=direction, socket_type="NodeSocketColor")
    entry, leave = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    inner, inner_picture = group.nodes.new("CompositorNodeAlphaOver"), group.nodes.new("CompositorNodeImage")
    inner["rle_splat"], inner_picture["rle_splat"] = over["rle_splat"], picture["rle_splat"]
    inner_picture.image = picture.image
    below, above = [socket for socket in inner.inputs if socket.type == "RGBA"][:2]
    group.links.new(entry.outputs[0], below)
    group.links.new(inner_picture.outputs[0], above)
    group.links.new(inner.outputs[0], leave.inputs[0])
    tree.nodes.remove(over)
    tree.nodes.remove(picture)
    holder = tree.nodes.new("CompositorNodeGroup")
    holder.node_tree = group
    tree.links.new(source, holder.inputs[0])
    tree.links.new(holder.outputs[0], target)
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[8, 8, 3], FULL, atol=1 / 255)
    assert settings.message == ""
    (tmp_path / "cube.raw").unlink()
    assert is_placeholder(scenes.rendered(tmp_path / "out.exr"))


def test_B34_a_volume_one_voxel_thick_under_post_classification(tmp_path, capfd):
    owner = scenes.import_raw(tmp_path, np.full((1, N, N), 100, np.uint8))
    scenes.give_transfer(owner, ((0.0, 0.0), (50.0, ALPHA), (255.0, ALPHA)), (1.0, 0.5, 0.25))
    scenes.use_cycles((16, 16))
    scenes.add_camera((4.0, 4.0, 30.0), type="ORTHO", ortho_scale=4.0)
    bpy.context.scene.rle_splat.classification = "post"
    settings = composite()
    assert scenes.rendered(tmp_path / "out.exr")[..., 3].max() == 0.0
    assert "one voxel thick" in settings.message and "choose the classification pre" in settings.message
    assert settings.message in capfd.readouterr().out and settings.failed_frames == ""
    settings.classification = "pre"
    assert scenes.rendered(tmp_path / "out.exr")[8, 8, 3] > 0.05 and settings.message == ""


def test_frames_in_which_everything_is_transparent(volume, tmp_path):
    """A fade is no failure: the frames are named, and they are no placeholders."""
    settings = composite()
    for frame, opacity in ((1, 1.0), (2, 0.0), (3, 0.0)):
        volume.rle_splat.opacity_scale = opacity
        volume.rle_splat.keyframe_insert("opacity_scale", frame=frame)
    frames = animated(tmp_path)
    assert [frames[number][..., 3].max() > 0.5 for number in (1, 2, 3)] == [True, False, False]
    assert settings.message == (
        "Frame 2-3: The transfer function makes every voxel transparent, so the picture is empty."
    )
    assert settings.failed_frames == ""


# --- deletion -----------------------------------------------------------------------------------------------------


def delete_as_a_user(one):
    """X in the 3D view: every pointer of an extension keeps the object's data where it is."""
    with bpy.context.temp_override(selected_objects=[one]):
        bpy.ops.object.delete()


@pytest.mark.parametrize("remove", [delete_as_a_user, lambda one: bpy.data.objects.remove(one)])
def test_B22_a_volume_deleted_by_the_user_or_from_python(volume, tmp_path, remove):
    settings = composite()
    remove(volume)
    assert is_placeholder(scenes.rendered(tmp_path / "out.exr"))
    assert settings.message == (
        "The volume 'cube' was deleted and renders show no other one; import one, or turn Show in Renders off."
    )


def test_B23_a_deleted_channel_is_not_drawn(volume, tmp_path):
    other = scenes.even_cube(tmp_path, N, ALPHA, (1.0, 0.5, 0.25), name="other")
    volume.rle_splat.channels.add().source = other
    bpy.context.view_layer.objects.active = volume
    settings = composite()
    np.testing.assert_allclose(
        scenes.rendered(tmp_path / "out.exr")[8, 8, 3], 1.0 - (1.0 - ALPHA) ** (2 * N), atol=1 / 255
    )
    delete_as_a_user(other)
    assert volume.rle_splat.channels[0].source is not None
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[8, 8, 3], FULL, atol=1 / 255)
    assert settings.message == ""


def test_B24_a_deleted_clip_object_does_not_cut(volume, tmp_path):
    bpy.context.view_layer.objects.active = volume
    assert bpy.ops.rle_splat.add_cutting_object(kind="PLANE") == {"FINISHED"}
    scene, settings = bpy.context.scene, bpy.context.scene.rle_splat
    clip = settings.clip_objects.objects[0]
    clip.location, clip.rotation_euler = (4.0, 4.0, 4.0), (0.0, 0.0, 0.0)
    bpy.context.view_layer.objects.active = volume
    composite()
    half = scenes.rendered(tmp_path / "out.exr")[8, 8, 3]
    assert 0.2 < half < FULL - 0.1
    scene.collection.children.unlink(settings.clip_objects)  # the outliner's Delete Hierarchy
    assert settings.clip_objects.objects[0] == clip
    np.testing.assert_allclose(scenes.rendered(tmp_path / "out.exr")[8, 8, 3], FULL, atol=1 / 255)


# --- without the extension ----------------------------------------------------------------------------------------

RENDER_WITHOUT = """
import os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
assert not hasattr(bpy.types.Scene, "rle_splat")
bpy.context.scene.render.filepath = sys.argv[2]
bpy.ops.render.render(write_still=True)
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.skipif(bool(bpy.app.binary_path), reason="the other process takes Blender as a module of Python")
def test_B70_a_file_rendered_without_the_extension_shows_no_saved_picture(volume, tmp_path):
    """Nor a shifted one with it, at whatever size.  The session keeps its picture when it is saved, and Blender has no
    unsaved picture to ask about."""
    settings = composite()
    scenes.rendered(tmp_path / "seen.exr")
    image, path = settings.composite_image, tmp_path / "saved.blend"
    before = scenes.image_pixels(image)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    np.testing.assert_array_equal(scenes.image_pixels(image), before)
    assert before.max() > 0.5 and not image.is_dirty
    subprocess.run(
        [sys.executable, "-c", RENDER_WITHOUT, str(path), str(tmp_path / "without.exr")], check=True,
        env={"BLENDER_USER_RESOURCES": str(tmp_path / "nobody"), "PATH": "/usr/bin:/bin"})  # fmt: skip
    assert np.abs(scenes.load_pixels(tmp_path / "without.exr")).max() == 0.0
    bpy.ops.wm.open_mainfile(filepath=str(path))
    for percentage in (100, 200, 100):
        bpy.context.scene.render.resolution_percentage = percentage
        np.testing.assert_allclose(scenes.rendered(tmp_path / "again.exr")[..., 3], FULL, atol=1 / 255)
        composite()
        np.testing.assert_allclose(scenes.rendered(tmp_path / "again.exr")[..., 3], FULL, atol=1 / 255)
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
        bpy.ops.wm.open_mainfile(filepath=str(path))
