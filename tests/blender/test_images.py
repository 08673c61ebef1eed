"""Pictures as image datablocks: exact float values, the right color space, the right way up, through save and load."""

import json
from functools import partial

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy", "classified_first")

COLOR = (0.9, 0.5, 0.2)


@pytest.fixture
def volume(tmp_path):
    """Opaque on a slab of half the height, so that up is up."""
    voxels = np.zeros((9, 9, 9), np.uint8)
    voxels[:, 5:, :] = 200
    owner = scenes.import_raw(tmp_path, voxels, name="slab")
    scenes.give_transfer(owner, ((0.0, 0.0), (255.0, 0.5)), COLOR)
    scenes.add_camera((4.0, 4.0, 30.0), type="ORTHO", ortho_scale=12.0)
    bpy.context.scene.render.resolution_x, bpy.context.scene.render.resolution_y = 40, 40
    return owner


def random_picture(height=5, width=7):
    rng = np.random.default_rng(3)
    rgba = rng.random((height, width, 4)).astype(np.float32)
    rgba[..., :3] *= rgba[..., 3:]
    rgba[0, 0] = (12.5, 1e-3, 0.3, 0.5)  # brighter than white survives
    return rgba


def test_values_survive_packing_saving_and_loading(bridge, tmp_path):
    images = bridge("pictures.images")
    rgba = random_picture()
    depth = np.full((5, 7), 1e10, np.float32)
    depth[1, 2] = 3.14159
    color_image = images.ensure_image(None, "color", 7, 5)
    depth_image = images.ensure_image(None, "depth", 7, 5, depth=True)
    for image in (color_image, depth_image):
        image.use_fake_user = True
    images.write_color(color_image, rgba)
    images.write_numbers(depth_image, depth)
    color_image.pack()
    depth_image.pack()
    assert color_image.alpha_mode == "PREMUL" and color_image.colorspace_settings.name == "Linear Rec.709"
    assert depth_image.colorspace_settings.name == "Non-Color" and color_image.is_float

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    again, depth_again = bpy.data.images["color"], bpy.data.images["depth"]
    np.testing.assert_array_equal(scenes.image_pixels(again), rgba)
    np.testing.assert_array_equal(scenes.image_pixels(depth_again)[..., 0], depth)
    assert again.alpha_mode == "PREMUL" and again.is_float


def test_an_image_is_reused_and_resized(bridge):
    images = bridge("pictures.images")
    image = images.ensure_image(None, "picture", 7, 5)
    images.write_color(image, random_picture())
    image.pack()
    larger = random_picture(9, 4)
    assert images.ensure_image(image, "picture", 4, 9) == image
    images.write_color(image, larger)
    np.testing.assert_array_equal(scenes.image_pixels(image), larger)
    image.pack()
    np.testing.assert_array_equal(scenes.image_pixels(image), larger)


@pytest.fixture(params=["BESIDE", "PACKED"])
def kept(addon, request):
    """Where the user prefers pictures to be kept."""
    preferences = bpy.context.preferences.addons[addon.__name__].preferences
    preferences.pictures = request.param
    yield request.param
    preferences.pictures = "BESIDE"


@pytest.mark.parametrize("depth", [False, True])
def test_pixels_are_kept_bit_for_bit_when_the_file_is_saved(bridge, tmp_path, kept, depth):
    images, rgba = bridge("pictures.images"), random_picture()
    if depth:
        rgba[:] = rgba[..., :1]
        rgba[..., 3] = 1.0
    image = images.ensure_image(None, "A/B: picture", 7, 5, depth=depth)
    image.use_fake_user = True
    images.write_color(image, rgba)
    assert image.packed_file is None  # until then they cost no memory of undo
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / name / f"{name}.blend"))
        rgba[0, 0, 0] += 1.0  # written over a file, or over what was packed
        images.write_color(image, rgba)
    bpy.ops.wm.save_mainfile()
    for name, first in (("first", rgba[0, 0, 0] - 2.0), ("second", rgba[0, 0, 0])):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / name / f"{name}.blend"))
        found, wanted = bpy.data.images["A/B: picture"], rgba.copy()
        wanted[0, 0, 0] = first
        np.testing.assert_array_equal(scenes.image_pixels(found), wanted)
        assert (found.packed_file is not None) == (kept == "PACKED")
        beside = tmp_path / name / f"{name}_rle_splat" / "A_B_ picture.exr"
        assert beside.is_file() == (kept == "BESIDE")
        if kept == "BESIDE":
            assert found.filepath == str(beside)
            written = scenes.stored(tmp_path / name / f"{name}.blend", "images", "A/B: picture").filepath
            assert written.replace("\\", "/") == f"//{name}_rle_splat/A_B_ picture.exr"


def test_pictures_get_file_names_that_every_system_can_have(bridge):
    taken: set = set()
    file_name = bridge("pictures.picture_files")._file_name
    made = [file_name(name, "", taken) for name in ("A/B", "a/b", "..", "con", "NUL.front")]
    assert made == ["A_B.exr", "a_b 2.exr", "picture.exr", "picture con.exr", "picture NUL.front.exr"]


