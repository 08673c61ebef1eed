"""The panels used in a real window by mouse and keys, one part of them after the other: a photograph of each.

    python3 dev.py blender --photograph tests/blender/record_panels.py --size 1600x1000

keeps them in build/window-shots/record_panels.  Buttons and settings are found by hovering over the sidebar.  The CT is
the practice CT; the PET and the MR are those of tests/blender/data, if they are there.
"""

import os
import shutil
import subprocess
import tempfile
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender import scenes
from tests.blender.formats import write_dose
from tests.blender.scenes import module
from tests.blender.user_steps import (
    choose,
    choose_import,
    confirm_browser,
    drag,
    find_button,
    hover,
    middle,
    press,
    press_button,
    settled,
    simulate,
    viewport,
)
from tests.blender.window_driver import (
    SHOTS,
    Run,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    redraw,
    region_of,
    until,
    wait_for_rest,
    window,
)

DATA = Path(__file__).parent / "data"
FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_panels_"))
SPACING = 2.0  # mm, of the practice CT
OP = "bpy.ops.rle_splat."
LEFT, CENTER, RIGHT = (230,), (140,), (75,)  # pixels from the right edge of the sidebar
FRAME = 114.0  # gray of the lines around a curve
TO_HEADER = 30  # pixels from a panel's first button up to its header
OF_NEXT = 21  # pixels from a small button to the one on its left
BRAIN, AIR = np.array((0.45, 0.35, 0.0)), np.array((0.03, 0.03, 0.0))  # shares of the volume's sides
BRAIN_GRAYS = (89.25, 121.1, 25.5)  # of white and gray matter and water from 0 to 80 HU
BELOW = 90  # pixels at the foot of the viewport, where Blender shows the last operator
MODES = ("mip", "minip", "average", "xray")


def space():
    return area_of("VIEW_3D").spaces.active


def volumes() -> list:
    return [one for one in bpy.data.objects if one.rle_splat.is_volume]


def slices() -> dict:
    return {one.rle_splat.slice_kind: one for one in bpy.data.objects if one.rle_splat.is_slice}


def open_file(*panels):
    """A new file with these panels open.  Only in the first one may its editors be arranged: not after Blender has
    opened a file browser."""
    first = Run.start
    open_panels(*(f"RLE_SPLAT_PT_{name}" for name in panels))
    Run.start = first
    yield from new_file()


def start(*panels):
    """A new file with these panels open, and the practice CT from File > Import, seen from the front and above."""
    yield from open_file(*panels)
    space().overlay.show_floor = space().overlay.show_axis_x = space().overlay.show_axis_y = False
    bpy.context.scene.view_settings.view_transform = "Standard"
    scan = FOLDER / "practice-ct"
    if not scan.is_dir():
        import_module("devtools.practice_ct").write_series(scan, SPACING)
    yield from imported(1, scan.parent, scan)
    with in_the_view():
        assert bpy.ops.rle_splat.apply_preset(preset="ct-bone") == {"FINISHED"}
    space().region_3d.view_rotation = Euler((radians(65.0), 0.0, radians(25.0))).to_quaternion()
    yield from settled()
    yield from wait_for_rest()


def imported(entry: int, folder: Path, scan: Path):
    """Import by the menus; ``entry``: 0 for a file, 1 for a DICOM folder."""
    before = len(volumes())
    yield from choose_import(entry)
    yield from confirm_browser(*((scan,) if entry else (folder, scan.name)))
    yield from until(lambda: len(volumes()) > before)
    yield from settled()


def seen(name: str) -> np.ndarray:
    """A photograph of the viewport without the sidebar and the bars: (H, W, 3), 0 to 255, row 0 at the top."""
    yield from photograph(name)
    picture = 255.0 * scenes.load_pixels(Path(os.environ[SHOTS]) / f"{name}.png")[..., :3]
    region, sidebar = (region_of(area_of("VIEW_3D"), kind) for kind in ("WINDOW", "UI"))
    top = len(picture) - region.y - region.height
    return picture[top + 60 : len(picture) - region.y - BELOW, region.x + 60 : sidebar.x - 60]


def pixel_of(point, name: str) -> np.ndarray:
    """The color of a photograph where the view shows a point of the world."""
    picture, region = 255.0 * scenes.load_pixels(Path(os.environ[SHOTS]) / f"{name}.png"), None
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    place = location_3d_to_region_2d(region, space().region_3d, Vector(point))
    return picture[len(picture) - 1 - int(region.y + place.y), int(region.x + place.x), :3]


