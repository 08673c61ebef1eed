"""DICOM RTSTRUCT: contours of regions as labels on the grid of a scan, against volumes of closed form and a judge."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pydicom")

from pydicom.dataset import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import generate_uid

from rle_splat.read.dicom import contours
from rle_splat.read.dicom.pictures import STRUCTURES, hash_text
from rle_splat.read.formats import read_volume
from rle_splat.read.labels import read_labels
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import PATIENT, Volume

from . import dicom_phantoms as phantoms

PLACE = "1.2.3.4"
ANGLES = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
MIDDLE = np.array((24.3, 25.1, 22.0))  # voxel index of the shapes' centers
SHAPE = (45, 50, 48)  # z, y, x


def scan(turn=None, spacing=(1.0, 1.0, 1.0), shear=0.0) -> Volume:
    """An empty scan; ``turn``: (3, 3) directions of its axes; ``shear``: of a tilted gantry, in mm for each slice."""
    affine = np.eye(4)
    affine[:3, :3] = (np.eye(3) if turn is None else turn) * spacing
    affine[1, 2] += shear
    affine[:3, 3] = (-31.0, 12.0, 55.0)
    return Volume(np.zeros(SHAPE, np.uint8), affine, space=PATIENT, place_key=hash_text(PLACE))


def oblique() -> np.ndarray:
    """Directions of axes that are turned against the patient's."""
    return np.linalg.qr(np.array([[1.0, 0.3, -0.2], [-0.2, 1.0, 0.4], [0.3, -0.1, 1.0]]))[0]


def circle(radius: float, z: float, middle=MIDDLE, squeeze=1.0) -> np.ndarray:
    """A circle or an ellipse in voxel indices, (n, 3)."""
    x, y = middle[0] + radius * np.cos(ANGLES), middle[1] + squeeze * radius * np.sin(ANGLES)
    return np.stack([x, y, np.full_like(x, z)], axis=1)


def sphere(radius: float, step: float = 1.0) -> list:
    """Contours of a sphere in every ``step``-th slice."""
    places = MIDDLE[2] + np.arange(-40, 41) * step
    return [circle(np.sqrt(radius**2 - (z - MIDDLE[2]) ** 2), z) for z in places if abs(z - MIDDLE[2]) < radius]


def torus(large: float, small: float, step: float = 1.0) -> list:
    """Contours of a torus about z, an outer and an inner one in each plane."""
    found = []
    for z in MIDDLE[2] + np.arange(-40, 41) * step:
        half = small**2 - (z - MIDDLE[2]) ** 2
        if half > 0.0:
            found += [circle(large + np.sqrt(half), z), circle(large - np.sqrt(half), z)[::-1]]
    return found


def write(path: Path, volume: Volume, regions, place: str = PLACE, kind: str = "CLOSED_PLANAR", change=None) -> Path:
    """Write an RTSTRUCT; ``regions``: number -> contours in voxel indices of ``volume``."""
    dataset = Dataset()
    dataset.SOPClassUID, dataset.SOPInstanceUID, dataset.Modality = STRUCTURES, generate_uid(), "RTSTRUCT"
    dataset.PatientName, dataset.PatientID, dataset.SeriesInstanceUID = phantoms.PERSON, phantoms.NUMBER, generate_uid()
    described, drawn = [], []
    for number, shapes in regions.items():
        described.append(Dataset())
        described[-1].ROINumber, described[-1].ROIName = number, f"organ {number}"
        described[-1].ReferencedFrameOfReferenceUID = place
        drawn.append(Dataset())
        drawn[-1].ReferencedROINumber, drawn[-1].ROIDisplayColor = number, [255, 0, 128]
        drawn[-1].ContourSequence = Sequence([contour(points, volume, kind) for points in shapes])
    dataset.StructureSetROISequence, dataset.ROIContourSequence = Sequence(described), Sequence(drawn)
    dataset.ApprovalStatus = "UNAPPROVED"  # an element behind the contours
    if change is not None:
        change(dataset)
    return phantoms.save(dataset, path)


