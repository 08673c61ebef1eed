"""A library with a volume, its labels, a channel and a cutting object, and ways to bring them into another file."""

import bpy
import numpy as np

from tests.blender.scenes import activate

SHAPE = (7, 6, 5)


def write_raw(path, first):
    """A raw volume whose voxels tell the files apart; returns them."""
    voxels = (np.arange(5 * 6 * 7, dtype=np.uint8) % 50 + first).reshape(5, 6, 7)
    path.write_bytes(voxels.tobytes())
    return voxels


def write_labels(path, *numbers):
    labels = np.zeros((5, 6, 7), np.uint8)
    for i, number in enumerate(numbers):
        labels[i] = number
    path.write_bytes(labels.tobytes())
    return labels


def import_raw(path):
    done = bpy.ops.rle_splat.import_volume(
        filepath=str(path), shape=SHAPE, dtype="uint8", spacing=(1.0, 2.0, 3.0), preset="faint"
    )
    assert done == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def reopened():
    """Save the open file, open it again, and return the volume "scan"."""
    save(bpy.data.filepath)
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    return scan()


def scan():
    """The volume "scan": one of this file before a linked one, and an override before what it overrides."""
    found = [o for o in bpy.data.objects if o.name == "scan"]
    return min(found, key=lambda o: (o.library is not None, o.override_library is None))


def make_library(tmp_path):
    """library/library.blend with the volume "scan", its labels 0, 1 and 2, its channel "second" and a cutter, all
    in the collection "study"; afterwards work/work.blend is open, and empty.  Returns the library's path."""
    folder, work = tmp_path / "library", tmp_path / "work"
    folder.mkdir()
    work.mkdir()
    for place, first in ((folder, 0), (work, 100)):
        for i, name in enumerate(("scan", "second", "other")):
            write_raw(place / f"{name}.raw", first + 10 * i)
        write_labels(place / "labels.raw", 1, 2)
        write_labels(place / "other_labels.raw", 2, 7)
    write_labels(work / "labels.raw", 8)
    study = bpy.data.collections.new("study")
    bpy.context.scene.collection.children.link(study)
    bpy.context.view_layer.active_layer_collection = bpy.context.view_layer.layer_collection.children["study"]
    second = import_raw(folder / "second.raw")
    owner = import_raw(folder / "scan.raw")
    owner.rle_splat.label_file = str(folder / "labels.raw")
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    activate(owner, second)
    assert bpy.ops.rle_splat.add_channels() == {"FINISHED"}
    cut = bpy.data.objects.new("cut", None)
    cut.empty_display_type = "CUBE"
    study.objects.link(cut)
    save(folder / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    save(work / "work.blend")
    return folder / "library.blend"


def bring(library, how):
    """Get the volume into the open file; it is active."""
    kind, name = ("Collection", "study") if "collection" in how or "hierarchy" in how else ("Object", "scan")
    operator = bpy.ops.wm.append if "append" in how else bpy.ops.wm.link
    options = {} if "append" in how else {"relative_path": True}
    operator(directory=f"{library}/{kind}/", filename=name, instance_collections=False, **options)
    owner = scan()
    activate(owner)
    if how == "override":
        owner = owner.override_create(remap_local_usages=True)
    elif how == "override hierarchy":
        assert bpy.ops.object.make_override_library(collection=bpy.data.collections["study"].session_uid) == {
            "FINISHED"
        }
    elif "make local" in how:
        assert bpy.ops.object.make_local(type="SELECT_OBJECT") == {"FINISHED"}
    owner = scan()
    activate(owner)
    assert (owner.library is not None) == (how == "link")
    assert (owner.override_library is not None) == ("override" in how)
    return owner
