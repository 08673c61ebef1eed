"""Undo, save, reload, append, copies: what is in the .blend stays, and voxels are read again."""

import os

import bpy
import numpy as np
import pytest

from tests.blender import scenes


def the_volume():
    found = [o for o in bpy.data.objects if o.rle_splat.is_volume]
    assert len(found) == 1
    return found[0]


def save(path, **options):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), **options)


def written_in(blend):
    """The path of the volume "phantom" in a saved .blend."""
    return scenes.stored(blend, "objects", "phantom").rle_splat.filepath.replace("\\", "/")


def test_save_and_reload(volume_object, phantom, bridge, tmp_path):
    transfer, volumes = bridge("look.transfer"), bridge("volumes.volumes")
    bpy.ops.rle_splat.apply_preset(preset="mr-head")
    volume_object.location = (1.0, 2.0, 3.0)
    before = transfer.read_transfer(volume_object)
    save(tmp_path / "scene.blend")
    assert (tmp_path / "scene.blend").stat().st_size < 2_000_000
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    owner = the_volume()
    assert transfer.read_transfer(owner) == before
    assert owner.rle_splat.filepath == str(phantom[0])
    warnings = []
    np.testing.assert_array_equal(volumes.load_volume(owner, warnings.append).voxels, phantom[1])
    assert not warnings
    assert len(owner.instance_collection.objects) == 1


def test_paths_follow_the_blend(volume_object, phantom, bridge, tmp_path):
    volumes = bridge("volumes.volumes")
    (tmp_path / "a" / "b").mkdir(parents=True)
    for name, options, written in (
        ("first.blend", {}, "//phantom.raw"), ("a/b/copy.blend", {"copy": True}, "//../../phantom.raw"),
        ("a/second.blend", {}, "//../phantom.raw"),
    ):  # fmt: skip
        save(tmp_path / name, **options)
        assert written_in(tmp_path / name) == written
        assert volume_object.rle_splat.filepath == str(phantom[0])
    for name in ("a/second.blend", "a/b/copy.blend"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / name))
        assert os.path.samefile(volumes.resolved_path(the_volume()), phantom[0])


def test_a_volume_imported_into_a_saved_file_is_stored_relative(phantom, tmp_path):
    save(tmp_path / "scene.blend")
    bpy.ops.rle_splat.import_volume(filepath=str(phantom[0]), shape=(7, 6, 5), dtype="uint8")
    save(tmp_path / "scene.blend")
    assert written_in(tmp_path / "scene.blend") == "//phantom.raw"


def test_undo_across_save_as_leads_to_the_same_files(phantom, bridge, tmp_path):
    """Beside the new .blend another patient's files have the same names and sizes."""
    folders = [tmp_path / "first", tmp_path / "second"]
    for folder, step in zip(folders, (1, 3)):
        (folder / "scene_rle_splat").mkdir(parents=True)
        for name in ("ct", "labels", "typed"):
            (folder / f"{name}.raw").write_bytes((phantom[1] // 100 * step).tobytes())
    bpy.ops.rle_splat.import_volume(filepath=str(folders[0] / "ct.raw"), shape=(7, 6, 5), dtype="uint8")
    properties, name = the_volume().rle_splat, the_volume().name
    properties.label_file = str(folders[0] / "labels.raw")
    bpy.ops.mesh.primitive_cube_add()
    save(folders[0] / "scene.blend")
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    bpy.ops.ed.undo_push(message="opened")
    bpy.data.objects[name].rle_splat.label_file = "//typed.raw"
    bpy.ops.ed.undo_push(message="typed")
    save(folders[1] / "scene.blend")
    for step, labels in ((bpy.ops.ed.undo, "labels"), (bpy.ops.ed.redo, "typed")):
        assert step() == {"FINISHED"}
        owner, volumes = bpy.data.objects[name], bridge("volumes.volumes")
        files = [volumes.resolved_path(owner, one) for one in ("filepath", "label_file")]
        assert files == [str(folders[0] / "ct.raw"), str(folders[0] / f"{labels}.raw")]
        np.testing.assert_array_equal(volumes.load_volume(owner).voxels, phantom[1] // 100)


@pytest.mark.parametrize("kind", ["volumes", "images"])
def test_paths_that_blender_remaps_do_not_outlive_undo_after_save_as(kind, tmp_path):
    """Why a volume's path is ours: once this fails, Blender's own remapping could take its place."""
    folders = [tmp_path / "first", tmp_path / "second" / "deeper"]
    for folder in folders:
        folder.mkdir(parents=True)
    (folders[0] / "scan.raw").write_bytes(b"scan")
    save(folders[0] / "scene.blend")
    made = bpy.data.volumes.new("scan") if kind == "volumes" else bpy.data.images.new("scan", 1, 1)
    made.use_fake_user = True
    if kind == "images":
        made.source = "FILE"
    made.filepath = "//scan.raw"
    bpy.ops.ed.undo_push(message="made")
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.ed.undo_push(message="cube")
    save(folders[1] / "scene.blend")

    def leads_to_the_file() -> bool:
        return os.path.isfile(bpy.path.abspath(getattr(bpy.data, kind)["scan"].filepath))

    assert leads_to_the_file()
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert not leads_to_the_file()


def test_undo_and_redo(volume_object, bridge):
    transfer = bridge("look.transfer")
    start = transfer.read_transfer(volume_object)
    name = volume_object.name
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.rle_splat.apply_preset(preset="mr-head")
    bpy.ops.ed.undo_push(message="preset")
    changed = transfer.read_transfer(bpy.data.objects[name])
    assert changed != start
    bpy.ops.ed.undo()
    assert transfer.read_transfer(bpy.data.objects[name]) == start
    bpy.ops.ed.redo()
    assert transfer.read_transfer(bpy.data.objects[name]) == changed


def test_undo_of_an_import_takes_everything_away(phantom):
    bpy.ops.ed.undo_push(message="empty")
    bpy.ops.rle_splat.import_volume(filepath=str(phantom[0]), shape=(7, 6, 5), dtype="uint8")
    bpy.ops.ed.undo_push(message="imported")
    assert the_volume()
    bpy.ops.ed.undo()
    assert not [o for o in bpy.data.objects if o.rle_splat.is_volume]
    assert not [t for t in bpy.data.node_groups if "RLE Splat" in t.name]
    bpy.ops.ed.redo()
    assert the_volume().rle_splat.transfer is not None


@pytest.mark.parametrize("link", [False, True])
def test_append_and_link(volume_object, phantom, bridge, tmp_path, link):
    transfer, volumes = bridge("look.transfer"), bridge("volumes.volumes")
    before = transfer.read_transfer(volume_object)
    (tmp_path / "library").mkdir()
    save(tmp_path / "library" / "scene.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    save(tmp_path / "other.blend")
    with bpy.data.libraries.load(str(tmp_path / "library" / "scene.blend"), link=link) as (source, target):
        target.objects = [name for name in source.objects if "Box" not in name]
    owner = the_volume()
    bpy.context.scene.collection.objects.link(owner)
    assert transfer.read_transfer(owner) == before
    np.testing.assert_array_equal(volumes.load_volume(owner).voxels, phantom[1])


def test_deleting_the_object_and_purging_leaves_nothing(volume_object, tmp_path):
    bpy.data.objects.remove(volume_object)
    bpy.ops.outliner.orphans_purge(do_recursive=True)
    assert not bpy.data.node_groups and not bpy.data.meshes and not bpy.data.collections
