"""What a user's scene can be while the panels are drawn: each state is made in an empty file, in the background as in a
window.

``STATES``: name -> function of a folder for files.  Pictures are small.
"""

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.scenes import module

SIDE = 8  # voxels
LONG_NAME = "sub-01_ses-preop_acq-mprage_run-02_T1w"  # as scans have them, and too long for its row
SENTENCE = (
    "The file of 'sub-01_ses-preop_acq-mprage_run-02_T1w' is not at //scans/sub-01.nii.gz; click Relocate in the "
    "RLE Splat tab to choose its new place."
)


def add_volume(folder, name="scan", stored="uint8"):
    """A ball that grows denser inwards, active and selected, seen by a camera from above; ``stored``: its type."""
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
    voxels = np.clip(255.0 - 62.0 * np.sqrt(x**2 + y**2 + z**2), 0.0, 255.0).astype(stored)
    owner = scenes.import_raw(folder, voxels, name=name)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = 48, 36
    if scene.camera is None:
        middle = (SIDE - 1) / 2
        scenes.add_camera((middle, middle, 30.0), type="ORTHO", ortho_scale=2.0 * SIDE)
    return owner


def make_active(owner):
    for other in bpy.context.selected_objects:
        other.select_set(False)
    owner.select_set(True)
    bpy.context.view_layer.objects.active = owner


def empty(_folder):
    pass


def one(folder):
    add_volume(folder, LONG_NAME)
    bpy.context.object.rle_splat.remarks = "All values are whole numbers.\nThe file says nothing about its unit."


def many_with_none_selected(folder):
    for name in ("first", "second", "third"):
        add_volume(folder, name).select_set(False)
    bpy.context.view_layer.objects.active = None


def linked(folder):
    local = add_volume(folder)
    path = str(folder / "library.blend")
    bpy.data.libraries.write(path, {local})
    box = local.instance_collection
    for other in (*box.objects, local):
        bpy.data.objects.remove(other)
    bpy.data.collections.remove(box)
    with bpy.data.libraries.load(path, link=True) as (source, target):
        target.objects = [name for name in source.objects if name == "scan"]
    owner = target.objects[0]
    bpy.context.scene.collection.objects.link(owner)
    owner.select_set(True)
    bpy.context.view_layer.objects.active = owner
    assert owner.library is not None and owner.rle_splat.is_volume


def overridden(folder):
    linked(folder)
    override = bpy.context.object.override_create(remap_local_usages=True)
    bpy.context.view_layer.objects.active = override
    assert override.override_library is not None and override.rle_splat.is_volume


def deleted(folder):
    """By X, which takes a volume out of the scenes: it was composited and had a backdrop that follows."""
    composited(folder)
    bpy.ops.rle_splat.preview_in_camera_view(follow=True)
    bpy.ops.object.delete()
    assert bpy.context.scene.rle_splat.use_composite and not bpy.context.scene.objects.get("scan")


def other_objects_deleted(folder):
    """A channel's volume and a cutting object, which their lists still hold."""
    owner = add_volume(folder)
    channel = owner.rle_splat.channels.add()
    channel.source = add_volume(folder, "channel")
    make_active(owner)
    bpy.ops.rle_splat.add_cutting_object(kind="BOX")
    channel.source.select_set(True)
    bpy.ops.object.delete()
    make_active(owner)
    assert channel.source is not None and not channel.source.users_scene


def without_transfer(folder):
    add_volume(folder).rle_splat.transfer = None


def shared_transfer(folder):
    owner = add_volume(folder)
    add_volume(folder, "other").rle_splat.transfer = owner.rle_splat.transfer


def labels(folder):
    add_labels(folder, add_volume(folder))


