"""Slices: what their images show, when they are updated, and copies, undo, files and deleted volumes."""

import bpy
import numpy as np
import pytest
from mathutils import Vector

from tests.blender import scenes
from tests.blender.test_messages import delete_as_a_user

pytestmark = pytest.mark.usefixtures("by_numpy")

NX, NY, NZ = 9, 8, 7
LOW, HIGH = 20.0, 220.0
KINDS = {"axial": 2, "coronal": 1, "sagittal": 0}


def decoded(gray):
    """Scene-linear values of sRGB ones."""
    gray = np.asarray(gray, dtype=np.float64)
    return np.where(gray <= 0.04045, gray / 12.92, ((gray + 0.055) / 1.055) ** 2.4)


def shown(values, low=LOW, high=HIGH):
    """The scene-linear gray that a slice shows for values."""
    return decoded(np.clip((np.asarray(values, np.float64) - low) / (high - low), 0.0, 1.0))


@pytest.fixture
def voxels():
    return np.random.default_rng(5).integers(0, 256, (NZ, NY, NX)).astype(np.uint8)


@pytest.fixture
def owner(addon, tmp_path, voxels):
    """A volume of random voxels, a world unit a voxel, whose slices have its window."""
    owner = scenes.import_raw(tmp_path, voxels)
    owner.rle_splat.slices_follow_window = True
    assert bpy.ops.rle_splat.window_level(center=0.5 * (LOW + HIGH), width=HIGH - LOW) == {"FINISHED"}
    return owner


def add(owner, kind="axial"):
    scenes.activate(owner)
    assert bpy.ops.rle_splat.add_slice(kind=kind.upper()) == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def gray_of(one):
    """(H, W) of the image that a slice shows; all of it opaque."""
    pixels = scenes.image_pixels(one.rle_splat.slice_image)
    np.testing.assert_array_equal(pixels[..., 3], 1.0)
    np.testing.assert_array_equal(pixels[..., 0], pixels[..., 2])
    return pixels[..., 0]


def layer(voxels, axis, index):
    """A layer of voxels as a slice shows it: row 0 is the last one."""
    return np.take(voxels, index, axis=2 - axis)[::-1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_slice_shows_the_voxels_of_the_middle_layer(owner, voxels, kind):
    one = add(owner, kind)
    axis = KINDS[kind]
    middle = (NX, NY, NZ)[axis] // 2
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, axis, middle)), atol=1e-6)
    assert one.parent == owner and one.type == "MESH" and tuple(one.location) == (0.0, 0.0, 0.0)
    corners = np.array([one.matrix_world @ vertex.co for vertex in one.data.vertices])
    np.testing.assert_allclose(corners[:, axis], middle, atol=1e-5)
    across = [other for other in range(3) if other != axis]
    np.testing.assert_allclose(corners.min(axis=0)[across], -0.5, atol=1e-5)
    np.testing.assert_allclose(corners.max(axis=0)[across], np.array((NX, NY, NZ))[across] - 0.5, atol=1e-5)
    assert bpy.context.scene.render.use_lock_interface


def test_the_position_of_a_slice_is_in_the_unit_of_the_file(owner):
    one, scene = add(owner), bpy.context.scene
    owner.scale, owner.rotation_euler = (2.0, 2.0, 2.0), (0.3, 0.0, 0.5)  # moves a scan, not where it is cut
    middle = one.rle_splat.slice_position
    one.location.z = 0.002 * scene.rle_splat.scene_scale / 0.001
    before = one.rle_splat.slice_position
    assert before - middle == pytest.approx(2.0)
    scene.rle_splat.scene_scale *= 0.25
    assert one.rle_splat.slice_position == pytest.approx(before)
    one.rle_splat.slice_position = middle - 1.5
    bpy.context.view_layer.update()
    place = owner.matrix_world.inverted() @ one.matrix_world.translation
    one.rle_splat.slice_position = middle
    bpy.context.view_layer.update()
    moved = (place - owner.matrix_world.inverted() @ one.matrix_world.translation).length
    assert moved / scene.rle_splat.scene_scale == pytest.approx(1.5, rel=1e-5)


