"""The tables of a scalar volume: three axes that decode to the voxels, scalars and codes there are."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.encode.scalars import NOT_A_NUMBER, scalars_of
from rle_splat.pipeline.scalar_source import ScalarSource
from rle_splat.pipeline.source import Work
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import Clock, drain
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import STORED_TYPES, Volume
from tests.unit.test_relevant import corners_of, ends_of_cells

SHAPE = (9, 10, 12)
# Where decoded tables lie in (nz, ny, nx): principal x has slices of x, scanlines along y; y and z have them along x.
VOXEL_OF = {0: lambda k, j, i: (j, i, k), 1: lambda k, j, i: (j, k, i), 2: lambda k, j, i: (k, j, i)}
# Where the values of a type begin, so that all of its sign and width is used.
BEGIN = {"int8": -60, "int16": -30000, "uint16": 65000, "int32": -2_000_000_000, "uint32": 4_294_960_000,
         "float64": 1e9}  # fmt: skip
LIGHT_STEP = 2.0**-12  # relative error of a code


def waves(seed=0):
    """(9, 10, 12) float64 from 0 to 120."""
    z, y, x = np.indices(SHAPE)
    return 60.0 + 40.0 * np.sin(0.9 * x + 0.3 * y + seed) + 20.0 * np.cos(0.8 * z - 0.4 * y)


def scene_of(volume, begin=0.0, shade=None, **more):
    """A scene that shows values 50 to 70 above ``begin``."""
    tf = TransferFunction(
        opacity=((begin + 50, 0.0), (begin + 60, 0.5), (begin + 70, 0.0)), color=((begin, 1, 0.5, 0.2),), shade=shade
    )
    camera, matrix = turntable(volume, 20.0, 10.0)
    return Scene(volume, tf, camera, 16, 16, matrix, **({"headlight": False} | more))


def encoded(scene, axes=(0, 1, 2), **machine):
    """The ScalarVolume of each axis, and the number of voxels."""
    quality = Quality(classification="post", **machine)
    medium = drain(ScalarSource(scene, quality).medium_steps(Work(StageCache(0).job(), Clock(), len(axes))))
    return drain(medium.encode_steps(axes))


def decoded(table, records):
    """{(z, y, x): record} by walking slices, scanlines and runs one at a time, as the paper's words have it."""
    tables, found, count = table.tables, {}, 0
    for k in range(tables.n_slices):
        assert tables.data_pointers[k] == count
        for j in range(tables.n_scanlines):
            run, x = int(tables.scanline_pointers[k, j]), 0
            at = int(tables.scanline_data_pointers[k, j])
            assert at == count or table.axis == 1, "y has its records where z has them"
            while run >= 0 and x < tables.width:
                x += int(tables.runs[run])
                for _ in range(int(tables.runs[run + 1]) if x < tables.width else 0):
                    found[VOXEL_OF[table.axis](k, j, x)] = records[at]
                    at, count, x = at + 1, count + 1, x + 1
                run += 2
    assert count == tables.n_voxels == len(records)
    return found


def shown_corners(values, low, high):
    """(nz, ny, nx) bool: corners of cells that reach into (low, high); none of a cell with a NaN."""
    least, largest = ends_of_cells(values)
    with np.errstate(invalid="ignore"):
        return corners_of((least < high) & (largest > low))


@pytest.mark.parametrize(
    ("dtype", "way"),
    [*((kind, "numpy") for kind in STORED_TYPES), ("uint8", "numba"), ("float32", "numba")],
    indirect=["way"],
)
def test_three_axes_decode_to_the_voxels_and_their_values(dtype, way):
    begin = BEGIN.get(dtype, 0)
    values = waves() + (0.25 if np.dtype(dtype).kind == "f" else 0.0)
    volume = Volume((begin + values).astype(dtype), np.eye(4))
    tables = encoded(scene_of(volume, begin))
    stored = volume.voxels.astype(np.float64)
    kept = shown_corners(stored, begin + 50, begin + 70)
    assert 0.3 < kept.mean() < 0.95
    own = np.dtype(dtype).itemsize <= 2 or dtype == "float32"
    for axis, table in tables.items():
        assert table.axis == axis and table.codes is None and table.light is None
        assert table.scalars.dtype == (np.dtype(dtype) if own else np.float32)
        assert table.record == table.scalars.itemsize and (table.center == 0.0 or not own)
        found = decoded(table, table.scalars)
        assert set(found) == set(zip(*(at.tolist() for at in np.nonzero(kept)), strict=True))
        for index, scalar in found.items():
            if own:
                assert scalar == volume.voxels[index]
            else:  # float32 of what is left beside the middle of all values: its width, not its size, is what counts
                assert abs(float(scalar) + table.center - stored[index]) <= 2.0**-24 * 60.5