def contour(points, volume: Volume, kind: str) -> Dataset:
    found = Dataset()
    points = points @ volume.affine[:3, :3].T + volume.affine[:3, 3]
    found.ContourGeometricType, found.NumberOfContourPoints = kind, len(points)
    found.ContourData = [f"{value:.6f}" for value in points.ravel()]
    return found


def labels_of(path: Path, volume: Volume) -> Volume:
    return read_labels(path, volume)


def counted(tmp_path: Path, volume: Volume, shapes) -> int:
    """Voxels of one region."""
    return int(np.count_nonzero(labels_of(write(tmp_path / "s.dcm", volume, {1: shapes}), volume).voxels))


GRIDS = {
    "axial": {}, "oblique": {"turn": oblique()}, "mirrored": {"turn": np.diag((1, -1, -1))},
    "tilted": {"shear": 0.3}, "flat voxels": {"spacing": (0.7, 0.9, 2.5)},
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("grid", GRIDS)
def test_shapes_have_the_volumes_of_their_formulas(tmp_path: Path, grid: str):
    """In voxels, so that the grid does not count. The squeezed sphere is an ellipsoid."""
    volume = scan(**GRIDS[grid])
    squeezed = [points * (1, 0.7, 1) + (0, 0.3 * MIDDLE[1], 0) for points in sphere(18.0)]
    for shapes, exact in (
        (sphere(18.0), 4 / 3 * np.pi * 18**3),
        (squeezed, 0.7 * 4 / 3 * np.pi * 18**3),
        (torus(14.0, 6.5), 2 * np.pi**2 * 14 * 6.5**2),
    ):
        assert counted(tmp_path, volume, shapes) == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("grid", GRIDS)
def test_irregular_regions_have_the_areas_of_their_polygons(tmp_path: Path, grid: str):
    """The area of a polygon, from its corners, times the distance of slices; summed and in millimeters."""
    random, volume = np.random.default_rng(4), scan(**GRIDS[grid])
    shapes, area = [], 0.0
    for z in range(10, 32):
        radius = 13.0 + sum(random.uniform(0.0, 2.0) * np.cos(n * ANGLES + random.uniform(0.0, 6.0)) for n in (2, 3, 5))
        x, y = MIDDLE[0] + radius * np.cos(ANGLES), MIDDLE[1] + radius * np.sin(ANGLES)
        shapes.append(np.stack([x, y, np.full_like(x, z)], axis=1))
        corners = shapes[-1] @ volume.affine[:3, :3].T
        area += 0.5 * np.linalg.norm(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0))
    apart = np.cross(*volume.affine[:3, :2].T)
    apart = abs(volume.affine[:3, 2] @ apart) / np.linalg.norm(apart)
    voxel = abs(np.linalg.det(volume.affine[:3, :3]))
    assert counted(tmp_path, volume, shapes) * voxel == pytest.approx(area * apart, rel=0.01)


@pytest.mark.parametrize("step", [0.5, 1.5, 2.0, 3.0])
def test_planes_of_another_distance_than_the_slices(tmp_path: Path, step: float):
    """A part of a sphere between two contours, whose volume is known."""
    ends = MIDDLE[2] + 12.0 * np.array((-1, 1))
    shapes = [points for points in sphere(18.0, step) if ends[0] <= points[0, 2] <= ends[1]]
    slices = np.arange(-12, 13)
    exact = np.pi * (18**2 - slices**2.0).sum()
    assert counted(tmp_path, scan(), shapes) == pytest.approx(exact, rel=0.01)


def test_filled_gaps_and_gaps_that_stay(tmp_path: Path):
    """A forgotten contour is filled; between two parts of a region there is nothing."""
    places = [5, 6, 7, 9, 10, 30, 31, 32]
    shapes = [circle(8.0, z) for z in places]
    found = labels_of(write(tmp_path / "s.dcm", scan(), {1: shapes}), scan())
    assert np.flatnonzero(found.voxels.any(axis=(1, 2))).tolist() == [5, 6, 7, 8, 9, 10, 30, 31, 32]
    np.testing.assert_array_equal(found.voxels[8], found.voxels[7])
    assert found.remarks == ("Slices of regions that lie between contours were interpolated (1).",)


