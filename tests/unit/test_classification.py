"""Classification against a reading of the points voxel by voxel in plain Python; hard cases are in tests/stability."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest

from rle_splat.classify.classification import classify
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.scene import REMOVED_VALUES, Quality, RleSplatError, without_removed
from rle_splat.volume.volume import Volume
from tests.ways import BY_TYPE, both

LISTS = ("row_start", "column", "extinction", "opacity", "color")
STEPPED = TransferFunction(
    opacity=((10, 0.0), (50, 0.2), (50, 0.6), (80, 0.0), (100, 0.0), (120, 1.0)),
    color=((0, 0.0, 0.5, 1.0), (60, 1.0, 0.5, 0.25), (60, 2.0, 0.0, 0.0), (200, 0.0, 0.0, 4.0)),
)


def read_points(points, value):
    """Heights at ``value`` by walking the points: steps from the right, ends held."""
    if value < points[0][0]:
        return points[0][1:]
    for (x0, *y0), (x1, *y1) in pairwise(points):
        if x0 <= value < x1:
            return tuple(a + (b - a) * (value - x0) / (x1 - x0) for a, b in zip(y0, y1))
    return points[-1][1:]


def expected(volume, tf, world_distance):
    """(row, x, extinction, alpha, color) of every visible voxel, one after the other."""
    nx, ny, nz = volume.shape_xyz
    for z in range(nz):
        for y in range(ny):
            for x in range(nx):
                value = float(volume.voxels[z, y, x]) * volume.slope + volume.intercept
                if math.isnan(value):
                    continue
                (alpha,) = read_points(tf.opacity, value)
                if alpha > 0.0:
                    tau = 24 * math.log(2) if alpha == 1.0 else min(-math.log1p(-alpha), 24 * math.log(2))
                    yield z * ny + y, x, tau / world_distance, alpha, read_points(tf.color, value)


def assert_as_expected(classified, volume, tf, world_distance=1.0):
    rows, xs, extinction, alpha, color = zip(*expected(volume, tf, world_distance))
    got_rows = np.repeat(np.arange(len(classified.row_start) - 1), np.diff(classified.row_start))
    np.testing.assert_array_equal(got_rows, rows)
    np.testing.assert_array_equal(classified.column, xs)
    np.testing.assert_allclose(classified.extinction, extinction, rtol=2e-7)
    np.testing.assert_allclose(classified.opacity, alpha, rtol=2e-7)
    np.testing.assert_allclose(classified.color, color, rtol=2e-7, atol=1e-7)


def grid(dtype, shape=(5, 7, 11), seed=3):
    kind = np.dtype(dtype).kind
    values = np.random.default_rng(seed).integers(-20 if kind != "u" else 0, 125, shape)
    return Volume((values + (0.25 if kind == "f" else 0)).astype(dtype), np.eye(4))


@pytest.mark.parametrize(("dtype", "way"), BY_TYPE, indirect=["way"])
def test_every_stored_type_is_classified_as_its_points_say(dtype, way):
    volume = grid(dtype)
    classified = classify(volume, STEPPED, np.eye(4))
    assert_as_expected(classified, volume, STEPPED)
    assert classified.row_start.dtype == np.int64 and classified.column.dtype == np.uint16


@pytest.mark.parametrize("dtype", "uint8 int16 int32 float32 float64".split())
def test_kernel_and_reference_agree_to_the_bit(dtype):
    volume = grid(dtype, (9, 13, 70), seed=8)
    one, two = both(lambda: classify(volume, STEPPED, np.eye(4)))
    for name in LISTS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_the_number_of_threads_changes_nothing():
    volume = grid("float32", (9, 13, 70))
    one, two = (classify(volume, STEPPED, np.eye(4), threads=n) for n in (1, 2))
    for name in LISTS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_slope_and_intercept_come_before_the_points(way):
    stored = np.arange(-30, 34, dtype=np.int16).reshape(4, 4, 4)
    volume = Volume(stored, np.eye(4), slope=-2.5, intercept=40.0)
    assert_as_expected(classify(volume, STEPPED, np.eye(4)), volume, STEPPED)
    same = Volume(stored.astype(np.float64), np.eye(4), slope=-2.5, intercept=40.0)
    assert_as_expected(classify(same, STEPPED, np.eye(4)), volume, STEPPED)


def test_a_step_is_decided_by_the_rounded_physical_value(way):
    # 3 * 0.1 rounds to just above 0.3; fused with the intercept it would not.
    tf = TransferFunction(opacity=((0.1 * 3 + 0.7, 0.0), (0.1 * 3 + 0.7, 0.5)), color=((0, 1, 1, 1),))
    for dtype in (np.uint8, np.float32):
        stored = np.arange(8, dtype=dtype).reshape(2, 2, 2)
        volume = Volume(stored, np.eye(4), slope=0.1, intercept=0.7)
        classified = classify(volume, tf, np.eye(4))
        assert classified.visible_voxels == int((stored.astype(float) * 0.1 + 0.7 >= 0.1 * 3 + 0.7).sum())


def test_opacity_is_per_length_in_the_world():
    volume = Volume(np.full((2, 2, 2), 120, np.uint8), np.diag((2.0, 3.0, 0.5, 1.0)))
    tf = TransferFunction(opacity=((0, 0.25),), color=((0, 1, 1, 1),))
    tau = -math.log1p(-0.25)
    for scale in (1e-12, 0.001, 1.0, 1e12):
        classified = classify(volume, tf, np.diag((scale, scale, scale, 1.0)) @ volume.affine)
        assert classified.unit_length == pytest.approx(scale, rel=1e-12)
        np.testing.assert_allclose(classified.extinction, tau / (0.5 * scale), rtol=1e-6)
    # A turn, a shear and a mirror keep volumes, so they keep the length too.
    shear = np.array([[0.0, -1.0, 0.7, 5.0], [1.0, 0.0, 0.3, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    assert classify(volume, tf, shear @ volume.affine).unit_length == pytest.approx(1.0)
    own = TransferFunction(opacity=((0, 0.25),), color=((0, 1, 1, 1),), opacity_unit_distance=4.0)
    np.testing.assert_allclose(classify(volume, own, volume.affine).extinction, tau / 4.0, rtol=1e-6)


def test_a_flat_matrix_is_refused():
    volume = Volume(np.ones((2, 2, 2), np.uint8), np.eye(4))
    with pytest.raises(RleSplatError, match="flat"):
        classify(volume, STEPPED, np.diag((1.0, 1.0, 0.0, 1.0)))


def test_values_at_the_ends_of_float64_hold_the_end_heights_without_a_warning(way):
    """One over the gap of the points times the distance to them is beyond float64: an overflow, yet no fault."""
    function = TransferFunction(
        opacity=((0.0, 0.25), (1e-200, 0.5)), color=((0.0, 1.0, 0.0, 0.0), (1e-200, 0.0, 1.0, 0.0))
    )
    values = np.array([-1e300, -1.0, 0.0, 0.5e-200, 1e-200, 1.0, 1e300]).reshape(1, 1, -1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = classify(Volume(values, np.eye(4)), function, np.eye(4))
    np.testing.assert_allclose(found.opacity, (0.25, 0.25, 0.25, 0.375, 0.5, 0.5, 0.5), rtol=1e-6)
    np.testing.assert_allclose(found.color[:, 0], (1.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0), atol=1e-6)


OLD = {"record": 8, "kernel": "bspline3"}  # knobs of earlier versions


@pytest.mark.parametrize(("make", "quality", "used"), (
    (lambda: Quality("refined"), Quality(), "'post'"),
    (lambda: Quality(classification="refined", **OLD), Quality(), "'post' with the kernel tent and the record 16"),
    (lambda: Quality.preset("fine", "refined"), Quality.preset("fine"), "'post'"),
    (lambda: Quality.preset("fine", "pre").classified("refined"), Quality.preset("fine"), "'post'"),
    (lambda: Quality(classification="refined", minification="pool"), Quality(), "'post' with the minification off"),
))  # fmt: skip
def test_a_classification_that_was_removed_is_replaced_and_a_sentence_says_so(make, quality, used):
    with pytest.warns(FutureWarning) as found:
        assert make() == quality
    assert [str(one.message) for one in found] == [f"The classification 'refined' was removed; {used} is used instead."]


@pytest.mark.parametrize(("field", "old", "new"), [
    (field, *row) for field, rows in REMOVED_VALUES.items() if field != "classification" for row in rows.items()
])  # fmt: skip
def test_a_value_that_was_removed_is_replaced_and_a_sentence_says_so(field, old, new):
    with pytest.warns(FutureWarning) as found:
        assert Quality.preset("fine", "pre", **{field: old}) == Quality.preset("fine", "pre", **{field: new})
    assert [str(one.message) for one in found] == [f"The {field} {old!r} was removed; {new!r} is used instead."]


def test_fields_that_were_removed_are_left_out_of_what_files_of_earlier_versions_say():
    said = {"classification": "post", "refinement": 3, "backend": "numpy", "threads": 2}
    assert without_removed(said) == ({"classification": "post", "threads": 2}, ())
    for field in ("refinement", "backend"):
        with pytest.raises(TypeError, match=field):
            Quality(**{field: said[field]})
