"""Undo and redo after every operator, the extension switched off and on again, scripts reloaded."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

SIMPLE = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}


@pytest.fixture
def owner(addon, tmp_path):
    return scenes.cube_scene(tmp_path)


def plain(group):
    """The values of a property group, and of the rows in its collections."""
    found = {}
    for entry in group.bl_rna.properties:
        value = getattr(group, entry.identifier)
        if entry.type in SIMPLE:
            found[entry.identifier] = tuple(value) if getattr(entry, "is_array", False) else value
        elif entry.type == "COLLECTION":
            found[entry.identifier] = [plain(row) for row in value]
        elif entry.identifier not in ("rna_type", "id_data"):
            found[entry.identifier] = getattr(value, "name", None)
    return found


def function_of(tree):
    """Curve and ramp of a transfer function's node group, with the keyframes on them."""
    points = [tuple(point.location) for point in tree.nodes["Opacity"].mapping.curves[0].points]
    stops = [(stop.position, *stop.color) for stop in tree.nodes["Color"].color_ramp.elements]
    return points, stops, tree.animation_data is not None


def state():
    """What an edit may change, in the whole .blend."""
    scene = bpy.context.scene
    volumes = [one for one in bpy.data.objects if one.rle_splat.is_volume]
    tree = scene.compositing_node_group if bpy.app.version >= (5, 0) else scene.use_nodes and scene.node_tree
    return {
        "objects": {one.name: tuple(map(tuple, one.matrix_basis)) for one in scene.objects},
        "volumes": {one.name: plain(one.rle_splat) for one in volumes},
        "functions": {one.name: function_of(one.rle_splat.transfer) for one in volumes},
        "backdrops": [(one.image.name, one.display_depth) for one in scene.camera.data.background_images],
        "compositor": sorted((one.from_node.name, one.to_node.name) for one in tree.links) if tree else None,
        "clip objects": sorted(one.name for one in getattr(scene.rle_splat.clip_objects, "all_objects", ())),
        "composited": (scene.rle_splat.use_composite, getattr(scene.rle_splat.composite_object, "name", None)),
        "quality": (scene.rle_splat.quality, scene.rle_splat.classification, scene.rle_splat.sheet_density),
        "labels": [len(one.rle_splat.labels) for one in volumes],
    }


def two_volumes(tmp_path):
    other = scenes.add_cube(tmp_path, "other", scenes.BLUE)
    scenes.activate(bpy.data.objects["cube"], other)


def one_channel(tmp_path):
    two_volumes(tmp_path)
    bpy.ops.rle_splat.add_channels()


def shared_function(tmp_path):
    owner = bpy.data.objects["cube"]
    copy = owner.copy()
    bpy.context.scene.collection.objects.link(copy)
    scenes.activate(owner)


def clip_box(tmp_path):
    bpy.ops.rle_splat.add_cutting_object(kind="BOX")
    scenes.activate(bpy.data.objects["cube"])


def large_clip_box(tmp_path):
    bpy.ops.rle_splat.add_cutting_object(kind="BOX")
    bpy.context.object.scale *= 3.0  # around all of the volume
    scenes.activate(bpy.context.object)


def labels(tmp_path):
    path = tmp_path / "labels.raw"
    path.write_bytes(np.repeat(np.arange(7, dtype=np.uint8) % 3, 49).tobytes())
    bpy.data.objects["cube"].rle_splat.label_file = str(path)


def listed_labels(tmp_path):
    labels(tmp_path)
    bpy.ops.rle_splat.load_segments()


def composited(tmp_path):
    bpy.ops.rle_splat.show_in_renders()


def backdrop(tmp_path):
    bpy.ops.rle_splat.preview_in_camera_view()


def measured(tmp_path):
    row = bpy.context.scene.rle_splat.accuracy_rows.add()  # measuring compiles every plan's kernels
    row.name, row.knobs, row.truth = "denser", '{"sheet_density": 1.5}', "T2"


def own_preset(tmp_path):
    assert bpy.ops.rle_splat.save_user_preset(name="one color", overwrite=True) == {"FINISHED"}
    bpy.ops.rle_splat.apply_preset(preset="faint")