@pytest.mark.parametrize("spacing", [(1.0, 1.0), (0.5, 2.0)])
def test_a_shape_between_two_shapes_lies_between_them(spacing):
    """Between two circles with one center, in mm, a circle of the radius in between."""
    y, x = np.mgrid[:60, :80]
    distance = np.hypot((x - 40.3) * spacing[0], (y - 30.2) * spacing[1])
    radii = (5.0, 13.0)
    borders = [[circle(radius, 0.0, (0.0, 0.0))[:, :2] / spacing + (40.3, 30.2)] for radius in radii]
    ends = [contours.fill(border, x.shape)[0] for border in borders]
    for share in (0.25, 0.5, 0.9):
        found = contours.interpolate_shapes(ends, borders, share, spacing)
        wanted = distance < radii[0] + share * (radii[1] - radii[0])
        assert np.count_nonzero(found != wanted) <= 2
    assert not contours.interpolate_shapes(ends, borders, 1.0, spacing)[ends[1] != (distance < radii[1])].any()


def test_holes_islands_and_keyholes(tmp_path: Path):
    """A hole as a contour of its own, or joined to the outer one by a channel of no width: the same voxels."""
    outer, inner, island = circle(15.0, 20.0), circle(9.0, 20.0)[::-1], circle(4.0, 20.0)
    keyhole = np.concatenate([outer, outer[:1], inner, inner[:1]])
    found = []
    for shapes in ([outer, inner, island], [island, outer, inner], [keyhole, island]):
        labels = labels_of(write(tmp_path / "s.dcm", scan(), {1: shapes}), scan())
        found.append(labels.voxels)
        assert not labels.remarks
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])
    assert np.count_nonzero(found[0]) == pytest.approx(np.pi * (15**2 - 9**2 + 4**2), rel=0.01)


def test_crossing_contours_are_filled_even_odd_and_stated(tmp_path: Path):
    eight = circle(8.0, 20.0)
    eight[:, 1] = MIDDLE[1] + 8.0 * np.sin(2 * ANGLES)
    pair = [circle(8.0, 10.0), circle(8.0, 10.0) + (5.0, 0.0, 0.0)]
    labels = labels_of(write(tmp_path / "s.dcm", scan(), {1: [eight], 2: pair}), scan())
    assert labels.remarks == ("s.dcm holds contours that cross and are filled even-odd (2).",)
    one, other = (labels_of(write(tmp_path / "s.dcm", scan(), {1: [each]}), scan()).voxels for each in pair)
    np.testing.assert_array_equal(labels.voxels[10], 2 * (one ^ other)[10])


@pytest.mark.parametrize("axis", ["sagittal", "turned"])
def test_planes_across_the_slices(tmp_path: Path, axis: str):
    turn = np.eye(3)[[2, 0, 1]] if axis == "sagittal" else oblique()
    shapes = [(points - MIDDLE) @ turn + MIDDLE for points in sphere(16.0)]
    assert counted(tmp_path, scan(), shapes) == pytest.approx(4 / 3 * np.pi * 16**3, rel=0.01)
    holes = [(points - MIDDLE) @ turn + MIDDLE for points in torus(14.0, 6.5)]
    assert counted(tmp_path, scan(), holes) == pytest.approx(2 * np.pi**2 * 14 * 6.5**2, rel=0.01)


