"""Proves the segment tools against SimpleITK and against distances measured voxel by voxel."""

import numpy as np
import pytest

from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.segment import label_map, masks
from rle_splat.volume.volume import Volume

itk = pytest.importorskip("SimpleITK")
SPACING = np.array((0.7, 1.1, 1.9))
SHAPE = (9, 14, 17)  # z, y, x


def blobs(seed=3, share=0.35):
    """A mask of rough pieces, some at the sides."""
    noise = np.random.default_rng(seed).random(SHAPE)
    smooth = sum(np.roll(noise, shift, axis) for axis in range(3) for shift in (-1, 0, 1))
    return smooth > np.quantile(smooth, 1.0 - share)


def distances_to(mask):
    """(nz, ny, nx): from each voxel to the nearest one of a mask, every pair measured."""
    places = np.stack(np.indices(SHAPE), -1).reshape(-1, 3) * SPACING[::-1]
    others = places[mask.ravel()]
    return np.array([np.linalg.norm(others - place, axis=1).min() for place in places]).reshape(SHAPE)


@pytest.mark.parametrize("length", [0.65, 1.0, 2.6])
def test_growing_and_shrinking_move_the_boundary_by_the_distance(length):
    mask = blobs()
    mask[:, :, :3] = mask[:2] = False  # its box is smaller than the volume
    np.testing.assert_array_equal(drain(masks.grow_steps(mask, SPACING, length)), distances_to(mask) <= length)
    np.testing.assert_array_equal(drain(masks.shrink_steps(mask, SPACING, length)), distances_to(~mask) > length)


def test_smoothing_is_an_opening_and_a_closing():
    mask, length = blobs(share=0.6), 1.2
    opened = distances_to(~mask) > length
    opened = distances_to(opened) <= length
    closed = distances_to(~(distances_to(opened) <= length)) > length
    assert 0 < np.count_nonzero(mask != closed)
    np.testing.assert_array_equal(drain(masks.smooth_steps(mask, SPACING, length)), closed)
    single = np.zeros(SHAPE, bool)
    single[4, 5, 6] = True
    with pytest.raises(RleSplatError, match=r"as thick as 2\.4; smooth it less"):
        drain(masks.smooth_steps(single, SPACING, length))


def image_of(mask):
    return itk.GetImageFromArray(mask.astype(np.uint8))


@pytest.mark.parametrize("seed", range(4))
def test_parts_and_holes_are_those_of_another_library(seed):
    mask = blobs(seed, 0.3)
    parts = itk.GetArrayFromImage(itk.RelabelComponent(itk.ConnectedComponent(image_of(mask), False)))
    assert parts.max() > 2
    np.testing.assert_array_equal(drain(masks.keep_largest_steps(mask)), parts == 1)
    for number in (1, 2, parts.max()):
        z, y, x = np.argwhere(parts == number)[0]
        np.testing.assert_array_equal(drain(masks.connect_steps(mask, (x, y, z))), parts == number)
    shells = blobs(seed, 0.75)
    filled = itk.GetArrayFromImage(itk.BinaryFillhole(image_of(shells), False)) > 0
    assert (filled != shells).any()
    np.testing.assert_array_equal(drain(masks.fill_steps(shells)), filled)


def test_values_between_two_bounds():
    stored = np.arange(60, dtype=np.uint8).reshape(3, 4, 5)
    volume = Volume(stored, np.eye(4), slope=-2.0, intercept=10.0)
    found = drain(masks.threshold_steps(volume, -20.0, 4.0))
    np.testing.assert_array_equal(found, (stored >= 3) & (stored <= 15))
    with pytest.raises(RleSplatError, match="exchange them"):
        drain(masks.threshold_steps(volume, 2.0, 1.0))
    with pytest.raises(RleSplatError, match="No voxel has a value from 90 to 95"):
        drain(masks.threshold_steps(volume, 90.0, 95.0))


@pytest.mark.parametrize(
    ("steps", "problem"),
    [
        (lambda mask: masks.connect_steps(mask, (0, 0, 0)), "Nothing is visible at this place"),
        (lambda mask: masks.connect_steps(mask, (-1, 4, 4)), "Nothing is visible at this place"),
        (lambda mask: masks.grow_steps(mask, SPACING, 0.0), "must be above 0, not 0"),
        (lambda mask: masks.shrink_steps(mask, SPACING, float("nan")), "must be above 0, not nan"),
        (lambda mask: masks.fill_steps(mask & False), "has no voxels"),
    ],
)
def test_bad_input(steps, problem):
    mask = np.zeros(SHAPE, bool)
    mask[3:6, 4:8, 4:8] = True
    with pytest.raises(RleSplatError, match=problem):
        drain(steps(mask))


@pytest.mark.parametrize(("module", "tool"), [("edt", masks.grow_steps), ("cc3d", masks.fill_steps)])
def test_without_a_library_there_is_one_sentence(module, tool, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(RleSplatError, match=r"Segment tools need the package .* which this Python lacks; install it"):
        drain(tool(blobs(), SPACING, 1.0) if tool is masks.grow_steps else tool(blobs()))


def test_a_mask_becomes_a_segment():
    voxels = np.zeros(SHAPE, np.uint8)
    voxels[2:5], voxels[5:] = 7, 255
    labels = Volume(voxels, np.eye(4))
    mask = np.zeros(SHAPE, bool)
    mask[0, :2], mask[4] = True, True
    number = label_map.free_number(labels)
    assert number == 256
    over = label_map.put_segment(labels, number, mask)
    assert over.voxels.dtype == np.int16 and (over.voxels[mask] == 256).all()
    np.testing.assert_array_equal(over.voxels[~mask], voxels[~mask])
    under = label_map.put_segment(labels, 7, mask, over_others=False)
    expected = np.where(voxels == 7, 0, voxels)
    expected[0, :2] = expected[4] = 7
    np.testing.assert_array_equal(under.voxels, expected)
    assert labels.voxels[0, 0, 0] == 0, "the map of before is as it was"
    with pytest.raises(RleSplatError, match="No voxel would be in the segment"):
        label_map.put_segment(labels, 9, voxels == 255, over_others=False)
    largest = Volume(np.full(SHAPE, 2**31 - 1, np.int32), np.eye(4))
    with pytest.raises(RleSplatError, match=r"number 2147483648; a segment can be added where all are below"):
        label_map.put_segment(largest, label_map.free_number(largest), mask)
    negative = Volume(np.full(SHAPE, -5, np.int8), np.eye(4))
    found = label_map.put_segment(negative, label_map.free_number(negative), mask)
    assert found.voxels.dtype == np.int16 and set(found.voxels[mask]) == {1} and set(found.voxels[~mask]) == {-5}
