"""Save Figure: files, sidecar and view, and the same bits from the command line without Blender."""

import json
from types import SimpleNamespace
from xml.etree import ElementTree

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests.blender import layout_recorder, scenes

BALL = scenes.ball()
SMALL = dict(width_cm=2.0, dpi=60.0, font_size=4.0)


@pytest.fixture
def ball(addon, tmp_path):
    """A ball of 11 mm seen from the patient's head by an orthographic camera that shows 20 mm."""
    return scenes.ball_scene(tmp_path, type="ORTHO", ortho_scale=20.0)


def texts_of(path) -> list[str]:
    root = ElementTree.fromstring(path.read_bytes())
    return [text.text for text in root.iter("{http://www.w3.org/2000/svg}text")]


def texts_of_dialog() -> list[str]:
    cls = next(one for one in layout_recorder.subclasses(bpy.types.Operator) if one.__name__.endswith("_save_figure"))
    log = []
    cls.draw(layout_recorder.Drawn(cls, log, layout_recorder.operator_properties(cls.bl_idname)), bpy.context)
    return [text for kind, text in log if kind == "text"]


def save(path, **options):
    assert bpy.ops.rle_splat.save_figure(filepath=str(path), **{**SMALL, **options}) == {"FINISHED"}


def test_a_figure_is_made_again_without_blender_bit_for_bit(ball, core, tmp_path):
    """By the command line, in this process: the same kernels."""
    path = tmp_path / "fig.svg"
    save(path, title="Ball")
    texts = texts_of(path)
    assert {"Ball", "5 mm", "Values without unit"} <= set(texts)
    sidecar = json.loads((tmp_path / "fig.figure.json").read_text())
    assert sidecar["data"]["file"] == "cube.raw" and sidecar["missing"] == []
    assert tmp_path.as_posix() not in json.dumps(sidecar)
    again = tmp_path / "again.svg"
    assert core("cli.main").main(["figure", str(tmp_path / "fig.figure.json"), "-o", str(again)]) == 0
    assert again.read_bytes() == path.read_bytes()


def test_the_dialog_says_that_slices_are_left_out(ball):
    assert "Slices are not in figures" not in texts_of_dialog()
    assert bpy.ops.rle_splat.add_slice(kind="AXIAL") == {"FINISHED"}
    assert "Slices are not in figures" in texts_of_dialog()


def test_pictures_and_linear_files(ball, core, tmp_path):
    save(tmp_path / "fig.png", background="transparent")
    save(tmp_path / "fig.exr", background="transparent")
    image = bpy.data.images.load(str(tmp_path / "fig.exr"))
    width, height = image.size
    image.colorspace_settings.is_data = True
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    linear = pixels.reshape(height, width, 4)[::-1]
    assert (tmp_path / "fig.png").read_bytes() == core("scene.png").png_bytes(linear, 60.0)
    bpy.data.images.remove(image)


def test_a_dialog_writes_over_no_sidecar_of_another_figure(ball, bridge, core, tmp_path):
    """The file browser marks the name of a figure that is there, and knows nothing of sidecars."""
    figure = bridge("pictures.figure")
    save(tmp_path / "fig.svg")
    figure.check_files(str(tmp_path / "fig.svg"), was_typed=True)
    figure.check_files(str(tmp_path / "fig.png"), was_typed=False)
    with pytest.raises(core("scene").RleSplatError, match=r"fig\.figure\.json belongs to another figure"):
        figure.check_files(str(tmp_path / "fig.png"), was_typed=True)
    free = {name: figure.is_free(str(tmp_path / name)) for name in ("fig.svg", "fig.png", "fig 2.svg")}
    assert free == {"fig.svg": False, "fig.png": False, "fig 2.svg": True}
    assert bpy.ops.rle_splat.save_figure.get_rna_type().properties["check_existing"].default


