"""Values from file to voxel, V6 to V13 of the catalogue: what is no number or beyond the ends, gradients, transfer
functions with steps, and stored types, under every classification.  Opacities and colors at their ends:
test_values.py."""

import gzip
import math
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.classify.classification import classify, optical_depth
from rle_splat.classify.lookup_table import lookup_table
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.read.formats import read_volume
from rle_splat.scene import Quality, RleSplatError
from rle_splat.shade.lighting import lighting
from rle_splat.shade.shading import shaded_colors
from rle_splat.volume.gradient import unit_normals
from rle_splat.volume.volume import STORED_TYPES, Volume
from tests.stability.scenes import FINER, STEPPED, columns, drawn, from_above, noise, transfer, turned, unlike

BITS = "differing bits"
LISTS = ("row_start", "column", "extinction", "opacity", "color")
every_finer = pytest.mark.parametrize("classification", FINER)


def lists_unlike(one, two) -> int:
    """How many entries of two ClassifiedVolumes differ."""
    return sum(unlike(getattr(one, name), getattr(two, name)) for name in LISTS)


def against_oracle(scene, classification, **knobs):
    """The Difference of a fine picture, termination off, from the truth of its classification."""
    true = truth(scene, "T1" if classification == "pre" else "T2", tolerance=1e-6)[0]
    fine = dict(depth_rule="midpoint-8", sheet_density=4.0, termination=0.0)
    picture = drawn(scene, classification, **(fine | knobs))
    return difference(picture, true.reshape(picture.shape))


# --- what is no number, or beyond the ends --------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ("float32", "float64"))
def test_V6_not_a_number_is_transparent_and_counted(record, dtype, way):
    values = noise(dtype)
    holes = np.random.default_rng(5).random(values.shape) < 0.2
    with_nan, with_air = values.copy(), values.copy()
    with_nan[holes], with_air[holes] = np.nan, 0.0
    one, two = (Volume(v, np.eye(4)) for v in (with_nan, with_air))
    first, second = (classify(v, STEPPED, np.eye(4)) for v in (one, two))
    assert first.nan_voxels == holes.sum() and second.nan_voxels == 0
    record(
        "V6",
        f"{BITS} of the optical properties, against those voxels transparent",
        lists_unlike(first, second),
        0,
        "either",
        "the same numbers in any width",
    )
    unshaded = replace(STEPPED, shade=None)
    quality = Quality(classification="pre")
    pictures = [render(turned(v, unshaded), quality) for v in (one, two)]
    assert f"{holes.sum()} voxels are not numbers" in " ".join(pictures[0].report["remarks"])
    record("V6", f"{BITS} of the picture", unlike(*(p.rgba for p in pictures)), 0, "either", "the same sums")
    shaded = render(turned(one, STEPPED), quality).rgba
    record("V6", "pixels that are not finite, shaded", (~np.isfinite(shaded)).sum(), 0, "either", "whole numbers")


@pytest.mark.parametrize("slope", (1.0, -1.0))
def test_V7_V9_infinities_and_data_beyond_the_ends(record, slope, way):
    ends = TransferFunction(opacity=((-5, 0.3), (0, 0.0), (5, 0.7)), color=((-5, 1, 0, 0), (5, 0, 1, 0)), shade=None)
    stored = np.array([-np.inf, np.inf, 1e308, -1e308, 5.0, -5.0, 0.0, 2.0]).reshape(2, 2, 2)
    held = np.clip(stored, -5, 5)
    one, two = (Volume(v, np.eye(4), slope=slope) for v in (stored, held))
    classified = [classify(v, ends, np.eye(4)) for v in (one, two)]
    assert classified[0].visible_voxels == 7 and classified[0].nan_voxels == 0
    why = "the same numbers in any width"
    pictures = [render(turned(v, ends), Quality(classification="pre")).rgba for v in (one, two)]
    for case in ("V7", "V9"):
        claim = f"{BITS} of the optical properties, against data clamped to the ends"
        record(case, claim, lists_unlike(*classified), 0, "either", why)
        record(case, f"{BITS} of the picture, against data clamped to the ends", unlike(*pictures), 0, "either", why)
    lit = render(turned(one, replace(ends, shade=Shade())), Quality(classification="pre")).rgba
    record("V7", "pixels that are not finite, shaded", (~np.isfinite(lit)).sum(), 0, "either", "whole numbers")


