"""One head, written by other programs in files of several formats and orders of voxels, gives one picture."""

import nibabel
import nrrd
import numpy as np
import pytest

from rle_splat import Quality, Scene, fit_preset, read_volume, render, turntable
from tests.read.head import head, reordered
from tests.read.phantoms import ras

SimpleITK = pytest.importorskip("SimpleITK")  # not in the benchmarks' environment

SIZE = 144


def nifti(path, values, affine):
    nibabel.save(nibabel.Nifti1Image(values, ras(affine)), path)


def mgh(path, values, affine):
    nibabel.save(nibabel.freesurfer.MGHImage(values, ras(affine)), path)


def slicer(path, values, affine):
    there = ras(affine)
    header = {"space": "right-anterior-superior", "space directions": there[:3, :3].T, "space origin": there[:3, 3]}
    nrrd.write(str(path), values, header)


def itk(path, values, affine):
    image = SimpleITK.GetImageFromArray(np.ascontiguousarray(values.T))
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    image.SetSpacing(spacing.tolist())
    image.SetDirection((affine[:3, :3] / spacing).ravel().tolist())
    image.SetOrigin(affine[:3, 3].tolist())
    SimpleITK.WriteImage(image, str(path))


FILES = {
    "ras.nii.gz": (nifti, (-1, -1, 1), (0, 1, 2)), "las.nii": (nifti, (1, -1, 1), (0, 1, 2)),
    "coronal.nii": (nifti, (1, 1, -1), (0, 2, 1)), "sagittal.nrrd": (slicer, (-1, 1, 1), (1, 2, 0)),
    "axial.nrrd": (itk, (1, 1, -1), (0, 1, 2)), "mirrored.mha": (itk, (1, -1, -1), (0, 1, 2)),
    "coronal.mgz": (mgh, (-1, 1, -1), (0, 2, 1)),
}  # fmt: skip


def picture(volume) -> np.ndarray:
    """(SIZE, SIZE, 4): the head from the front, its bone shaded by a headlight."""
    camera, matrix = turntable(volume)
    function, _ = fit_preset("ct-bone", volume)
    scene = Scene(volume, function, camera, SIZE, SIZE, matrix, headlight=True)
    return render(scene, Quality.preset("fine")).rgba


@pytest.fixture(scope="module")
def plain():
    """The picture of the head as it is, with a volume made by hand."""
    from rle_splat import Volume

    values, affine = head()
    return picture(Volume(np.ascontiguousarray(values.T), affine, space="patient", value_unit="HU", modality="CT"))


def test_the_face_looks_at_the_viewer_with_the_mark_at_the_right(plain):
    """The patient's left cheek, which has the mark, is at the viewer's right; the nose is above the mouth."""
    differs = np.abs(plain - plain[:, ::-1]).max(axis=2)
    middle = SIZE // 2
    rows, columns = np.nonzero(differs[:, middle + 4 :] > 0.1)
    assert rows.size > 20
    there = (slice(rows.min(), rows.max() + 1), slice(middle + 4 + columns.min(), middle + 5 + columns.max()))
    mark, cheek = (np.percentile(one[there][..., 2], 98) for one in (plain, plain[:, ::-1]))
    assert mark > cheek + 0.1  # the denser, the whiter
    nose, mouth = (plain[row, middle - 2 : middle + 2, 3].mean() for row in (70, 94))
    assert plain[0].max() == 0.0 and nose > 0.9 and mouth > 0.5


@pytest.mark.parametrize("name", FILES)
def test_each_file_gives_the_picture(tmp_path, plain, name):
    """Only the sampling differs with the order of the voxels; a mirrored head differs by ten times the bound."""
    write, flips, order = FILES[name]
    stored, affine = reordered(*head(), flips, order)
    write(tmp_path / name, stored, affine)
    volume = read_volume(tmp_path / name)
    assert volume.space == "patient" and volume.value_unit == "HU"
    found = picture(volume)
    assert np.abs(found - plain).max() < 0.05
    assert np.sqrt(np.mean((found - plain) ** 2)) < 0.002 < 0.02 < np.sqrt(np.mean((found[:, ::-1] - plain) ** 2))
