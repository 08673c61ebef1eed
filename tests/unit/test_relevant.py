"""Which voxels matter to sheets of the scalar, against a search of every cell with the truth's own reading of transfer
functions; kernels against their reference implementations; and which range of values covers which."""

import numpy as np
import pytest

from rle_splat.accuracy.transfer import piecewise_linear
from rle_splat.classify.relevant import Reach, count_kept, gather_kept, relevant_steps
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.runtime.jit import use_reference
from rle_splat.runtime.steps import drain
from rle_splat.volume.blocks import block_steps
from rle_splat.volume.volume import STORED_TYPES, Volume
from tests.ways import NUMPY

COMPILED = ("uint8", "int16", "float32", "float64")  # one of each kind: kernels are the same source for all
# Below, at and beyond a block (8, 8, 32) and a word of 64 voxels; without a cell; with just one.
SHAPES = ((9, 17, 130), (20, 9, 65), (8, 8, 32), (3, 7, 5), (9, 3, 66), (2, 2, 2), (1, 6, 9), (6, 1, 9), (6, 9, 1))
# Stored values and opacities; where the slope is below zero all of it is mirrored.
CURVES = {
    "ramps": ((40, 0.0), (50, 0.5), (60, 0.0)),
    "two of them": ((20, 0.0), (23, 0.5), (26, 0.0), (70, 0.0), (71, 0.4), (72, 0.0)),
    "step up": ((50, 0.0), (50, 0.6)),
    "step down": ((50, 0.6), (50, 0.0)),
    "steps between numbers": ((49.4, 0.0), (49.4, 0.3), (61.7, 0.2), (61.7, 0.0)),
    "between two whole numbers": ((50.2, 0.0), (50.3, 0.7), (50.4, 0.0)),
    "low values": ((30, 0.4), (45, 0.0)),
    "high values": ((75, 0.0), (90, 0.4)),
    "all": ((50, 0.3),),
    "nothing": ((50, 0.0),),
    "nothing that there is": ((150, 0.0), (160, 0.5), (170, 0.0)),
}


def function(points, volume=None):
    if volume is not None:
        points = [(float(volume.physical(value)), alpha) for value, alpha in points]
        points = points if volume.slope > 0.0 else points[::-1]
    return TransferFunction(opacity=tuple(points), color=((0, 1, 1, 1),))


def field(shape, dtype, seed=0):
    """Values from 0 to 120 in slow waves with some noise, so that cells are shown here and there."""
    random = np.random.default_rng(seed)
    z, y, x = np.ogrid[: shape[0], : shape[1], : shape[2]]
    waves = 60.0 + 55.0 * np.sin(0.15 * x + 0.1 * y + seed) * np.cos(0.2 * y - 0.25 * z)
    values = np.clip(waves + random.normal(0.0, 2.0, shape), 0.0, 120.0).astype(dtype)
    if values.dtype.kind == "f":
        values[random.random(shape) < 0.01] = np.nan
        values[random.random(shape) < 0.005] = np.inf
        values[random.random(shape) < 0.005] = -np.inf
    return values


EIGHT = tuple(tuple(slice(one, one - 1 or None) for one in corner) for corner in np.ndindex(2, 2, 2))


def ends_of_cells(values):
    """The least and the largest value at the corners of each cell; NaN where one is."""
    eight = [values[corner] for corner in EIGHT]
    return np.min(eight, axis=0), np.max(eight, axis=0)


def corners_of(cells):
    """(nz, ny, nx) bool: the corners of these cells."""
    kept = np.zeros(np.add(cells.shape, 1), bool)
    for corner in EIGHT:
        kept[corner] |= cells
    return kept


def searched(volume, tf):
    """(nz, ny, nx) bool: corners of cells between whose least and largest value opacity is above zero somewhere; no
    corner may be NaN, and what is infinite takes the end values."""
    knots = np.unique([value for value, *_ in (*tf.opacity, *tf.color)])
    values = volume.physical(volume.voxels)
    values = np.where(np.isinf(values), np.clip(values, knots[0] - 1.0, knots[-1] + 1.0), values)
    low, high = ends_of_cells(values)
    shown = np.zeros(low.shape, bool)
    # Between two knots opacity is above zero everywhere or nowhere: ends, knots and next to knots are all there is.
    tried = np.concatenate((knots, np.nextafter(knots, np.inf), np.nextafter(knots, -np.inf)))
    for value in (low, high, *(np.full(low.shape, one) for one in tried)):
        with np.errstate(invalid="ignore"):
            between = (low <= value) & (value <= high)
        shown |= between & (np.nan_to_num(piecewise_linear(tf.opacity, value)) > 0.0)
    return corners_of(shown)