def test_names_colors_and_overlaps(tmp_path: Path):
    """The highest number counts, whatever the order in the file; a region outside has no name."""
    regions = {7: [circle(10.0, z) for z in (20, 21)], 300: [circle(5.0, 20)], 4: [circle(14.0, 20)],
               9: [circle(3.0, 500.0)]}  # fmt: skip
    labels = labels_of(write(tmp_path / "s.dcm", scan(), regions), scan())
    assert labels.voxels.dtype == np.uint16
    assert [(one.label, one.name) for one in labels.named_labels] == [(n, f"organ {n}") for n in (4, 7, 300)]
    np.testing.assert_allclose(labels.named_labels[0].color, (1.0, 0.0, 0.2158605), atol=1e-6)
    middle = labels.voxels[20, int(MIDDLE[1])]
    assert [middle[int(MIDDLE[0]) + off] for off in (0, 4, 7, 12, 17)] == [300, 300, 7, 4, 0]
    inner = [np.count_nonzero(labels.voxels == number) for number in (7, 300)]
    overlap = sum(inner) - np.count_nonzero(labels.voxels[21]) + inner[1]
    assert labels.remarks == (
        "s.dcm holds regions without a voxel in the scan (1).",
        f"Regions overlap in {overlap} voxels, which show the region with the highest number.",
    )


def test_numbers_beyond_labels_are_counted_anew(tmp_path: Path):
    regions = {0: [circle(5.0, 20)], 70000: [circle(5.0, 30)]}
    labels = labels_of(write(tmp_path / "s.dcm", scan(), regions), scan())
    assert [(one.label, one.name) for one in labels.named_labels] == [(1, "organ 0"), (2, "organ 70000")]


def refusal(path: Path, volume: Volume) -> str:
    with pytest.raises(RleSplatError) as caught:
        labels_of(path, volume)
    text = str(caught.value)
    assert "DOE" not in text and phantoms.NUMBER not in text and text.endswith(".") and text.count(". ") == 0
    return text


class TestBadInput:
    def test_another_frame_of_reference(self, tmp_path: Path):
        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, 20)]}, place="9.9")
        assert "another frame of reference" in refusal(path, scan())
        assert labels_of(path, replace(scan(), place_key="")).voxels.any()  # a scan that does not say its own

    def test_one_region_of_another_frame(self, tmp_path: Path):
        def change(dataset):
            dataset.StructureSetROISequence[1].ReferencedFrameOfReferenceUID = "9.9"

        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, 20)], 2: [circle(5.0, 20)]}, change=change)
        labels = labels_of(path, scan())
        assert set(np.unique(labels.voxels)) == {0, 1}
        assert labels.remarks == ("s.dcm holds regions of another frame of reference (1).",)

    def test_no_contours(self, tmp_path: Path):
        assert "no closed contours; export" in refusal(write(tmp_path / "s.dcm", scan(), {}), scan())

    @pytest.mark.parametrize(("kind", "word"), [("POINT", "points (2)"), ("OPEN_PLANAR", "open contours (2)")])
    def test_points_and_open_contours_alone(self, tmp_path: Path, kind: str, word: str):
        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, z) for z in (20, 21)]}, kind=kind)
        assert f"no closed contours, only {word};" in refusal(path, scan())

    def test_odd_contours_beside_good_ones_are_left_out(self, tmp_path: Path):
        def change(dataset):
            drawn = dataset.ROIContourSequence[0].ContourSequence
            drawn[1].ContourGeometricType = "OPEN_PLANAR"
            drawn[2].ContourData = drawn[2].ContourData[:6]
            drawn[3].ContourData = drawn[3].ContourData[:7]

        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, z) for z in (20, 21, 22, 23)]}, change=change)
        labels = labels_of(path, scan())
        assert np.flatnonzero(labels.voxels.any(axis=(1, 2))).tolist() == [20]
        assert labels.remarks == tuple(
            f"s.dcm holds {what} (1)."
            for what in ("open contours", "contours of fewer than 3 points", "damaged contours")
        )

    def test_elsewhere(self, tmp_path: Path):
        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, 500)]})
        assert "No contour of s.dcm lies within the scan" in refusal(path, scan())

    def test_a_scan_without_place(self, tmp_path: Path):
        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, 20)]})
        assert "does not say how it lies in the patient" in refusal(path, replace(scan(), space=None))

    def test_a_file_that_breaks_off(self, tmp_path: Path):
        path = write(tmp_path / "s.dcm", scan(), {1: sphere(10.0)})
        path.write_bytes(path.read_bytes()[:-4000])
        try:
            labels_of(path, scan())
        except RleSplatError as problem:
            assert "s.dcm" in str(problem)

    def test_where_a_volume_is_wanted(self, tmp_path: Path):
        path = write(tmp_path / "s.dcm", scan(), {1: [circle(5.0, 20)]})
        with pytest.raises(RleSplatError, match="read the file as labels"):
            read_volume(path)


