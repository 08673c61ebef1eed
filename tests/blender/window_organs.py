"""Organs in a real window, from File > Import by mouse and keys: a CT with the contours of an RTSTRUCT, Anatomy, and a
PET in SUV over its CT.

dev.py test runs it.  The files are written with pydicom, which the extension brings.
"""

import os
import shutil
import tempfile
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender import scenes
from tests.blender.real_blender import MODULE
from tests.blender.user_steps import choose_import, confirm_browser, settled
from tests.blender.window_driver import (
    SHOTS,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    region_of,
    until,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_organs_"))
N, SPACING = 48, 4.0  # voxels, mm
CT, PET, STRUCTURES = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.128", "1.2.840.10008.5.1.4.1.1.481.3"
PLACE = "1.2.3.4.5"  # the frame of reference of all files
ORGANS = {"liver": (16.0, 24.0, 24.0), "spleen": (32.0, 24.0, 24.0)}  # name -> middle, in voxels
RADIUS = 6.0
WEIGHT, DOSE, HALF_LIFE = 70.0, 350e6, 6586.2  # kg, Bq, s
HOT = 8.0  # SUV in the middle of the liver


def distances(middle) -> np.ndarray:
    """(z, y, x) distances from a point, in voxels."""
    z, y, x = np.indices((N, N, N))
    return np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)


def write_series(folder: Path, stored: np.ndarray, kind: str, slope: float, intercept: float, **more) -> Path:
    """A DICOM series of 16-bit values, (z, y, x)."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    folder.mkdir()
    series, study = generate_uid(), generate_uid()
    for z, words in enumerate(stored):
        one = Dataset()
        one.file_meta = FileMetaDataset()
        one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        one.SOPClassUID, one.SOPInstanceUID = kind, generate_uid()
        one.file_meta.MediaStorageSOPClassUID, one.file_meta.MediaStorageSOPInstanceUID = kind, one.SOPInstanceUID
        one.StudyInstanceUID, one.SeriesInstanceUID, one.FrameOfReferenceUID = study, series, PLACE
        one.Modality, one.InstanceNumber = "CT" if kind == CT else "PT", z + 1
        one.SeriesDate = one.AcquisitionDate = one.StudyDate = "20210304"
        one.SeriesTime = one.AcquisitionTime = "110000"
        one.ImagePositionPatient, one.ImageOrientationPatient = [0.0, 0.0, SPACING * z], [1, 0, 0, 0, 1, 0]
        one.PixelSpacing, one.SliceThickness = [SPACING, SPACING], SPACING
        one.Rows = one.Columns = N
        one.SamplesPerPixel, one.PhotometricInterpretation, one.PixelRepresentation = 1, "MONOCHROME2", 0
        one.BitsAllocated, one.BitsStored, one.HighBit = 16, 16, 15
        one.RescaleSlope, one.RescaleIntercept = f"{slope:.10g}", intercept
        for name, value in more.items():
            setattr(one, name, value)
        one.PixelData = words.astype("<u2").tobytes()
        one.save_as(folder / f"{z:03}.dcm", enforce_file_format=True)
    return folder


def write_ct() -> Path:
    """A body of water with a spine, in HU."""
    values = np.full((N, N, N), -1000.0)
    values[distances((23.5, 23.5, 23.5)) < 21.0] = 40.0
    values[np.broadcast_to(distances((23.5, 40.0, 23.5))[N // 2] < 3.0, values.shape)] = 700.0
    return write_series(FOLDER / "ct", values + 1024.0, CT, 1.0, -1024.0)


def write_structures(path: Path) -> Path:
    """The organs as spheres of circles, an RTSTRUCT of the CT's frame of reference."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, generate_uid

    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    described, drawn = [], []
    for number, (name, (x, y, z)) in enumerate(ORGANS.items(), 1):
        roi, lines = Dataset(), Dataset()
        roi.ROINumber, roi.ROIName, roi.ReferencedFrameOfReferenceUID = number, name, PLACE
        lines.ReferencedROINumber, lines.ROIDisplayColor, lines.ContourSequence = number, [255, 255, 0], []
        for plane in range(int(z - RADIUS) + 1, int(z + RADIUS)):
            radius = np.sqrt(RADIUS**2 - (plane - z) ** 2)
            plane_of = np.full_like(angles, plane)
            points = np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles), plane_of], axis=1)
            contour = Dataset()
            contour.ContourGeometricType, contour.NumberOfContourPoints = "CLOSED_PLANAR", len(points)
            contour.ContourData = [f"{value:.5f}" for value in (SPACING * points).ravel()]
            lines.ContourSequence.append(contour)
        described.append(roi)
        drawn.append(lines)
    one = Dataset()
    one.file_meta = FileMetaDataset()
    one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    one.SOPClassUID, one.SOPInstanceUID, one.Modality = STRUCTURES, generate_uid(), "RTSTRUCT"
    one.file_meta.MediaStorageSOPClassUID, one.file_meta.MediaStorageSOPInstanceUID = STRUCTURES, one.SOPInstanceUID
    one.SeriesInstanceUID, one.FrameOfReferenceUID = generate_uid(), PLACE
    one.StructureSetROISequence, one.ROIContourSequence = described, drawn
    one.save_as(path, enforce_file_format=True)
    return path


