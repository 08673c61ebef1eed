"""Indexed splatting: bisection in sorted slices finds the voxels that classification finds, whatever the data."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.classification import classify
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.comparison import ihm_lee, ours
from rle_splat.volume.volume import Volume

COLORS = ((0.0, 1.0, 0.5, 0.2), (100.0, 0.1, 0.4, 0.9))
OPACITIES = {
    "window": ((30.0, 0.0), (60.0, 0.5), (90.0, 0.0)),
    "two ranges": ((10.0, 0.0), (15.0, 0.2), (20.0, 0.0), (70.0, 0.0), (80.0, 0.9), (120.0, 0.3)),
    "step": ((50.0, 0.0), (50.0, 0.7)),
    "single value": ((40.0, 0.0), (40.0, 0.5), (40.0, 0.0)),
    "everything": ((0.0, 0.1),),
    "nothing": ((0.0, 0.0),),
}


def volume(kind: str) -> Volume:
    values = np.random.default_rng(11).uniform(0.0, 127.0, (7, 9, 13))
    if kind == "float32":
        values[2, 3, 4:7] = np.nan
        values[1, 0, 0], values[6, 8, 12] = np.inf, -np.inf
        return Volume(values.astype(np.float32), np.eye(4))
    if kind == "falling":
        return Volume(values.astype(np.int16), np.diag((1.0, 1.0, 2.0, 1.0)), slope=-0.5, intercept=90.0)
    return Volume(values.astype(kind), np.eye(4))


def same(found, expected):
    for name in ("row_start", "column", "extinction", "opacity", "color"):
        a, b = getattr(found, name), getattr(expected, name)
        assert a.dtype == b.dtype, name
        np.testing.assert_array_equal(a, b, name)
    np.testing.assert_array_equal(found.voxels.row_pieces, expected.voxels.row_pieces)
    for name in ("shape_xyz", "nan_voxels", "unit_length", "opacity_distance"):
        assert getattr(found, name) == getattr(expected, name), name


@pytest.mark.parametrize("kind", ("uint8", "int16", "int32", "float32", "falling"))
@pytest.mark.parametrize("shape", OPACITIES)
def test_finds_what_classification_finds(kind, shape):
    data = volume(kind)
    index = ihm_lee.index_volume(data)
    function = TransferFunction(shape, None, OPACITIES[shape], COLORS, None, None)
    same(ihm_lee.classify_shown(index, data, function, data.affine), classify(data, function, data.affine))


def test_the_index_serves_every_window():
    data = volume("uint8")
    index = ihm_lee.index_volume(data)
    kept = [np.copy(index.order), np.copy(index.values)]
    seen = set()
    for low in (0.0, 20.0, 55.0):
        function = TransferFunction("window", None, ((low, 0.0), (low + 30.0, 1.0)), COLORS, None, None)
        found = ihm_lee.classify_shown(index, data, function, data.affine)
        same(found, classify(data, function, data.affine))
        seen.add(found.visible_voxels)
    assert len(seen) == 3
    np.testing.assert_array_equal(index.order, kept[0])
    np.testing.assert_array_equal(index.values, kept[1])


def test_sorted_slices_and_their_size():
    data = volume("float32")
    index = ihm_lee.index_volume(data)
    slices = data.voxels.reshape(7, -1)
    for k in range(7):
        np.testing.assert_array_equal(slices[k][index.order[k]], index.values[k])
        assert sorted(index.order[k].tolist()) == list(range(9 * 13))
        assert (np.diff(index.values[k, : index.numbers[k]]) >= 0).all()
    assert index.numbers.tolist() == [117, 117, 114, 117, 117, 117, 117]
    assert index.nbytes == 7 * 117 * (2 + 4) + 7 * 8


@pytest.mark.parametrize("rows", (1, 3))
def test_rows_of_shown_voxels_may_be_full_or_not(rows, monkeypatch):
    """The last row of the small volume that is classified holds fillers; they are left out again."""
    data = volume("uint8")
    function = TransferFunction("all", None, ((0.0, 0.3),), COLORS, None, None)
    monkeypatch.setattr(ihm_lee, "ROW", 7 * 9 * 13 // rows + (rows == 1))
    same(
        ihm_lee.classify_shown(ihm_lee.index_volume(data), data, function, data.affine),
        classify(data, function, data.affine),
    )


def test_draws_what_ours_draws(stand):
    data = volume("uint8")
    function = TransferFunction("window", None, OPACITIES["window"], COLORS, 1.0, None)
    scene = stand.scene(data.voxels, function=function)
    medium = stand.medium(replace(scene))
    prepared = ihm_lee.prepare(medium, stand.quality)
    np.testing.assert_array_equal(prepared.draw().rgba, ours.prepare(medium, stand.quality).draw().rgba)
    assert prepared.memory_bytes["index"] == prepared.notes["index_bytes"] == 7 * 117 * (2 + 1) + 7 * 8
    assert prepared.notes["three_axes_of_records_bytes"] == 48 * medium.classified.visible_voxels