def choose_item(owner, name: str, item: str, columns=RIGHT):
    """Choose an item of a setting's menu by mouse and arrow keys."""
    at = yield from find_button(f"rle_splat.{name}", columns=columns)
    yield from choose(at, [one.identifier for one in owner.bl_rna.properties[name].enum_items].index(item))
    assert getattr(owner, name) == item, f"{name} is {getattr(owner, name)}"
    yield from settled()


def press_setting(name: str, columns=RIGHT):
    yield from press("LEFTMOUSE", (yield from find_button(name, columns=columns)))
    yield from wait_for_rest()


def check_slices():
    """Each orientation is one click; slices have a brain window, and the bone beside them stays as it was."""
    yield from start("slices")
    owner = volumes()[0]
    properties = owner.rle_splat
    yield from check_orbit()
    bone = yield from seen("01-bone")
    for kind, column in (("axial", LEFT), ("coronal", CENTER), ("sagittal", RIGHT)):
        yield from press_button(f"{OP}add_slice(", f"'{kind.upper()}'", columns=column)
        yield from settled()
        scenes.activate(owner)
        assert kind in slices(), kind
    assert set(slices()) == {"axial", "coronal", "sagittal"}
    yield from seen("02-three-slices")
    at = yield from find_button(f"{OP}use_window_tool(", columns=(45,))
    before = properties.window_center, properties.window_width
    windows = [name for name, *_ in module("operators.window_level").ITEMS if name != "CUSTOM"]
    yield from choose((at[0] - OF_NEXT, at[1]), windows.index("CT_BRAIN"))
    yield from settled()
    shown = properties.slice_center, properties.slice_width
    assert shown == (40.0, 80.0), shown
    assert (properties.window_center, properties.window_width) == before
    yield from seen("03-brain-window")
    space().show_object_viewport_volume = True
    for one in slices().values():
        one.hide_set(True)
    yield from settled()
    apart = np.abs((yield from seen("04-bone-again")) - bone).max()
    print(f"the bone changes by {apart:.1f} of 255", flush=True)
    assert apart <= 2.0
    for one in slices().values():
        one.hide_set(False)
    yield from check_gray(owner)


def check_orbit():
    """While the view turns, a draft without dashes across it; the view is turned back."""
    view = space().region_3d.view_rotation.copy()
    one = viewport()
    drafts = one.counts["drafts"]
    for number, _ in enumerate(drag("MIDDLEMOUSE", middle(), [(30, 10)] * 4)):
        yield
        if number == 5:  # the button is held
            yield from until(lambda: one.counts["drafts"] > drafts and one._work is None)
            redraw()
            path = str(Path(os.environ[SHOTS]) / "00-orbit.png")
            subprocess.run([shutil.which("import"), "-window", "root", path], check=True)
    space().region_3d.view_rotation = view
    yield from settled()


def check_gray(owner):
    """In Solid mode brain in a slice has the gray of its value in the window, and air is clear by a switch."""
    for kind in ("coronal", "sagittal"):
        slices()[kind].hide_set(True)
    space().show_object_viewport_volume = False
    with in_the_view():
        assert bpy.ops.rle_splat.frame_volume(side="S") == {"FINISHED"}
    corners = module("bridge.volumes.box").world_corners(owner)
    low, high = corners.min(axis=0), corners.max(axis=0)
    height = slices()["axial"].matrix_world.translation.z
    brain, air = ((*(low + (high - low) * share)[:2], height) for share in (BRAIN, AIR))
    air_before = []
    for name in ("05-slice-alone", "06-clear-black"):
        yield from wait_for_rest()
        yield from photograph(name)
        colors = [pixel_of(point, name) for point in (brain, air)]
        print(f"{name}: brain {colors[0]}, air {colors[1]}", flush=True)
        assert np.ptp(colors[0]) <= 1.0 and np.abs(colors[0][0] - np.array(BRAIN_GRAYS)).min() <= 3.0, colors
        air_before.append(colors[1].max())
        if name.startswith("05"):
            yield from press_setting("slices_clear_black")
    assert air_before[0] <= 1.0 < air_before[1], "air is not clear"