def test_a_folder_that_cannot_be_written_packs_and_says_so(volume, tmp_path):
    bpy.ops.rle_splat.render_image()
    settings = bpy.context.scene.rle_splat
    before = scenes.image_pixels(settings.image)
    (tmp_path / "saved_rle_splat").write_text("a file where the folder should be")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert "could not be written" in settings.message and str(tmp_path) not in settings.message
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    np.testing.assert_array_equal(scenes.image_pixels(bpy.context.scene.rle_splat.image), before)


def test_render_image(volume):
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    settings = bpy.context.scene.rle_splat
    picture, depth = scenes.image_pixels(settings.image), scenes.image_pixels(settings.depth_image)[..., 0]
    assert settings.image.name.startswith("slab") and settings.depth_image.name.startswith("slab")
    assert tuple(settings.image.size) == (40, 40)
    assert picture[10, 20, 3] > 0.9 and picture[30, 20, 3] == 0.0  # +Y, the filled half, is on top
    np.testing.assert_allclose(picture[10, 20, :3], np.array(COLOR) * picture[10, 20, 3], rtol=1e-4)
    # Half the light is left after log(1/2) / log(1 - alpha) units, of which the ramp [8, 9] above the slab counts half.
    units = np.log(0.5) / np.log(1.0 - 0.5 * 200 / 255)
    assert depth[10, 20] == pytest.approx(30.0 - (8.0 - (units - 0.5)), abs=0.01)
    assert depth[30, 20] == np.float32(1e10)
    report = json.loads(settings.last_report_json)
    assert report["image"] == {"width": 40, "height": 40} and "\nVoxels to layers: " in settings.last_report


def test_rendering_again_reuses_the_images(volume):
    bpy.ops.rle_splat.render_image()
    settings = bpy.context.scene.rle_splat
    first, count = settings.image, len(bpy.data.images)
    before = scenes.image_pixels(first)
    bpy.context.scene.render.resolution_percentage = 50
    bpy.ops.rle_splat.render_image()
    assert settings.image == first and len(bpy.data.images) == count
    assert tuple(first.size) == (20, 20)
    np.testing.assert_allclose(scenes.image_pixels(first)[5, 10], before[10, 20], atol=2e-3)


def test_an_image_of_the_users_is_not_overwritten(volume):
    own = bpy.data.images.new("slab Splat", 2, 2)
    bpy.ops.rle_splat.render_image()
    assert tuple(own.size) == (2, 2) and bpy.context.scene.rle_splat.image != own


def test_the_picture_survives_save_and_reload_and_can_be_made_again(volume, tmp_path):
    bpy.ops.rle_splat.render_image()
    before = scenes.image_pixels(bpy.context.scene.rle_splat.image)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    settings = bpy.context.scene.rle_splat
    np.testing.assert_array_equal(scenes.image_pixels(settings.image), before)
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    np.testing.assert_allclose(scenes.image_pixels(settings.image), before, atol=1e-6)


def test_moving_the_volume_moves_the_picture(volume):
    bpy.ops.rle_splat.render_image()
    settings = bpy.context.scene.rle_splat
    before = scenes.centroid(scenes.image_pixels(settings.image)[..., 3])
    volume.location.x += 0.75
    bpy.ops.rle_splat.render_image()
    after = scenes.centroid(scenes.image_pixels(settings.image)[..., 3])
    np.testing.assert_allclose(after - before, (0.75 / 12.0 * 40, 0.0), atol=0.05)


def test_the_picture_is_the_renderers_own(volume, bridge, core):
    """Nothing happens to the picture between the renderer and the image."""
    bpy.ops.rle_splat.render_image()
    plain, quality = scenes.read_scene(volume)
    rendering = core("pipeline.render").render(plain, quality)
    settings = bpy.context.scene.rle_splat
    np.testing.assert_array_equal(scenes.image_pixels(settings.image), rendering.rgba)
    np.testing.assert_array_equal(scenes.image_pixels(settings.depth_image)[..., 0], rendering.depth)


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="Blender 4.5 has one working color space")
def test_once_the_file_is_saved_the_working_color_space_can_change(volume, tmp_path):
    """Blender refuses while an image has unsaved pixels, because it could not convert them.

    It would accept a picture that is packed, or that has a file in a temporary folder.  But packed pixels are in the
    steps of undo, and a file takes 0.3 s for each 1920 x 1080 pixels at every edit of what a backdrop follows.
    """
    scenes.use_cycles((40, 40))
    change = partial(bpy.ops.wm.set_working_color_space, working_space="ACEScg")
    for make in ("render_image", "show_in_renders"):
        assert getattr(bpy.ops.rle_splat, make)() == {"FINISHED"}
    scenes.rendered(tmp_path / "out.exr")
    before = scenes.image_pixels(bpy.context.scene.rle_splat.image)
    assert change() == {"CANCELLED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert change() == {"FINISHED"}
    after = scenes.image_pixels(bpy.context.scene.rle_splat.image)
    np.testing.assert_allclose(after[..., 3], before[..., 3], atol=1e-6)
    assert np.abs(after[..., :3] - before[..., :3]).max() > 0.01, "its colors were not converted"