def test_the_interface_stays_locked_for_slices_when_renders_include_no_volume(owner):
    render = bpy.context.scene.render
    scenes.add_camera((0.0, 0.0, 30.0))
    for has_slice in (False, True):
        render.use_lock_interface = False
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"} and render.use_lock_interface
        if has_slice:
            add(owner, "axial")
        assert bpy.ops.rle_splat.remove_from_renders() == {"FINISHED"}
        assert render.use_lock_interface == has_slice


def test_a_moved_slice_shows_another_layer_and_between_layers_their_mean(owner, voxels):
    one = add(owner)
    one.location.z = 2.0
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2 + 2)), atol=1e-5)
    one.location.z = -0.5
    scenes.update()
    mean = 0.5 * (layer(voxels, 2, NZ // 2).astype(float) + layer(voxels, 2, NZ // 2 - 1))
    np.testing.assert_allclose(gray_of(one), shown(mean), atol=1e-5)


def test_it_follows_the_window_and_the_volume(owner, voxels):
    one = add(owner)
    owner.rle_splat.window_center, owner.rle_splat.window_width = 60.0, 40.0
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2), 40.0, 80.0), atol=1e-5)
    before = gray_of(one)
    owner.location, owner.rotation_euler = (5.0, -3.0, 2.0), (0.4, 0.2, -0.7)
    bpy.context.scene.rle_splat.scene_scale = 0.01
    scenes.update()
    np.testing.assert_allclose(gray_of(one), before, atol=1e-3)  # the slice moves along
    middle = np.array(one.matrix_world.translation)
    expected = owner.matrix_world @ (0.01 * Vector(((NX - 1) / 2, (NY - 1) / 2, NZ // 2)))
    np.testing.assert_allclose(middle, expected, atol=1e-5)


def test_an_oblique_slice_shows_its_plane(addon, tmp_path):
    z, y, x = np.mgrid[:21, :21, :21]
    owner = scenes.import_raw(tmp_path, (2 * x + 3 * y + 4 * z).astype(np.uint8))
    owner.rle_splat.slices_follow_window = True
    assert bpy.ops.rle_splat.window_level(center=90.0, width=180.0) == {"FINISHED"}
    one = add(owner)
    one.rotation_euler, one.location = (0.5, -0.3, 0.8), (0.7, -0.2, 1.1)
    scenes.update()
    pixels = scenes.image_pixels(one.rle_splat.slice_image)
    height, width = pixels.shape[:2]
    columns, rows = np.meshgrid((np.arange(width) + 0.5) / width * 2 - 1, 1 - (np.arange(height) + 0.5) / height * 2)
    matrix = np.array(one.matrix_world)
    places = np.einsum("ij,jhw->ihw", matrix, np.stack((columns, rows, 0 * rows, 1 + 0 * rows)))[:3]
    within = ((places >= 0.0) & (places <= 20.0)).all(axis=0)
    beyond = ((places < -0.51) | (places > 20.51)).any(axis=0)
    assert within.sum() > 100 and beyond.sum() > 20
    expected = shown(2 * places[0] + 3 * places[1] + 4 * places[2], 0.0, 180.0)
    np.testing.assert_allclose(pixels[..., 0][within], expected[within], atol=1e-4)
    assert (pixels[..., 3][within] == 1.0).all() and not pixels[beyond].any()


def test_undo_and_redo_bring_back_pixels(owner, voxels):
    name = owner.name
    bpy.ops.ed.undo_push(message="start")
    one = add(owner).name
    bpy.ops.ed.undo_push(message="added")
    bpy.data.objects[one].location.z = 1.0
    scenes.update()
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    np.testing.assert_allclose(gray_of(bpy.data.objects[one]), shown(layer(voxels, 2, NZ // 2)), atol=1e-5)
    bpy.ops.ed.undo()
    assert one not in bpy.data.objects and name in bpy.data.objects
    bpy.ops.ed.redo()
    np.testing.assert_allclose(gray_of(bpy.data.objects[one]), shown(layer(voxels, 2, NZ // 2)), atol=1e-5)
    bpy.ops.ed.redo()
    np.testing.assert_allclose(gray_of(bpy.data.objects[one]), shown(layer(voxels, 2, NZ // 2 + 1)), atol=1e-5)


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_saved_slice_is_there_after_loading(owner, voxels, tmp_path, is_lost):
    one = add(owner)
    one.location.z = 1.0
    scenes.update()
    path = tmp_path / "work" / "scene.blend"
    path.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    if is_lost:
        for kept in path.parent.rglob("*.exr"):
            kept.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    one = next(one for one in bpy.data.objects if one.rle_splat.is_slice)
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2 + 1)), atol=1e-5)


def test_a_deleted_volume_leaves_a_sentence_and_no_stale_slice(owner, bridge):
    one = add(owner)
    before = gray_of(one)
    delete_as_a_user(owner)
    scenes.update()
    settings = bpy.context.scene.rle_splat
    assert "not the child of a volume" in settings.message and one.name in settings.message
    assert bridge("live.slice_pictures").problem_of(one) == settings.message
    assert scenes.image_pixels(one.rle_splat.slice_image).shape[:2] != before.shape


def test_a_missing_file_leaves_a_sentence(owner, bridge, tmp_path):
    one = add(owner)
    (tmp_path / "cube.raw").unlink()
    bridge("volumes.volumes").forget_all()
    one.location.z = 1.0
    scenes.update()
    assert "click Relocate" in bpy.context.scene.rle_splat.message


@pytest.mark.parametrize("linked", [False, True])
def test_a_copied_slice_has_a_picture_of_its_own(owner, voxels, linked):
    one = add(owner)
    scenes.activate(one)
    assert bpy.ops.object.duplicate(linked=linked) == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    copy.location.z = 2.0
    scenes.update()
    assert copy.rle_splat.slice_image != one.rle_splat.slice_image
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2)), atol=1e-5)
    np.testing.assert_allclose(gray_of(copy), shown(layer(voxels, 2, NZ // 2 + 2)), atol=1e-5)
    for each in (one, copy):
        nodes = each.material_slots[0].material.node_tree.nodes
        assert [node.image for node in nodes if node.type == "TEX_IMAGE"] == [each.rle_splat.slice_image]


def test_a_linked_slice_shows_its_volume_as_it_is_here(owner, voxels, tmp_path):
    one = add(owner)
    path = tmp_path / "work" / "library.blend"
    path.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    name = one.name
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.context.scene.rle_splat.scene_scale = 1.0
    with bpy.data.libraries.load(str(path), link=True) as (_, target):
        target.objects = [name]
    one = target.objects[0]
    for linked in (one, one.parent):
        bpy.context.scene.collection.objects.link(linked)
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2)), atol=1e-5)
    one.parent.rle_splat.window_center = 200.0
    scenes.update()
    expected = shown(layer(voxels, 2, NZ // 2), 200.0 - 0.5 * (HIGH - LOW), 200.0 + 0.5 * (HIGH - LOW))
    np.testing.assert_allclose(gray_of(one), expected, atol=1e-5)


def test_a_copied_scene_has_slices_of_its_own(owner, voxels):
    add(owner)
    bpy.ops.scene.new(type="FULL_COPY")
    scene = bpy.context.scene
    copy = next(one for one in scene.objects if one.rle_splat.is_slice)
    copy.location.z = 1.0
    scenes.update()
    first = next(one for one in bpy.data.objects if one.rle_splat.is_slice and one != copy)
    assert first.rle_splat.slice_image != copy.rle_splat.slice_image
    np.testing.assert_allclose(gray_of(first), shown(layer(voxels, 2, NZ // 2)), atol=1e-5)
    np.testing.assert_allclose(gray_of(copy), shown(layer(voxels, 2, NZ // 2 + 1)), atol=1e-5)


def test_a_removed_image_is_made_again(owner, voxels):
    one = add(owner)
    bpy.data.images.remove(one.rle_splat.slice_image)
    one.location.z = 1.0
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2 + 1)), atol=1e-5)


def test_a_dragged_slice_has_fewer_pixels_and_is_made_in_full_when_it_is_still(owner, voxels, bridge, monkeypatch):
    follow = bridge("live.slice_pictures")
    one = add(owner)
    full = gray_of(one)
    monkeypatch.setattr(follow, "MOST_OF_DRAFT", 12)
    monkeypatch.setattr(follow, "STILL", 0.0)
    one.location.z += 1.0
    scenes.update()  # background mode makes it in full
    follow.forget()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    follow.update(bpy.context.scene, depsgraph, may_wait=True)
    image = one.rle_splat.slice_image
    assert image.size[0] * image.size[1] <= 12
    for _ in range(20):
        if bridge("loop.work")._tick() is None:
            break
    assert gray_of(one).shape == full.shape
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2 + 1)), atol=1e-6)
    follow.update(bpy.context.scene, depsgraph, may_wait=True)  # nothing changed: it stays as it is
    assert tuple(image.size) == full.shape[::-1]


def test_a_render_makes_a_dragged_slice_in_full(owner, bridge, monkeypatch):
    follow = bridge("live.slice_pictures")
    one = add(owner)
    monkeypatch.setattr(follow, "MOST_OF_DRAFT", 12)
    follow.forget()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    follow.update(bpy.context.scene, depsgraph, may_wait=True)
    assert one.rle_splat.slice_image.size[0] < NX
    follow.update(bpy.context.scene, depsgraph, may_wait=False)
    assert tuple(one.rle_splat.slice_image.size) == (NX, NY)


def test_a_slice_is_tagged_only_when_its_pixels_change(owner, voxels):
    """Each tag lets viewports that render start over."""
    one = add(owner)
    image, tagged = one.rle_splat.slice_image, []

    def note(_scene, depsgraph):
        tagged.append(any(update.id.original == image for update in depsgraph.updates))

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        scenes.update()
        tagged.clear()
        other = bpy.data.objects.new("other", None)
        bpy.context.scene.collection.objects.link(other)
        for x in range(4):
            other.location.x = x
            scenes.update()
        assert len(tagged) >= 4 and not any(tagged)
        one.location.z += 1.0
        scenes.update()
        other.location.x = 9.0
        scenes.update()
        assert any(tagged)
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)


def test_new_slices_have_a_window_of_their_own_and_the_volume_keeps_its_own(addon, tmp_path, voxels):
    owner = scenes.import_raw(tmp_path, voxels)
    properties = owner.rle_splat
    volumes_own = properties.window_center, properties.window_width
    one = add(owner)
    low, high = np.sort(voxels.ravel())[[int(np.ceil(share * voxels.size)) - 1 for share in (0.01, 0.995)]]
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2), low, high), atol=1e-5)
    assert not properties.slices_follow_window
    scenes.activate(owner)
    assert bpy.ops.rle_splat.window_level(center=100.0, width=50.0, of_slices=True) == {"FINISHED"}
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2), 75.0, 125.0), atol=1e-5)
    assert (properties.window_center, properties.window_width) == volumes_own
    add(owner, "coronal")  # a later slice leaves the window
    assert (properties.slice_center, properties.slice_width) == (100.0, 50.0)
    properties.slices_follow_window = True
    scenes.update()
    center, width = volumes_own
    expected = shown(layer(voxels, 2, NZ // 2), center - 0.5 * width, center + 0.5 * width)
    np.testing.assert_allclose(gray_of(one), expected, atol=1e-5)


def test_a_ct_begins_with_the_soft_tissue_window(addon, tmp_path, voxels):
    owner = scenes.import_raw(tmp_path, voxels)
    owner.rle_splat.value_unit = "HU"
    add(owner)
    assert (owner.rle_splat.slice_center, owner.rle_splat.slice_width) == (50.0, 400.0)


def test_slices_of_earlier_files_follow_the_volume_until_they_get_a_window(owner):
    properties = owner.rle_splat
    del properties["slices_follow_window"]  # what such a file lacks
    assert properties.slices_follow_window
    properties.slices_follow_window = False
    assert (properties.slice_center, properties.slice_width) == (0.5 * (LOW + HIGH), HIGH - LOW)


def test_black_is_transparent_by_choice(owner, voxels):
    one = add(owner)
    assert (scenes.image_pixels(one.rle_splat.slice_image)[..., 3] == 1.0).all()
    owner.rle_splat.slices_clear_black = True
    scenes.update()
    pixels = scenes.image_pixels(one.rle_splat.slice_image)
    values = layer(voxels, 2, NZ // 2)
    np.testing.assert_array_equal(pixels[..., 3], values > LOW)
    np.testing.assert_allclose(pixels[..., 0], shown(values), atol=1e-5)


def test_the_wheel_moves_a_slice_by_layers_and_not_out_of_its_volume(owner, voxels):
    one = add(owner, "coronal")
    for layers, index in ((1, NY // 2 + 1), (-3, NY // 2 - 2), (-1, 1)):
        assert bpy.ops.rle_splat.scroll_slice(layers=layers) == {"FINISHED"}
        scenes.update()
        np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 1, index)), atol=1e-5)
    assert bpy.ops.rle_splat.scroll_slice(layers=50) == {"FINISHED"}
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 1, NY - 1)), atol=1e-5)
    assert bpy.ops.rle_splat.scroll_slice(layers=1) == {"CANCELLED"}