def check_four_up():
    """The four-up view in one click; the wheel over a slice moves it; a click links the windows."""
    owner = volumes()[0]
    space().show_object_viewport_volume = True
    scenes.activate(owner)
    yield from press_button(f"{OP}four_up_view(", columns=RIGHT)
    yield from settled()
    assert len(space().region_quadviews) == 4
    region = [one for one in area_of("VIEW_3D").regions if one.type == "WINDOW"][1]  # top left, the axial one
    at = region.x + 0.4 * region.width, region.y + 0.6 * region.height
    before = {kind: one.matrix_world.translation.copy() for kind, one in slices().items()}
    simulate("MOUSEMOVE", "NOTHING", at)
    yield
    for _ in range(4):
        simulate("WHEELUPMOUSE", "PRESS", at)
        yield
    yield from settled()
    yield from photograph("07-four-up")
    moved = {kind: (one.matrix_world.translation - before[kind]).length for kind, one in slices().items()}
    print(f"four turns of the wheel moved {moved}", flush=True)
    assert sorted(map(bool, moved.values())) == [False, False, True]
    scenes.activate(owner)
    yield from press_setting("slices_follow_window", columns=LEFT)
    yield from photograph("08-linked")
    assert owner.rle_splat.slices_follow_window
    yield from press_button(f"{OP}four_up_view(", columns=RIGHT)
    yield from settled()
    assert not len(space().region_quadviews)


def check_two_volumes():
    """Mode and lighting of one volume leave another as it is."""
    yield from start("display", "shading")
    first = volumes()[0]
    z, y, x = np.mgrid[:24, :24, :24] - 11.5
    with in_the_view():
        ball = np.where(x**2 + y**2 + z**2 < 100.0, 200, 0).astype(np.uint8)
        second = scenes.import_raw(FOLDER, ball, (4.0,) * 3, name="ball")
        scenes.load_color(FOLDER, (0.8, 0.4, 0.2))
    bpy.context.scene.rle_splat.scene_scale = 0.001
    corners = module("bridge.volumes.box").world_corners(first)
    second.location = corners.max(axis=0) + (0.0, -0.1, -0.2)
    with in_the_view():
        for one in (first, second):
            one.select_set(True)
        bpy.ops.view3d.view_selected()
    scenes.activate(first)
    yield from settled()
    center = Vector(module("bridge.volumes.box").world_corners(second).mean(axis=0))
    yield from photograph("10-two-volumes")
    before = pixel_of(center, "10-two-volumes")
    yield from choose_item(first.rle_splat, "lighting", "BOTH")
    yield from choose_item(first.rle_splat, "display", "xray")
    yield from photograph("11-first-changed")
    after = pixel_of(center, "11-first-changed")
    print(f"the second volume {before}, then {after}", flush=True)
    assert (second.rle_splat.mode, second.rle_splat.lighting) != (first.rle_splat.mode, first.rle_splat.lighting)
    assert np.abs(after - before).max() <= 2.0
    bpy.data.objects.remove(second)


def check_modes():
    """Each mode begins with a window that suits it; the background is black after one click."""
    yield from start("display")
    owner = volumes()[0]
    yield from choose_item(owner.rle_splat, "display", MODES[0])
    yield from press_button(f"{OP}plain_background(", columns=RIGHT)
    for mode in MODES:
        if mode != owner.rle_splat.display:
            yield from choose_item(owner.rle_splat, "display", mode)
        if mode == "minip":  # as the panel says: of all of the head every line passes air
            with in_the_view():
                assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}
            bpy.context.scene.rle_splat.clip_objects.objects[0].scale *= 0.55
            scenes.activate(owner)
            yield from settled()
        picture = yield from seen(f"20-{mode}")
        white = np.mean(picture.min(axis=2) > 250.0)
        print(f"{mode}: white {white:.3f} of the view, spread {picture.std():.1f}, "
              f"corner {picture[-8, 8]}, level {owner.rle_splat.window_center:g}, "
              f"window {owner.rle_splat.window_width:g}", flush=True)  # fmt: skip
        assert white < 0.05 or mode == "minip", "saturated"  # all but air is white in a MinIP of it
        assert picture.std() > 10.0, "an empty box"
        assert picture[-8, 8].max() <= 1.0, "not on black"


def check_shift():
    """A drag of 36 pixels on Shift moves by whole units of the value; bars are drawn after a click each."""
    yield from start("display", "shading")
    owner = volumes()[0]
    at = yield from find_button("rle_splat.shift_by", columns=RIGHT)
    yield from drag("LEFTMOUSE", at, [(6, 0)] * 6)
    yield from settled()
    shift = owner.rle_splat.shift_by
    print(f"36 pixels shift by {shift:g} HU", flush=True)
    assert 10.0 <= abs(shift) <= 100.0 and shift == round(shift)
    for name in ("show_scale_bar", "show_color_bar"):
        yield from press_setting(name)
        assert getattr(bpy.context.scene.rle_splat, name)
    yield from photograph("30-shift-and-bars")
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "SUN"))
    light.data.energy, light.rotation_euler = 3.0, (0.0, radians(80.0), 0.0)
    bpy.context.scene.collection.objects.link(light)
    scenes.activate(owner)
    pictures = {}
    for lighting in ("SCENE", "HEADLIGHT", "BOTH"):
        if owner.rle_splat.lighting != lighting:
            yield from choose_item(owner.rle_splat, "lighting", lighting)
        yield from settled()
        pictures[lighting] = yield from seen(f"31-{lighting.lower()}")
    print({name: round(float(one.mean()), 2) for name, one in pictures.items()}, flush=True)
    assert (pictures["BOTH"] >= np.maximum(pictures["SCENE"], pictures["HEADLIGHT"]) - 2.0).mean() > 0.99


