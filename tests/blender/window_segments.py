"""Hide Table in a real Blender with a window, from the import of a chest CT to undo.

dev.py test runs it.  The scan is a file tests/blender/chest.* if there is one, else a phantom of a chest on a table.
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from tests.blender.scenes import module
from tests.blender.user_steps import find_button, press_button, scroll_sidebar, settled
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    region_of,
    until,
    window,
)

BELOW = 48  # pixels from a button to the second header under it
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_segments_"))


def write_phantom() -> Path:
    """A trunk with lungs on a table, in HU, 4 mm voxels: (40, 96, 96) in z, y, x."""
    _, y, x = np.indices((40, 96, 96)) - np.array((19.5, 47.5, 47.5))[:, None, None, None]
    values = np.full(x.shape, -1000, np.int16)
    values[(x / 38.0) ** 2 + ((y + 6.0) / 24.0) ** 2 <= 1.0] = 40
    values[((np.abs(x) - 16.0) / 11.0) ** 2 + ((y + 8.0) / 15.0) ** 2 <= 1.0] = -850
    values[(np.abs(x) - 3.0 < 4.0) & (np.abs(y - 10.0) < 5.0)] = 500
    values[(np.abs(y - 26.0) < 1.6) & (np.abs(x) < 46.0)] = 200
    path = FOLDER / "chest.nii.gz"
    read = module("rle_splat.read.formats")
    volumes = module("rle_splat.volume.volume")
    read.write_volume(
        volumes.Volume(values, np.diag((4.0, 4.0, 4.0, 1.0)), value_unit="HU", modality="CT", space="patient"), path
    )
    return path


def press(kind: str, place=None) -> None:
    where = {} if place is None else {"x": place[0], "y": place[1]}
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=kind, value=value, **where)


def volume():
    return next(one for one in bpy.data.objects if one.rle_splat.is_volume)


def rows():
    return [(row.label_name, row.show) for row in volume().rle_splat.labels]


def is_idle() -> bool:
    return not module("bridge.loop.jobs").StepwiseOperator.is_running()


def call_menu(entry: int):
    """Open the menu of segment tools under the mouse and choose an entry, from 0, by keys."""
    area = area_of("VIEW_3D")
    region = region_of(area, "WINDOW")
    middle = region.x + region.width // 3, region.y + region.height // 2
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=middle[0], y=middle[1])
    yield
    with in_the_view():
        bpy.ops.wm.call_menu(name="RLE_SPLAT_MT_segments")
    yield from settled()
    yield from photograph("menu")
    press("HOME")
    yield
    for _ in range(entry):
        press("DOWN_ARROW")
        yield
    press("RET")
    yield


def check_remove_table():
    yield from new_file()
    path = next(Path(__file__).parent.glob("chest.*"), None) or write_phantom()
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(filepath=str(path), modality="CT") == {"FINISHED"}
        bpy.ops.rle_splat.frame_volume(side="I")
        bpy.ops.ed.undo_push(message="imported")
    yield from settled()
    yield from photograph("with_table")
    yield from call_menu(0)
    yield from until(lambda: is_idle() and rows())
    assert rows() == [("Background", False), ("Body", True)], rows()
    yield from settled()
    yield from photograph("without_table")
    with in_the_view():
        bpy.ops.ed.undo()
    yield from settled()
    assert not rows() and volume().rle_splat.label_file == ""
    yield from photograph("undone")
    with in_the_view():
        bpy.ops.ed.redo()
    yield from settled()
    assert rows() == [("Background", False), ("Body", True)]


def click(place):
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=place[0], y=place[1])
    yield
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type="LEFTMOUSE", value=value, x=place[0], y=place[1])
        yield


def bone_place() -> tuple:
    """The window's pixel of the phantom's spine, seen from the feet."""
    area = area_of("VIEW_3D")
    region = region_of(area, "WINDOW")
    corners = module("bridge.volumes.box").world_corners(volume())
    low, high = corners.min(axis=0), corners.max(axis=0)
    point = Vector(low + (high - low) * (0.5, 57.5 / 95.0, 0.0))
    place = location_3d_to_region_2d(region, area.spaces.active.region_3d, point)
    return region.x + int(place.x), region.y + int(place.y)


def check_pick():
    """A click on the volume keeps what is connected; one beside it changes nothing."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    for place in (bone_place(), (region.x + region.width // 2, region.y + 4)):
        with in_the_view():
            assert bpy.ops.rle_splat.pick_connected("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
        yield
        yield from click(place)
        yield from until(lambda: is_idle() and rows() and rows()[-1] == ("Kept", True))
        assert not any(shown for _, shown in rows()[:-1]), rows()


def check_names():
    """Letters and the names of two segments, by the mouse from the panel Render on."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_picture")
    yield from new_file()
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(filepath=str(write_phantom()), modality="CT") == {"FINISHED"}
        assert bpy.ops.rle_splat.threshold_segment(low=300.0, high=600.0) == {"FINISHED"}
        bpy.ops.rle_splat.frame_volume(side="A")
    volume().rle_splat.labels[0].show = False
    yield from settled()
    scene, view = bpy.context.scene, area_of("VIEW_3D").spaces.active.region_3d
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.matrix_world = camera, view.view_matrix.inverted()
    view.view_perspective = "CAMERA"
    yield from settled()
    yield from scroll_sidebar(40)
    x, y = yield from find_button("meshes_occlude")
    yield from click((x, y - BELOW))  # Pictures and Files
    yield from settled()
    yield from scroll_sidebar(40)
    for command in ("add_letters", "add_names"):
        yield from press_button(f"bpy.ops.rle_splat.{command}")
        yield from settled()
    yield from photograph("names")
    assert {"R", "L", "S", "I"} <= texts() and len([text for text in texts() if len(text) > 1]) == 2, texts()
    yield from press_button("bpy.ops.rle_splat.name_structure")
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    x, y = region.x + region.width // 2, region.y + region.height // 2
    yield from click((x, y))
    for key in (*"CYST", "RET", "RET"):  # the text, its end, and the end of the dialog
        window().event_simulate(type=key, value="PRESS", unicode=key.lower() if len(key) == 1 else "", x=x, y=y)
        yield
        window().event_simulate(type=key, value="RELEASE", x=x, y=y)
        yield
    yield from until(lambda: "cyst" in texts())
    yield from settled()
    yield from photograph("labeled")


def texts() -> set:
    return {one.data.body for one in bpy.context.scene.objects if one.type == "FONT"}


def scenario():
    open_panels("RLE_SPLAT_PT_labels", "RLE_SPLAT_PT_volume")
    yield from check_remove_table()
    passed("remove table")
    yield from check_pick()
    passed("pick")
    yield from check_names()
    passed("names")
    yield from settled()
    yield from photograph("kept")


drive(scenario, overlap=False)
