"""Every voxel of a DICOM phantom lies where its value says, to 0.1 mm."""

from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

pytest.importorskip("pydicom")

from pydicom.pixels import get_decoder
from pydicom.uid import AllTransferSyntaxes, JPEG2000Lossless, JPEGLSNearLossless, RLELossless, generate_uid

from rle_splat.read.dicom import pictures
from rle_splat.read.formats import read_volume
from rle_splat.volume.volume import PATIENT

from . import dicom_phantoms as phantoms

BOUND = 0.1 + 1e-6  # mm
GEOMETRIES = phantoms.geometries()
OF_OTHER_ENCODERS = (
    *phantoms.BY_PILLOW, *(pytest.param(syntax, marks=pytest.mark.extras) for syntax in phantoms.BY_IMAGECODECS),
)  # fmt: skip


def error_of(path, axis: int) -> float:
    volume = read_volume(path)
    assert volume.space == PATIENT and volume.unit == "mm"
    return phantoms.worst_error(volume.physical(volume.voxels), volume.affine, axis)


def write(kind: str, folder: Path, where, axis: int, encoding=phantoms.PLAIN) -> None:
    """One phantom in a folder, as one file a slice or as one multi-frame file."""
    if kind == "classic":
        phantoms.write_classic(folder, where, axis, encoding)
    else:
        phantoms.write_enhanced(folder / "all.dcm", where, axis, encoding)


@pytest.mark.parametrize("name", GEOMETRIES)
@pytest.mark.parametrize("kind", ["classic", "enhanced"])
def test_geometry(tmp_path: Path, name: str, kind: str):
    for axis in range(3):
        path = tmp_path / str(axis)
        write(kind, path, GEOMETRIES[name], axis)
        assert error_of(path, axis) <= BOUND


@pytest.mark.parametrize("name", phantoms.ENCODINGS)
@pytest.mark.parametrize("kind", ["classic", "enhanced"])
def test_encoding(tmp_path: Path, name: str, kind: str):
    write(kind, tmp_path, GEOMETRIES["axial"], 1, phantoms.ENCODINGS[name])
    assert error_of(tmp_path, 1) <= BOUND


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "syntax"),
    [
        *(("axial", syntax) for syntax in phantoms.WRITABLE),
        *product(("two slices missing", "irregular and tilt"), (*phantoms.NATIVE[:1], RLELossless, JPEG2000Lossless)),
    ],
    ids=lambda word: getattr(word, "keyword", word),
)
@pytest.mark.parametrize("kind", ["classic", "enhanced"])
def test_transfer_syntax(tmp_path: Path, syntax: str, kind: str, name: str):
    encodings = {"plain": phantoms.Encoding()}
    if name == "axial":
        encodings = {**encodings, **{key: phantoms.ENCODINGS[key] for key in ("8 bit", "signed 12 in 16 with junk")}}
    for key, encoding in encodings.items():
        encoding = replace(phantoms.with_syntax(encoding, syntax), junk=encoding.junk and syntax in phantoms.NATIVE)
        write(kind, tmp_path / key, GEOMETRIES[name], 1, encoding)
        assert error_of(tmp_path / key, 1) <= BOUND, key


def test_every_transfer_syntax_that_pydicom_decodes_has_a_phantom():
    def is_decoded(syntax) -> bool:
        try:
            return get_decoder(syntax).is_available
        except NotImplementedError:
            return False

    read = {*pictures.NATIVE, pictures.RLE, *pictures.JPEG, *pictures.JPEG_2000} - {""}
    assert {*phantoms.WRITABLE, *phantoms.BY_IMAGECODECS, *phantoms.BY_PILLOW} == read
    assert read == {str(syntax) for syntax in AllTransferSyntaxes if is_decoded(syntax)}


@pytest.mark.parametrize("syntax", OF_OTHER_ENCODERS, ids=lambda uid: uid.keyword)
@pytest.mark.parametrize("kind", ["classic", "enhanced"])
def test_transfer_syntax_of_other_encoders(tmp_path: Path, syntax: str, kind: str):
    pytest.importorskip("PIL" if syntax in phantoms.BY_PILLOW else "imagecodecs")
    twelve = phantoms.Encoding(stored=12, intercepts=(200.0,))
    signed = phantoms.Encoding(stored=12, signed=True, intercepts=(2000.0,))
    encodings = (
        [phantoms.LOSSY[syntax]]
        if syntax in phantoms.LOSSY
        else [twelve, signed, phantoms.PLAIN, phantoms.ENCODINGS["8 bit"]]
    )
    for i, encoding in enumerate(encodings[: None if kind == "classic" else 1]):
        folder = tmp_path / str(i)
        write(kind, folder, GEOMETRIES["non-square"], 1, phantoms.with_syntax(encoding, syntax))
        assert error_of(folder, 1) <= BOUND + (0.1 if syntax == JPEGLSNearLossless else 0.0), encoding


@pytest.mark.extras
@pytest.mark.filterwarnings("ignore")  # of the writer
@pytest.mark.parametrize("name", GEOMETRIES)
def test_an_enhanced_object_of_another_writer(tmp_path: Path, name: str):
    highdicom = pytest.importorskip("highdicom")
    slices = [phantoms.read(path) for path in phantoms.write_classic(tmp_path / "classic", GEOMETRIES[name], 1)]
    for dataset in slices:
        dataset.AcquisitionTime = dataset.ContentTime = "101010"
        dataset.ContentDate, dataset.AcquisitionNumber, dataset.PatientPosition = "20210304", 1, "HFS"
        dataset.Manufacturer, dataset.Laterality, dataset.PositionReferenceIndicator = "maker", "", ""
    numbers = (generate_uid(), 9, generate_uid(), 1)
    highdicom.legacy.LegacyConvertedEnhancedCTImage(slices, *numbers).save_as(tmp_path / "enhanced.dcm")
    assert error_of(tmp_path / "enhanced.dcm", 1) <= BOUND
