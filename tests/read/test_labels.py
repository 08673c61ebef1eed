"""Label maps: matched to a scan by their places, named by files of several programs, merged from masks."""

from xml.etree import ElementTree

import nibabel
import numpy as np
import pytest

from rle_splat.read.formats import read_volume, write_steps
from rle_splat.read.labels import is_label_text, read_label_text, read_labels
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.volume.regrid import on_grid_steps
from rle_splat.volume.volume import PATIENT, NamedLabel, Volume

from .phantoms import AFFINES, ras, rotation

SHAPE = (8, 7, 6)  # x, y, z of the scan
SCAN = Volume(np.zeros(SHAPE[::-1], np.uint8), AFFINES["oblique"], space=PATIENT)


def points(volume) -> np.ndarray:
    """(nz, ny, nx, 3): the place of each voxel."""
    nx, ny, nz = volume.shape_xyz
    z, y, x = np.indices((nz, ny, nx))
    return np.stack((x, y, z), axis=-1) @ volume.affine[:3, :3].T + volume.affine[:3, 3]


def labels_on(affine, shape, space=PATIENT, dtype=np.uint16) -> Volume:
    """A label map in which each voxel has a number of its own."""
    numbers = np.arange(1, np.prod(shape) + 1, dtype=dtype).reshape(shape[::-1])
    return Volume(numbers, affine, space=space)


def nearest(labels, volume) -> np.ndarray:
    """By brute force: for each voxel of the volume the label of the nearest voxel of the label map."""
    there = points(labels).reshape(-1, 3)
    apart = np.linalg.norm(points(volume).reshape(-1, 1, 3) - there, axis=2)
    return labels.voxels.reshape(-1)[apart.argmin(axis=1)].reshape(volume.voxels.shape)


def turned(flips, order):
    """The scan's grid with axes flipped, then reordered; and its shape."""
    last = np.array(SHAPE) - 1
    flip = np.diag((*flips, 1.0))
    flip[:3, 3] = [last[i] if flips[i] < 0 else 0.0 for i in range(3)]
    affine = (SCAN.affine @ flip)[:, [*order, 3]]
    return affine, tuple(SHAPE[i] for i in order)


@pytest.mark.parametrize("flips", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0), (1, 2, 0), (2, 0, 1), (0, 2, 1)])
def test_flips_and_orders_of_axes_are_undone_exactly(flips, order):
    labels = labels_on(*turned(flips, order))
    found = drain(on_grid_steps(labels, SCAN))
    np.testing.assert_array_equal(found.voxels, nearest(labels, SCAN))
    assert sorted(found.voxels.ravel()) == sorted(labels.voxels.ravel())
    if (flips, order) == ((1, 1, 1), (0, 1, 2)):
        assert found is labels
    else:
        assert found.remarks == ("The segmentation file stores its voxels in another order; they were reordered.",)


def test_a_coarser_grid_gives_the_nearest_label():
    scale = np.diag((1.9, 1.4, 2.7, 1.0))
    labels = labels_on(SCAN.affine @ scale, (4, 5, 2))
    found = drain(on_grid_steps(labels, SCAN))
    index = np.round(np.indices(SHAPE[::-1])[::-1].reshape(3, -1).T / (1.9, 1.4, 2.7)).astype(int)
    inside = (index < (4, 5, 2)).all(axis=1).reshape(SHAPE[::-1])
    assert 0 < (~inside).sum() < inside.size
    assert (found.voxels[~inside] == 0).all()
    np.testing.assert_array_equal(found.voxels[inside], nearest(labels, SCAN)[inside])
    assert "another grid (4 x 5 x 2 voxels); each voxel takes the nearest label, and" in found.remarks[0]
    np.testing.assert_array_equal(read_labels(labels, SCAN).voxels, found.voxels)


