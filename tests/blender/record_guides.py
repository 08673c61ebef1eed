"""Pictures of the how-to guides, photographed in a real window.

    python3 dev.py blender --photograph tests/blender/record_guides.py --size 1280x800

writes how-to-*.jpg into build/window-shots/record_guides.  In tests/blender/data are: ``scan``, the DICOM series of the
gallery's skull; ``chest``, that of a chest; ``pet``, a PET series; ``cta_aorta_labels``, the dissected aorta with its
segments; and the files of RAW, FOOT and HEAD_MR.
how-to-preferences.jpg is a part of preferences.png of window_panels.py, without paths.
"""

import shutil
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

from tests.blender.guide_steps import (
    BRAIN,
    DATA,
    HEAD_MR,
    HEART,
    SCANS,
    activate,
    arrow,
    bare,
    begin,
    beside,
    imported,
    keep,
    line,
    look_from,
)
from tests.blender.scenes import module
from tests.blender.user_steps import hover, middle, press, scroll_sidebar, settled, simulate
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    wait_for_rest,
    window,
)

HEAD, CUT = "620x560+140+170", "620x560+235+170"
AXIAL = (250, 560)  # over the axial slice of the four-up view
TOOL = "800x440+0+28"  # with the toolbar and both headers
BEATING, PANEL = "280x322+380+234", "260x322+990+455"
RAW = "cthead_256x256x113_uint16be.raw.gz"
FOOT = "foot_256x256x256_uint8_fromjpeg.raw.gz"
MEDIASTINUM = 60.0, 400.0  # HU: level and window
PANELS = ("transfer", "slices", "shading")  # that are open


def skull():
    """The skull without its head holder, by the preset Bone; returns the volume."""
    volume = yield from imported("ct-bone", "scan")
    look_from(76.0, -30.0, 0.5)
    with in_the_view():
        assert bpy.ops.rle_splat.hide_table() == {"FINISHED"}
    yield from settled()
    return volume


def curve():
    """Bones in a foot that is nearly clear."""
    open_panels("RLE_SPLAT_PT_volume", *(f"RLE_SPLAT_PT_{name}" for name in PANELS))
    yield from imported("xa-limb", FOOT, spacing=(1.0, 1.0, 1.0))
    bpy.context.scene.rle_splat.quality = "fine"
    bare()
    look_from(65.0, -80.0, 0.5)
    yield from settled()
    yield from keep("how-to-curve")
    passed("curve")


def window_tool():
    """The value under the mouse on an axial slice of a chest, seen from the feet, and a drag that brightens it."""
    volume = yield from imported("ct-angiography", "chest")
    bare()
    ours, view = volume.rle_splat, area_of("VIEW_3D").spaces.active
    with in_the_view():
        activate(volume)
        assert bpy.ops.rle_splat.add_slice(kind="AXIAL") == {"FINISHED"}
        activate(volume)
        ours.opacity_scale = 0.0
        ours.slices_follow_window, ours.slice_center, ours.slice_width = False, *MEDIASTINUM
        bpy.ops.rle_splat.use_window_tool()
    bpy.context.scene.view_settings.view_transform = "Standard"  # leaves gray values as they are
    overlay = view.overlay
    overlay.show_text = overlay.show_outline_selected = overlay.show_extras = overlay.show_object_origins = False
    volume.select_set(False)
    view.region_3d.view_perspective = "ORTHO"
    look_from(180.0, 0.0, 0.62)
    view.region_3d.view_location += Vector((0.06, 0.07, 0.0))  # farther left and up in the picture
    yield from settled()
    begin_at, end_at = middle(-130.0, 130.0), middle(-60.0, 10.0)
    for at in (middle(), begin_at):
        simulate("MOUSEMOVE", "NOTHING", at)
        yield
    yield from settled()
    yield from keep("read", TOOL, arrow(begin_at))
    simulate("LEFTMOUSE", "PRESS", begin_at)
    for share in np.linspace(0.1, 1.0, 10):
        yield
        simulate("MOUSEMOVE", "NOTHING", np.array(begin_at) + share * np.subtract(end_at, begin_at))
    yield from settled()
    yield from keep("drag", TOOL, [*line(begin_at, end_at), *arrow(end_at)])
    yield from press("ESC", end_at)
    dragged = "Drag down and to the right: the level falls, the window grows"
    beside("how-to-window", {"Read the value under the mouse": "read", dragged: "drag"}, across=1)
    passed("window")