def add_labels(folder, owner):
    """Two segments, one of them hidden, the other one with a color of its own."""
    numbers = np.zeros((SIDE, SIDE, SIDE), np.uint8)
    numbers[:, :, :3], numbers[:, :, 5:] = 3, 7
    numbers.tofile(folder / "labels.raw")
    owner.rle_splat.label_file = str(folder / "labels.raw")
    bpy.ops.rle_splat.load_segments()
    hidden, colored = owner.rle_splat.labels[1:]
    hidden.show, colored.use_color = False, True


def channels(folder):
    others = [add_volume(folder, name) for name in ("PET", "vessels of the portal phase")]
    owner = add_volume(folder)
    add_channels(owner, others)
    owner.rle_splat.channels.add()  # whose volume is gone
    assert len(owner.rle_splat.channels) == 3


def add_channels(owner, others):
    make_active(owner)
    for other in others:
        other.select_set(True)
    bpy.ops.rle_splat.add_channels()


def clip_objects(folder):
    add_clips(add_volume(folder))


def add_clips(owner):
    for kind, keep in (("BOX", "INSIDE"), ("PLANE", "OUTSIDE")):
        bpy.ops.rle_splat.add_cutting_object(kind=kind, keep=keep)
        make_active(owner)


def slices(folder):
    owner = add_volume(folder)
    bpy.ops.rle_splat.add_slice(kind="ALL")
    make_active(owner)


def slices_of_a_deleted_volume(folder):
    slices(folder)
    bpy.ops.object.delete()
    bpy.context.view_layer.update()
    assert "not the child of a volume" in bpy.context.scene.rle_splat.message


def encoded(folder):
    """A volume whose voxels are encoded: nothing of its look can be edited."""
    add_volume(folder)
    core = {name: module(f"rle_splat.{name}") for name in ("encode.store", "pipeline.encode_scene")}
    plain, quality = module("bridge.scene.render_scene").read_scene(
        bpy.context.object, bpy.context.evaluated_depsgraph_get(), with_meshes=False
    )
    stored = core["pipeline.encode_scene"].encode(plain, quality.classified("pre"))
    core["encode.store"].write_encoded(stored, folder / "scan.rle")
    assert bpy.ops.rle_splat.import_volume(filepath=str(folder / "scan.rle")) == {"FINISHED"}


def measured(folder):
    add_volume(folder)
    bpy.ops.rle_splat.measure_accuracy(probes=20, repeats=1)
    bpy.ops.rle_splat.error_map(step=4)
    assert bpy.context.scene.rle_splat.accuracy_rows


def effects_listed(folder):
    add_volume(folder)
    bpy.ops.rle_splat.render_image()
    bpy.ops.rle_splat.list_effects()
    assert bpy.context.scene.rle_splat.effect_rows


def message(folder):
    add_volume(folder)
    bpy.context.scene.rle_splat.message = SENTENCE


def paper(folder):
    add_volume(folder)
    bpy.context.scene.rle_splat.quality = "paper"


def custom(folder):
    add_volume(folder)
    settings = bpy.context.scene.rle_splat
    settings.quality, settings.classification = "custom", "pre"


def composited(folder):
    add_volume(folder)
    bpy.ops.rle_splat.show_in_renders()
    assert bpy.context.scene.rle_splat.use_composite


def in_time(folder):
    """A volume of several frames, of which a keyframe chooses one."""
    owner = add_volume(folder)
    owner.rle_splat.frame_count, owner.rle_splat.playback, owner.rle_splat.frame = 12, "FIXED", 3
    owner.keyframe_insert("rle_splat.frame", frame=1)


def in_time_looped(folder):
    in_time(folder)
    bpy.context.view_layer.objects.active.rle_splat.playback = "LOOP"


STATES = {
    state.__name__: state for state in (
        empty, one, many_with_none_selected, linked, overridden, deleted, other_objects_deleted, without_transfer,
        shared_transfer, labels, channels, clip_objects, slices,
        slices_of_a_deleted_volume, encoded, measured, effects_listed, message, paper, custom, composited,
        in_time, in_time_looped)
}  # fmt: skip