def write_pet() -> Path:
    """Uptake of SUV 1 in the body and of HOT in the liver, in Bq/ml an hour after the injection."""
    from pydicom.dataset import Dataset

    values = np.where(distances((23.5, 23.5, 23.5)) < 21.0, 1.0, 0.0)
    values[distances(ORGANS["liver"]) < RADIUS] = HOT
    factor = 1000.0 * WEIGHT / (DOSE * 2.0 ** (-3600.0 / HALF_LIFE))  # SUV per Bq/ml
    drug = Dataset()
    drug.RadionuclideTotalDose, drug.RadionuclideHalfLife, drug.RadiopharmaceuticalStartTime = DOSE, HALF_LIFE, "100000"
    return write_series(
        FOLDER / "pet", values * 1000.0, PET, 1e-3 / factor, 0.0, Units="BQML", DecayCorrection="START",
        PatientWeight=WEIGHT, RadiopharmaceuticalInformationSequence=[drug])  # fmt: skip


def volumes() -> list:
    return [one for one in bpy.data.objects if one.rle_splat.is_volume]


def is_idle() -> bool:
    return not import_module(f"{MODULE}.bridge.loop.jobs").StepwiseOperator.is_running()


def imported(folder: Path):
    """Import a DICOM folder by File > Import and its file browser; returns the new volume object."""
    before = set(volumes())
    yield from choose_import(1)
    yield from confirm_browser(folder)
    yield from until(lambda: set(volumes()) - before and is_idle())
    return (set(volumes()) - before).pop()


def from_the_front() -> None:
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_rotation, view.view_perspective = Euler((np.pi / 2.0, 0.0, 0.0)).to_quaternion(), "ORTHO"
    view.update()


def color_at(name: str, owner, index) -> np.ndarray:
    """What the photograph of this name shows at a voxel, RGB in [0, 1]."""
    return around(name, owner, index, 0.0)[0, 0]


def around(name: str, owner, index, voxels: float = 1.5 * RADIUS) -> np.ndarray:
    """(2 n + 1, 2 n + 1, 3) what the photograph of this name shows around a voxel, by so many voxels to each side."""
    pixels = scenes.load_pixels(Path(os.environ[SHOTS]) / f"{name}.png")[..., :3]
    region, view = region_of(area_of("VIEW_3D"), "WINDOW"), area_of("VIEW_3D").spaces.active.region_3d
    corners = import_module(f"{MODULE}.bridge.volumes.box").world_corners(owner)
    axes = corners[[1, 2, 4]] - corners[0]
    places = (Vector(corners[0] + np.array(at) / (N - 1.0) @ axes) for at in (index, index + np.array((voxels, 0, 0))))
    place, beside = (location_3d_to_region_2d(region, view, at) for at in places)
    row, column, n = len(pixels) - 1 - int(region.y + place.y), int(region.x + place.x), int((beside - place).length)
    return pixels[row - n : row + n + 1, column - n : column + n + 1]


def check_structures(ct):
    """The contours become segments with names; Anatomy gives them the colors of an atlas."""
    with in_the_view():
        ct.rle_splat.label_file = str(write_structures(FOLDER / "organs.dcm"))
        bpy.ops.rle_splat.read_labels("INVOKE_DEFAULT")
    yield from until(lambda: len(ct.rle_splat.labels) == 1 + len(ORGANS) and is_idle())
    rows = ct.rle_splat.labels
    assert [row.label_name for row in rows[1:]] == list(ORGANS), [row.label_name for row in rows]
    with in_the_view():
        assert bpy.ops.rle_splat.color_anatomy("INVOKE_DEFAULT") == {"FINISHED"}
    yield from until(lambda: not rows[0].show)
    yield from settled()
    yield from photograph("anatomy")
    liver, spleen = (np.array(rows[number].color) for number in (1, 2))
    assert all(row.show and row.look == "SOLID" and row.use_color for row in rows[1:])
    assert np.abs(liver - spleen).max() > 0.05
    seen = [color_at("anatomy", ct, middle) for middle in ORGANS.values()]
    print("anatomy", liver, spleen, seen, flush=True)
    for color, shown in zip((liver, spleen), seen):  # with a highlight, which is white
        assert np.array_equal(np.argsort(color), np.argsort(shown)), (color, shown)


