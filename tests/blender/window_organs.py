"""Organs in a real window, from File > Import by mouse and keys: a CT with the contours of an RTSTRUCT, Anatomy, a PET
in SUV over its CT, the channels of a fluorescence file, and nuclei with numbers.

dev.py test runs it.  The files are written with pydicom and tifffile, which the extension brings.
"""

import os
import shutil
import tempfile
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from tests.blender import scenes
from tests.blender.scenes import module
from tests.blender.user_steps import choose_import, confirm_browser, press_button, settled
from tests.blender.window_driver import (
    SHOTS,
    TAB,
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

# Channels of a fluorescence file: the color that it states (sRGB), the largest value, and where its spheres are.
CELLS = (
    ((0, 128, 255), 900.0, ((12.0, 24.0, 14.0), (24.0, 24.0, 34.0))),
    ((255, 128, 0), 20_000.0, ((36.0, 24.0, 14.0), (24.0, 24.0, 34.0))),
    ((0, 255, 0), 60_000.0, ((8.0, 24.0, 36.0),)),
)
NUCLEI = [(x, 23.8, z) for x in (9.6, 23.4, 37.7) for z in (13.7, 34.4)]
NUCLEUS = 6.5  # radius in voxels


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
    return not module("bridge.loop.jobs").StepwiseOperator.is_running()


def imported(path: Path):
    """Import a file or a DICOM folder by File > Import and its file browser; returns the new volume object."""
    before = set(volumes())
    yield from choose_import(int(path.is_dir()))
    yield from confirm_browser(*((path,) if path.is_dir() else (path.parent, path.name)))
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
    corners = module("bridge.volumes.box").world_corners(owner)
    axes = corners[[1, 2, 4]] - corners[0]
    places = (Vector(corners[0] + np.array(at) / (N - 1.0) @ axes) for at in (index, index + np.array((voxels, 0, 0))))
    place, beside = (location_3d_to_region_2d(region, view, at) for at in places)
    row, column, n = len(pixels) - 1 - int(region.y + place.y), int(region.x + place.x), int((beside - place).length)
    return pixels[row - n : row + n + 1, column - n : column + n + 1]


def check_structures(ct):
    """The contours become segments with names; Anatomy gives them the colors of an atlas."""
    with in_the_view():
        ct.rle_splat.label_file = str(write_structures(FOLDER / "organs.dcm"))
        bpy.ops.rle_splat.load_segments("INVOKE_DEFAULT")
    yield from until(lambda: len(ct.rle_splat.labels) == 1 + len(ORGANS) and is_idle())
    rows = ct.rle_splat.labels
    assert [row.label_name for row in rows[1:]] == list(ORGANS), [row.label_name for row in rows]
    with in_the_view():
        assert bpy.ops.rle_splat.color_by_anatomy("INVOKE_DEFAULT") == {"FINISHED"}
    yield from until(lambda: not rows[0].show)
    yield from settled()
    yield from photograph("anatomy", looked_at=True)
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
    yield from photograph("pet_in_ct", looked_at=True)
    (channel,) = ct.rle_splat.channels
    assert channel.source == pet
    channel.show = False
    pet.hide_set(True)  # which would be seen beside the CT
    yield from settled()
    yield from photograph("without_pet", looked_at=True)
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
    yield from photograph("pet_mip", looked_at=True)
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


def spheres(middles, radius: float = RADIUS) -> np.ndarray:
    """(z, y, x) from 1 in the middle of each sphere to 0 at its boundary."""
    return np.clip(1.0 - np.min([distances(middle) for middle in middles], axis=0) / radius, 0.0, 1.0)


def write_cells() -> Path:
    """An OME-TIFF of three channels, each with the color that the file states and with values of its own range."""
    import tifffile

    packed = [(red << 24 | green << 16 | blue << 8 | 255) for (red, green, blue), _, _ in CELLS]
    signed = [one - (1 << 32) if one >= 1 << 31 else one for one in packed]
    values = np.stack([np.minimum(2.0 * spheres(middles), 1.0) * most for _, most, middles in CELLS], axis=1)
    path = FOLDER / "cells.ome.tif"
    tifffile.imwrite(
        path, values.astype(np.uint16), ome=True, photometric="minisblack",
        metadata={"axes": "ZCYX", "Channel": {"Color": signed}})  # fmt: skip
    return path


def check_fluorescence():
    """The channels of a file are added in the colors that it states, each in the window of its own values."""
    yield from new_file()
    owner = yield from imported(write_cells())
    region_of(area_of("VIEW_3D"), "UI").active_panel_category = TAB
    yield from press_button("bpy.ops.rle_splat.import_channel(", "of_file=True")
    yield from until(lambda: len(owner.rle_splat.channels) == len(CELLS) - 1 and is_idle())
    from_the_front()
    yield from settled()
    yield from photograph("channels", looked_at=True)
    sources = [owner, *(row.source for row in owner.rle_splat.channels)]
    highest = [one.rle_splat.window_center + one.rle_splat.window_width / 2.0 for one in sources]
    seen = [color_at("channels", owner, middles[0]) for _, _, middles in CELLS]
    both = color_at("channels", owner, CELLS[0][2][1])
    print("channels", highest, seen, both, flush=True)
    for (color, most, _), high, shown in zip(CELLS, highest, seen):
        assert 0.5 * most < high < 1.1 * most, (most, high)
        assert np.corrcoef(color, shown)[0, 1] > 0.95 and np.ptp(shown) > 0.4, (color, shown)
    assert np.all(both[[0, 2]] > 0.9 * np.array((seen[1][0], seen[0][2]))), "light of channels adds up"
    sources[1].rle_splat.window_center *= 3.0  # beyond its values
    yield from settled()
    yield from photograph("channel_window", looked_at=True)
    change = [
        np.abs(color_at("channel_window", owner, middles[0]) - one).max() for (*_, middles), one in zip(CELLS, seen)
    ]
    print("channel_window", change, flush=True)
    assert change[1] > 0.1 and max(change[0], change[2]) < 0.02, "a window changes its own channel alone"


def check_nuclei():
    """Nuclei with numbers, in a file beside the scan, are shown in distinct colors by the import."""
    import tifffile

    folder = FOLDER / "nuclei"
    folder.mkdir()
    numbers = np.zeros((N, N, N), np.uint32)
    for number, middle in enumerate(NUCLEI, 1):
        numbers[distances(middle) < NUCLEUS] = number
    values = 200.0 + 20_000.0 * np.minimum(2.0 * spheres(NUCLEI, NUCLEUS), 1.0)
    tifffile.imwrite(folder / "nuclei.tif", values.astype(np.uint16), photometric="minisblack")
    tifffile.imwrite(folder / "nuclei_labels.tif", numbers, photometric="minisblack")
    yield from new_file()
    owner = yield from imported(folder / "nuclei.tif")
    from_the_front()
    yield from settled()
    yield from photograph("nuclei", looked_at=True)
    rows = owner.rle_splat.labels
    assert len(rows) == 1 + len(NUCLEI) and not rows[0].show
    seen = np.array([color_at("nuclei", owner, (x, y, z - 4.0)) for x, y, z in NUCLEI])  # beside highlights
    apart = np.abs(seen[:, None] - seen).max(axis=-1)[~np.eye(len(seen), dtype=bool)]
    print("nuclei", apart.min(), flush=True)
    assert apart.min() > 0.12, "each nucleus has a color of its own"


def scenario():
    open_panels("RLE_SPLAT_PT_labels", "RLE_SPLAT_PT_channels")  # all of them fit
    yield from new_file()
    ct = yield from imported(write_ct())
    from_the_front()
    yield from settled()
    yield from photograph("imported")
    assert ct.rle_splat.transfer_name == "CT Bone" and ct.rle_splat.space == "patient"
    passed("import")
    for check in (check_structures, check_pet):
        yield from check(ct)
        passed(check.__name__)
    for check in (check_fluorescence, check_nuclei):
        yield from check()
        passed(check.__name__)


drive(scenario)
