"""DICOM series in Blender: imported, decoded by Blender's own Python, read again, and without the patient's name."""

import re
import shutil
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import bpy
import pytest

READERS = ModuleType("tests_of_readers")  # stands for the folder, which is no package
READERS.__path__ = [str(Path(__file__).resolve().parents[1] / "read")]


@pytest.fixture
def phantoms(addon):
    """The writer of phantoms, which needs the libraries of the installed zip."""
    pytest.importorskip("pydicom", reason="the zip has no wheels")
    sys.modules[READERS.__name__] = READERS
    return import_module(f"{READERS.__name__}.dicom_phantoms")


@pytest.fixture
def oblique(phantoms):
    return phantoms.geometries()["oblique"]


def active():
    return bpy.context.view_layer.objects.active


def loaded(bridge):
    bridge("volumes.volumes").forget_all()
    return bridge("volumes.volumes").load_volume(active(), warn=pytest.fail)


@pytest.mark.parametrize("name", ["ExplicitVRLittleEndian", "RLELossless", "JPEG2000Lossless", "JPEGLosslessSV1"])
def test_a_series_is_imported_and_read_again(tmp_path, bridge, phantoms, oblique, name):
    """JPEG and JPEG 2000 are decoded in child processes of Blender's Python."""
    encoding = phantoms.with_syntax(phantoms.PLAIN, getattr(phantoms, name))
    paths = phantoms.write_classic(tmp_path / "scan", oblique, 1, encoding)
    for path in (paths[3], tmp_path / "scan"):
        assert bpy.ops.rle_splat.import_volume(filepath=str(path)) == {"FINISHED"}
        volume = loaded(bridge)
        assert phantoms.worst_error(volume.physical(volume.voxels), volume.affine, 1) <= 0.1 + 1e-6
        assert active().name.startswith("CT HEAD") and active().rle_splat.space == "patient"


def test_of_several_series_one_is_chosen_and_kept(tmp_path, bridge, refused, phantoms, oblique):
    phantoms.write_classic(tmp_path / "scan" / "a", phantoms.geometries()["axial"])
    phantoms.write_classic(tmp_path / "scan" / "b", oblique)
    refused(bpy.ops.rle_splat.import_volume, "There are 2 series", filepath=str(tmp_path / "scan"))
    bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "scan"), series=2)
    assert phantoms.worst_error(loaded(bridge).voxels, loaded(bridge).affine, 2) <= 0.1 + 1e-6


def test_damaged_frames_are_refused_and_change_nothing(tmp_path, refused, phantoms, oblique):
    encoding = phantoms.with_syntax(phantoms.PLAIN, phantoms.JPEG2000Lossless)
    path = phantoms.write_classic(tmp_path / "scan", oblique, 1, encoding)[2]
    data = bytearray(path.read_bytes())
    data[-400:-200] = bytes(200)
    path.write_bytes(data)
    before = len(bpy.data.objects)
    refused(bpy.ops.rle_splat.import_volume, path.name, filepath=str(path))
    assert len(bpy.data.objects) == before


def test_a_saved_scene_does_not_name_the_patient(tmp_path, capfd, phantoms, oblique):
    """The .blend is saved unpacked and searched, and so is everything that was printed."""
    folder = tmp_path / "scan"
    phantoms.write_classic(folder, oblique)
    uids = {str(phantoms.read(path)[name].value) for path in folder.iterdir() for name in
            ("SOPInstanceUID", "SeriesInstanceUID", "StudyInstanceUID", "FrameOfReferenceUID")}  # fmt: skip
    bpy.ops.rle_splat.import_volume(filepath=str(folder))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"), compress=False)
    captured = capfd.readouterr()
    shutil.rmtree(folder)
    saved = (tmp_path / "a.blend").read_bytes()
    assert b"CT HEAD" in saved
    words = (phantoms.PERSON, "JANE", "ROE^RICHARD", phantoms.NUMBER, phantoms.BIRTH, "20210304", "General Hospital")
    for word in (*words, *uids):
        assert not re.search(re.escape(word.encode()), saved), word
        assert word not in captured.out + captured.err


def test_an_rtstruct_fills_the_rows_of_segments(tmp_path, bridge, phantoms, refused):
    from pydicom.dataset import Dataset

    phantoms.write_classic(tmp_path / "scan", phantoms.geometries()["axial"], change=with_place)
    bpy.ops.rle_splat.import_dicom_series(directory=str(tmp_path / "scan"))
    owner, volume = active(), loaded(bridge)
    dataset, drawn = Dataset(), Dataset()
    dataset.SOPClassUID = "1.2.840.10008.5.1.4.1.1.481.3"
    dataset.SOPInstanceUID, dataset.Modality = "1.2.3.5", "RTSTRUCT"
    dataset.StructureSetROISequence = phantoms.one(
        ROINumber=3, ROIName="heart", ReferencedFrameOfReferenceUID="1.2.3.4"
    )
    drawn.ContourGeometricType, drawn.NumberOfContourPoints = "CLOSED_PLANAR", 4
    corners = [(4.5, 6.5, 2, 1), (9.5, 6.5, 2, 1), (9.5, 12.5, 2, 1), (4.5, 12.5, 2, 1)]
    drawn.ContourData = [f"{value:.5f}" for corner in corners for value in (volume.affine @ corner)[:3]]
    dataset.ROIContourSequence = phantoms.one(
        ReferencedROINumber=3, ROIDisplayColor=[255, 0, 0], ContourSequence=[drawn]
    )
    scan = phantoms.read(next((tmp_path / "scan").iterdir()))
    dataset.ReferencedFrameOfReferenceSequence = phantoms.one(SeriesInstanceUID=scan.SeriesInstanceUID)
    path = phantoms.save(dataset, tmp_path / "structures.dcm")
    owner.rle_splat.label_file = str(path)
    assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
    assert [(row.label, row.label_name) for row in owner.rle_splat.labels] == [(0, "Background"), (3, "heart")]
    assert tuple(owner.rle_splat.labels[1].color) == (1.0, 0.0, 0.0)
    found = bridge("volumes.labels").file_of(owner).key(volume)
    assert (bridge("loop.store").find(found).volume.voxels == 3).sum() == 5 * 6
    refused(bpy.ops.rle_splat.import_volume, "read the file as labels", filepath=str(path))
    bpy.ops.rle_splat.import_dicom_series(directory=str(tmp_path / "scan"), use_segments=True)
    heart = active().rle_splat.labels[1]
    assert (heart.label_name, heart.look, heart.use_color) == ("heart", "SOLID", True)
    assert tuple(heart.color) != (1.0, 0.0, 0.0), "the color of atlases"


def with_place(dataset, _number):
    dataset.FrameOfReferenceUID = "1.2.3.4"