# operator -> (its options, what stands in for a file in them, what has to be there before)
EDITS = {
    "import_volume": (dict(filepath="cube.raw", shape=(7, 7, 7), dtype="uint8"), None),
    "relocate_volume": (dict(filepath="elsewhere.raw"), None),
    "apply_preset": (dict(preset="faint"), None),
    "load_transfer_function": (dict(filepath="one_color.json"), None),
    "apply_user_preset": (dict(name="one color"), own_preset),
    "window_level": (dict(center=90.0, width=40.0, keep_values=True), None),
    "drag_window": (dict(center=90.0, width=40.0), None),
    "make_single_user": ({}, shared_function),
    "keyframe_transfer_function": ({}, None),
    "show_in_renders": ({}, None),
    "remove_from_renders": ({}, composited),
    "remove_from_camera_view": ({}, backdrop),
    "choose_plan": (dict(index=0), measured),
    "add_cutting_object": (dict(kind="BOX", keep="INSIDE"), None),
    "cut_along_view": (dict(through="VIEW"), None),
    "add_slice": (dict(kind="ALL"), None),
    "add_letters": ({}, None),
    "add_name": (dict(text="Corner", point=(0.003, 0.003, 0.003)), None),
    "add_lights": (dict(kind="SMOKE"), None),
    "load_segments": ({}, labels),
    "show_segment_alone": (dict(label=1), listed_labels),
    "add_names": ({}, listed_labels),
    "clear_segments": ({}, listed_labels),
    "color_by_anatomy": ({}, listed_labels),
    "add_channels": ({}, two_volumes),
    "import_channel": (dict(filepath="cube.raw", shape=(7, 7, 7), dtype="uint8"), None),
    "remove_channel": (dict(index=0), one_channel),
    "delete_cutting_object": (dict(name="Cut Box"), clip_box),
    "fit_cutting_object": ({}, large_clip_box),
    "gray_values_on_cut": ({}, clip_box),
    "reload_volume": (dict(flip=(True, False, False)), None),
    "extract_surface": ({}, None),
    "bake_volume": (dict(filepath="baked.vdb"), None),
}
PICTURES = {"render_image": {}, "preview_in_camera_view": {}, "shadow_pass": {}, "error_map": dict(step=8)}
# Of which nothing is undone.
READERS = (
    "list_effects",
    "save_figure",
    "save_transfer_function",
    "measure_accuracy",
    "clear_cache",
    "value_at_surface",
)
VIEWS = (  # of views and the selection alone; those of slices are tested in a window
    "frame_volume", "try_again", "choose_object", "use_window_tool", "plain_background", "four_up_view", "scroll_slice",
    "show_tab",
)  # fmt: skip
OF_THE_SCENE = ("hide_mesh", "update_world_light")  # not of a volume
FILES = ("save_user_preset", "delete_user_preset", "import_presets")  # of presets, which have no undo
CHOICES = ("choose_transfer_function", "name_structure")  # dialogs and clicks, which call one of the others
MOVIES = ("turntable",)  # the camera that one adds is undone below
SEGMENTS = (  # undone in test_segment_tools.py
    "hide_table", "keep_connected", "pick_connected", "threshold_segment", "change_segment", "export_segments",
)  # fmt: skip
SERIES = ("import_dicom_series", "choose_series")  # undone in test_series.py


def test_B75_every_operator_is_listed(addon):
    listed = {*EDITS, *PICTURES, *READERS, *FILES, *CHOICES, *VIEWS, *MOVIES, *SERIES, *SEGMENTS, *OF_THE_SCENE}
    assert listed == set(dir(bpy.ops.rle_splat))


@pytest.mark.parametrize("name", EDITS)
def test_B75_undo_and_redo_of_an_edit(owner, tmp_path, name):
    options, prepare = EDITS[name]
    if prepare is not None:
        prepare(tmp_path)
    if name == "relocate_volume":
        (tmp_path / "elsewhere.raw").write_bytes((tmp_path / "cube.raw").read_bytes())
    if name == "load_transfer_function":
        bpy.data.objects["cube"].rle_splat.window_width += 1.0
    if "filepath" in options:
        options = {**options, "filepath": str(tmp_path / options["filepath"])}
    scenes.update()
    bpy.ops.ed.undo_push(message="start")
    before = state()
    assert getattr(bpy.ops.rle_splat, name)("EXEC_DEFAULT", True, **options) == {"FINISHED"}
    scenes.update()
    after = state()
    assert after != before
    for step, expected in ((bpy.ops.ed.undo, before), (bpy.ops.ed.redo, after), (bpy.ops.ed.undo, before)):
        step()
        scenes.update()
        assert state() == expected
        scenes.activate(bpy.data.objects["cube"])
        assert scenes.shown_at(scenes.picture_of()[1]) == pytest.approx((12.0, 12.0), abs=0.1)


def test_B75_undo_of_a_turntable(owner, tmp_path):
    scenes.update()
    bpy.ops.ed.undo_push(message="start")
    before = state()
    options = dict(filepath=str(tmp_path / "turn"), output="PNG", frames=1)
    assert bpy.ops.rle_splat.turntable("EXEC_DEFAULT", True, **options) == {"FINISHED"}
    assert set(state()["objects"]) > set(before["objects"])
    bpy.ops.ed.undo()
    assert state() == before


