"""Files: pictures beside the .blend, through save, save-as, revert and reload; the extension missing; volume files that
change while frames go by."""

import shutil

import bpy
import numpy as np
import pytest

from tests.blender import scenes
from tests.blender.test_animation import animated

pytestmark = pytest.mark.usefixtures("by_numpy")

PICTURES = ("render_image", "preview_in_camera_view", "shadow_pass", "measure_accuracy", "error_map")


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.cube_scene(tmp_path)


def our_images():
    """Everything that the operators made: what the scene points at, and what the camera shows."""
    scene = bpy.context.scene
    pointed = (scene.rle_splat.image, scene.rle_splat.depth_image, scene.rle_splat.error_image)
    return [image for image in (*pointed, *scenes.backdrops(scene.camera)) if image is not None]


def our_pictures():
    """Their pixels."""
    return [scenes.image_pixels(image) for image in our_images()]


def make_pictures():
    """A backdrop that follows, another picture with its depth, and a map of errors."""
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    bpy.context.scene.rle_splat.mode = "mip"
    scenes.picture_of()
    bpy.context.scene.rle_splat.mode = "composite"
    scenes.update()
    assert bpy.ops.rle_splat.error_map(step=8) == {"FINISHED"}


def assert_same(pictures, before):
    assert len(pictures) == len(before)
    for picture, earlier in zip(pictures, before):
        np.testing.assert_array_equal(picture, earlier)


def save(path, **options):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), **options)


def load(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))


def folder_of(blend):
    return blend.with_name(f"{blend.stem}_rle_splat")


