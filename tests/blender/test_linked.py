"""Proves that linked volumes are read and never edited in vain, and that edits of overridden, appended and localized
ones survive save, reload and save-as, with every path leading to the file it was meant for.

The library's folder and this file's hold files of the same names with other voxels, so a path that counts from the
wrong .blend is seen.
"""

import bpy
import pytest

from tests.blender import scenes
from tests.blender.linking import bring, import_raw, reopened, save, scan, write_labels, write_raw
from tests.blender.scenes import activate

pytestmark = pytest.mark.usefixtures("by_numpy")

EDITABLE = ("override", "override hierarchy", "append", "append collection", "link, make local")
SENTENCE = "'scan' is linked from library.blend; make a library override (Object > Library Override > Make) or make it"


def shape_of(owner, bridge):
    """Everything of a volume that decides a picture, as plain data."""
    properties, volumes, labels = owner.rle_splat, bridge("volumes.volumes"), bridge("volumes.labels")
    volume = volumes.load_volume(owner)
    wish = bridge("loop.store").wish_of(owner, None, labels.PURPOSE)
    return {
        "voxels": volume.voxels.tobytes(), "spacing": tuple(volume.spacing),
        "transfer function": bridge("look.transfer").read_transfer(owner),
        "files": [volumes.resolved_path(owner, name) for name in ("filepath", "label_file")],
        "labels": labels.drain(labels.load_steps(wish, labels.file_of(owner), volume)).volume.voxels.tobytes(),
        "styles": [row.plain() for row in properties.labels],
        "channels": [(row.source.name, row.show, row.source.library is None) for row in properties.channels],
        "facts": (properties.facts, properties.data_key, properties.histogram, properties.value_low),
        "keep": properties.clip_keep,
    }  # fmt: skip


@pytest.mark.parametrize("how", ["link", *EDITABLE])
def test_B39_a_volume_of_another_file_is_read_at_once_and_after_save_as(library, bridge, tmp_path, how):
    owner = bring(library, how)
    before = shape_of(owner, bridge)
    assert before["voxels"] == (library.parent / "scan.raw").read_bytes()
    assert before["files"] == [str(library.parent / "scan.raw"), str(library.parent / "labels.raw")]
    assert [row.label for row in owner.rle_splat.labels] == [0, 1, 2]
    assert before["channels"][0][0] == "second"
    assert shape_of(reopened(), bridge) == before
    deeper = tmp_path / "work" / "deep" / "er"
    deeper.mkdir(parents=True)
    save(deeper / "moved.blend")
    assert shape_of(scan(), bridge) == before
    assert shape_of(reopened(), bridge) == before


@pytest.mark.parametrize("how", EDITABLE)
def test_B38_every_edit_survives_save_and_reload(library, bridge, tmp_path, how):
    owner = bring(library, how)
    mine = import_raw(tmp_path / "work" / "other.raw")
    mine.name = "mine"
    activate(owner, mine)
    properties = owner.rle_splat
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    assert bpy.ops.rle_splat.apply_preset(preset="mr-head") == {"FINISHED"}
    assert bpy.ops.rle_splat.window_level(center=20.0, width=30.0) == {"FINISHED"}
    properties.opacity_scale, properties.opacity_unit_distance = 0.5, 0.25
    properties.use_shading, properties.use_gradient_opacity, properties.gradient_low = True, True, 3.0
    properties.clip_keep = "OUTSIDE"
    properties.labels[1].show, properties.labels[2].color = False, (0.1, 0.2, 0.3)
    properties.labels[2].use_color, properties.labels[2].look = True, "smoke"
    properties.labels[2].label_name = "liver"
    properties.channels[0].show = False
    properties.filepath, properties.label_file = "//other.raw", "//other_labels.raw"
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    assert 7 in [row.label for row in properties.labels]
    curve = bridge("look.transfer_nodes").opacity_mapping(properties.transfer).curves[0]
    curve.points[0].location[1] = 0.125
    before = shape_of(owner, bridge)
    assert before["files"] == [str(tmp_path / "work" / name) for name in ("other.raw", "other_labels.raw")]
    assert [channel[:2] for channel in before["channels"]] == [("second", False), ("mine", True)]
    assert shape_of(reopened(), bridge) == before
    (tmp_path / "elsewhere").mkdir()
    save(tmp_path / "elsewhere" / "moved.blend")
    assert shape_of(reopened(), bridge) == before