def test_scrolling_needs_a_slice(owner, refused):
    refused(bpy.ops.rle_splat.scroll_slice, "Add a slice first")
    add(owner)
    scenes.activate(owner)
    refused(bpy.ops.rle_splat.scroll_slice, "no slice; select one")


def test_the_four_up_view_needs_a_viewport(owner, refused):
    with bpy.context.temp_override(area=None):
        refused(bpy.ops.rle_splat.four_up_view, "No 3D viewport is open")


# Kind -> where a reading workstation looks and what is up, in LPS.
LOOKS = {"axial": ((0, 0, 1), (0, -1, 0)), "coronal": ((0, 1, 0), (0, 0, 1)), "sagittal": ((-1, 0, 0), (0, 0, 1))}


@pytest.mark.parametrize("kind", KINDS)
def test_a_view_straight_onto_a_slice_is_as_on_a_reading_workstation(owner, bridge, kind):
    one = add(owner, kind)
    owner.rotation_euler = 0.3, -0.2, 1.1
    scenes.update()
    found = bridge("live.slice_places").straight_onto(one, kind, np.array(owner.matrix_world)).to_matrix()
    turned = np.array(owner.matrix_world.to_3x3())
    for column, sign, expected in ((2, -1.0, LOOKS[kind][0]), (1, 1.0, LOOKS[kind][1])):
        np.testing.assert_allclose(sign * np.array(found.col[column]), turned @ np.array(expected), atol=1e-5)