def test_a_turned_grid_gives_the_nearest_label():
    middle = points(SCAN)[3, 3, 3]
    affine = np.eye(4)
    affine[:3, :3] = rotation(33, 0)[:3, :3] @ rotation(20, 1)[:3, :3] * 0.7
    affine[:3, 3] = middle - affine[:3, :3] @ (30, 30, 30)
    labels = labels_on(affine, (61, 61, 61), dtype=np.uint32)
    found = drain(on_grid_steps(labels, SCAN))
    index = np.linalg.inv(affine) @ np.vstack((points(SCAN).reshape(-1, 3).T, np.ones(found.voxels.size)))
    expected = np.round(index[:3]).astype(int)
    inside = ((expected >= 0) & (expected < 61)).all(axis=0)
    truth = labels.voxels[expected[2][inside], expected[1][inside], expected[0][inside]]
    np.testing.assert_array_equal(found.voxels.ravel()[inside], truth)
    assert inside.mean() > 0.9 and "nearest label" in found.remarks[0]


def test_labels_of_another_place_are_refused():
    affine = AFFINES["oblique"].copy()
    affine[:3, 3] += 500.0
    with pytest.raises(RleSplatError, match=r"lies elsewhere.*choose the labels of this scan"):
        drain(on_grid_steps(labels_on(affine, SHAPE), SCAN))


@pytest.mark.parametrize(
    ("stored", "numbers"),
    [(np.uint32, (0, 1, 2**31)), (np.int64, (0, 1, 2**40)), (np.float32, (0, 2**31, 3)), (np.int64, (0, -(2**33), 3))],
)
def test_numbers_that_are_too_large_are_an_error(stored, numbers, tmp_path):
    voxels = np.zeros((2, 3, 4), stored)
    voxels.ravel()[:3] = np.array(numbers, stored)
    nibabel.save(nibabel.Nifti1Image(voxels, np.eye(4), dtype=stored), tmp_path / "a.nii")
    scan = Volume(np.zeros((4, 3, 2), np.int16), np.diag((-1.0, -1.0, 1.0, 1.0)), space="patient")
    wanted = max(numbers, key=abs)
    with pytest.raises(RleSplatError, match=rf"the number {wanted}; give labels numbers below 2\^31"):
        read_labels(tmp_path / "a.nii", scan)


def test_negative_numbers_are_labels(tmp_path):
    voxels = np.zeros((2, 3, 4), np.int32)
    voxels[0, 0, :2] = -3, 70
    nibabel.save(nibabel.Nifti1Image(voxels, np.eye(4), dtype=np.int32), tmp_path / "a.nii")
    scan = Volume(np.zeros((4, 3, 2), np.int16), np.diag((-1.0, -1.0, 1.0, 1.0)), space="patient")
    found = read_labels(tmp_path / "a.nii", scan).voxels
    assert found.dtype == np.int16 and np.unique(found).tolist() == [-3, 0, 70]


def test_labels_without_a_place_are_matched_by_index_and_say_so():
    labels = labels_on(np.eye(4), SHAPE, None)
    found = drain(on_grid_steps(labels, SCAN))
    np.testing.assert_array_equal(found.voxels, labels.voxels)
    assert "The segmentation file does not say how it lies in the patient" in found.remarks[0]
    bare = Volume(SCAN.voxels, np.eye(4))
    assert drain(on_grid_steps(labels, bare)) is labels
    spaced = Volume(SCAN.voxels, np.diag((0.26, 0.26, 0.29, 1.0)))  # as given for a file without a spacing
    found = drain(on_grid_steps(labels, spaced))
    assert found.voxels is labels.voxels and np.array_equal(found.affine, spaced.affine)


TEXT = """################################################
# ITK-SnAP Label Description File
    0     0    0    0        0  0  0    "Clear Label"
    1   255    0    0        1  1  1    "left ventricle"
    2     0  128  255      0.5  0  1    "wall"
"""


def test_names_of_itk_snap(tmp_path):
    (tmp_path / "a.txt").write_text(TEXT)
    (clear, _), (one, seen), (two, hidden) = read_label_text(tmp_path / "a.txt")
    assert (clear.label, one.label, one.name, seen, two.name, hidden) == (0, 1, "left ventricle", True, "wall", False)
    np.testing.assert_allclose((*one.color, *two.color), (1, 0, 0, 0, 0.2158605, 1), rtol=1e-6)
    (tmp_path / "b.txt").write_text("notes")
    assert not is_label_text(tmp_path / "b.txt")
    with pytest.raises(RleSplatError, match="no label description of ITK-SNAP"):
        read_label_text(tmp_path / "b.txt")


