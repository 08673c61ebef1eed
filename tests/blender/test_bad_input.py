"""Each mistake gets one sentence in Blender's own report that says what to do, and the scene stays as it was."""

import sys

import bpy
import numpy as np
import pytest

from tests.blender import scenes

PICTURE_OPERATORS = ("render_image", "preview_in_camera_view", "show_in_renders")


@pytest.fixture
def volume(tmp_path):
    owner = scenes.even_cube(tmp_path, 9, 0.3, (0.9, 0.5, 0.2))
    scenes.use_cycles((32, 32))
    return owner


def refusal(operator, **arguments):
    """What ``bpy.ops.rle_splat.<operator>`` says when it refuses, having changed nothing."""
    before = state()
    with pytest.raises(RuntimeError) as caught:
        getattr(bpy.ops.rle_splat, operator)(**arguments)
    assert state() == before
    text = str(caught.value)
    assert "Traceback" not in text
    return text


def state():
    """What a refusal must leave alone."""
    scene = bpy.context.scene
    return (
        sorted(o.name for o in bpy.data.objects), sorted(i.name for i in bpy.data.images),
        sorted(t.name for t in bpy.data.node_groups), [len(c.background_images) for c in bpy.data.cameras],
        scene.rle_splat.use_composite, scene.render.use_lock_interface, scene.rle_splat.image,
    )  # fmt: skip


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_no_volume(operator):
    scenes.add_camera()
    assert "Import a volume" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_no_camera(volume, operator):
    assert "no active camera" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
@pytest.mark.parametrize("kind", ["PANO", "CUSTOM"])
def test_a_panoramic_camera(volume, operator, kind):
    scenes.add_camera(type=kind)
    assert "Perspective or Orthographic" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_an_object_that_is_no_camera(volume, operator):
    bpy.context.scene.camera = volume
    assert "not a camera" in refusal(operator)


@pytest.mark.parametrize("operator", ["render_image", "preview_in_camera_view"])
def test_a_camera_that_sees_nothing(volume, operator):
    scenes.add_camera((500.0, 0.0, 10.0))
    assert "does not see the volume" in refusal(operator)


@pytest.mark.parametrize("operator", ["render_image", "preview_in_camera_view"])
def test_a_volume_scaled_to_nothing(volume, operator):
    scenes.add_camera()
    volume.scale = (1.0, 0.0, 1.0)
    assert "give it a scale other than zero on every axis" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_a_camera_scaled_to_nothing(volume, operator):
    scenes.add_camera((4.0, 4.0, 30.0)).scale = (0.0, 0.0, 0.0)
    assert "scale of the camera" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_a_file_that_is_gone(volume, bridge, operator, tmp_path):
    scenes.add_camera((4.0, 4.0, 30.0))
    bridge("volumes.volumes").forget_all()
    (tmp_path / "cube.raw").unlink()
    assert "Relocate" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_no_transfer_function(volume, operator):
    scenes.add_camera((4.0, 4.0, 30.0))
    volume.rle_splat.transfer = None
    assert "transfer function" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_several_volumes_and_none_chosen(volume, operator, tmp_path):
    scenes.add_camera((4.0, 4.0, 30.0))
    scenes.import_raw(tmp_path, np.full((3, 3, 3), 1, np.uint8), name="second")
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = None
    assert "Select one" in refusal(operator)


@pytest.mark.parametrize("operator", PICTURE_OPERATORS)
def test_stereoscopy(volume, operator):
    scenes.add_camera((4.0, 4.0, 30.0))
    bpy.context.scene.render.use_multiview = True
    assert "stereoscopy" in refusal(operator)


def test_a_blank_transfer_function_warns(volume):
    """Blank is allowed, and said: the picture is made and the report explains it."""
    scenes.add_camera((4.0, 4.0, 30.0))
    volume.rle_splat.opacity_scale = 0.0
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    assert scenes.image_pixels(bpy.context.scene.rle_splat.image)[..., 3].max() == 0.0
    assert "transparent" in bpy.context.scene.rle_splat.last_report_json


def test_a_removed_volume_is_told(volume, tmp_path):
    scenes.add_camera((4.0, 4.0, 30.0))
    bpy.ops.rle_splat.show_in_renders()
    assert scenes.rendered(tmp_path / "seen.exr")[16, 16, 3] > 0.3
    bpy.data.objects.remove(volume)
    assert scenes.rendered(tmp_path / "gone.exr")[..., 3].min() == 1.0  # a placeholder
    assert "was deleted" in bpy.context.scene.rle_splat.message
    assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}


def test_a_deleted_picture_is_told(volume, tmp_path):
    scenes.add_camera((4.0, 4.0, 30.0))
    bpy.ops.rle_splat.show_in_renders()
    bpy.data.images.remove(bpy.context.scene.rle_splat.composite_image)
    scenes.rendered(tmp_path / "gone.exr")
    assert "turn Show in Renders off and on" in bpy.context.scene.rle_splat.message


def test_nodes_deleted_by_hand_are_told(volume, bridge, tmp_path):
    scenes.add_camera((4.0, 4.0, 30.0))
    bpy.ops.rle_splat.show_in_renders()
    tree = bridge("versions").compositor_tree(bpy.context.scene)
    for node in [node for node in tree.nodes if node.bl_idname == "CompositorNodeAlphaOver"]:
        tree.nodes.remove(node)
    scenes.rendered(tmp_path / "gone.exr")
    assert "removed from the compositor" in bpy.context.scene.rle_splat.message


@pytest.mark.skipif(sys.platform != "linux", reason="Blender needs libEGL on Linux alone")
def test_a_compositor_that_would_abort_blender(volume, bridge, monkeypatch):
    def no_library(name):
        raise OSError(name)

    scenes.add_camera((4.0, 4.0, 30.0))
    bpy.context.scene.render.compositor_device = "GPU"
    monkeypatch.setattr(bridge("versions").ctypes, "CDLL", no_library)
    assert "libegl1" in refusal("show_in_renders")


def test_numba_missing_is_told_in_panel_and_report(volume, core, monkeypatch):
    """The same picture is made without it, and both places say why it took so long."""
    scenes.add_camera((4.0, 4.0, 30.0))
    bpy.ops.rle_splat.render_image()
    compiled = scenes.image_pixels(bpy.context.scene.rle_splat.image)
    for module in ("runtime.jit", "pipeline.report"):
        monkeypatch.setattr(core(module), "NUMBA_PROBLEM", "ImportError: no numba here")
    with core("runtime.jit").use_reference():
        assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    settings = bpy.context.scene.rle_splat
    for shown in (settings.last_report, settings.last_report_json):
        assert "without compiled code (ImportError: no numba here)" in shown
    np.testing.assert_allclose(scenes.image_pixels(settings.image), compiled, atol=1e-5)


@pytest.mark.parametrize("content, words", [
    ('{"opacity": [], "color": [[0, 1, 1, 1]]}', "opacity"), ("{}", "opacity"), ("{not json", "empty.json"),
])  # fmt: skip
def test_an_empty_transfer_function(volume, tmp_path, content, words):
    path = tmp_path / "empty.json"
    path.write_text(content)
    before = volume.rle_splat.transfer_name
    assert words in refusal("load_transfer_function", filepath=str(path))
    assert volume.rle_splat.transfer_name == before