@pytest.mark.parametrize("how", EDITABLE)
def test_a_relocated_volume_stays_where_it_was_put(library, bridge, tmp_path, how):
    """Also where both files call it "//scan.raw", which Blender takes for no override at all."""
    bring(library, how)
    mine = write_raw(tmp_path / "work" / "scan.raw", 100)
    (tmp_path / "work" / "more").mkdir()
    assert bpy.ops.rle_splat.relocate_volume(filepath=str(tmp_path / "work" / "scan.raw")) == {"FINISHED"}
    before = shape_of(scan(), bridge)
    assert before["voxels"] == mine.tobytes()
    box = [tuple(v.co) for v in scan().instance_collection.objects[0].data.vertices]
    for path in (bpy.data.filepath, tmp_path / "work" / "more" / "deep.blend", tmp_path / "work" / "last.blend"):
        save(path)
        assert shape_of(reopened(), bridge) == before
    assert [tuple(v.co) for v in scan().instance_collection.objects[0].data.vertices] == box


def test_B40_edits_of_a_linked_volume_are_refused_in_a_sentence(library, bridge, refused, tmp_path):
    owner = bring(library, "link")
    (tmp_path / "function.json").write_text("{}")
    other = import_raw(tmp_path / "work" / "other.raw")
    activate(owner, other)
    before = shape_of(owner, bridge)
    edits = {
        "apply_preset": {"preset": "mr-head"}, "relocate_volume": {"filepath": str(tmp_path / "work" / "other.raw")},
        "window_level": {"center": 1.0, "width": 2.0}, "drag_window": {"center": 1.0, "width": 2.0},
        "keyframe_transfer_function": {}, "make_single_user": {},
        "load_transfer_function": {"filepath": str(tmp_path / "function.json")}, "apply_user_preset": {"name": "any"},
        "load_segments": {}, "show_segment_alone": {"label": 1}, "color_by_anatomy": {}, "add_channels": {},
        "remove_channel": {"index": 0}, "hide_table": {}, "threshold_segment": {}, "change_segment": {},
        "import_channel": {"filepath": str(tmp_path / "work" / "other.raw")},
    }  # fmt: skip
    for name, options in edits.items():
        operator = getattr(bpy.ops.rle_splat, name)
        refused(operator, SENTENCE, **options)
        with pytest.raises(RuntimeError) as caught:
            operator(**options)
        assert str(library.parent) not in str(caught.value)
    assert shape_of(owner, bridge) == before
    saved = tmp_path / "saved.json"
    assert bpy.ops.rle_splat.save_transfer_function(filepath=str(saved)) == {"FINISHED"}, "reading is no edit"


@pytest.mark.parametrize("way", ["make local", "duplicate", "duplicate beside", "override made local"])
def test_paths_of_copies_of_linked_volumes_lead_to_the_librarys_files(library, bridge, tmp_path, way):
    owner = bring(library, "override" if way.startswith("override") else "link")
    if way == "make local":
        owner.make_local()
    elif way == "override made local":
        owner.make_local(clear_liboverride=True)
    else:
        bpy.ops.object.duplicate()
        if way == "duplicate":
            bpy.data.objects.remove(owner)
    found = next(o for o in bpy.data.objects if o.name.startswith("scan") and bridge("linked").is_own(o))
    found.name = "copy"
    expected = [str(library.parent / "scan.raw"), str(library.parent / "labels.raw")]
    files = [bridge("volumes.volumes").resolved_path(found, name) for name in ("filepath", "label_file")]
    assert files == expected
    assert bridge("volumes.volumes").load_volume(found).voxels.tobytes() == (library.parent / "scan.raw").read_bytes()
    save(tmp_path / "work" / "work.blend")
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    found = bpy.data.objects["copy", None]
    files = [bridge("volumes.volumes").resolved_path(found, name) for name in ("filepath", "label_file")]
    assert files == expected


