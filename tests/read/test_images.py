"""Images of SimpleITK and nibabel in memory give the volumes of the files that they are written to."""

from dataclasses import dataclass

import numpy as np
import pytest

from rle_splat import Volume, read_nibabel, read_sitk, read_volume
from rle_splat.scene import RleSplatError
from rle_splat.volume.mapped_files import is_mapped

from .phantoms import AFFINES, LEAST_ERROR, coordinates, ras, worst_error

CONVERTED = [
    (np.array((False, True)), "uint8"),
    (np.array((0, 255), np.int64), "uint8"),
    (np.array((-1024, 3071), np.int64), "int16"),
    (np.array((0, 2**40), np.uint64), "float32"),
    (np.array((0, 2**40 + 1), np.int64), "float64"),
    (np.array((0.5, -3.0), np.float16), "float32"),
    (np.array((0.5, -3.0), np.float64), "float32"),
    (np.array((0.1, -3.0), np.float64), "float64"),
    (np.array((-2, 700), ">i2"), "int16"),
    (np.array((0.25, 7.0), ">f4"), "float32"),
]


class _FakeSitk:
    """An image as SimpleITK's, by what ``read_sitk`` uses of it; values (z, y, x), components last."""

    def __init__(self, values, affine=None, kind="16-bit signed integer", components=1):
        self.values, self.kind, self.components = values, kind, components
        self.affine = np.eye(4) if affine is None else affine

    def GetSize(self):
        return self.values.shape[::-1]

    def GetNumberOfComponentsPerPixel(self):
        return self.components

    def GetPixelIDTypeAsString(self):
        return self.kind

    def GetSpacing(self):
        return tuple(np.linalg.norm(self.affine[:3, :3], axis=0))

    def GetDirection(self):
        return tuple((self.affine[:3, :3] / self.GetSpacing()).ravel())

    def GetOrigin(self):
        return tuple(self.affine[:3, 3])


def GetArrayFromImage(image):
    """As SimpleITK's module has it beside the class of an image."""
    return image.values


@dataclass
class _FakeNibabel:
    """A nibabel image of a format without codes of a place, such as MGH; values (x, y, z)."""

    dataobj: np.ndarray
    affine: np.ndarray
    header: object = None

    @property
    def shape(self):
        return self.dataobj.shape

    def get_filename(self):
        return None