def found(volume, tf, threads=0):
    """Words of bits, counts and the voxels that are kept."""
    blocks = drain(block_steps(volume, threads=threads))
    bits = drain(relevant_steps(volume, Reach.of(volume, tf), blocks, threads=threads))
    counted = count_kept(bits, threads=threads)
    return bits, counted, gather_kept(volume, bits, counted, blocks, threads=threads)


def mask_of(voxels):
    nx, ny, nz = voxels.shape_xyz
    mask = np.zeros((nz * ny, nx), bool)
    mask[np.repeat(np.arange(nz * ny), np.diff(voxels.row_start)), voxels.column] = True
    return mask.reshape(nz, ny, nx)


@pytest.mark.parametrize("slope", (1.0, -2.5))
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_kept_voxels_are_the_corners_of_the_cells_that_are_shown(dtype, slope):
    for n, shape in enumerate(SHAPES):
        volume = Volume(field(shape, dtype, n), np.eye(4), slope=slope, intercept=3.0)
        for name in list(CURVES)[n % 3 :: 3]:
            tf = function(CURVES[name], volume)
            with use_reference():
                bits, counted, voxels = found(volume, tf)
            mask = mask_of(voxels)
            np.testing.assert_array_equal(mask, searched(volume, tf), f"{name} {shape}")
            assert voxels.stored.tobytes() == volume.voxels[mask].tobytes()
            assert voxels.nan_voxels == np.isnan(volume.voxels).sum() and len(voxels) == mask.sum()
            rows = np.pad(mask.reshape(-1, shape[2]), ((0, 0), (1, 0)))
            np.testing.assert_array_equal(voxels.row_pieces, (rows[:, 1:] & ~rows[:, :-1]).sum(axis=1))
            if min(shape) == 1:
                assert not mask.any()
            if dtype not in COMPILED:
                continue
            compiled = found(volume, tf)
            np.testing.assert_array_equal(bits, compiled[0])
            for ours, theirs in zip(counted, compiled[1], strict=True):
                np.testing.assert_array_equal(ours, theirs)
            for part in ("row_start", "row_pieces", "column", "stored"):
                np.testing.assert_array_equal(getattr(voxels, part), getattr(compiled[2], part))
                assert getattr(voxels, part).dtype == getattr(compiled[2], part).dtype


@NUMPY
def test_the_curves_show_something_of_the_field_and_not_all(way):
    """The premise of the test above."""
    volume = Volume(field(SHAPES[0], np.int16), np.eye(4))
    shares = {name: mask_of(found(volume, function(curve))[2]).mean() for name, curve in CURVES.items()}
    assert shares.pop("all") == 1.0
    assert shares.pop("nothing") == shares.pop("nothing that there is") == 0.0
    assert all(0.02 < share < 0.98 for share in shares.values()), shares