def test_B75_undo_and_redo_of_many_edits(owner, tmp_path):
    """Through pictures and frames between them, all the way back and forth again."""
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    bpy.ops.ed.undo_push(message="start")
    states = [state()]
    for name in (
        "apply_preset",
        "window_level",
        "show_in_renders",
        "add_cutting_object",
        "remove_from_renders",
        "load_transfer_function",
    ):
        options = {**EDITS[name][0]}
        if "filepath" in options:
            options["filepath"] = str(tmp_path / options["filepath"])
        scenes.activate(bpy.data.objects["cube"])
        getattr(bpy.ops.rle_splat, name)("EXEC_DEFAULT", True, **options)
        scenes.to_frame(len(states) + 1)
        states.append(state())
    for step, expected in ((bpy.ops.ed.undo, states[-2::-1]), (bpy.ops.ed.redo, states[1:])):
        for wanted in expected:
            step()
            scenes.to_frame(1)
            assert state() == wanted


@pytest.mark.parametrize("name", PICTURES)
def test_B76_an_edit_before_a_picture(owner, name):
    """Undone and redone, with the picture made again each time."""
    make = getattr(bpy.ops.rle_splat, name)
    bpy.ops.object.light_add(type="SUN")  # whose shadows there is a pass of
    owner.rle_splat.use_shading = True
    scenes.activate(owner)
    bpy.ops.ed.undo_push(message="start")
    owner.location.x = 2.0
    bpy.ops.ed.undo_push(message="moved")

    def made():
        scenes.update()
        assert make("EXEC_DEFAULT", True, **PICTURES[name]) == {"FINISHED"}
        assert bpy.ops.rle_splat.render_image("EXEC_DEFAULT", True) == {"FINISHED"}
        images = [image for image in bpy.data.images if image.type == "IMAGE"]
        return scenes.shown_at(scenes.image_pixels(bpy.context.scene.rle_splat.image)), len(images)

    _, count = made()
    for step, expected in ((bpy.ops.ed.undo, 12.0), (bpy.ops.ed.redo, 16.0), (bpy.ops.ed.undo, 12.0)):
        step()
        scenes.activate(bpy.context.scene.objects["cube"])
        middle, images = made()
        assert middle == pytest.approx((expected, 12.0), abs=0.1) and images == count


def goes_on(tmp_path):
    """The backdrop follows, renders show the volume, and Render to Image goes into the image of before."""
    scene = bpy.context.scene
    settings, camera = scene.rle_splat, scene.camera
    owner = scene.objects["cube"]
    scenes.activate(owner)
    image, count = settings.image, len(bpy.data.images)
    assert owner.rle_splat.is_volume and scenes.picture_of()[0] == image
    middle = scenes.shown_at(scenes.backdrop_of(camera))
    camera.location.x += 0.5
    scenes.to_frame(scene.frame_current + 1)
    np.testing.assert_allclose(scenes.shown_at(scenes.backdrop_of(camera)) - middle, (-1.0, 0.0), atol=0.1)
    render = scenes.rendered(tmp_path / "out.exr")
    np.testing.assert_allclose(scenes.shown_at(render), scenes.shown_at(scenes.backdrop_of(camera)), atol=0.1)
    assert settings.message == "" and len([one for one in bpy.data.images if one.type == "IMAGE"]) <= count


@pytest.fixture
def in_use(owner):
    """With a picture, a backdrop that follows, and composited into renders."""
    assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    scenes.picture_of()
    bpy.ops.rle_splat.show_in_renders()
    return owner


def our_handlers():
    lists = (getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if not name.startswith("_"))
    return sorted(f"{one.__module__}.{one.__qualname__}" for functions in lists if isinstance(functions, list)
                  for one in functions if "rle_splat" in one.__module__)  # fmt: skip


def test_B78_disabled_and_enabled(in_use, addon, tmp_path):
    handlers = our_handlers()
    goes_on(tmp_path)
    bpy.ops.preferences.addon_disable(module=addon.__name__)
    assert not our_handlers()
    scenes.to_frame(bpy.context.scene.frame_current + 1)
    scenes.update()
    bpy.ops.preferences.addon_enable(module=addon.__name__)
    assert our_handlers() == handlers
    goes_on(tmp_path)


def test_B79_scripts_reloaded(in_use, tmp_path):
    handlers = our_handlers()
    goes_on(tmp_path)
    assert bpy.ops.script.reload() == {"FINISHED"}
    assert our_handlers() == handlers
    goes_on(tmp_path)


NAMES = ("big_head", "head_little", "be_7", "scan_le_x")


@pytest.mark.parametrize("order", ["<u2", ">u2"], ids=["little-endian", "big-endian"])
@pytest.mark.parametrize("word", NAMES)
def test_B58_words_in_a_name_do_not_overrule_the_bytes(addon, tmp_path, word, order):
    """A smooth ramp from 0 to 900: in the other order its values would jump all over 16 bits."""
    path = tmp_path / f"{word}_30x20x10_uint16.raw"
    values = np.linspace(0.0, 900.0, 30 * 20 * 10).astype(order)
    path.write_bytes(values.tobytes())
    assert bpy.ops.rle_splat.import_volume(filepath=str(path)) == {"FINISHED"}
    properties = bpy.context.object.rle_splat
    assert (properties.value_low, properties.value_high) == (0.0, 900.0)