def test_undo_of_a_save_and_of_make_local(library, bridge):
    owner = bring(library, "link")
    expected = str(library.parent / "scan.raw")
    bpy.ops.ed.undo_push(message="linked")
    owner.make_local()
    bpy.ops.ed.undo_push(message="local")
    save(bpy.data.filepath)
    bpy.ops.ed.undo_push(message="saved")
    for step in (bpy.ops.ed.undo, bpy.ops.ed.undo, bpy.ops.ed.redo, bpy.ops.ed.redo):
        assert step() == {"FINISHED"}
        assert bridge("volumes.volumes").resolved_path(scan()) == expected
    assert scan().library is None


def test_a_volume_of_this_file_keeps_its_path_beside_a_linked_one_of_the_same_voxels(library, bridge, tmp_path):
    write_raw(tmp_path / "work" / "scan.raw", 0)
    owner = import_raw(tmp_path / "work" / "scan.raw")
    owner.name = "here"
    linked = bring(library, "link")
    save(bpy.data.filepath)
    here = scenes.stored(tmp_path / "work" / "work.blend", "objects", "here")
    assert linked.rle_splat.filepath == here.rle_splat.filepath == "//scan.raw"
    bpy.data.libraries.remove(here.library)
    for _again in range(2):
        here, there = bpy.data.objects["here"], scan()
        assert bridge("volumes.volumes").resolved_path(here) == str(tmp_path / "work" / "scan.raw")
        assert bridge("volumes.volumes").resolved_path(there) == str(library.parent / "scan.raw")
        reopened()


def test_an_override_of_an_override(library, bridge, tmp_path):
    (tmp_path / "middle").mkdir()
    labels = write_labels(tmp_path / "middle" / "labels.raw", 3)
    owner = bring(library, "override")
    owner.rle_splat.label_file = str(tmp_path / "middle" / "labels.raw")
    owner.rle_splat.window_center = 11.0
    save(tmp_path / "middle" / "middle.blend")
    written = scenes.stored(tmp_path / "middle" / "middle.blend", "objects", "scan")
    assert written.rle_splat.label_file == "//./labels.raw"
    bpy.ops.wm.read_homefile(use_empty=True)
    save(tmp_path / "work" / "work.blend")
    bpy.ops.wm.link(directory=f"{tmp_path / 'middle' / 'middle.blend'}/Object/", filename="scan")
    owner = scan()
    for override_it in (True, False):
        found = shape_of(owner, bridge)
        assert found["files"] == [str(library.parent / "scan.raw"), str(tmp_path / "middle" / "labels.raw")]
        assert found["labels"] == labels.tobytes() and owner.rle_splat.window_center == 11.0
        if override_it:
            owner.override_create(remap_local_usages=True).rle_splat.opacity_scale = 0.75
            owner = reopened()
    assert owner.library is None and owner.rle_splat.opacity_scale == 0.75


def test_an_override_keeps_its_edits_when_the_library_changes(library, bridge, tmp_path):
    owner = bring(library, "override")
    owner.rle_splat.window_center = 11.0
    owner.rle_splat.labels[2].show = False
    work = bpy.data.filepath
    save(work)
    bpy.ops.wm.open_mainfile(filepath=str(library))
    activate(scan())
    scan().rle_splat.opacity_scale = 0.375
    scan().rle_splat.label_file = str(library.parent / "other_labels.raw")  # 0, 2 and 7
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    save(library)
    bpy.ops.wm.open_mainfile(filepath=work)
    properties = scan().rle_splat
    assert properties.window_center == 11.0 and properties.opacity_scale == 0.375
    assert {row.label: row.show for row in properties.labels} == {0: True, 2: False, 7: True}
    assert bridge("volumes.volumes").resolved_path(scan(), "label_file") == str(library.parent / "other_labels.raw")