def test_beside_its_series(tmp_path: Path):
    """The frame of reference of the series' own files is compared; a folder with both is its series."""
    where = phantoms.geometries()["oblique"]

    def change(dataset, i):
        dataset.FrameOfReferenceUID = PLACE

    phantoms.write_classic(tmp_path / "both", where, change=change)
    volume = read_volume(tmp_path / "both")
    shapes = [circle(8.0, z, (17.2, 16.1)) for z in range(2, 6)]
    path = write(tmp_path / "both" / "s.dcm", volume, {1: shapes})
    found = labels_of(path, read_volume(tmp_path / "both"))
    assert np.count_nonzero(found.voxels) == pytest.approx(4 * np.pi * 64, rel=0.01)
    assert "another frame" in refusal(write(tmp_path / "s.dcm", volume, {1: shapes}, place="9.9"), volume)


def test_contours_through_the_outermost_centers_fill_their_mask():
    """As those that libraries make of masks: the border pixels are on the edges, also of holes and slanted ones."""
    y, x = np.mgrid[:30, :34]
    octagon = (np.abs(x - 15) + np.abs(y - 14) <= 13) & (np.abs(x - 15) <= 10) & (np.abs(y - 14) <= 9)
    outer = np.array([(5, 11), (5, 17), (11, 23), (19, 23), (25, 17), (25, 11), (19, 5), (11, 5)], float)
    hole = np.array([(15, 10), (11, 14), (15, 18), (19, 14)], float)  # its border belongs to the mask
    mask = octagon & ~(np.abs(x - 15) + np.abs(y - 14) < 4)
    rounded = 1e-5 * np.random.default_rng(1).standard_normal((8, 2))
    np.testing.assert_array_equal(contours.fill([outer + rounded, hole], mask.shape)[0], mask)
    assert contours.fill([outer - 0.5], mask.shape)[0].sum() < octagon.sum()


def off_edges(x: float, y: float, polygon) -> float:
    """Distance of a point from the nearest edge."""
    begin, along = polygon, np.roll(polygon, -1, axis=0) - polygon
    share = np.clip(((np.array((x, y)) - begin) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(begin + share[:, None] * along - (x, y)).T).min())


@pytest.mark.extras
@pytest.mark.parametrize("corners", [3, 7, 40])
def test_polygons_are_filled_as_matplotlib_fills_them(corners: int):
    """Points in a polygon by code that shares nothing with ours; centers within 0.001 pixels of an edge are filled."""
    path = pytest.importorskip("matplotlib.path")
    random = np.random.default_rng(corners)
    y, x = np.mgrid[:40, :44]
    centers = np.stack([x.ravel(), y.ravel()], axis=1)
    for _ in range(20):
        angles = np.sort(random.uniform(0.0, 2.0 * np.pi, corners))  # a star about a center: it does not cross itself
        radius = random.uniform(4.0, 25.0, corners)  # beyond the grid
        polygon = np.stack([21.3 + radius * np.cos(angles), 18.7 + radius * np.sin(angles)], axis=1)
        wanted = path.Path(polygon).contains_points(centers).reshape(x.shape)
        found = contours.fill([polygon], x.shape)[0]
        assert all(found[j, i] and off_edges(i, j, polygon) <= 1e-3 for j, i in np.argwhere(found != wanted))