def presets():
    """The grid of presets, with pictures of a heart."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_presets")
    volume = yield from imported("ct-angiography", HEART)
    volume.name = "Heart"
    bare()
    look_from(84.0, 30.0, 0.6)
    with in_the_view():
        assert bpy.ops.rle_splat.hide_table() == {"FINISHED"}
    activate(volume)
    yield from settled()
    yield from scroll_sidebar(10)
    yield from wait_for_rest()  # with the pictures of presets
    yield from keep("how-to-presets")
    passed("presets")


def kept():
    """A click on a heart keeps it and what is connected to it, but no bones, from which the shift separates it."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_labels")
    volume = yield from imported("ct-angiography", HEART)
    bare()
    activate(volume)
    area_of("VIEW_3D").spaces.active.overlay.show_overlays = False  # without the box
    look_from(84.0, 20.0, 0.56)
    yield from settled()
    yield from keep("all", HEAD)
    volume.rle_splat.shift_by = 130.0  # HU
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.pick_connected("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from press("LEFTMOUSE", middle(140.0, -50.0))
    yield from settled()
    assert any(row.label_name == "Kept" for row in volume.rle_splat.labels)
    with in_the_view():
        assert bpy.ops.rle_splat.change_segment(tool="GROW", length=2.0) == {"FINISHED"}
    volume.rle_splat.shift_by = 0.0
    yield from settled()
    yield from keep("kept", HEAD)
    beside("how-to-keep", {"Angio": "all", "Kept by one click, Shift 130 HU": "kept"})
    passed("kept")


def segments():
    """Vessels and chambers of a heart: a threshold, its largest part, grown, and smoothed."""
    volume = yield from imported("ct-angiography", HEART)
    bare()
    area_of("VIEW_3D").spaces.active.overlay.show_overlays = False  # without the box
    look_from(84.0, 20.0, 0.56)
    activate(volume)
    shown = {}
    for caption, operator, given in (
        ("Threshold to Segment, from 290 HU", "threshold_segment", {"low": 290.0, "high": 3000.0}),
        ("Keep Largest", "change_segment", {"tool": "LARGEST"}),
        ("Grow, 2 mm", "change_segment", {"tool": "GROW", "length": 2.0}),
        ("Smooth, 4 mm", "change_segment", {"tool": "SMOOTH", "length": 4.0}),
    ):
        with in_the_view():
            assert getattr(bpy.ops.rle_splat, operator)(**given) == {"FINISHED"}
        if not shown:
            volume.rle_splat.labels[0].show = False  # the background
        yield from settled()
        shown[caption] = f"segment-{len(shown)}"
        yield from keep(shown[caption], HEAD)
    beside("how-to-segments", shown, across=2)
    passed("segments")


def fused():
    """A PET, red on what stands for its CT, of which there is none: the same PET, whose body is faint and gray."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_channels", "RLE_SPLAT_PT_transfer")
    volume = yield from imported("pet", "pet")
    bare()
    area_of("VIEW_3D").spaces.active.overlay.show_overlays = False  # without the box
    look_from(85.0, 25.0, 0.55)
    body = Path(tempfile.mkdtemp()) / "Body.json"
    opacity = [(0.0, 0.0), (0.25, 0.0), (0.6, 0.03), (20.0, 0.03)]  # of SUV
    module("rle_splat").TransferFunction(
        "Body", "SUVbw", opacity, [(0.0, 0.3, 0.32, 0.35)], opacity_unit_distance=6.0
    ).save(str(body))
    activate(volume)
    with in_the_view():
        assert bpy.ops.rle_splat.load_transfer_function(filepath=str(body)) == {"FINISHED"}
        assert bpy.ops.rle_splat.import_channel(filepath=str(next((DATA / "pet").iterdir()))) == {"FINISHED"}
    channel = volume.rle_splat.channels[0].source
    channel.name, channel.rle_splat.window_center, channel.rle_splat.window_width = "Uptake", 5.0, 6.0
    volume.select_set(False)
    activate(channel)
    bpy.context.scene.rle_splat.quality = "fine"
    yield from settled()
    yield from keep("how-to-fuse")
    passed("fused")


def set_up_slices():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_slices")
    yield from begin()
    with in_the_view():
        scan = shutil.copy(DATA / HEAD_MR, Path(tempfile.mkdtemp()) / "Head.nii.gz")  # a short name
        assert bpy.ops.rle_splat.import_volume(filepath=str(scan), at_cursor=True) == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    volume.select_set(False)
    bare()
    look_from(76.0, 30.0, 0.5)
    bpy.context.scene.view_settings.view_transform = "Standard"  # leaves gray values as they are
    volume.rle_splat.smoothness, bpy.context.scene.rle_splat.quality = 2.0, "fine"
    quarter(volume, (1.0, -1.0, 1.0))[0].hide_set(True)  # its handles and lines would hide the slices
    with in_the_view():
        activate(volume)
        assert bpy.ops.rle_splat.four_up_view("EXEC_DEFAULT", True) == {"FINISHED"}
    activate(volume)
    volume.rle_splat.slices_clear_black = True
    yield from hover(AXIAL)
    yield from settled()
    yield from keep("how-to-slices")
    passed("slices")


def layout():
    """Blender as it starts, with a scan in the view and the tab beside it."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display")
    yield from new_file()
    for editor, factor, kind in (("PROPERTIES", 0.7, "OUTLINER"), ("VIEW_3D", 0.15, "DOPESHEET_EDITOR")):
        with bpy.context.temp_override(window=window(), area=area_of(editor)):
            bpy.ops.screen.area_split(direction="HORIZONTAL", factor=factor)
        yield
        parts = [one for one in window().screen.areas if one.type == editor]
        (max if kind == "OUTLINER" else min)(parts, key=lambda one: one.y).type = kind
        yield
    area_of("DOPESHEET_EDITOR").ui_type = "TIMELINE"
    with in_the_view():
        scan = shutil.copy(DATA / HEAD_MR, Path(tempfile.mkdtemp()) / "Head.nii.gz")  # a short name
        assert bpy.ops.rle_splat.import_volume(filepath=str(scan), at_cursor=True) == {"FINISHED"}
        assert bpy.ops.rle_splat.apply_preset(preset="mr-head") == {"FINISHED"}
    look_from(76.0, 30.0, 0.7)
    yield from settled()
    yield from keep("how-to-blender")
    passed("layout")