def test_names_beside_the_label_file_are_found(tmp_path):
    values = np.zeros(SHAPE, np.float32)
    values[2:4] = 1
    nibabel.save(nibabel.Nifti1Image(values, ras(SCAN.affine)), tmp_path / "seg.nii.gz")
    (tmp_path / "seg.label").write_text(TEXT)
    found = read_labels(tmp_path / "seg.nii.gz", SCAN)
    assert found.voxels.dtype == np.uint16 and found.voxels.sum() == 2 * 7 * 6
    assert [one.name for one in found.named_labels] == ["Clear Label", "left ventricle", "wall"]


def masks(folder, organs, affine=SCAN.affine):
    folder.mkdir()
    for name, (begin, end) in organs.items():
        values = np.zeros(SHAPE, np.uint8)
        values[begin:end] = 1
        nibabel.save(nibabel.Nifti1Image(values, ras(affine)), folder / f"{name}.nii.gz")
    (folder / "statistics.json").write_text("{}")
    return folder


def test_a_folder_of_masks_is_one_label_map(tmp_path):
    folder = masks(tmp_path / "seg", {"aorta": (0, 3), "liver": (2, 5), "nothing": (4, 4), "spleen": (6, 8)})
    volume = read_volume(folder)
    expected = np.array((1, 1, 2, 2, 2, 0, 4, 4), np.uint8)
    np.testing.assert_array_equal(volume.voxels, np.broadcast_to(expected, SHAPE[::-1]))
    assert [(one.label, one.name) for one in volume.named_labels] == [(1, "aorta"), (2, "liver"), (4, "spleen")]
    assert volume.space == PATIENT and "overlap in 42 voxels" in volume.remarks[-1]
    np.testing.assert_allclose(volume.affine, SCAN.affine, rtol=1e-6)
    found = read_labels(folder, SCAN)
    assert found.key == volume.key


def test_a_file_of_named_labels_in_a_folder_of_masks_is_a_segment_for_each(tmp_path):
    folder = masks(tmp_path / "seg", {"liver": (0, 5), "spleen": (6, 8)})
    voxels = np.zeros(SHAPE[::-1], np.uint8)
    voxels[:, 1:3], voxels[:, 3:] = 7, 4
    names = (NamedLabel(4, "false lumen", (0.2, 0.1, 0.5)), NamedLabel(7, "true lumen"), NamedLabel(9, "nowhere"))
    drain(write_steps(Volume(voxels, SCAN.affine, space=PATIENT, named_labels=names), folder / "lumens.nii.gz"))
    volume = read_volume(folder)
    assert [(one.label, one.name) for one in volume.named_labels] == [
        (1, "liver"), (2, "false lumen"), (3, "true lumen"), (5, "spleen")]  # fmt: skip
    np.testing.assert_allclose(volume.named_labels[1].color, (0.2, 0.1, 0.5), atol=1e-5)
    expected = np.where(voxels == 4, 2, np.where(voxels == 7, 3, np.arange(8) < 5))
    expected[..., 6:] = 5
    np.testing.assert_array_equal(volume.voxels, expected)
    voxels[0, 0, 0] = 8  # a value without a name
    drain(write_steps(Volume(voxels, SCAN.affine, space=PATIENT, named_labels=names), folder / "lumens.nii.gz"))
    with pytest.raises(RleSplatError, match="3 NIfTI files that are not masks on one grid"):
        read_volume(folder)


