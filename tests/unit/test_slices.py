"""Slices: the values of a volume on a plane, exact for a linear field and at voxels, and the polygon inside it."""

import os
from pathlib import Path

import numpy as np
import pytest

from rle_splat.read.formats import read_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.volume import slices
from rle_splat.volume.interpolate import interpolate
from rle_splat.volume.volume import Volume

SHAPE = (9, 7, 5)  # x, y, z
FIELD = (3.0, -2.0, 7.0, 100.0)  # value = 3 x - 2 y + 7 z + 100


def resampled(*arguments):
    return drain(slices.resample_steps(*arguments))


def field(x, y, z):
    return FIELD[0] * x + FIELD[1] * y + FIELD[2] * z + FIELD[3]


def linear_volume(affine=None, **meaning):
    z, y, x = np.mgrid[: SHAPE[2], : SHAPE[1], : SHAPE[0]].astype(np.float64)
    return Volume(field(x, y, z), np.eye(4) if affine is None else affine, **meaning)


def pixel_places(matrix, width, height):
    """Voxel indices (3, height, width) of the centers of the pixels, row 0 at y = 1."""
    x = (np.arange(width) + 0.5) / width * 2.0 - 1.0
    y = 1.0 - (np.arange(height) + 0.5) / height * 2.0
    xx, yy = np.meshgrid(x, y)
    points = np.stack((xx, yy, np.zeros_like(xx), np.ones_like(xx)))
    return np.einsum("ij,jhw->ihw", matrix, points)[:3]


def at_edge(places):
    """Where a place is so near to the volume's edge that rounding decides whether it is inside."""
    gaps = [np.minimum(np.abs(p + 0.5), np.abs(p - n + 0.5)) for p, n in zip(places, SHAPE)]
    return np.min(gaps, axis=0) <= 2.0 * slices.NEAR_EDGE


def oblique(seed, reach):
    """A plane through the middle of the volume in a random position."""
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = axes * reach
    matrix[:3, 3] = 0.5 * (np.array(SHAPE) - 1.0)
    return matrix