def test_an_override_outlives_a_library_that_is_missing_for_a_while(library, bridge, tmp_path):
    owner = bring(library, "override")
    owner.rle_splat.label_file = str(tmp_path / "work" / "labels.raw")  # the library's text, too, is "//labels.raw"
    owner.rle_splat.window_center = 11.0
    before, work = shape_of(owner, bridge), bpy.data.filepath
    save(work)
    library.rename(library.parent / "away.blend")
    bpy.ops.wm.open_mainfile(filepath=work)
    assert scan().rle_splat.window_center == 11.0
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "labels.raw").write_bytes((tmp_path / "work" / "labels.raw").read_bytes())
    save(tmp_path / "elsewhere" / "moved.blend")
    (library.parent / "away.blend").rename(library)
    assert shape_of(reopened(), bridge) == before


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="Blender packs linked data from 5.0 on")
def test_linked_data_packed_into_the_file(library, bridge, refused):
    with bpy.data.libraries.load(str(library), link=True, pack=True) as (_, target):
        target.objects = ["scan"]
    bpy.context.scene.collection.objects.link(target.objects[0])
    before = shape_of(scan(), bridge)
    assert scan().is_linked_packed and before["files"][0] == str(library.parent / "scan.raw")
    activate(scan())
    refused(bpy.ops.rle_splat.apply_preset, SENTENCE, preset="mr-head")
    assert shape_of(reopened(), bridge) == before


