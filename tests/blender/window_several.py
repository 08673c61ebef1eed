"""Two volumes with files of their own in a real window: it comes to rest, and the picture follows the view meanwhile.
dev.py test runs it."""

import tempfile
from collections import Counter
from pathlib import Path

import bpy
import numpy as np

from tests.blender import scenes
from tests.blender.scenes import module
from tests.blender.user_steps import drag, live, middle, settled, viewport
from tests.blender.window_driver import area_of, drive, in_the_view, new_file, passed, photograph, until, wait_for_rest

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_several_"))
NEAR, FAR = 64, 48  # voxels along a side of the two cubes, whose sides are one unit long
SEGMENTS = {"near": ((0.1, 0.5, 0.9), (0.9, 0.2, 0.1)), "far": ((0.2, 0.7, 0.2), (0.9, 0.7, 0.1))}
reads: Counter = Counter()  # of files, by the function that reads them
held: list = []  # not empty while label files take forever


def count_reads():
    for name, function in (("volumes.volumes", "file_steps"), ("volumes.labels", "read_label_steps")):
        original = getattr(module(f"bridge.{name}"), function)

        def counted(*given, original=original, function=function, **more):
            reads[function] += 1
            while function == "read_label_steps" and held:
                yield module("rle_splat.runtime.steps").Progress(0.5, "reading labels")
            return (yield from original(*given, **more))

        setattr(module(f"bridge.{name}"), function, counted)


def write_labels(name, side, split):
    """A label file with two segments, of which the second begins at a share of the side."""
    labels = np.ones((side,) * 3, np.uint8)
    labels[:, :, int(split * side) :] = 2
    path = FOLDER / f"{name} {split}.raw"
    labels.tofile(path)
    return str(path)


def add_cube(name, side, place):
    """A cube of one unit, opaque, with a label file and two colored segments."""
    path = FOLDER / f"{name}.raw"
    np.full((side,) * 3, 100, np.uint8).tofile(path)
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(
            filepath=str(path), shape=(side,) * 3, dtype="uint8", spacing=(1.0 / side,) * 3
        ) == {"FINISHED"}
        owner = bpy.context.view_layer.objects.active
        owner.location = place
        functions = module("rle_splat.classify.transfer_function")
        module("bridge.look.transfer").write_transfer(owner, functions.TransferFunction(
            name="opaque", unit=None, opacity=((0.0, 0.9), (255.0, 0.9)),
            color=((0.0, 0.5, 0.5, 0.5), (255.0, 0.5, 0.5, 0.5)), opacity_unit_distance=0.02, shade=None))  # fmt: skip
        owner.rle_splat.label_file = write_labels(name, side, 0.5)
        assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    for row, color in zip(owner.rle_splat.labels, SEGMENTS[name]):
        row.use_color, row.color = True, color
    return owner


def at_rest(name, expected):
    """Nothing is read or drawn any more, and no file was read twice."""
    yield from settled()
    yield from until(lambda: not viewport().waits)
    yield from settled()
    yield from photograph(name)
    yield from wait_for_rest()
    before = viewport().counts.copy(), live().calls.copy(), reads.copy()
    for _ in range(20):
        yield
    assert (viewport().counts, live().calls, reads) == before, f"{name} does not come to rest"
    assert not viewport().waits and not viewport().problem and viewport().is_refined
    assert reads == expected, f"{name}: {reads}"
    print(f"{name}: at rest after {dict(reads)}, {dict(viewport().counts)}", flush=True)


def set_up():
    yield from new_file()
    count_reads()
    settings = bpy.context.scene.rle_splat
    settings.quality, settings.scene_scale = "draft", 1.0
    settings.lighting = "NONE"
    add_cube("far", FAR, (1.6, 0.8, 0.0))
    add_cube("near", NEAR, (0.0, 0.0, 0.0))
    with in_the_view():
        for one in bpy.context.view_layer.objects:
            one.select_set(True)
        bpy.ops.view3d.view_selected()
        bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "several.blend"))


def check_label_files():
    """Two volumes on two grids, each with its own label file."""
    yield from at_rest("label_files", {"file_steps": 2, "read_label_steps": 2})


def check_unread():
    """The same file opened anew, so that nothing is in memory."""
    reads.clear()
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "several.blend"))
    yield
    yield from at_rest("unread", {"file_steps": 2, "read_label_steps": 2})


def check_the_picture_follows():
    """Another label file is being read while the mouse orbits: both volumes are drawn in the new view."""
    reads.clear()
    held.append(True)
    near = bpy.data.objects["near"]
    near.rle_splat.label_file = write_labels("near", NEAR, 0.25)
    near.update_tag()
    yield
    yield
    assert viewport().waits
    drafts, before = viewport().counts["drafts"], viewport()._request.matrices
    yield from drag("MIDDLEMOUSE", middle(), [(40, -12)] * 4)
    assert viewport()._request.matrices != before, "the mouse has turned nothing"
    yield from until(lambda: not viewport().is_busy)
    assert viewport().waits and viewport().counts["drafts"] > drafts
    assert viewport()._shot.matrices == viewport()._request.matrices and len(viewport()._shot.contents) == 2
    yield from photograph("orbit_while_reading")
    assert viewport().pictures and viewport().waits
    held.clear()
    yield from at_rest("another_label_file", {"read_label_steps": 1})


def check_limit():
    """With room for one volume, both that the window shows stay; a hidden one leaves when the other is read anew."""
    store, most = module("bridge.loop.store"), module("bridge.loop.store").MOST_BYTES
    store.MOST_BYTES = 1
    reads.clear()
    module("bridge.volumes.volumes").forget_all()
    yield from at_rest("limit", {"file_steps": 2, "read_label_steps": 2})
    bpy.data.objects["far"].hide_set(True)
    near = bpy.data.objects["near"]
    near.rle_splat.label_file = write_labels("near", NEAR, 0.75)
    near.update_tag()
    yield from at_rest("hidden", {"file_steps": 2, "read_label_steps": 3})
    is_at_hand = module("bridge.volumes.volumes").is_at_hand
    assert [is_at_hand(bpy.data.objects[name]) for name in ("near", "far")] == [True, False]
    bpy.data.objects["far"].hide_set(False)
    yield from at_rest("shown_again", {"file_steps": 3, "read_label_steps": 4})
    store.MOST_BYTES = most


def check_deleted():
    """A volume deleted from Python leaves the memory and its camera, and the other one is shown on."""
    reads.clear()
    camera, near = scenes.add_camera((0.5, 0.5, 4.0)), bpy.data.objects["near"]
    scenes.activate(near)
    with in_the_view():
        assert bpy.ops.rle_splat.preview_in_camera_view(follow=True) == {"FINISHED"}
    assert len(camera.data.background_images) == 1
    bpy.data.objects.remove(near)
    yield from until(lambda: not camera.data.background_images)
    message = bpy.context.scene.rle_splat.message
    assert message == "The volume 'near' was deleted, so its backdrop was removed.", message
    yield from at_rest("deleted", {})
    assert len(module("bridge.loop.store")._entries) == 2, "the voxels and the labels of the other one"
    scenes.activate(bpy.data.objects["far"])
    with in_the_view():
        bpy.ops.object.delete()
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    assert viewport() is None and module("bridge.loop.store").nbytes() == 0


def scenario():
    yield from set_up()
    for check in (check_label_files, check_unread, check_the_picture_follows, check_limit, check_deleted):
        yield from check()
        passed(check.__name__)


drive(scenario, overlap=False)