@pytest.mark.parametrize("seed", range(5))
def test_an_oblique_slice_of_a_linear_field_is_exact(seed):
    volume = linear_volume(slope=0.5, intercept=-20.0)
    matrix = oblique(seed, 1.4)  # all of it between the outermost centers
    values, inside = resampled(volume, matrix, 31, 24)
    assert inside.all()
    np.testing.assert_allclose(values, 0.5 * field(*pixel_places(matrix, 31, 24)) - 20.0, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_outside_is_what_lies_half_a_voxel_beyond_the_centers(seed):
    matrix = oblique(seed, 8.0)
    values, inside = resampled(linear_volume(), matrix, 40, 40)
    places = pixel_places(matrix, 40, 40)
    within = np.logical_and.reduce([(p >= -0.5) & (p <= n - 0.5) for p, n in zip(places, SHAPE)])
    np.testing.assert_array_equal(inside[~at_edge(places)], within[~at_edge(places)])
    assert 0 < inside.sum() < inside.size and not values[~inside].any()
    clamped = [np.clip(p, 0.0, n - 1.0) for p, n in zip(places, SHAPE)]
    np.testing.assert_allclose(values[inside], field(*clamped)[inside], atol=1e-10)


@pytest.mark.parametrize("axis", range(3))
def test_the_first_place_of_a_slice_holds_the_voxels_of_one_layer(axis):
    rng = np.random.default_rng(axis)
    volume = Volume(rng.integers(0, 4096, SHAPE[::-1]).astype(np.int16), np.diag((0.7, 0.7, 0.7, 1.0)))
    matrix = slices.slice_matrix(volume, axis)
    width, height = slices.slice_size(volume, matrix)
    across = [count for i, count in enumerate(SHAPE) if i != axis]
    assert (width, height) == tuple(across)
    values, inside = resampled(volume, matrix, width, height)
    layer = np.take(volume.voxels, SHAPE[axis] // 2, axis=2 - axis)
    assert inside.all()
    np.testing.assert_allclose(values, layer[::-1], atol=1e-9)


def test_pixels_have_the_finest_spacing_up_to_a_limit():
    volume = linear_volume(np.diag((1.0, 0.5, 2.0, 1.0)))
    assert slices.slice_size(volume, slices.slice_matrix(volume, 2)) == (18, 7)
    assert slices.slice_size(volume, slices.slice_matrix(volume, 0)) == (7, 20)
    wide = slices.slice_matrix(volume, 2) @ np.diag((1000.0, 1.0, 1.0, 1.0))
    assert slices.slice_size(volume, wide) == (slices.MOST_ACROSS, 7)
    assert slices.slice_size(volume, np.diag((0.0, 0.0, 1.0, 1.0))) == (1, 1)
    with pytest.raises(RleSplatError, match="not finite"):
        slices.slice_size(volume, np.full((4, 4), np.nan))


def test_a_real_scan_at_voxels():
    data = os.environ.get("RLE_SPLAT_DATA")
    path = Path(data or "") / "t1_head_188x256x190_uint8.nii.gz"
    if not data or not path.exists():
        pytest.skip("no real volumes: set RLE_SPLAT_DATA")
    volume = read_volume(str(path))
    for name in slices.SLICE_NAMES:
        axis = slices.slice_axis(volume, name)
        matrix = slices.slice_matrix(volume, axis)
        values, inside = resampled(volume, matrix, *slices.slice_size(volume, matrix))
        layer = np.take(volume.voxels, volume.shape_xyz[axis] // 2, axis=2 - axis)
        assert inside.all() and values.shape == layer.shape and layer.max() > 100
        np.testing.assert_allclose(values, volume.physical(layer[::-1]), atol=1e-9)
        between = matrix.copy()
        between[axis, 3] -= 0.25
        mixed, _ = resampled(volume, between, *slices.slice_size(volume, matrix))
        below = np.take(volume.voxels, volume.shape_xyz[axis] // 2 - 1, axis=2 - axis)
        np.testing.assert_allclose(mixed, volume.physical(0.75 * layer[::-1] + 0.25 * below[::-1]), atol=1e-9)


def test_axial_follows_the_patient():
    turned = np.zeros((4, 4))  # voxel axes x, y, z along the patient's S, L, -P
    turned[2, 0], turned[0, 1], turned[1, 2], turned[3, 3] = 1.0, 1.0, -1.0, 1.0
    patient, other = linear_volume(turned, space="patient"), linear_volume(turned)
    assert [slices.slice_axis(patient, name) for name in ("sagittal", "coronal", "axial")] == [1, 2, 0]
    assert [slices.slice_axis(other, name) for name in ("sagittal", "coronal", "axial")] == [0, 1, 2]


def test_gray_levels_of_a_window():
    values = np.array([-1e9, 0.0, 50.0, 75.0, 100.0, 1e9, np.nan, np.inf])
    np.testing.assert_allclose(slices.gray_levels(values, 50.0, 100.0), [0, 0, 0, 0.5, 1, 1, 0, 1])


def test_a_nan_counts_only_where_it_has_a_share():
    voxels = np.ones((2, 2, 3))
    voxels[0, 0, 2] = np.nan
    values, inside = interpolate(voxels, [np.array([1.0, 1.5, 2.0]), np.zeros(3), np.array([0.0, 0.0, 1.0])])
    assert inside.all()
    np.testing.assert_array_equal(np.isnan(values), [False, True, False])


@pytest.mark.parametrize("seed", range(8))
def test_the_polygon_holds_the_pixels_inside(seed):
    matrix = oblique(seed, (6.0, 4.0, 1.0))
    polygon = slices.cut_polygon(SHAPE, matrix)
    assert len(polygon) >= 3 and np.abs(polygon).max() <= 1.0 + 1e-12
    _, inside = resampled(linear_volume(), matrix, 60, 50)
    x = (np.arange(60) + 0.5) / 30.0 - 1.0
    y = 1.0 - (np.arange(50) + 0.5) / 25.0
    xx, yy = np.meshgrid(x, y)
    ends = np.roll(polygon, -1, axis=0)
    left = [
        (b[0] - a[0]) * (yy - a[1]) - (b[1] - a[1]) * (xx - a[0]) >= -1e-9 for a, b in zip(polygon, ends)
    ]  # fmt: skip
    clear = ~at_edge(pixel_places(matrix, 60, 50))
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(np.logical_and.reduce(left)[clear], inside[clear])


def test_a_polygon_outside_the_volume_is_empty_and_a_fitted_one_whole():
    volume = linear_volume()
    whole = slices.cut_polygon(SHAPE, slices.slice_matrix(volume, 1))
    np.testing.assert_allclose(np.sort(whole, axis=0), [[-1, -1], [-1, -1], [1, 1], [1, 1]])
    beyond = slices.slice_matrix(volume, 1)
    beyond[1, 3] = SHAPE[1]
    assert len(slices.cut_polygon(SHAPE, beyond)) == 0


def test_a_draft_has_at_most_so_many_pixels_and_the_slices_shape():
    volume = linear_volume()
    matrix = slices.slice_matrix(volume, 2)
    assert slices.slice_size(volume, matrix) == (9, 7)
    assert slices.slice_size(volume, matrix, 1000) == (9, 7)
    width, height = slices.slice_size(volume, matrix, 16)
    assert width * height <= 16 and (width, height) == (4, 3)


def test_bands_of_rows_are_the_whole_slice(monkeypatch):
    volume, matrix = linear_volume(), slices.slice_matrix(linear_volume(), 1)
    whole = resampled(volume, matrix, 31, 24)
    monkeypatch.setattr(slices, "PIXELS_A_STEP", 100)
    fractions = list(slices.resample_steps(volume, matrix, 31, 24))
    assert len(fractions) == 8 and fractions[-1] == 1.0
    for one, other in zip(resampled(volume, matrix, 31, 24), whole):
        np.testing.assert_array_equal(one, other)


def area_of(triangles):
    edges = triangles[:, 1:] - triangles[:, :1]
    return 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]).sum()


def test_the_positive_part_of_a_slice_ends_where_its_levels_are_zero():
    x, y = (2.0 * np.arange(80) + 1.0) / 80 - 1.0, 1.0 - (2.0 * np.arange(60) + 1.0) / 60
    cone = 0.7 - np.hypot(x[None], y[:, None] - 0.1)
    for sign, area in ((1.0, np.pi * 0.7**2), (-1.0, 4.0 - np.pi * 0.7**2)):
        part = slices.positive_part(sign * cone)
        np.testing.assert_allclose(area_of(part), area, rtol=2e-3)  # chords for arcs
        corners = part.reshape(-1, 2)
        assert (sign * (0.7 - np.hypot(corners[:, 0], corners[:, 1] - 0.1)) > -2e-3).all()
    assert len(slices.positive_part(cone)) < 1000  # whole squares of a row are one


def test_all_of_a_slice_or_nothing_is_positive():
    np.testing.assert_allclose(area_of(slices.positive_part(np.ones((5, 7)))), 4.0)
    assert len(slices.positive_part(-np.ones((5, 7)))) == 0


def test_the_positive_part_of_a_plane_is_exact():
    x = (2.0 * np.arange(10) + 1.0) / 10 - 1.0
    tilted = np.broadcast_to(x - 0.25, (6, 10)) + (2.0 * np.arange(6)[:, None] - 5.0) / 6 * 0.3
    np.testing.assert_allclose(area_of(slices.positive_part(tilted)), 2.0 * 0.75, rtol=1e-2)