def _cycle(values) -> np.ndarray:
    """(2, 3, 4): the values over and over, in their own type and byte order."""
    return np.tile(values, 24 // len(values)).reshape(2, 3, 4)


@pytest.mark.parametrize("name", AFFINES)
def test_every_voxel_of_an_image_lies_where_its_value_says(name):
    values = coordinates(AFFINES[name])
    if name != "sheared":  # which ITK has not
        assert worst_error([read_sitk(_FakeSitk(one.T, AFFINES[name])) for one in values]) <= LEAST_ERROR
    found = [read_nibabel(_FakeNibabel(one, ras(AFFINES[name]))) for one in values]
    assert worst_error(found) <= LEAST_ERROR
    assert all((one.space, one.unit) == ("patient", "mm") for one in found)


@pytest.mark.parametrize(("values", "kind"), CONVERTED, ids=lambda one: str(getattr(one, "dtype", one)))
def test_types_that_volumes_lack_are_converted_without_loss(values, kind):
    stored = _cycle(values)
    before = stored.copy()
    for found in (read_sitk(_FakeSitk(stored)), read_nibabel(_FakeNibabel(stored.T, np.eye(4)))):
        assert found.voxels.dtype == kind and found.voxels.dtype.isnative
        np.testing.assert_array_equal(found.voxels, before)
    assert stored.dtype == before.dtype
    np.testing.assert_array_equal(stored, before)  # the image's own values are as they were


def test_further_fields_are_those_given():
    image = _FakeSitk(_cycle(np.array((0, 9), np.int16)))
    found = read_sitk(image, value_unit="HU", modality="CT", name="head")
    assert (found.value_unit, found.modality, found.name, found.space) == ("HU", "CT", "head", "patient")
    assert read_sitk(image, space=None, unit="um").space is None


def test_an_image_that_looks_like_hounsfield_units_is_a_ct_as_a_file_would_be():
    values = np.resize(np.array((-1000, -990, 0, 40, 300), np.int16), (8, 8, 8))
    assert read_sitk(_FakeSitk(values)).value_unit == "HU"
    assert read_sitk(_FakeSitk(values), value_unit="Gy").value_unit == "Gy"


@pytest.mark.parametrize(("make", "words"), (
    (lambda: read_sitk(_FakeSitk(np.zeros((3, 4), np.int16))), "2 dimensions; a volume needs three"),
    (lambda: read_sitk(_FakeSitk(np.zeros((2, 2, 3, 4), np.int16))), r"4 dimensions; .* image\[:, :, :, 0\]"),
    (lambda: read_sitk(_FakeSitk(np.zeros((2, 3, 4)), components=3)), "3 numbers per voxel; .*SelectionCast"),
    (lambda: read_sitk(_FakeSitk(np.zeros((2, 3, 4)), kind="label of 8-bit unsigned integer")), "LabelMapToLabel"),
    (lambda: read_sitk(_FakeSitk(np.zeros((2, 3, 4), np.complex64))), "complex64 are not supported"),
    (lambda: read_sitk("ct.nrrd"), "SimpleITK, not a str; read_volume reads files"),
    (lambda: read_nibabel(_FakeNibabel(np.zeros((4, 3), np.int16), np.eye(4))), "2 dimensions"),
    (lambda: read_nibabel(_FakeNibabel(np.zeros((4, 3, 2, 5)), np.eye(4))), r"4 dimensions; .*slicer\[\.\.\., 0\]"),
    (lambda: read_nibabel(_FakeNibabel(np.zeros((4, 3, 2), "u1,u1,u1"), np.eye(4))), "colors"),
    (lambda: read_nibabel(_FakeNibabel(np.zeros((4, 3, 2), np.complex64), np.eye(4))), "complex64"),
    (lambda: read_nibabel(np.zeros((2, 3, 4))), "nibabel, not a ndarray; .*Volume takes arrays"),
))  # fmt: skip
def test_what_is_no_volume_is_refused_in_one_sentence(make, words):
    with pytest.raises(RleSplatError, match=words) as found:
        make()
    assert str(found.value).count(". ") == 0 and str(found.value).endswith(".")


class _SeveralSlopes:
    """The data of an AFNI file: ``scaling`` counts in place of ``slope``."""

    slope, inter, scaling = 1.0, 0.0, np.array((0.5, 2.0))

    def __init__(self, physical):
        self.physical, self.shape = physical, physical.shape

    def get_unscaled(self):
        return np.zeros(self.shape, np.int16)

    def __array__(self, dtype=None, copy=None):
        return self.physical


def test_data_with_several_slopes_have_physical_values():
    values = _cycle(np.array((3.0, 8.5), np.float32)).T
    np.testing.assert_array_equal(read_nibabel(_FakeNibabel(_SeveralSlopes(values), np.eye(4))).voxels, values.T)


def _same(found: Volume, expected: Volume) -> None:
    np.testing.assert_allclose(found.affine, expected.affine, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(found.physical(found.voxels), expected.physical(expected.voxels), rtol=1e-6)
    assert found.voxels.dtype == expected.voxels.dtype
    for name in ("unit", "space", "value_unit", "modality"):
        assert getattr(found, name) == getattr(expected, name), name


def test_an_image_of_simpleitk_is_the_volume_of_its_file(tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    values, affine = coordinates(AFFINES["oblique"])[1].T, AFFINES["oblique"]
    image = sitk.GetImageFromArray(values)
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    image.SetSpacing(spacing.tolist())
    image.SetDirection((affine[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(affine[:3, 3].tolist())
    sitk.WriteImage(image, str(tmp_path / "a.nii.gz"))
    _same(read_sitk(image), read_volume(tmp_path / "a.nii.gz"))
    colors = sitk.GetImageFromArray(np.zeros((2, 3, 4, 3), np.uint8), isVector=True)
    objects = sitk.Image([4, 3, 2], sitk.sitkLabelUInt8)
    for other in (colors, objects, image[:, :, 0], sitk.JoinSeries([image, image])):
        with pytest.raises(RleSplatError, match=r"^The image (has|is) "):
            read_sitk(other)


@pytest.mark.parametrize("unit", ["mm", "meter", "micron", "unknown"])
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_an_image_of_nibabel_is_the_volume_of_its_file(tmp_path, unit, suffix):
    nibabel = pytest.importorskip("nibabel")
    values, path = coordinates(AFFINES["oblique"])[0], tmp_path / f"brain{suffix}"
    image = nibabel.Nifti1Image(values, ras(AFFINES["oblique"]))
    image.header.set_xyzt_units(unit)
    image.header.set_slope_inter(0.5, -1000.0)
    nibabel.save(image, path)
    loaded, expected = nibabel.load(path), read_volume(path)
    found = read_nibabel(loaded)
    _same(found, expected)
    assert (found.slope, found.intercept, found.name) == (0.5, -1000.0, "brain")
    assert is_mapped(found.voxels) == (suffix == ".nii")  # not read into memory
    found = read_nibabel(image)  # not saved, so its values are not scaled
    np.testing.assert_array_equal(found.physical(found.voxels), values.T)
    np.testing.assert_allclose(found.affine, expected.affine, rtol=1e-6, atol=1e-5)


def test_one_time_point_of_a_nibabel_image(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    values = np.arange(120, dtype=np.int16).reshape(4, 3, 2, 5)
    image = nibabel.Nifti1Image(values, np.eye(4))
    with pytest.raises(RleSplatError, match="take one volume of it"):
        read_nibabel(image)
    np.testing.assert_array_equal(read_nibabel(image.slicer[..., 2]).voxels, values[..., 2].T)
    nibabel.save(image.slicer[..., 2:3], tmp_path / "a.nii")  # an axis of length 1, as many files have
    np.testing.assert_array_equal(read_nibabel(nibabel.load(tmp_path / "a.nii")).voxels, values[..., 2].T)


def test_an_image_without_a_place_in_the_patient_has_its_spacing_alone(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    for kind in (nibabel.Nifti1Image, nibabel.AnalyzeImage):
        image = kind(np.arange(24, dtype=np.int16).reshape(4, 3, 2), None)
        image.header.set_zooms((0.5, 0.75, 2.0))
        path = tmp_path / f"a{image.files_types[0][1]}"
        nibabel.save(image, path)
        for one in (image, nibabel.load(path)):
            found = read_nibabel(one)
            assert found.space is None and "left and right are not known" in found.remarks[-1]
            np.testing.assert_array_equal(found.affine, np.diag((0.5, 0.75, 2.0, 1.0)))