def test_the_same_bits_from_any_number_of_threads():
    volume = Volume(field((26, 25, 70), np.uint8), np.eye(4))
    one, two = (found(volume, function(CURVES["ramps"]), threads)[0] for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_a_single_cell_at_every_border_of_blocks(way):
    """A step between two voxels, one at a time: its eight cells' corners, whatever blocks and words they lie in."""
    shape = (17, 17, 67)
    for z in (0, 7, 8, 16):
        for y in (0, 7, 8, 16):
            for x in (0, 31, 32, 63, 64, 66):
                voxels = np.zeros(shape, np.uint8)
                voxels[z, y, x] = 100
                kept = mask_of(found(Volume(voxels, np.eye(4)), function(((50, 0.0), (60, 0.5))))[2])
                around = tuple(slice(max(at - 1, 0), at + 2) for at in (z, y, x))
                assert kept[around].all() and kept.sum() == kept[around].size


def test_solid_infinity_takes_the_end_value(way):
    """V7: cells of which every corner is infinite are shown where the function's end is."""
    for slope in (1.0, -1.0):
        for sign in (1.0, -1.0):
            volume = Volume(np.full((3, 3, 3), sign * np.inf), np.eye(4), slope=slope)
            high = function(((0, 0.0), (1, 0.5)))
            low = function(((0, 0.5), (1, 0.0)))
            shown = [mask_of(found(volume, tf)[2]).all() for tf in (high, low)]
            assert shown == ([True, False] if slope * sign > 0.0 else [False, True])


@NUMPY
def test_the_largest_numbers_of_a_type(way):
    """Values at either end of their type, shown alone: the search for stored values ends there and not beside them."""
    for dtype in STORED_TYPES:
        limits = np.finfo(dtype) if np.dtype(dtype).kind == "f" else np.iinfo(dtype)
        ends = (limits.min, limits.max) if dtype != "float64" else (-1e300, 1e300)  # beyond is taken for infinity
        for slope in (1.0, -1.0, 1e-3):
            voxels = np.full((2, 4, 2), ends[0], dtype)
            voxels[:, 2:] = ends[1]
            volume = Volume(voxels, np.eye(4), slope=slope)
            low, high = sorted(float(volume.physical(end)) for end in ends)
            first = function(((low, 0.5), (np.nextafter(low, np.inf), 0.0)))
            last = function(((np.nextafter(high, -np.inf), 0.0), (high, 0.5)))
            for tf, rows in ((first, (0, 1, 2)), (last, (1, 2, 3))):
                rows = rows if slope > 0.0 else [3 - row for row in rows]
                kept = mask_of(found(volume, tf)[2])
                assert kept[:, rows].all() and kept.sum() == 12, (dtype, slope)


def reach_of(*points, dtype=np.int16, slope=1.0):
    volume = Volume(np.zeros((2, 2, 2), dtype), np.eye(4), slope=slope)
    return Reach.of(volume, function(points))


@pytest.mark.parametrize("slope", (1.0, -1.0))
@pytest.mark.parametrize("dtype", (np.int16, np.float32))
def test_what_covers_what(dtype, slope):
    def reach(*points):
        return reach_of(*points, dtype=dtype, slope=slope)

    wide, same = reach((10, 0.0), (20, 0.5), (90, 0.0)), reach((10, 0.0), (50, 0.1), (90, 0.0))
    narrow = reach((30, 0.0), (40, 0.5), (50, 0.0))
    apart = reach((10, 0.0), (11, 0.5), (20, 0.0), (70, 0.0), (71, 0.5), (80, 0.0))
    over = reach((80, 0.0), (85, 0.5), (95, 0.0))
    nothing, all_of_it = reach((50, 0.0)), reach((50, 0.5))
    assert wide.covers(same) and same.covers(wide) and wide.key == same.key
    assert wide.covers(narrow) and not narrow.covers(wide)
    assert wide.covers(apart) and not apart.covers(wide) and not apart.covers(narrow)
    assert not wide.covers(over) and not over.covers(wide)
    for one in (wide, narrow, apart, over, nothing):
        assert all_of_it.covers(one) and one.covers(nothing) and one.covers(one)
    assert not nothing.covers(narrow) and not wide.covers(all_of_it)


@NUMPY
def test_what_is_covered_keeps_no_other_voxel(way):
    """The promise that a kept range is used by: of random functions, whoever covers another keeps all that it does."""
    random = np.random.default_rng(3)
    volume = Volume(field((9, 9, 40), np.uint8, 4), np.eye(4))
    functions = []
    for _ in range(24):
        ends = np.sort(random.uniform(0.0, 120.0, 4))
        heights = (0.0, *random.choice((0.0, 0.4), 2), 0.0)
        functions.append(function(tuple(zip(ends.tolist(), heights))))
    reaches = [Reach.of(volume, tf) for tf in functions]
    masks = [mask_of(found(volume, tf)[2]) for tf in functions]
    covering = 0
    for a, reach in enumerate(reaches):
        for b, other in enumerate(reaches):
            if a != b and reach.covers(other):
                assert not (masks[b] & ~masks[a]).any()
                covering += masks[b].any()
    assert covering > 5


def test_blocks_without_what_is_shown_are_not_looked_at():
    """``of_blocks`` names every block that holds a kept voxel, and few others."""
    voxels = np.zeros((40, 40, 160), np.float32)
    voxels[18:22, 20, 70:74] = 100.0
    voxels[0:8, 0:8, 0:32] = np.nan
    volume = Volume(voxels, np.eye(4))
    blocks = drain(block_steps(volume))
    reach = Reach.of(volume, function(((50, 0.0), (60, 0.5))))
    near = reach.of_blocks(blocks)
    kept = searched(volume, function(((50, 0.0), (60, 0.5))))
    held = kept.reshape(5, 8, 5, 8, 5, 32).any(axis=(1, 3, 5))
    assert held.any() and (near[held] > 0).all() and near.sum() <= 27