def test_append_from_a_file_that_links_the_volume(library, bridge, tmp_path):
    (tmp_path / "middle").mkdir()
    write_raw(tmp_path / "middle" / "scan.raw", 50)
    bring(library, "link")
    holder = bpy.data.collections.new("holder")
    bpy.context.scene.collection.children.link(holder)
    holder.objects.link(scan())
    save(tmp_path / "middle" / "middle.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    save(tmp_path / "work" / "work.blend")
    bpy.ops.wm.append(directory=f"{tmp_path / 'middle' / 'middle.blend'}/Collection/", filename="holder")
    assert bridge("volumes.volumes").resolved_path(scan()) == str(library.parent / "scan.raw")


def test_B41_an_appended_scene_is_drawn_at_once(library, bridge):
    bpy.ops.wm.append(directory=f"{library}/Scene/", filename="Scene")
    owner = scan()
    assert shape_of(owner, bridge)["files"][0] == str(library.parent / "scan.raw")
    bpy.context.window.scene = next(s for s in bpy.data.scenes if owner.name in s.objects)
    activate(owner)
    owner.rle_splat.label_file = ""
    bpy.context.scene.rle_splat.scene_scale = 1.0
    scenes.add_camera((3.0, 5.0, 40.0), type="ORTHO", ortho_scale=14.0)
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 24
    assert bpy.ops.rle_splat.render_image() == {"FINISHED"}
    assert scenes.image_pixels(bpy.context.scene.rle_splat.image)[:, :, 3].max() > 0.05


def test_the_transfer_function_of_an_override(library, bridge):
    """A preset goes to a node group of this file; Make Single-User Copy and keyframes copy the library's."""
    transfer, linked = bridge("look.transfer"), bridge("linked")
    owner = bring(library, "override")
    before = transfer.read_transfer(owner)
    assert not linked.is_own(owner.rle_splat.transfer)
    assert bpy.ops.rle_splat.make_single_user() == {"FINISHED"}
    assert linked.is_own(owner.rle_splat.transfer) and transfer.read_transfer(owner) == before
    owner = reopened()
    assert linked.is_own(owner.rle_splat.transfer) and transfer.read_transfer(owner) == before
    activate(owner)
    assert not bpy.ops.rle_splat.make_single_user.poll(), "it has one of its own now"
    assert bpy.ops.rle_splat.window_level(center=20.0, width=40.0, keep_values=True) == {"FINISHED"}
    before = transfer.read_transfer(owner)
    assert transfer.read_transfer(reopened()) == before


def test_an_overridden_node_group_is_exchanged_for_one_that_keeps_edits(library, bridge):
    owner = bring(library, "override")
    tree = owner.rle_splat.transfer.override_create(remap_local_usages=False)
    owner.rle_splat.transfer = tree
    assert bpy.ops.rle_splat.make_single_user() == {"FINISHED"}
    nodes = bridge("look.transfer_nodes")
    nodes.color_ramp(owner.rle_splat.transfer).elements[0].color = (0.25, 0.5, 0.75, 1.0)
    ramp = nodes.color_ramp(reopened().rle_splat.transfer)
    assert tuple(ramp.elements[0].color) == (0.25, 0.5, 0.75, 1.0)


@pytest.mark.parametrize("animated", [False, True])
def test_keyframes_on_an_override(library, bridge, animated):
    if animated:  # the library's own keyframes at frame 1
        bpy.ops.wm.open_mainfile(filepath=str(library))
        activate(scan())
        assert bpy.ops.rle_splat.keyframe_transfer_function() == {"FINISHED"}
        save(library)
        bpy.ops.wm.open_mainfile(filepath=str(library.parent.parent / "work" / "work.blend"))
    owner = bring(library, "override")
    bridge("look.transfer").own_tree(owner)
    bpy.context.scene.frame_set(5)  # first: it plays what is animated
    owner.rle_splat.window_center = 33.0
    ramp = bridge("look.transfer_nodes").color_ramp(owner.rle_splat.transfer)
    ramp.elements[0].color = (0.25, 0.5, 0.75, 1.0)
    assert bpy.ops.rle_splat.keyframe_transfer_function() == {"FINISHED"}
    owner = reopened()
    tree = owner.rle_splat.transfer
    for block in (owner, tree):
        assert block.animation_data.action.library is None
        assert block.animation_data.action.frame_range[1] == 5.0
    bpy.context.scene.frame_set(1)
    bpy.context.scene.frame_set(5)
    assert owner.rle_splat.window_center == 33.0
    assert tuple(bridge("look.transfer_nodes").color_ramp(tree).elements[0].color) == (0.25, 0.5, 0.75, 1.0)


def test_what_an_override_cannot_drop_is_said(library, bridge, core, refused, tmp_path):
    owner = bring(library, "override")
    words = "comes from library.blend, and a library override cannot remove it"
    refused(bpy.ops.rle_splat.remove_channel, words, index=0)
    mine = import_raw(tmp_path / "work" / "other.raw")
    theirs = import_raw(tmp_path / "work" / "second.raw")
    activate(owner, mine, theirs)
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    owner = reopened()
    activate(owner)
    assert len(owner.rle_splat.channels) == 3
    assert bpy.ops.rle_splat.remove_channel(index=1) == {"FINISHED"}
    kept = owner.rle_splat.channels[1].source.name
    owner = reopened()
    assert [row.source.name for row in owner.rle_splat.channels][1:] == [kept]

    owner.rle_splat.label_file = str(tmp_path / "work" / "other_labels.raw")  # 0, 2 and 7; the library has 1
    labels, volume = bridge("volumes.labels"), bridge("volumes.volumes").load_volume(owner)
    listed = core("runtime.steps").drain(labels.listed_steps(labels.file_of(owner), volume))
    assert labels.list_labels(owner, listed)[:2] == (3, 1)
    owner = reopened()
    assert sorted(row.label for row in owner.rle_splat.labels) == [0, 1, 2, 7]
    assert labels.list_labels(owner, listed)[:2] == (3, 1)


def test_a_linked_collection_of_clip_objects_takes_more(library, bridge):
    bring(library, "append")
    bpy.ops.wm.link(directory=f"{library}/Collection/", filename="study", instance_collections=False)
    scene = bpy.context.scene
    scene.rle_splat.clip_objects = bpy.data.collections["study"]
    activate(next(o for o in bpy.data.objects if o.name == "scan" and o.library is None))
    assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}
    names = [one.name for one in bridge("scene.clip_objects").clip_objects(scene)]
    reopened()
    assert [one.name for one in bridge("scene.clip_objects").clip_objects(bpy.context.scene)] == names
    assert "cut" in names and "Cut Box" in names


def test_a_volume_is_imported_beside_a_linked_active_collection(library, tmp_path):
    bpy.ops.wm.link(directory=f"{library}/Collection/", filename="study", instance_collections=False)
    layer = bpy.context.view_layer
    layer.active_layer_collection = layer.layer_collection.children["study"]
    owner = import_raw(tmp_path / "work" / "other.raw")
    assert owner.name in bpy.context.scene.collection.objects


def test_the_quality_of_a_linked_scene_is_not_chosen_in_vain(library, bridge, core):
    with bpy.data.libraries.load(str(library), link=True) as (_, target):
        target.scenes = ["Scene"]
    linked = target.scenes[0]
    row = bpy.context.scene.rle_splat.accuracy_rows.add()
    row.name, row.knobs = "fine", "{}"
    before = linked.rle_splat.quality
    with pytest.raises(core("scene").RleSplatError, match=r"'Scene' is linked from library\.blend"):
        bridge("data.accuracy").choose(linked, row)
    assert linked.rle_splat.quality == before