def test_presets_are_compared(ball, tmp_path):
    """A label in a color of its own, which is not solid, has the opacities of each panel's preset."""
    labels = tmp_path / "labels.raw"
    labels.write_bytes((np.indices(BALL.shape)[2] // 6).astype(np.uint8).tobytes())
    ball.rle_splat.label_file = str(labels)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    ball.rle_splat.labels[1].use_color = True
    save(tmp_path / "fig.svg", compare="ct-bone, ct-skin", width_cm=4.0)
    texts = texts_of(tmp_path / "fig.svg")
    assert {"a", "b", "CT Bone", "CT Skin"} <= set(texts)
    scenes_told = [panel["scene"] for panel in json.loads((tmp_path / "fig.figure.json").read_text())["panels"]]
    opacities = [scene["transfer_function"]["opacity"] for scene in scenes_told]
    of_label = [one["transfer_function"]["opacity"] for scene in scenes_told for one in scene["labels"]["functions"]]
    assert of_label == opacities and opacities[0] != opacities[1]


def test_labels_and_channels_are_made_again_from_a_moved_folder(ball, core, tmp_path):
    """A label in a color of its own, a hidden one, and a further volume; the command line finds all three files."""
    folder = tmp_path / "made"
    folder.mkdir()
    labels = folder / "labels.raw"
    labels.write_bytes((np.indices(BALL.shape)[2] // 4).astype(np.uint8).tobytes())
    ball.rle_splat.label_file = str(labels)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    for row, color in zip(ball.rle_splat.labels, ((0.9, 0.1, 0.1), (0.1, 0.8, 0.2), None)):
        row.label_name, row.show = "Of a patient", color is not None
        if color is not None:
            row.shown_color = color
    other = scenes.import_raw(folder, BALL[::-1].copy())
    bpy.context.view_layer.objects.active = ball
    bridge_row = ball.rle_splat.channels.add()
    bridge_row.name, bridge_row.source = "other", other
    save(folder / "fig.png")
    sidecar = json.loads((folder / "fig.figure.json").read_text())
    assert sidecar["missing"] == [] and "Of a patient" not in json.dumps(sidecar)
    assert [sidecar["data"]["file"], sidecar["labels"]["file"], sidecar["channels"][0]["file"]] == [
        "../cube.raw", "labels.raw", "cube.raw"]  # fmt: skip
    shown = sidecar["panels"][0]["scene"]["labels"]["functions"]
    assert [one["transfer_function"] is None for one in shown] == [False, False, True]
    moved = tmp_path / "moved"
    folder.rename(moved)
    assert core("cli.main").main(["figure", str(moved / "fig.figure.json"), "-o", str(moved / "b.png")]) == 0
    assert (moved / "b.png").read_bytes() == (moved / "fig.png").read_bytes()


@pytest.mark.parametrize("parallel", [True, False])
def test_the_view_is_that_of_the_viewport(ball, bridge, core, parallel):
    """Corners of the volume's box are where the viewport's own matrices put them."""
    width, height = 90, 60
    turned = Matrix.Translation((-3.0, -4.0, -30.0)) @ Matrix.Rotation(0.6, 4, "X") @ Matrix.Rotation(0.3, 4, "Z")
    window = Matrix.Diagonal((0.05, 0.075, -0.01, 1.0))
    if not parallel:
        window = Matrix(((2.0, 0.0, 0.1, 0.0), (0.0, 3.0, 0.0, 0.0), (0.0, 0.0, -1.002, -0.2), (0.0, 0.0, -1.0, 0.0)))
    view = SimpleNamespace(view_matrix=turned, window_matrix=window, view_perspective="ORTHO")
    space = SimpleNamespace(region_3d=view, clip_start=0.1, clip_end=100.0)
    region = SimpleNamespace(type="WINDOW", width=width, height=height)
    area = SimpleNamespace(
        type="VIEW_3D", spaces=SimpleNamespace(active=space), regions=[region], width=width, height=height
    )
    screen = SimpleNamespace(areas=[area])
    context = SimpleNamespace(window=SimpleNamespace(screen=screen), area=None, scene=bpy.context.scene)
    camera, *size = bridge("pictures.figure").viewport_camera(context, ball)
    assert size == [width, height] and camera.type == ("ORTHO" if parallel else "PERSP")
    corners = np.column_stack((bridge("volumes.box").world_corners(ball), np.ones(8)))
    clip = corners @ np.array(window @ turned).T
    expected = (0.5 + 0.5 * clip[:, :2] / clip[:, 3:] * (1.0, -1.0)) * (width, height)
    seen = corners @ core("view.projection").world_to_pixel(camera, width, height).T
    assert np.allclose(seen[:, :2] / seen[:, 2:], expected, atol=1e-3)
    context.window.screen.areas.clear()
    with pytest.raises(core("scene").RleSplatError, match="There is no 3D viewport"):
        bridge("pictures.figure").viewport_camera(context, ball)


def test_bad_input_is_refused(ball, refused, tmp_path):
    save_figure, path = bpy.ops.rle_splat.save_figure, str(tmp_path / "fig.png")
    refused(save_figure, "The figure has no file", filepath="")
    refused(save_figure, "has no suffix of a format of figures", filepath=str(tmp_path / "fig.tif"))
    refused(save_figure, "does not exist", filepath=str(tmp_path / "nowhere" / "fig.png"))
    refused(save_figure, "There is no preset 'bones'", filepath=path, compare="bones")
    refused(save_figure, "not known where the patient's sides are", filepath=path, sides="letters")
    refused(save_figure, "has the character", filepath=path, title="頭")
    bpy.context.scene.camera.data.type = "PERSP"
    refused(save_figure, "at one depth only", filepath=path, scale_length=5.0)
    bpy.context.scene.camera.data.type = "ORTHO"
    bpy.context.scene.rle_splat.max_error = 2.0
    refused(save_figure, "cannot be made with a Maximum Error", filepath=path)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["cube.raw"]


def test_the_scan_itself_is_never_overwritten(ball, refused, tmp_path):
    """A file's content decides its format, so a scan may be called as a figure or a baked volume is."""
    for name, operator in (("scan.png", bpy.ops.rle_splat.save_figure), ("scan.vdb", bpy.ops.rle_splat.bake_volume)):
        path = tmp_path / name
        path.write_bytes(BALL.tobytes())
        ball.rle_splat.filepath = str(path)
        refused(operator, "'cube' is read from, and is never overwritten", filepath=str(tmp_path / "." / name))
        assert path.read_bytes() == BALL.tobytes()


def test_the_caption_names_a_preset_and_what_was_changed(volume_object, bridge, core):
    """Blender's numbers of 32 bits are none."""
    properties, function_words = volume_object.rle_splat, core("figure.layout")._function_words
    properties.value_unit = "HU"
    presets = core("classify.presets").PRESETS
    for name in (one for one in presets if core("classify.presets").preset(one).unit == "HU"):
        label = presets[name].label
        assert bpy.ops.rle_splat.apply_preset(preset=name) == {"FINISHED"}
        scene = SimpleNamespace(
            transfer_function=bridge("look.transfer").read_transfer(volume_object),
            volume=SimpleNamespace(unit="mm", spacing=np.ones(3)),
        )
        assert function_words(scene) == label
        properties.window_center -= 100.0
        properties.opacity_unit_distance = 0.05
        scene.transfer_function = bridge("look.transfer").read_transfer(volume_object)
        assert function_words(scene) == f"{label}, shifted by −100 HU, opacity unit distance 0.05 mm"
        properties.opacity_scale = 0.5
        scene.transfer_function = bridge("look.transfer").read_transfer(volume_object)
        words = function_words(scene)
        assert words.startswith(f"{label}, modified") and words.endswith(", opacity unit distance 0.05 mm")
        if name == "ct-bone":
            assert words.startswith("CT Bone, modified: opacity 0 at 170, 0.17 at 350, 0.38 at 800, 0.47 at 1900 HU,")