@every_finer
@pytest.mark.parametrize("dtype", ("float32", "float64"))
def test_V6_cells_with_a_corner_that_is_no_number_are_transparent(record, dtype, classification, way):
    values = noise(dtype)
    holes = np.random.default_rng(5).random(values.shape) < 0.04
    values[holes] = np.nan
    faint = replace(STEPPED, opacity=((10, 0.0), (50, 0.2), (120, 0.4)), shade=None)
    scene = turned(Volume(values, np.eye(4)), faint, 32)
    picture = render(scene, Quality(classification=classification))
    assert f"{holes.sum()} voxels are not numbers" in " ".join(picture.report["remarks"])
    assert np.isfinite(picture.rgba).all() and picture.rgba[..., 3].max() > 0.3
    if classification == "post":
        whole = turned(Volume(np.where(holes, 50.0, values).astype(dtype), np.eye(4)), faint, 32)
        with_holes, without = (against_oracle(one, classification).rmse for one in (scene, whole))
        claim = "RMSE from the oracle with NaN among the corners, over that without"
        record("V6", claim, with_holes / without, 1.5)
    lit = drawn(turned(Volume(values, np.eye(4)), replace(faint, shade=Shade()), 32), classification)
    record("V6", "pixels that are not finite, shaded", (~np.isfinite(lit)).sum(), 0, "either", "whole numbers")


@every_finer
@pytest.mark.parametrize("slope", (1.0, -1.0))
def test_V7_infinities_take_the_nearest_end_however_classified(record, slope, classification, way):
    ends = TransferFunction(opacity=((-5, 0.3), (0, 0.0), (5, 0.7)), color=((-5, 1, 0, 0), (5, 0, 1, 0)), shade=None)
    stored = np.random.default_rng(6).uniform(-5, 5, (5, 6, 7))
    stored[::2, ::3, ::2] *= np.inf
    one, two = (Volume(v, np.eye(4), slope=slope) for v in (stored, np.clip(stored, -5, 5)))
    pictures = [drawn(turned(v, ends), classification) for v in (one, two)]
    assert pictures[1][..., 3].max() > 0.3
    record(
        "V7",
        "difference from data clamped to the ends, steps of 255",
        255.0 * np.abs(pictures[0] - pictures[1]).max(),
        1e-3,
        "float32",
        "scalars of sheets are float32",
    )


@every_finer
@pytest.mark.parametrize("dtype", ("float32", "float64"))
@pytest.mark.parametrize("far", (101.0, 1e4, 1e30))
def test_V9_data_at_and_beyond_the_ends_however_classified(record, far, dtype, classification, way):
    """A block beyond the last point looks like one at it: to 1e30, a value that float32 holds."""
    held = TransferFunction(
        opacity=((0, 0.0), (100, 0.2)), color=((0, 0.0, 0.5, 1.0), (100, 1.0, 0.5, 0.25)), shade=None
    )
    pictures = [
        drawn(turned(Volume(np.full((6, 7, 8), value, dtype), np.eye(4)), held), classification)
        for value in (100.0, far)
    ]
    assert pictures[0][..., 3].max() > 0.5
    worst = 255.0 * np.abs(pictures[1] - pictures[0]).max()
    claim = "difference of a block beyond the ends from one at them, steps of 255"
    record("V9", claim, worst, 1e-3, "float32", "scalars of sheets are float32")


# --- gradients ------------------------------------------------------------------------------------------------


def all_normals(voxels) -> np.ndarray:
    volume = Volume(voxels, np.eye(4))
    nx, ny, nz = volume.shape_xyz
    rows, column = np.arange(nz * ny + 1, dtype=np.int64) * nx, np.tile(np.arange(nx, dtype=np.uint16), nz * ny)
    return unit_normals(volume, rows, column, np.eye(4)).reshape(*voxels.shape, 3)