def test_a_mask_whose_header_has_a_whole_table_is_named_as_its_file(tmp_path):
    folder = masks(tmp_path / "seg", {"liver": (0, 5)})
    voxels = np.zeros(SHAPE[::-1], np.uint8)
    voxels[..., 6:] = 1
    table = (NamedLabel(1, "liver"), NamedLabel(2, "spleen"))
    drain(write_steps(Volume(voxels, SCAN.affine, space=PATIENT, named_labels=table), folder / "spleen.nii.gz"))
    volume = read_volume(folder)
    assert [(one.label, one.name) for one in volume.named_labels] == [(1, "liver"), (2, "spleen")]
    assert (volume.voxels[..., 6:] == 2).all()


def test_a_folder_of_more_than_255_masks_has_numbers_of_16_bits(tmp_path):
    folder = masks(tmp_path / "seg", {f"m{number:03}": (number % 8, number % 8 + 1) for number in range(258)})
    volume = read_volume(folder)
    assert volume.voxels.dtype == np.uint16 and [one.label for one in volume.named_labels] == list(range(1, 259))
    np.testing.assert_array_equal(volume.voxels[0, 0], (257, 258, 251, 252, 253, 254, 255, 256))


def test_a_folder_of_scans_is_no_label_map(tmp_path):
    folder = masks(tmp_path / "seg", {"a": (0, 3), "b": (2, 5)})
    values = np.arange(np.prod(SHAPE), dtype=np.int16).reshape(SHAPE)
    nibabel.save(nibabel.Nifti1Image(values, ras(SCAN.affine)), folder / "c.nii.gz")
    with pytest.raises(RleSplatError, match="3 NIfTI files that are not masks on one grid; choose one"):
        read_volume(folder)


@pytest.mark.parametrize("name", ["a.nii.gz", "a.nii", "a.seg.nrrd"])
def test_names_and_colors_are_written_and_read_back(name, tmp_path):
    voxels = np.zeros(SHAPE[::-1], np.uint8)
    voxels[2:4], voxels[4:] = 3, 12
    given = (NamedLabel(3, 'Herz & <Aorta> "links"', (0.8, 0.1, 0.0)), NamedLabel(12, "肝臓 ]]>"))
    labels = Volume(voxels, AFFINES["oblique"], space=PATIENT, named_labels=given)
    drain(write_steps(labels, tmp_path / name))
    found = read_volume(tmp_path / name)
    np.testing.assert_array_equal(found.voxels, voxels)
    np.testing.assert_allclose(found.affine, AFFINES["oblique"], atol=1e-4)
    assert [(one.label, one.name) for one in found.named_labels] == [(one.label, one.name) for one in given]
    np.testing.assert_allclose(found.named_labels[0].color, given[0].color, atol=1e-5)
    assert found.named_labels[1].color is None


def test_other_programs_read_the_names_that_are_written(tmp_path):
    """nibabel and an XML parser a NIfTI's as TotalSegmentator does, SimpleITK a segmentation's as Slicer does."""
    voxels = np.ones(SHAPE[::-1], np.uint8)
    labels = Volume(
        voxels, AFFINES["oblique"], space=PATIENT, named_labels=(NamedLabel(0, "Background"), NamedLabel(1, "R & D"))
    )
    for name in ("a.nii.gz", "a.seg.nrrd"):
        drain(write_steps(labels, tmp_path / name))
    image = nibabel.load(tmp_path / "a.nii.gz")
    np.testing.assert_array_equal(np.asarray(image.dataobj), voxels.T)
    table = ElementTree.fromstring(image.header.extensions[0].get_content().rstrip(b"\0"))
    rows = table.findall("VolumeInformation/LabelTable/Label")
    assert [(row.get("Key"), row.text) for row in rows] == [("0", "Background"), ("1", "R & D")]
    SimpleITK = pytest.importorskip("SimpleITK")  # not in the benchmarks' environment
    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(str(tmp_path / "a.seg.nrrd"))
    image = reader.Execute()
    np.testing.assert_array_equal(SimpleITK.GetArrayFromImage(image), voxels)
    assert (image.GetMetaData("Segment0_Name"), image.GetMetaData("Segment0_LabelValue")) == ("R & D", "1")
    assert "Segment1_Name" not in image.GetMetaDataKeys(), "the background is no segment"