def check_gradient_opacity():
    """The histogram lies inside the opacity curve; a click shows the curve of opacity by change, and a drag of its
    last point makes what changes clearer."""
    yield from start("transfer")
    owner = volumes()[0]
    at = yield from find_button("use_gradient_opacity", columns=RIGHT)
    yield from press("LEFTMOUSE", at)
    yield from settled()
    assert owner.rle_splat.use_gradient_opacity
    before = yield from seen("40-gradient-opacity")
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    picture = 255.0 * scenes.load_pixels(Path(os.environ[SHOTS]) / "40-gradient-opacity.png")[..., :3]
    frame = np.abs(picture[:, sidebar.x : sidebar.x + sidebar.width] - FRAME).max(axis=2) < 3.0
    rows = np.flatnonzero(frame.mean(axis=1) > 0.5)  # both ends of the upper curve, then the foot of the lower one
    right = sidebar.x + np.flatnonzero(frame[rows[-1]]).max()
    last = right - 3, len(picture) - 1 - rows[-1] + rows[1] - rows[0] - 3  # a point at the upper right
    yield from hover(last)
    yield from drag("LEFTMOUSE", last, [(0, -15)] * 6)
    yield from settled()
    after = yield from seen("41-curve-dragged")
    points = module("bridge.look.transfer_nodes").gradient_mapping(owner.rle_splat.transfer).curves[0].points
    apart = np.mean(np.abs(after - before).max(axis=2) > 2.0)
    print(f"the last point is at {tuple(points[-1].location)}; {apart:.3f} of the view has changed", flush=True)
    assert points[-1].location.y < 0.8 and apart > 0.01


def check_cut():
    """A box whose cut is switched off and on in the panel's header, and fitted to the volume again."""
    yield from start("clip_objects")
    owner = volumes()[0]
    whole = yield from seen("50-whole")
    yield from press_button(f"{OP}add_cutting_object(", "BOX", columns=LEFT)
    box = bpy.context.scene.rle_splat.clip_objects.objects[0]
    box.scale.y *= 0.5
    yield from settled()
    scenes.activate(owner)
    cut = yield from seen("51-cut")
    at = yield from find_button(f"{OP}add_cutting_object(", "BOX", columns=LEFT)
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    header = yield from find_button(
        "rle_splat.use_clips", columns=[sidebar.x + sidebar.width - x for x in range(int(at[0]) - 60, int(at[0]), 8)]
    )
    yield from press("LEFTMOUSE", header)
    yield from settled()
    off = yield from seen("52-cut-off")
    assert not bpy.context.scene.rle_splat.use_clips
    yield from press("LEFTMOUSE", header)
    yield from press_button(f"{OP}fit_cutting_object(", columns=RIGHT)
    yield from settled()
    scenes.activate(owner)
    fitted = yield from seen("53-fitted")
    apart = [np.mean(np.abs(one - whole).max(axis=2) > 20.0) for one in (cut, off, fitted)]
    print(f"pixels that differ from the whole: cut, off, fitted {apart}", flush=True)
    assert apart[0] > 4.0 * max(apart[1:])


def check_presets():
    """Presets of CT by their buttons; folded they leave room for Color and Opacity."""
    yield from start("display", "presets", "transfer")
    owner = volumes()[0]
    yield from photograph("60-presets")
    for name, column in (("ct-heart", (60,)), ("ct-coronaries", LEFT), ("ct-liver", CENTER)):
        yield from press_button(f"{OP}apply_preset(", f"'{name}'", columns=column)
        yield from settled()
        yield from photograph(f"61-{name}")
        print(name, owner.rle_splat.transfer_name, flush=True)
    first = yield from find_button(f"{OP}save_user_preset(", columns=LEFT)
    yield from photograph("62-presets")
    header = first[0] - 40, first[1] + TO_HEADER
    yield from hover(header)
    yield from press("LEFTMOUSE", header)
    yield from settled()
    yield from photograph("62-presets-folded")
    level = yield from find_button("rle_splat.window_center", columns=CENTER)
    print(f"Level is {window().height - level[1]} pixels below the top", flush=True)
    assert window().height - level[1] < 0.75 * window().height