def head():
    """The skin of a head from slices 2 mm apart."""
    volume = yield from imported(
        "ct-skin", RAW, spacing=(1.0, 1.0, 2.0), use_calibration=True, intercept=-1024.0, value_unit="HU",
        modality="CT", orientation="LPI")  # fmt: skip
    bare()
    look_from(80.0, 35.0, 0.6)
    return volume


def smoothness():
    open_panels("RLE_SPLAT_PT_volume", *(f"RLE_SPLAT_PT_{name}" for name in PANELS))
    volume = yield from head()
    with in_the_view():
        assert bpy.ops.rle_splat.hide_table() == {"FINISHED"}
    area_of("VIEW_3D").spaces.active.region_3d.view_location.z += 0.045
    look_from(75.0, 25.0, 0.5)
    for name, smoothness in (("rough", 0.0), ("smooth", 3.0)):
        volume.rle_splat.smoothness = smoothness
        yield from settled()
        yield from keep(name, HEAD)
    beside("how-to-smoothness", {"Smoothness 0": "rough", "Smoothness 3 mm": "smooth"})
    passed("smoothness")


def table():
    yield from head()
    area_of("VIEW_3D").spaces.active.overlay.show_overlays = False  # without box and letters
    yield from settled()
    yield from keep("table", HEAD)
    with in_the_view():
        assert bpy.ops.rle_splat.hide_table() == {"FINISHED"}
    yield from settled()
    yield from keep("free", HEAD)
    beside("how-to-table", {"Before Hide Table": "table", "After Hide Table": "free"})
    passed("table")