@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_V8_a_constant_volume_has_no_normal_and_keeps_its_color(record, dtype, way):
    volume = Volume(np.full((4, 4, 4), 77, dtype), np.eye(4))
    with np.errstate(all="raise"):
        found = np.count_nonzero(all_normals(volume.voxels))
    record("V8", "components of normals other than 0", found, 0, "either", "whole numbers")
    white = TransferFunction(opacity=((0, 0.5),), color=((0, 0.2, 0.5, 1.0),))
    classified = classify(volume, white, np.eye(4))
    n = unit_normals(volume, classified.row_start, classified.column, np.eye(4))
    how = dict(headlight_direction=(0, 0, -1), eye=(0, 0, 1, 0))
    colors = shaded_colors(classified, n, lighting(np.eye(4), Shade(), (), **how))
    record(
        "V8",
        f"{BITS} of the shaded colors from the unshaded",
        unlike(colors, classified.color),
        0,
        "either",
        "the same numbers in any width",
    )


def test_V8_a_constant_volume_is_symmetric(record, way):
    cube = np.full((6, 6, 6), 50.0, np.float32)
    scene = from_above(cube, transfer(((0, 0.3),), ((0, 0.2, 0.5, 1.0),), shade=Shade()))
    picture = columns(replace(scene, headlight=True))
    worst = max(np.abs(picture - np.flip(picture, axis)).max() for axis in (0, 1))
    worst = max(worst, np.abs(picture - picture.transpose(1, 0, 2)).max())
    record("V8", "asymmetry of its picture, steps of 255", 255.0 * worst, 0.0)


@every_finer
def test_V8_a_constant_volume_is_symmetric_however_classified(record, classification, way):
    cube = np.full((6, 6, 6), 50.0, np.float32)
    plain = from_above(cube, transfer(((0, 0.3),), ((0, 0.2, 0.5, 1.0),)))
    shaded = replace(plain, transfer_function=replace(plain.transfer_function, shade=Shade()), headlight=True)
    pictures = [drawn(scene, classification) for scene in (plain, shaded)]
    assert pictures[0][..., 3].max() > 0.5
    if classification == "pre":  # with post the faces of its box are lit
        record("V8", f"{BITS} of the shaded picture from the unshaded", unlike(*pictures), 0)
    worst = max(np.abs(each - np.flip(each, axis)).max() for each in pictures for axis in (0, 1))
    record("V8", f"asymmetry of its picture, {classification}, steps of 255", 255.0 * worst, 0.01)


@pytest.mark.parametrize("dtype, mean, worst", (("float32", 0.35, 0.8), ("uint8", 0.4, 1.0)))
def test_V13_angles_on_a_sphere(record, dtype, mean, worst, way):
    z, y, x = np.indices((40, 40, 40)) - 19.5
    radius = np.sqrt(x * x + y * y + z * z)
    field = 255.0 / (1.0 + np.exp((radius - 13.0) / 1.5))
    voxels = np.rint(field).astype(dtype) if dtype == "uint8" else field.astype(dtype)
    edge = np.abs(radius - 13.0) < 1.5
    outward = np.stack((x, y, z), axis=-1)[edge] / radius[edge][:, None]
    angle = np.degrees(np.arccos(np.clip(-(all_normals(voxels)[edge] * outward).sum(axis=1), -1.0, 1.0)))
    why = "gradients are formed in float64 and kept as float32"
    record("V13", f"mean angle error on a sphere of {dtype}, degrees", angle.mean(), mean, "float32", why)
    record("V13", f"largest angle error on a sphere of {dtype}, degrees", angle.max(), worst, "float32", why)