def test_slices_cross_in_lines(owner, bridge):
    axial, sagittal = add(owner, "axial"), add(owner, "sagittal")
    crossing = bridge("live.slice_places").crossing
    ends = np.array(crossing(axial, sagittal))
    expected = [[NX // 2, -0.5, NZ // 2], [NX // 2, NY - 0.5, NZ // 2]]
    np.testing.assert_allclose(ends[np.argsort(ends[:, 1])], expected, atol=1e-4)
    assert crossing(axial, axial) is None
    sagittal.location.z = 50.0
    scenes.update()
    assert crossing(axial, sagittal) is None


@pytest.mark.parametrize("hide", ["eye", "screen"])
def test_a_slice_of_a_hidden_volume_follows_its_window(owner, voxels, hide):
    one = add(owner)
    if hide == "eye":
        owner.hide_set(True)
    else:
        owner.hide_viewport = True
    scenes.update()
    owner.rle_splat.window_center, owner.rle_splat.window_width = 60.0, 40.0
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2), 40.0, 80.0), atol=1e-6)


def test_a_hidden_slice_has_the_window_of_now_when_it_is_shown(owner, voxels):
    one = add(owner)
    one.hide_set(True)
    owner.rle_splat.window_center, owner.rle_splat.window_width = 60.0, 40.0
    scenes.update()
    one.hide_set(False)
    scenes.update()
    np.testing.assert_allclose(gray_of(one), shown(layer(voxels, 2, NZ // 2), 40.0, 80.0), atol=1e-6)


def test_values_of_a_slice_are_in_memory_as_long_as_it_is(owner, voxels, bridge):
    """Another window takes them from there; they go with their place, and with the slice."""
    store, name = bridge("loop.store"), owner.name

    def values():
        return [key for key in store._entries if key[0] == "slice"]

    one = add(owner)
    scenes.update()
    (first,) = values()
    assert store.nbytes() == voxels.nbytes + NX * NY * (8 + 1) + 16 * 8, "float64, whether inside, and the place"
    one.parent.rle_splat.window_width *= 0.5
    scenes.update()
    assert values() == [first]
    one.location.z += 1.0
    scenes.update()
    assert len(values()) == 1 and values() != [first]
    scenes.activate(one)
    bpy.ops.object.delete()
    scenes.update()
    assert values() == [] and store.nbytes() == voxels.nbytes, name