def check_pet(ct):
    """A PET is in SUV with inverted grays from 0 to 10, and lies over its CT after Add Selected Volumes."""
    pet = yield from imported(write_pet())
    own = pet.rle_splat
    assert own.transfer_unit == "SUVbw" and own.transfer_name == "PET", (own.transfer_unit, own.transfer_name)
    assert (own.window_center, own.window_width) == (5.0, 10.0), (own.window_center, own.window_width)
    assert abs(own.value_high - HOT) < 0.02 * HOT, own.value_high
    ct.hide_set(True)
    ct.hide_render = True
    yield from settled()
    yield from photograph("pet")
    yield from show_on_white(pet)
    ct.hide_set(False)
    ct.hide_render = False
    scenes.activate(ct)
    pet.select_set(True)
    with in_the_view():
        bpy.ops.rle_splat.add_channels("INVOKE_DEFAULT")
    yield from until(lambda: len(ct.rle_splat.channels) == 1 and is_idle())
    yield from settled()
    yield from photograph("pet_over_ct")
    ct.rle_splat.labels[1].opacity = 0.05  # the liver, which would hide what is in it
    yield from settled()
    yield from photograph("pet_in_ct")
    (channel,) = ct.rle_splat.channels
    assert channel.source == pet
    channel.show = False
    pet.hide_set(True)  # which would be seen beside the CT
    yield from settled()
    yield from photograph("without_pet")
    both = "pet_in_ct", "without_pet"
    liver, spleen = ([around(name, ct, middle) for name in both] for middle in ORGANS.values())
    hot, cold = (np.abs(one - other).max(axis=-1) for one, other in (liver, spleen))
    print("pet over ct", np.quantile(hot, 0.8), np.quantile(cold, (0.5, 0.99)), flush=True)
    assert np.quantile(hot, 0.8) > 0.15, "uptake shows within its segment"
    assert np.quantile(cold, 0.99) < 0.1, "segments have the boundaries that they have without a channel"


def show_on_white(pet):
    """MIP of a PET begins with inverted grays; one click makes the viewport white, and a turntable is on white."""
    pet.rle_splat.display = "mip"
    pet.rle_splat.window_center, pet.rle_splat.window_width = 5.0, 10.0
    with in_the_view():
        bpy.ops.rle_splat.plain_background("INVOKE_DEFAULT")
    yield from settled()
    yield from photograph("pet_mip")
    liver, beside = color_at("pet_mip", pet, ORGANS["liver"]), color_at("pet_mip", pet, (1, 24, 1))
    print("pet_mip", liver, beside, flush=True)
    assert beside.min() > 0.97 and liver.max() < 0.6, (liver, beside)
    path = FOLDER / "pet_turn"
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    with in_the_view():
        bpy.ops.rle_splat.turntable("EXEC_DEFAULT", filepath=str(path), frames=2, output="PNG", background="WHITE")
    yield from until(lambda: (FOLDER / "pet_turn_0002.png").exists() and not bpy.app.is_job_running("RENDER"))
    shown = scenes.load_pixels(FOLDER / "pet_turn_0002.png")[..., :3]
    assert shown[[0, -1], [0, -1]].min() > 0.97 and shown.min() < 0.6
    shutil.copy(FOLDER / "pet_turn_0002.png", Path(os.environ[SHOTS]) / "pet_turn.png")
    pet.rle_splat.display = "composite"
    with in_the_view():
        bpy.ops.rle_splat.plain_background("INVOKE_DEFAULT")


def scenario():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_labels", "RLE_SPLAT_PT_channels")
    yield from new_file()
    ct = yield from imported(write_ct())
    from_the_front()
    yield from settled()
    yield from photograph("imported")
    assert ct.rle_splat.transfer_name == "CT bone" and ct.rle_splat.space == "patient"
    passed("import")
    for check in (check_structures, check_pet):
        yield from check(ct)
        passed(check.__name__)


drive(scenario)