def test_V13_below_the_noise_floor_there_is_no_normal(record, way):
    x = np.indices((5, 5, 40))[2]
    slow = (x // 8).astype(np.uint8)  # one step in eight voxels: mostly flat
    lone = np.zeros((5, 5, 5), np.uint8)
    lone[2, 2, 2] = 1  # one stray step: Sobel sees an eighth of it straight ahead
    flat = (x % 8 > 0) & (x % 8 < 7)
    wobble = 1000.0 * (1.0 + 2.0**-23 * np.random.default_rng(1).integers(-2, 3, (5, 5, 5)))
    found = [
        np.count_nonzero(all_normals(voxels)[where])
        for voxels, where in ((lone, ...), (slow, flat), (wobble.astype(np.float32), ...))
    ]
    record("V13", "normals among steps of one stored value and rounding", sum(found), 0, "either", "whole numbers")
    clear = (1000.0 + 0.1 * x).astype(np.float32)
    off = np.abs(all_normals(clear) - (1, 0, 0)).max()
    record("V13", "error of a normal just above the floor", off, 1e-6, "float32", "normals are kept as float32")


# --- transfer functions ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ("uint8", "int16", "float32", "float64"))
def test_V10_steps_duplicates_unsorted_and_single_points(record, dtype, way):
    """Each function against the values read off it by hand, through the lists of every stored type."""
    values = np.array([0, 3, 4, 5, 6, 9, 10, 60], dtype).reshape(2, 2, 2)
    functions = {
        "unsorted": (((10, 0.6), (0, 0.2)), [0.2, 0.32, 0.36, 0.4, 0.44, 0.56, 0.6, 0.6]),
        "single": (((3, 0.7),), [0.7] * 8),
        "step": (((0, 0.1), (5, 0.1), (5, 0.9), (10, 0.9)), [0.1] * 3 + [0.9] * 5),
        "three at once": (((5, 0.1), (5, 0.5), (5, 0.9)), [0.1] * 3 + [0.9] * 5),
        "equal values keep their order": (((5, 0.9), (0, 0.5), (5, 0.1)), [0.5, 0.74, 0.82, 0.1, 0.1, 0.1, 0.1, 0.1]),
    }
    volume = Volume(values, np.eye(4))
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        for points, alphas in functions.values():
            classified = classify(volume, transfer(points), np.eye(4))
            assert classified.visible_voxels == 8
            off = np.abs(classified.opacity - np.array(alphas)).max()
            record("V10", "error of alpha at steps and duplicates", off, 2.0**-24, "float32")
            off = np.abs(transfer(points).alpha_at(values.ravel()) - np.array(alphas)).max()
            record("V10", "error of alpha at steps and duplicates", off, 2.0**-24, "float64")
    with pytest.raises(RleSplatError, match="no opacity points"):
        transfer(())


def test_V10_a_step_is_right_continuous(record):
    step = transfer(((0, 0.1), (5, 0.1), (5, 0.9), (10, 0.9)))
    below, at = step.alpha_at(np.nextafter(5.0, 0.0)), step.alpha_at(5.0)
    record(
        "V10",
        "error of alpha just left of a step and on it",
        max(abs(below - 0.1), abs(at - 0.9)),
        1e-15,
        "float64",
        "transfer functions are read in float64",
    )


@pytest.mark.parametrize("dtype", ("uint8", "uint16", "int16"))
def test_V10_tables_of_stored_values_are_exact(record, dtype, way):
    """8- and 16-bit volumes go by a table of every stored value: at any size of it nothing is interpolated."""
    bounds = np.iinfo(dtype)
    stored = np.linspace(bounds.min, bounds.max, 512).astype(dtype).reshape(8, 8, 8)
    volume = Volume(stored, np.eye(4), slope=0.37, intercept=-11.0)
    low, high = volume.value_range
    rugged = transfer(tuple((v, 0.1 + 0.8 * (i % 2)) for i, v in enumerate(np.linspace(low, high, 97))))
    classified = classify(volume, rugged, np.eye(4))
    off = np.abs(classified.opacity - rugged.alpha_at(volume.physical(stored)).ravel()).max()
    record(
        "V10",
        "difference of a table of stored values from the points",
        off,
        2.0**-24,
        "float32",
        "a table's entries are made in float64 and kept as float32",
    )


@pytest.mark.parametrize("dtype", ("int16", "float32"))
def test_V11_a_range_of_one_value_is_a_step(record, dtype, way):
    ramp = transfer(((0, 0.0), (100, 0.8)), ((0, 1.0, 0.2, 0.1), (100, 0.1, 0.3, 1.0)))
    step = transfer(((40, 0.0), (40, 0.8)), ((40, 1.0, 0.2, 0.1), (40, 0.1, 0.3, 1.0)))
    volume = Volume(noise(dtype), np.eye(4))
    assert (volume.voxels > 40).any() and (volume.voxels < 40).any()
    with np.errstate(divide="raise", invalid="raise"):
        for narrow in (ramp.remapped(40, 40), ramp.windowed(40, 0.0)):
            pictures = [columns(from_above(volume.voxels, tf)) for tf in (narrow, step)]
            record("V11", f"{BITS} of the picture, against a step", unlike(*pictures), 0)
    assert 0.5 < pictures[0][..., 3].max()


@pytest.mark.parametrize("dtype", ("uint8", "int16", "float32", "float64"))
def test_V10_a_table_converges_with_its_size(record, dtype):
    """The table that sheet pixels are classified by, against the points: exact where it has an entry for each stored
    value; else off by no more than half an entry of the steepest ramp, which halves as entries double."""
    ramps = transfer(((0, 0.0), (20, 0.6), (60, 0.1), (110, 0.9)), ((0, 0.0, 0.5, 1.0), (110, 1.0, 0.5, 0.0)))
    volume = Volume(noise(dtype), np.eye(4))
    stored = volume.voxels.ravel().astype(np.float64)
    if volume.voxels.dtype.kind == "f":
        stored = np.random.default_rng(1).uniform(0.0, 110.0, 5000)
    stored = stored[(stored > 0.0) & (stored < 110.0)]
    true = optical_depth(ramps.alpha_at(stored))
    steepest = 0.1 / (1.0 - 0.9)  # of optical depth per value: the last ramp's, at its end
    for entries in (0, 128, 512, 2048, 8192):
        table = lookup_table(volume, ramps, (float(stored.min()), float(stored.max())), 1.0, entries)
        entry = ((stored - table.origin) * table.rate).astype(np.int64)
        off = np.abs(table.entries[entry, 3] - true)
        if volume.voxels.dtype.kind != "f":
            record("V10", "error of a table over whole numbers", off.max(), 2.0**-22, "float32", "entries are float32")
        else:
            share = off.max() / (0.5 * steepest / table.rate + 2.0**-22)
            record(
                "V10",
                "error of a table, in half entries of the steepest ramp",
                share,
                1.0,
                "float32",
                "entries are float32",
            )


@every_finer
def test_V10_V11_steps_and_ranges_of_one_value_however_classified(record, classification, way):
    """A step between voxels is a surface inside cells, there where the interpolated value is."""
    z = np.linspace(0.0, 9.0, 10)
    ramp = np.broadcast_to(10.0 * z[:, None, None], (10, 6, 6)).astype(np.float32)
    step = transfer(((44.0, 0.0), (44.0, 0.3)), ((44.0, 1.0, 0.2, 0.1), (44.0, 0.1, 0.3, 1.0)))
    narrow = transfer(((0, 0.0), (100, 0.3)), ((0, 1.0, 0.2, 0.1), (100, 0.1, 0.3, 1.0))).remapped(44, 44)
    knobs = dict(depth_rule="midpoint-16" if classification == "post" else "midpoint-4", termination=0.0)
    pictures = [drawn(from_above(ramp, tf), classification, **knobs) for tf in (step, narrow)]
    record("V11", f"{BITS} of the picture, against a step", unlike(*pictures), 0)
    depth = -np.log1p(-pictures[0][3, 3, 3].astype(np.float64)) / -math.log1p(-0.3)
    if classification == "post":
        record("V10", "misplacement of a step inside a cell, voxels", abs(depth - 4.6), 1 / 16)
    else:
        record("V10", "misplacement of a step on a grid twice as fine, voxels", abs(depth - 4.6), 1 / 4)


# --- stored types ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_V12_slope_and_intercept_come_before_the_points(record, dtype, way):
    """A function that shows a single physical value, just where exact arithmetic in float64 puts it."""
    stored = noise(dtype)
    volume = Volume(stored, np.eye(4), slope=-2.5, intercept=0.125)
    for value in (float(stored.max()), float(stored.min()), float(stored[0, 0, 0])):
        at = -2.5 * value + 0.125  # exact: few bits
        shows = transfer(((at, 0.0), (at, 0.5), (np.nextafter(at, np.inf), 0.5), (np.nextafter(at, np.inf), 0.0)))
        seen = classify(volume, shows, np.eye(4)).visible_voxels
        record(
            "V12",
            "voxels shown wrongly by a function of one physical value",
            abs(seen - int((stored == value).sum())),
            0,
            "float64",
            "physical values are float64 for every stored type",
        )


@pytest.mark.parametrize("packed", (False, True))
@pytest.mark.parametrize("dtype", STORED_TYPES)
def test_V12_a_big_endian_file_is_the_same_file_byteswapped(record, tmp_path, dtype, packed):
    stored = noise(dtype, (3, 4, 5))
    volumes = []
    for order in "<>":
        path = tmp_path / f"{'big' if order == '>' else 'little'}.raw{'.gz' if packed else ''}"
        content = stored.astype(stored.dtype.newbyteorder(order)).tobytes()
        path.write_bytes(gzip.compress(content) if packed else content)
        volumes.append(read_volume(path, shape=(5, 4, 3), dtype=dtype, byte_order="big" if order == ">" else "little"))
    assert volumes[0].key == volumes[1].key
    record(
        "V12",
        "voxels that differ between a big- and a little-endian file",
        unlike(*(v.voxels for v in volumes)),
        0,
        "either",
        "stored values",
    )


@every_finer
@pytest.mark.parametrize(("dtype", "extreme", "bound"), (
    ("float64", 1e8, 1e-3), ("float64", 1e30, 1e-3), ("float64", -1e30, 1e-3),
    ("int32", -(2**31), 2.0),  # the tables of whole numbers have other entries
    pytest.param("uint32", 2**32 - 1, 2.0, marks=pytest.mark.deep),  # no zip brings its kernels
))  # fmt: skip
def test_V12_beside_one_extreme_voxel_values_are_as_exact_as_float32(record, dtype, extreme, bound, classification):
    stored = noise(dtype)
    stored[3, 4, 4] = extreme
    ramp = transfer(((0, 0.0), (60, 0.3), (120, 0.5)), ((0, 0.0, 0.5, 1.0), (120, 1.0, 0.5, 0.25)))
    pictures = [
        drawn(turned(Volume(voxels, np.eye(4)), ramp), classification) for voxels in (stored, stored.astype("f4"))
    ]
    assert pictures[1][..., 3].max() > 0.3
    worst = 255.0 * np.abs(pictures[0] - pictures[1]).max()
    claim = f"difference of {dtype} with an extreme voxel from the same in float32, steps of 255"
    record("V12", claim, worst, bound, "float32", "scalars of sheets are float32")


def test_V12_wrapped_values_are_told_apart(record, way):
    """The same bytes as int16 and as uint16: -1 is not 65535."""
    stored = np.array([-1, -1024, 3071, 32767, -32768, 0, 1, -2], np.int16).reshape(2, 2, 2)
    dense = transfer(((0, 0.0), (0, 0.5)))
    seen = [classify(Volume(v, np.eye(4)), dense, np.eye(4)).visible_voxels for v in (stored, stored.view(np.uint16))]
    record(
        "V12",
        "voxels at or above 0, miscounted as signed or unsigned",
        abs(seen[0] - 4) + abs(seen[1] - 8),
        0,
        "either",
        "whole numbers",
    )
