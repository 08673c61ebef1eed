"""What the recorders of guides and tutorials share: a bare window, photographs as JPEG, and lights."""

import os
import shutil
import subprocess
import sys
from importlib import import_module
from math import radians
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

from tests.blender.real_blender import MODULE
from tests.blender.user_steps import hover, middle, press, settled, simulate
from tests.blender.window_driver import SHOTS, area_of, in_the_view, new_file, photograph, region_of, window

DATA = Path(__file__).parent / "data"
AORTA = "cta_aorta_labels"
LEFT_OUT = "mask_superior_mesenteric_artery.nii.gz"  # below the slice of the tutorial
HEART = f"{AORTA}/cta_heart_aorta_120x126x164_int16.nii.gz"
BRAIN, HEAD_MR = "flair_brain_124x160x140_uint8.nrrd", "t1_head_188x256x190_uint8.nii.gz"
QUALITY = "70"
DISC, DIGIT = 10.5, 14  # pixels: the radius of a number, the size of its digit
ARROW = ((0, 0), (0, 17), (4, 13), (7, 20), (10, 19), (7, 12), (12, 12))  # pixels from the mouse, down
SCANS = Path("/scans")  # of the small system: a path that a reader could have
bpy.context.preferences.filepaths.temporary_directory = "/tmp"  # a reader's, which the panel Segments shows


def fold(*titles: int):
    """Open or close panels of the sidebar with clicks on their titles, at these pixels below the window's top."""
    sidebar = region_of(area_of("VIEW_3D"), "UI")
    for below in titles:
        at = sidebar.x + sidebar.width // 2, window().height - below
        yield from hover(at)
        yield from press("LEFTMOUSE", at)
        yield from settled()
    yield from hover(middle())  # no tooltip covers them


def keep(name: str, part: str = "", words=()):
    """A photograph, or the part of it, changed by words of ImageMagick, as JPEG."""
    yield from photograph(name)
    path = Path(os.environ[SHOTS]) / f"{name}.png"
    words = [*words, "-crop", part, "+repage"] if part else words
    subprocess.run(["convert", str(path), *words, "-quality", QUALITY, str(path.with_suffix(".jpg"))], check=True)


def beside(name: str, parts: dict[str, str], across: int | None = None) -> None:
    """A sheet of photographs by their captions, as JPEG."""
    sys.path.append(str(Path(import_module(MODULE).__file__).parent))  # has rle_splat, whose letters a sheet has
    from devtools.sheets import sheet

    folder = Path(os.environ[SHOTS])
    made = sheet([(caption, pixels(folder / f"{part}.jpg")) for caption, part in parts.items()], across)
    height, width = made.shape[:2]
    subprocess.run(["convert", "-size", f"{width}x{height}", "-depth", "8", "rgb:-", "-resize", "1100x>", "-quality",
                    QUALITY, str(folder / f"{name}.jpg")], input=made.tobytes(), check=True)  # fmt: skip
    for part in parts.values():
        (folder / f"{part}.jpg").unlink()


def pixels(path: Path) -> np.ndarray:
    """(H, W, 3) uint8: a picture that was kept."""
    command = ["convert", str(path), "-strip", "-depth", "8", "ppm:-"]
    _, size, _, data = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout.split(b"\n", 3)
    width, height = map(int, size.split())
    return np.frombuffer(data, np.uint8).reshape(height, width, 3)


def arrow(at) -> list[str]:
    """Words of ImageMagick that draw the mouse at a pixel of the window."""
    corners = " ".join(f"{at[0] + x},{window().height - at[1] + y}" for x, y in ARROW)
    return ["-fill", "white", "-stroke", "black", "-strokewidth", "1", "-draw", f"polygon {corners}"]