def quarter(volume, toward=(1.0, 1.0, 1.0)):
    """Remove a quarter of a head by a box; returns the box and the middle of the head."""
    corners = module("bridge.volumes.box").world_corners(volume)
    middle_of, half = Vector(corners.mean(axis=0)), Vector(np.ptp(corners, axis=0)) / 2
    with in_the_view():
        activate(volume)
        assert bpy.ops.rle_splat.add_cutting_object(kind="BOX", keep="OUTSIDE") == {"FINISHED"}
    box = bpy.context.view_layer.objects.active
    box.matrix_world = Matrix.LocRotScale(middle_of + half * Vector(toward), None, half)
    return box, middle_of


def values_on_cut(volume) -> None:
    ours = volume.rle_splat
    with in_the_view():
        activate(volume)
        assert bpy.ops.rle_splat.gray_values_on_cut() == {"FINISHED"}
    ours.slices_follow_window, ours.slice_center, ours.slice_width = False, 90.0, 160.0
    bpy.context.scene.view_settings.view_transform = "Standard"  # leaves gray values as they are
    area_of("VIEW_3D").spaces.active.shading.type = "MATERIAL"


def cut():
    """A head from behind: whole, cut open by a plane and by a box whose handles are shown, and with gray values."""
    volume = yield from imported("mr-head", HEAD_MR)
    bare()
    volume.rle_splat.smoothness, bpy.context.scene.rle_splat.quality = 2.0, "fine"
    view = area_of("VIEW_3D").spaces.active
    look_from(66.0, 135.0, 0.5)
    yield from settled()
    yield from keep("whole", CUT)
    with in_the_view():
        activate(volume)
        assert bpy.ops.rle_splat.add_cutting_object(kind="PLANE") == {"FINISHED"}
    yield from settled()
    yield from keep("plane", CUT)
    bpy.data.objects.remove(bpy.context.view_layer.objects.active)
    quarter(volume)
    yield from settled()
    yield from keep("box", CUT)
    values_on_cut(volume)
    bpy.data.objects["Cut Box"].hide_set(True)  # with its handles
    view.overlay.show_overlays = False
    yield from settled()
    yield from wait_for_rest()  # with the shaders of the slice
    yield from keep("gray", CUT)
    named = {"Whole": "whole", "Cut by a plane": "plane", "Cut by a box": "box", "Gray Values on Cut": "gray"}
    beside("how-to-cut", named, across=2)
    passed("cut")


def surface():
    """A brain, and the mesh of its surface."""
    volume = yield from imported("mr-brain", BRAIN)
    volume.rle_splat.smoothness, bpy.context.scene.rle_splat.quality = 1.5, "fine"
    bare()
    area_of("VIEW_3D").spaces.active.overlay.show_overlays = False  # without box and letters
    look_from(78.0, 30.0, 0.5)
    with in_the_view():
        assert bpy.ops.rle_splat.extract_surface(of="OPACITY") == {"FINISHED"}
    made, view = bpy.context.view_layer.objects.active, area_of("VIEW_3D").spaces.active
    made.select_set(False)  # its wires would be orange
    made.hide_set(True)
    yield from settled()
    yield from keep("volume", HEAD)
    made.hide_set(False)
    made.modifiers.new("Decimate", "DECIMATE").ratio = 0.15
    volume.hide_set(True)
    view.shading.color_type = "VERTEX"
    view.overlay.show_overlays, view.overlay.show_extras = True, False
    view.overlay.show_wireframes, view.overlay.wireframe_threshold, view.overlay.wireframe_opacity = True, 1.0, 0.4
    yield from wait_for_rest()
    yield from keep("mesh", HEAD)
    beside("how-to-surface", {"Volume": "volume", "Mesh": "mesh"})
    passed("surface")