def test_infinite_values_are_the_functions_ends_and_nan_is_never_kept():
    """V6 and V7, at either sign of the slope and beside values beyond the function's points."""
    for dtype in (np.float32, np.float64):
        for slope in (1.0, -1.0):
            values = waves().astype(dtype)
            values[2:4, 2:5, 3:6], values[6, 6, 6:9] = np.inf, -np.inf
            values[0, 0, 0], values[8, 9, 11], values[5, 2, 2] = 500.0, -300.0, np.nan
            volume = Volume(slope * values, np.eye(4), slope=slope)
            scene = scene_of(volume)
            table = encoded(scene, axes=(2,))[2]
            found = decoded(table, table.scalars)
            finite = np.clip(values, 0.0, 70.0)  # all points, those of the color too
            checked = 0
            for index, scalar in found.items():
                assert not np.isnan(values[index]) and np.isfinite(scalar)
                if np.isinf(values[index]):
                    assert float(scalar) + table.center == pytest.approx(slope * finite[index], abs=1e-4)
                    checked += 1
            assert checked > 10


@pytest.mark.parametrize("kind", ("float32", "float64"))
def test_scalars_that_are_no_numbers(kind):
    """What the sheets' own arithmetic must be safe from: NaN is what is not kept, huge values stay finite."""

    class Voxels:
        stored = np.array((np.nan, np.inf, -np.inf, 3.0, 1e38, -1e38), kind)

    found = scalars_of(Voxels, np.dtype(kind), (-5.0, 7.0), 1.0)
    np.testing.assert_array_equal(found, np.float32((NOT_A_NUMBER, 6.0, -6.0, 2.0, 1e37, -1e37)))


def test_bit_patterns_of_signed_values():
    """Voxels of 8 and 16 bits that come as unsigned patterns are the signed numbers they stand for."""
    for kind in (np.int8, np.int16):
        values = np.array((-100, -1, 0, 1, 100), kind)

        class Voxels:
            stored = values.view(f"u{values.itemsize}")

        found = scalars_of(Voxels, kind, (), 0.0)
        assert found.dtype == kind
        np.testing.assert_array_equal(found, values)


def test_a_range_without_a_voxel():
    volume = Volume(waves().astype(np.float32), np.eye(4))
    for table in encoded(scene_of(volume, 1e4)).values():
        assert len(table.scalars) == 0 and decoded(table, table.scalars) == {}


# --- codes ------------------------------------------------------------------------------------------------------


def test_codes_of_all_axes_and_any_number_of_threads():
    shade = Shade(0.1, 0.6, 0.5, 17.5)
    matrix = np.diag((1.0, -1.1, 0.9, 1.0))
    scene = replace(scene_of(Volume(waves(), np.eye(4)), shade=shade, headlight=True), volume_matrix=matrix)
    alone, together = (encoded(scene, threads=threads) for threads in (1, 2))
    z = decoded(alone[2], alone[2].codes)
    assert alone[2].codes.dtype == np.int16 and alone[2].codes.shape[1] == alone[2].light.planes == 3
    assert alone[2].record == 4 + 6 and np.abs(alone[2].codes).max() > 10000
    for axis in (0, 1, 2):
        np.testing.assert_array_equal(alone[axis].codes, together[axis].codes)
        found = decoded(alone[axis], alone[axis].codes)
        assert set(found) == set(z) and all((found[index] == z[index]).all() for index in z)