def line(begin_at, end_at) -> list[str]:
    """Words of ImageMagick that draw the way of the mouse between two pixels of the window."""
    way = " ".join(f"{int(x)},{window().height - int(y)}" for x, y in (begin_at, end_at))
    pens = ("-stroke", "black", "-strokewidth", "5"), ("-stroke", "white", "-strokewidth", "2")
    return [word for pen in pens for word in (*pen, "-draw", f"line {way}")]


def numbers(*places) -> list[str]:
    """Words of ImageMagick that draw numbers of a list in discs.

    ``places``: number and pixel from the upper left, beside a button, measured in a photograph of the same size.
    """
    disc = ("-fill", "#E8730C", "-stroke", "white", "-strokewidth", "1.5")
    digit = ("-fill", "white", "-stroke", "none", "-font", "DejaVu-Sans-Bold", "-pointsize", str(DIGIT))
    drawn = ((f"circle {x},{y} {x + DISC},{y}", f"text {x - 5},{y + 5} '{number}'") for number, x, y in places)
    return [word for circle, text in drawn for word in (*disc, "-draw", circle, *digit, "-draw", text)]


def look_from(tilt: float, turn: float, nearer: float = 0.6) -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation = Euler((radians(tilt), 0.0, radians(turn))).to_quaternion()
    view.view_distance *= nearer


def begin():
    """A new file whose window has the viewport alone."""
    simulate("MOUSEMOVE", "NOTHING", (-9, -9))  # no area is moved while the mouse is in a region
    yield
    yield from new_file()
    with bpy.context.temp_override(window=window(), area=area_of("PROPERTIES")):
        bpy.ops.screen.area_close()
    yield


def masks() -> Path:
    """A folder of masks as TotalSegmentator writes them, with a label map of both lumina; none of LEFT_OUT."""
    folder = SCANS / "segmentations"
    folder.mkdir(parents=True, exist_ok=True)
    for path in (DATA / AORTA).glob("mask_*.nii.gz"):
        if path.name != LEFT_OUT:
            shutil.copyfile(path, folder / path.name.removeprefix("mask_"))
    shutil.copyfile(DATA / AORTA / "labels_true_false_lumen_uint8.nii.gz", folder / "aorta_lumens.nii.gz")
    return folder


def save(name: str) -> None:
    """Save the file where a reader could have it."""
    SCANS.mkdir(parents=True, exist_ok=True)
    assert bpy.ops.wm.save_as_mainfile(filepath=str(SCANS / name)) == {"FINISHED"}


def activate(volume) -> None:
    bpy.context.view_layer.objects.active = volume


def bare() -> None:
    """The viewport without floor, axes and cursor."""
    overlay = area_of("VIEW_3D").spaces.active.overlay
    overlay.show_relationship_lines = overlay.show_cursor = False
    overlay.show_floor = overlay.show_axis_x = overlay.show_axis_y = False


def lamp(kind: str, name: str, energy: float, place, **settings) -> None:
    """A lamp that shines to the scan's middle; ``place``: from there."""
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    for key, value in settings.items():
        setattr(data, key, value)
    made = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(made)
    made.matrix_world = Matrix.Translation(place) @ Vector(place).to_track_quat("Z", "Y").to_matrix().to_4x4()


def imported(preset: str, name: str, **given):
    """A file of the data, or a folder, in a new file, shown by a preset; returns the volume."""
    yield from begin()
    with in_the_view():
        if (DATA / name).is_dir():
            assert bpy.ops.rle_splat.import_dicom_series(directory=str(DATA / name)) == {"FINISHED"}
        else:
            assert bpy.ops.rle_splat.import_volume(filepath=str(DATA / name), at_cursor=True, **given) == {"FINISHED"}
        assert bpy.ops.rle_splat.apply_preset(preset=preset) == {"FINISHED"}
    volume = bpy.context.view_layer.objects.active
    if not (DATA / name).is_dir():
        volume.name = Path(name).name.split("_")[0].title()  # a short one
    volume.select_set(False)  # a selected box is orange
    area_of("VIEW_3D").spaces.active.overlay.show_relationship_lines = False
    return volume