def live():
    """A head from behind, which hides its face, cut open, with gray values on the cut and a modeled electrode in it, in
    Material Preview."""
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_clip_objects")
    volume = yield from imported("mr-head", HEAD_MR)
    bare()
    volume.rle_splat.smoothness, bpy.context.scene.rle_splat.quality = 2.0, "fine"
    view = area_of("VIEW_3D").spaces.active
    view.lens, view.overlay.show_overlays = 85.0, False  # without the box
    look_from(66.0, 135.0, 0.62)
    box, middle_of = quarter(volume)
    values_on_cut(volume)
    tip = middle_of + Vector((0.012, 0.0005, 0.012))  # half embedded in the coronal cut
    for name, radius, length, color in (
        ("Lead", 0.0007, 0.11, (0.5, 0.53, 0.58)),
        ("Contact", 0.0009, 0.012, (1.0, 0.3, 0.05)),
    ):
        with in_the_view():
            bpy.ops.mesh.primitive_cylinder_add(radius=radius, depth=length)
        one = bpy.context.view_layer.objects.active
        one.name = name
        along = Vector((0.5, 0.0, 0.85)).normalized()
        one.matrix_world = (
            Matrix.Translation(tip + along * length / 2) @ along.to_track_quat("Z", "Y").to_matrix().to_4x4()
        )
        material = bpy.data.materials.new(name)
        material.diffuse_color = (*color, 1.0)
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1.0)
        one.data.materials.append(material)
        one.select_set(False)
    activate(volume)
    box.select_set(False)
    box.hide_set(True)  # with its handles
    yield from settled()
    yield from keep("how-to-live")
    passed("live")


def raw_file():
    yield from begin()
    SCANS.mkdir(parents=True, exist_ok=True)
    with in_the_view():
        bpy.ops.rle_splat.import_volume("INVOKE_DEFAULT", filepath=shutil.copy(DATA / RAW, SCANS))
    yield from wait_for_rest()
    yield from keep("how-to-raw")
    yield from press("ESC", middle())
    shutil.rmtree(SCANS)
    passed("raw file")


def ventricle(phase: float, side: int = 96) -> np.ndarray:
    """A bowl as a left ventricle is one, uint8: relaxed at phase 0, contracted and with a thicker wall at 1."""
    z, y, x = np.meshgrid(*3 * (np.linspace(-1.0, 1.0, side),), indexing="ij")
    outer = np.sqrt((x**2 + y**2) / (0.62 - 0.06 * phase) ** 2 + ((z - 0.35) / (1.15 - 0.15 * phase)) ** 2)
    inner = np.sqrt((x**2 + y**2) / (0.47 - 0.22 * phase) ** 2 + ((z - 0.35) / (1.0 - 0.25 * phase)) ** 2)
    wall = np.minimum(np.minimum(1.0 - outer, inner - 1.0) * 0.5, 0.45 - 0.1 * phase - z)
    return np.rint(250.0 / (1.0 + np.exp(-60.0 * wall))).astype(np.uint8)


def in_time():
    """A computed ventricle that contracts, as no scan of the data has times, and the panel Time."""
    folder = Path(tempfile.mkdtemp(prefix="rle_splat_time_"))
    for number in range(1, 13):
        voxels = ventricle(0.5 - 0.5 * np.cos(np.pi * (number - 1) / 6.0))
        (folder / f"heart_96x96x96_uint8_{number:04}.raw").write_bytes(voxels.tobytes())
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_scan", "RLE_SPLAT_PT_playback")
    yield from begin()
    with in_the_view():
        assert bpy.ops.rle_splat.import_volume(
            filepath=str(folder / "heart_96x96x96_uint8_0001.raw"), shape=(96, 96, 96), dtype="uint8", use_sequence=True
        ) == {"FINISHED"}  # fmt: skip
        assert bpy.ops.rle_splat.apply_preset(preset="ct-heart") == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    volume.rle_splat.playback, bpy.context.scene.rle_splat.quality = "LOOP", "fine"
    volume.rle_splat.smoothness = 3.0
    volume.select_set(False)
    bare()
    look_from(48.0, -30.0, 0.6)
    shown = {"Time point 1": "time-1", "Time point 4": "time-4", "Time point 7": "time-7", "Time panel": "time-panel"}
    for number in (1, 4, 7):
        bpy.context.scene.frame_set(number)
        yield from settled()
        yield from keep(f"time-{number}", BEATING)
    yield from scroll_sidebar(30)
    yield from keep("time-panel", PANEL)
    beside("how-to-time", shown)
    passed("time")


def scenario():
    bpy.context.preferences.system.use_region_overlap = False  # the sidebar stands beside the view
    open_panels("RLE_SPLAT_PT_volume", *(f"RLE_SPLAT_PT_{name}" for name in PANELS))
    for part in PARTS:
        yield from part()


PARTS = (
    layout, curve, window_tool, set_up_slices, presets, kept, segments, fused, smoothness, table, cut, surface,
    raw_file, live, in_time,
)  # fmt: skip
drive(scenario)