def check_other_presets():
    """A PET and an MR with the presets made for them, where these scans are here."""
    for scan, entry, wanted in (
        ("pet_seg/dicom_pet_128x128x266", 1, ("pet", "pet-hot")), ("t1_head_188x256x190_uint8.nii.gz", 0, ("mr-mip",)),
    ):  # fmt: skip
        path = DATA / scan
        if not path.exists():
            continue
        yield from open_file("display", "presets")
        yield from imported(entry, path.parent, path)
        if not entry:  # the file does not say what it is
            with in_the_view():
                assert bpy.ops.rle_splat.reload_volume(modality="MR") == {"FINISHED"}
        for name in wanted:
            yield from press_button(f"{OP}apply_preset(", f"'{name}'", columns=(230, 140, 60))
            yield from settled()
            yield from photograph(f"63-{name}")
            print(name, volumes()[0].rle_splat.transfer_name, flush=True)


def check_channels():
    """A second volume becomes a channel by one button of a panel of its own; segments are cleared by one."""
    yield from start("channels", "labels")
    owner = volumes()[0]
    with in_the_view():
        second = owner.copy()
        bpy.context.scene.collection.objects.link(second)
        second.hide_render = True
        scenes.activate(owner)
        second.select_set(True)
    yield from press_button(f"{OP}add_channels(", columns=RIGHT)
    yield from settled()
    assert [one.source for one in owner.rle_splat.channels] == [second]
    yield from photograph("70-channels")
    volume = module("bridge.volumes.volumes").load_volume(owner)
    path = FOLDER / "labels_uint8.raw"
    (volume.voxels > 1024 + 300).astype(np.uint8).tofile(path)
    owner.rle_splat.label_file = str(path)
    yield from press_button(f"{OP}load_segments(", columns=RIGHT)
    yield from settled()
    assert len(owner.rle_splat.labels)
    yield from photograph("71-segments")
    yield from press_button(f"{OP}clear_segments(", columns=(45, 55))
    yield from settled()
    yield from photograph("72-cleared")
    assert not owner.rle_splat.labels and not owner.rle_splat.label_file


def check_dose():
    """An RTDOSE is added to the CT with the panel's button and the file browser; its isodose steps show in a cut."""
    yield from start("channels", "clip_objects")
    owner = volumes()[0]
    dose = write_dose(FOLDER / "dose.dcm")
    with in_the_view():
        assert bpy.ops.rle_splat.add_cutting_object(kind="BOX") == {"FINISHED"}
    box = bpy.context.scene.rle_splat.clip_objects.objects[0]
    box.scale.y *= 0.5
    box.location.y += box.empty_display_size * box.scale.y
    scenes.activate(owner)
    before = yield from seen("80-without-dose")
    yield from press_button(f"{OP}import_channel(", columns=RIGHT)
    yield from confirm_browser(dose.parent, dose.name)
    yield from until(lambda: len(owner.rle_splat.channels))
    yield from settled()
    yield from wait_for_rest()
    letters, drawn = module("bridge.live.letters"), []
    draw = letters.blf.draw
    letters.blf.draw = lambda font, text: drawn.append(text) or draw(font, text)
    redraw()
    letters.blf.draw = draw
    assert drawn.count("S") == 1, "letters of the dose beside those of the CT"
    after = yield from seen("81-dose")
    (channel,) = owner.rle_splat.channels
    properties = channel.source.rle_splat
    print(f"{properties.transfer_name}, unit {properties.value_unit}, largest {properties.value_high:g}; changed "
          f"{np.mean(np.abs(after - before).max(axis=2) > 20.0):.3f} of the view", flush=True)  # fmt: skip
    assert (properties.transfer_name, properties.value_unit) == ("Isodose", "Gy")
    assert np.mean(np.abs(after - before).max(axis=2) > 20.0) > 0.005


CHECKS = (
    check_slices, check_four_up, check_two_volumes, check_modes, check_shift, check_gradient_opacity, check_cut,
    check_presets, check_other_presets, check_channels, check_dose,
)  # fmt: skip


def scenario():
    failed = []
    for check in CHECKS:
        try:
            yield from check()
            passed(check.__name__)
        except (AssertionError, RuntimeError) as problem:  # the other parts go on
            print(f"{check.__name__}: {problem!r}"[:1500], flush=True)
            failed.append(check.__name__)
    assert not failed, failed


drive(scenario)