def test_B62_pictures_are_no_undo_steps(owner):
    for name in PICTURES:
        assert not {"REGISTER", "UNDO"} & getattr(bpy.types, f"RLE_SPLAT_OT_{name}").bl_options, name
    name = owner.name
    bpy.ops.ed.undo_push(message="start")
    owner.location.x = 2.0
    bpy.ops.ed.undo_push(message="moved")
    for _ in range(10):
        bpy.ops.rle_splat.render_image("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    assert bpy.data.objects[name].location.x == 0.0


def test_B63_pictures_are_not_packed_before_the_blend_is_saved(owner, tmp_path):
    make_pictures()
    save(tmp_path / "saved.blend")
    make_pictures()
    assert [image.name for image in our_images() if image.packed_file] == []


def test_B64_pictures_are_written_beside_a_saved_blend(owner, tmp_path):
    make_pictures()
    before = our_pictures()
    save(tmp_path / "saved.blend")
    files = sorted(folder_of(tmp_path / "saved.blend").glob("*.exr"))
    held = [scenes.load_pixels(path)[..., :3] for path in files]
    for pixels in before:
        assert any(one.shape == pixels[..., :3].shape and (one == pixels[..., :3]).all() for one in held)
    assert not any(image.packed_file for image in bpy.data.images)


@pytest.fixture
def packed(addon):
    """The preference that pictures are packed."""
    preferences = bpy.context.preferences.addons[addon.__name__].preferences
    preferences.pictures = "PACKED"
    yield
    preferences.property_unset("pictures")


def test_B65_pictures_packed_by_the_preference(owner, packed, tmp_path):
    make_pictures()
    before = our_pictures()
    save(tmp_path / "saved.blend")
    assert not folder_of(tmp_path / "saved.blend").exists()
    load(tmp_path / "saved.blend")
    assert_same(our_pictures(), before)
    assert bpy.context.scene.rle_splat.image.packed_file is not None


def test_undo_across_save_as_keeps_the_pictures(owner, bridge, tmp_path):
    """The folder of the new .blend has another patient's picture under the name of the old one."""
    make_pictures()
    before = our_pictures()
    save(tmp_path / "saved.blend")
    bpy.ops.ed.undo_push(message="opened")
    bpy.context.scene.camera.location.z += 1.0
    bpy.ops.ed.undo_push(message="moved")
    other = tmp_path / "other"
    shutil.copytree(folder_of(tmp_path / "saved.blend"), folder_of(other / "saved.blend"))
    for path in folder_of(other / "saved.blend").iterdir():
        bridge("pictures.images").save_exr(np.full((4, 4, 4), 0.5, np.float32), str(path))
    save(other / "new.blend")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert_same(our_pictures(), before)
    scenes.save_and_reload(other / "new.blend")
    assert_same(our_pictures(), before)


def test_pictures_of_a_renamed_blend_are_not_replaced(owner, tmp_path):
    """It still reads them from the folder with its old name, and another .blend gets that name."""
    make_pictures()
    save(tmp_path / "saved.blend")
    (tmp_path / "saved.blend").rename(tmp_path / "renamed.blend")
    before = {path: path.read_bytes() for path in folder_of(tmp_path / "saved.blend").iterdir()}
    bpy.ops.wm.read_homefile(use_empty=True)
    scenes.cube_scene(tmp_path, color=scenes.BLUE)
    make_pictures()
    other = our_pictures()
    for _again in range(2):
        scenes.save_and_reload(tmp_path / "saved.blend")
        assert_same(our_pictures(), other)
    assert {path: path.read_bytes() for path in before} == before
    assert len(list(folder_of(tmp_path / "saved.blend").iterdir())) == 2 * len(before)


def test_B66_save_and_reload(owner, tmp_path):
    make_pictures()
    before = our_pictures()
    scenes.save_and_reload(tmp_path / "saved.blend")
    assert_same(our_pictures(), before)
    camera, count = bpy.context.scene.camera, len(bpy.data.images)
    middle = scenes.shown_at(scenes.backdrop_of(camera))
    camera.location.x += 2.0
    scenes.to_frame(2)
    np.testing.assert_allclose(scenes.shown_at(scenes.backdrop_of(camera)) - middle, (-4.0, 0.0), atol=0.1)
    make_pictures()
    assert len(bpy.data.images) == count
    after = our_pictures()
    scenes.save_and_reload(tmp_path / "saved.blend")  # over the files of the first time
    assert_same(our_pictures(), after)


@pytest.mark.parametrize("copy", [False, True], ids=["save as", "save copy"])
def test_B67_saved_under_another_name(owner, tmp_path, copy):
    make_pictures()
    first = our_pictures()
    save(tmp_path / "first.blend")
    owner.location.y += 2.0
    make_pictures()
    second = our_pictures()
    (tmp_path / "other").mkdir()
    save(tmp_path / "other/second.blend", copy=copy)
    assert_same(our_pictures(), second)
    load(tmp_path / "first.blend")
    assert_same(our_pictures(), first)
    (tmp_path / "other").rename(tmp_path / "moved")  # with what is beside it
    load(tmp_path / "moved/second.blend")
    assert_same(our_pictures(), second)


def test_B68_revert(owner, tmp_path):
    make_pictures()
    first = our_pictures()
    save(tmp_path / "first.blend")
    owner.location.y += 2.0
    make_pictures()
    assert np.abs(our_pictures()[0] - first[0]).max() > 0.1
    assert bpy.ops.wm.revert_mainfile() == {"FINISHED"}
    assert_same(our_pictures(), first)


def test_B69_the_folder_of_pictures_is_lost(owner, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    make_pictures()
    save(tmp_path / "saved.blend")
    shutil.rmtree(folder_of(tmp_path / "saved.blend"), ignore_errors=True)
    load(tmp_path / "saved.blend")
    camera, count = bpy.context.scene.camera, len(bpy.data.images)
    scenes.to_frame(2)
    assert scenes.shown_at(scenes.backdrop_of(camera)) == pytest.approx((12.0, 12.0), abs=0.1)
    make_pictures()
    assert len(bpy.data.images) == count
    assert scenes.rendered(tmp_path / "out.exr")[12, 12, 3] > 0.8
    before = our_pictures()
    scenes.save_and_reload(tmp_path / "saved.blend")
    assert_same(our_pictures(), before)


def disable(addon):
    bpy.ops.preferences.addon_disable(module=addon.__name__)
    assert not hasattr(bpy.types.Scene, "rle_splat")


def enable(addon):
    bpy.ops.preferences.addon_enable(module=addon.__name__)


def test_B71_saved_without_the_extension(owner, addon, tmp_path):
    bpy.ops.rle_splat.show_in_renders()
    make_pictures()
    before = our_pictures()
    save(tmp_path / "first.blend")
    disable(addon)
    load(tmp_path / "first.blend")
    bpy.ops.mesh.primitive_cube_add(location=(50.0, 50.0, 0.0))
    save(tmp_path / "second.blend")
    enable(addon)
    load(tmp_path / "second.blend")
    assert_same(our_pictures(), before)
    assert bpy.data.objects["cube"].rle_splat.is_volume
    assert scenes.rendered(tmp_path / "out.exr")[12, 12, 3] > 0.8
    bpy.context.scene.camera.location.x += 2.0
    scenes.to_frame(2)
    assert scenes.shown_at(scenes.backdrop_of(bpy.context.scene.camera)) == pytest.approx((8.0, 12.0), abs=0.1)


def test_pictures_of_a_file_that_was_opened_without_the_extension_are_replaced(owner, addon, bridge, tmp_path):
    make_pictures()
    save(tmp_path / "saved.blend")
    before = set(folder_of(tmp_path / "saved.blend").iterdir())
    bridge("pictures.picture_files")._of_this_file.clear()  # as in a session that begins without the extension
    disable(addon)
    load(tmp_path / "saved.blend")
    enable(addon)
    bpy.context.scene.camera.location.x += 2.0
    make_pictures()
    save(tmp_path / "saved.blend")
    assert set(folder_of(tmp_path / "saved.blend").iterdir()) == before


def write_vdb(path, side):
    """A file that says its own size, of a uniform cube."""
    bpy.utils.expose_bundled_modules()
    import openvdb

    grid = openvdb.FloatGrid()
    grid.copyFromArray(np.full((side,) * 3, 100.0, np.float32))
    grid.name = "density"
    openvdb.write(str(path), grids=[grid])


def each_frame(act):
    """Call ``act(frame)`` before each frame, as a handler of the user's; returns it, to be removed."""

    def handler(scene, *_):
        act(scene.frame_current)

    bpy.app.handlers.frame_change_pre.append(handler)
    return handler


@pytest.mark.parametrize("kind", ["raw", "vdb"])
def test_B72_a_file_of_another_size_between_frames(addon, tmp_path, kind):
    """A raw file's size is given with its options, so another does not fit them; a VDB says its own."""
    scenes.cube_scene(tmp_path)
    scene, path = bpy.context.scene, tmp_path / f"cube.{kind}"
    contents = {7: (tmp_path / "cube.raw").read_bytes(), 3: bytes([100]) * 27}
    if kind == "vdb":
        for side in (3, 7):
            write_vdb(path, side)
            contents[side] = path.read_bytes()
        scene.rle_splat.scene_scale = 0.001  # of a millimeter: a VDB is in world units
        assert bpy.ops.rle_splat.import_volume(filepath=str(path)) == {"FINISHED"}
        scenes.load_color(tmp_path, scenes.RED)
    sides = {1: 7, 2: 3, 3: 7}
    scene.frame_start, scene.frame_end = 1, 3
    bpy.ops.rle_splat.show_in_renders()
    handler = each_frame(lambda frame: path.write_bytes(contents[sides[frame]]))
    try:
        frames = animated(tmp_path)
    finally:
        bpy.app.handlers.frame_change_pre.remove(handler)
    np.testing.assert_array_equal(frames[0], frames[2])
    counts = [np.count_nonzero(alpha > 0.2) for alpha in frames]
    assert counts[0] > 100
    if kind == "vdb":
        assert 10 < counts[1] < 0.5 * counts[0] and "has changed" in scene.rle_splat.message
    else:
        assert path.name in scene.rle_splat.message


def test_B73_a_handler_changes_the_path(owner, tmp_path):
    """A series of files: the filled half of the cube is the left, the right, the left one."""
    scene, name = bpy.context.scene, owner.name
    for side, columns in (("left", slice(0, 4)), ("right", slice(3, 7))):
        voxels = np.zeros((7, 7, 7), np.uint8)
        voxels[:, :, columns] = 100
        (tmp_path / f"{side}.raw").write_bytes(voxels.tobytes())
    sides = {1: "left", 2: "right", 3: "left"}
    scene.frame_start, scene.frame_end = 1, 3
    bpy.ops.rle_splat.show_in_renders()
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)

    def choose(frame):
        bpy.data.objects[name].rle_splat.filepath = str(tmp_path / f"{sides[frame]}.raw")

    handler = each_frame(choose)
    try:
        frames = [scenes.centroid(alpha)[0] for alpha in animated(tmp_path)]
        for frame, side in sides.items():
            scenes.to_frame(frame)
            assert (scenes.shown_at(scenes.backdrop_of(scene.camera))[0] < 12.0) == (side == "left")
    finally:
        bpy.app.handlers.frame_change_pre.remove(handler)
    assert frames[0] < 11.0 and frames[1] > 13.0 and frames[2] < 11.0


def test_B74_drivers(owner, tmp_path):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    owner.driver_add("location", 0).driver.expression = "frame - 1"
    owner.rle_splat.driver_add("opacity_scale").driver.expression = "1 / frame"
    bpy.ops.rle_splat.show_in_renders()
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    frames = animated(tmp_path)
    for frame, alpha in enumerate(frames, start=1):
        scenes.to_frame(frame)
        shown = scenes.backdrop_of(scene.camera)[..., 3]
        np.testing.assert_allclose(shown, alpha, atol=1e-4)
        assert scenes.centroid(alpha)[0] == pytest.approx(12.0 + 2.0 * (frame - 1), abs=0.2)
        column = 12 + 2 * (frame - 1)
        assert alpha[12, column] == pytest.approx(1.0 - (1.0 - 0.3 / frame) ** 6, abs=0.01)
