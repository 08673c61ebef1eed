"""Values once more, V1 to V15, where what is interpolated is the scalar: sheet pixels, or the voxels of a finer grid,
are classified, so cells with a corner that is no number, steps inside cells and tables of values are met on the way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.classify.classification import optical_depth
from rle_splat.classify.limits import BRIGHTEST
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.classify.value_table import value_table
from rle_splat.pipeline.render import render
from rle_splat.scene import CLASSIFICATIONS, Light, Quality, RleSplatError
from rle_splat.volume.volume import Volume
from tests.stability.scenes import BACKENDS, STEPPED, WHITE, from_above, matter, noise, turned, unlike

BITS = "differing bits"
every_backend = pytest.mark.parametrize("backend", BACKENDS)
every_classification = pytest.mark.parametrize("classification", CLASSIFICATIONS)
every_finer = pytest.mark.parametrize("classification", [name for name in CLASSIFICATIONS if name != "pre"])


def drawn(scene, classification, backend="auto", **knobs) -> np.ndarray:
    """A picture at standard quality."""
    return render(scene, Quality.preset("standard", classification=classification, backend=backend, **knobs)).rgba


def against_oracle(scene, classification, backend, **knobs):
    """The Difference of a fine picture, termination off, from the truth of its classification."""
    true = truth(scene, "T1" if classification == "pre" else "T2", tolerance=1e-6)[0]
    fine = dict(depth_rule="midpoint-8", sheet_density=4.0, termination=0.0)
    picture = drawn(scene, classification, backend, **(fine | knobs))
    return difference(picture, true.reshape(picture.shape))


@every_backend
@every_classification
def test_V1_nothing_visible_however_classified(record, classification, backend):
    volume = Volume(noise(), np.eye(4))
    for points in (((0, 0.0),), ((500, 0.0), (501, 0.7)), ((-501, 0.7), (-500, 0.0))):
        picture = drawn(turned(volume, TransferFunction(opacity=points, color=WHITE)), classification, backend)
        record("V1", "largest channel of the picture", np.abs(picture).max(), 0, "either", "exactly 0 in any width")


@every_backend
@every_finer
def test_V2_all_opaque_however_classified(record, width, classification, backend):
    scene = from_above(np.ones((6, 8, 9), np.float32), matter(((0, 1.0),), ((0, 0.5, 1.0, 0.0),)))
    picture = drawn(scene, classification, backend, termination=0.0)
    assert np.isfinite(picture).all()
    alpha = picture[2:-2, 2:-2, 3]
    record("V2", "1 - alpha over max(T_min, 2^-24)", (1.0 - alpha).max() * 2.0**24, 1.0, width)


@every_backend
@every_finer
@pytest.mark.parametrize("dtype", ("float32", "float64"))
def test_V6_cells_with_a_corner_that_is_no_number_are_transparent(record, width, dtype, classification, backend):
    values = noise(dtype)
    holes = np.random.default_rng(5).random(values.shape) < 0.04
    values[holes] = np.nan
    faint = replace(STEPPED, opacity=((10, 0.0), (50, 0.2), (120, 0.4)), shade=None)
    scene = turned(Volume(values, np.eye(4)), faint, 32)
    picture = render(scene, Quality(classification=classification, backend=backend))
    assert f"{holes.sum()} voxels are not numbers" in " ".join(picture.report["remarks"])
    assert np.isfinite(picture.rgba).all() and picture.rgba[..., 3].max() > 0.3
    if classification == "post":
        whole = turned(Volume(np.where(holes, 50.0, values).astype(dtype), np.eye(4)), faint, 32)
        with_holes, without = (against_oracle(one, classification, backend).rmse for one in (scene, whole))
        claim = "RMSE from the oracle with NaN among the corners, over that without"
        record("V6", claim, with_holes / without, 1.5, width)
    lit = drawn(turned(Volume(values, np.eye(4)), replace(faint, shade=Shade()), 32), classification, backend)
    record("V6", "pixels that are not finite, shaded", (~np.isfinite(lit)).sum(), 0, "either", "whole numbers")


@every_backend
@every_finer
@pytest.mark.parametrize("slope", (1.0, -1.0))
def test_V7_infinities_take_the_nearest_end_however_classified(record, slope, classification, backend):
    ends = TransferFunction(opacity=((-5, 0.3), (0, 0.0), (5, 0.7)), color=((-5, 1, 0, 0), (5, 0, 1, 0)), shade=None)
    stored = np.random.default_rng(6).uniform(-5, 5, (5, 6, 7))
    stored[::2, ::3, ::2] *= np.inf
    one, two = (Volume(v, np.eye(4), slope=slope) for v in (stored, np.clip(stored, -5, 5)))
    pictures = [drawn(turned(v, ends), classification, backend) for v in (one, two)]
    assert pictures[1][..., 3].max() > 0.3
    record(
        "V7",
        "difference from data clamped to the ends, levels",
        255.0 * np.abs(pictures[0] - pictures[1]).max(),
        1e-3,
        "float32",
        "scalars of sheets are float32",
    )


@every_backend
@every_finer
@pytest.mark.parametrize("dtype", ("float32", "float64"))
@pytest.mark.parametrize("far", (101.0, 1e4, 1e30))
def test_V9_data_at_and_beyond_the_ends_however_classified(record, far, dtype, classification, backend):
    """A block beyond the last point looks like one at it: to 1e30, a value that float32 holds."""
    held = TransferFunction(
        opacity=((0, 0.0), (100, 0.2)), color=((0, 0.0, 0.5, 1.0), (100, 1.0, 0.5, 0.25)), shade=None
    )
    pictures = [
        drawn(turned(Volume(np.full((6, 7, 8), value, dtype), np.eye(4)), held), classification, backend)
        for value in (100.0, far)
    ]
    assert pictures[0][..., 3].max() > 0.5
    worst = 255.0 * np.abs(pictures[1] - pictures[0]).max()
    claim = "difference of a block beyond the ends from one at them, levels"
    record("V9", claim, worst, 1e-3, "float32", "scalars of sheets are float32")


@every_backend
@every_finer
def test_V8_a_constant_volume_is_symmetric_and_unshaded_however_classified(record, width, classification, backend):
    cube = np.full((6, 6, 6), 50.0, np.float32)
    plain = from_above(cube, matter(((0, 0.3),), ((0, 0.2, 0.5, 1.0),)))
    shaded = replace(plain, transfer_function=replace(plain.transfer_function, shade=Shade()), headlight=True)
    pictures = [drawn(scene, classification, backend) for scene in (plain, shaded)]
    assert pictures[0][..., 3].max() > 0.5
    record("V8", f"{BITS} of the shaded picture from the unshaded", unlike(*pictures), 0, width)
    worst = max(np.abs(pictures[0] - np.flip(pictures[0], axis)).max() for axis in (0, 1))
    record("V8", f"asymmetry of its picture, {classification}, levels", 255.0 * worst, 0.01, width)


@pytest.mark.parametrize("dtype", ("uint8", "int16", "float32", "float64"))
def test_V10_a_table_converges_with_its_size(record, dtype):
    """The table that sheet pixels are classified by, against the points: exact where it has an entry for each stored
    value; else off by no more than half an entry of the steepest ramp, which halves as entries double."""
    ramps = matter(((0, 0.0), (20, 0.6), (60, 0.1), (110, 0.9)), ((0, 0.0, 0.5, 1.0), (110, 1.0, 0.5, 0.0)))
    volume = Volume(noise(dtype), np.eye(4))
    stored = volume.voxels.ravel().astype(np.float64)
    if volume.voxels.dtype.kind == "f":
        stored = np.random.default_rng(1).uniform(0.0, 110.0, 5000)
    stored = stored[(stored > 0.0) & (stored < 110.0)]
    true = optical_depth(ramps.alpha_at(stored))
    steepest = 0.1 / (1.0 - 0.9)  # of optical depth per value: the last ramp's, at its end
    for entries in (0, 128, 512, 2048, 8192):
        table = value_table(volume, ramps, (float(stored.min()), float(stored.max())), 1.0, entries)
        place = ((stored - table.origin) * table.rate).astype(np.int64)
        off = np.abs(table.entries[place, 3] - true)
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


@every_backend
@every_finer
def test_V10_V11_steps_and_ranges_of_one_value_however_classified(record, width, classification, backend):
    """A step between voxels is a surface inside cells, there where the interpolated value is."""
    z = np.linspace(0.0, 9.0, 10)
    ramp = np.broadcast_to(10.0 * z[:, None, None], (10, 6, 6)).astype(np.float32)
    step = matter(((44.0, 0.0), (44.0, 0.3)), ((44.0, 1.0, 0.2, 0.1), (44.0, 0.1, 0.3, 1.0)))
    narrow = matter(((0, 0.0), (100, 0.3)), ((0, 1.0, 0.2, 0.1), (100, 0.1, 0.3, 1.0))).remapped(44, 44)
    knobs = dict(depth_rule="midpoint-16" if classification == "post" else "midpoint-4", termination=0.0)
    pictures = [drawn(from_above(ramp, tf), classification, backend, **knobs) for tf in (step, narrow)]
    record("V11", f"{BITS} of the picture, against a step", unlike(*pictures), 0, width)
    depth = -np.log1p(-pictures[0][3, 3, 3].astype(np.float64)) / -math.log1p(-0.3)
    if classification == "post":
        record("V10", "misplacement of a step inside a cell, voxels", abs(depth - 4.6), 1 / 16, width)
    else:
        record("V10", "misplacement of a step on a grid twice as fine, voxels", abs(depth - 4.6), 1 / 4, width)


@every_backend
@every_finer
@pytest.mark.parametrize("distance", (1e-300, 1e-30, 1e30, 1e300))
def test_V14_V15_the_brightest_and_the_densest_however_classified(record, width, distance, classification, backend):
    function = TransferFunction(
        opacity=((0, 0.0), (120, 1.0)), color=((0, BRIGHTEST, 0.0, 1.0),), opacity_unit_distance=distance, shade=None
    )
    picture = drawn(turned(Volume(noise(), np.eye(4)), function), classification, backend)
    assert (picture[..., 3].max() > 0.9) == (distance < 1.0)
    case = "V14" if distance < 1.0 else "V15"
    record(case, "pixels that are not finite at the limits", (~np.isfinite(picture)).sum(), 0, width)
    error = np.abs(picture[..., 0] / BRIGHTEST - picture[..., 3]).max()
    record(case, "relative error of the colour at the limits, finer classifications", error, 1e-5, width)


@every_backend
@every_finer
@pytest.mark.parametrize("kind", ("SUN", "POINT"))
def test_V14_lights_of_any_energy_however_classified(record, kind, classification, backend):
    function = TransferFunction(opacity=((0, 0.0), (120, 1.0)), color=((0, 1.0, 0.0, 0.5),))
    pose = np.eye(4)
    pose[:3, 3] = 3.0, 3.0, 20.0
    bad = refused = 0
    for energy in (1e-300, 1.0, 1e6, 1e12, 1e30, 1e300):
        light = Light(kind, (1.0, 0.5, 1e-300), energy, pose)
        scene = turned(Volume(noise("float32"), np.eye(4)), function, 24, lights=(light,))
        try:
            bad += (~np.isfinite(drawn(scene, classification, backend))).sum()
        except RleSplatError as problem:
            assert "brighter" in str(problem) and str(problem).endswith(".")
            refused += 1
    assert 1 <= refused <= 3
    record("V14", "pixels that are not finite under lights of 1e-300 to 1e300 W", bad, 0, "either", "whole numbers")


@every_classification
@pytest.mark.parametrize("away", (0.003, 1.0, 50.0))
def test_V14_a_lamp_lights_small_volumes_at_any_distance(record, away, classification):
    """Voxels of a fifth of a millimetre in a world of metres: however strong the lamp would be half a voxel away, what
    arrives is what counts."""
    z, y, x = np.indices((12, 12, 12)) - 5.5
    ball = (200.0 - 16.0 * np.sqrt(x * x + y * y + z * z)).clip(0, 255).astype(np.uint8)
    volume = Volume(ball, np.diag((2e-4, 2e-4, 2e-4, 1.0)), unit="m")
    matt = TransferFunction(opacity=((100, 0.0), (150, 0.5)), color=WHITE, shade=Shade(0.0, 1.0, 0.0, 1.0))
    pose = np.eye(4)
    pose[:3, 3] = 0.001, 0.001, away

    def seen(energy):
        scene = turned(volume, matt, 24, lights=(Light("POINT", energy=energy, matrix_world=pose),), headlight=False)
        return drawn(scene, classification)[..., 0].astype(np.float64)

    # The light is as far off, to two parts in a thousand or less, for every voxel that is seen; 10 W twice is 20 W.
    weak, strong = seen(1.0), seen(1e6 * away**2)
    assert weak.max() > 0.0
    share = np.abs(strong / (1e6 * away**2) - weak).max() / weak.max()
    record(
        "V14",
        "light of a lamp that does not grow with its energy, relative",
        share,
        2e-3,
        "float32",
        "light is kept in 16 bits where sheets are classified",
    )


@every_backend
@every_finer
def test_V15_the_world_may_be_of_any_size_however_classified(record, width, classification, backend):
    function = matter(((0, 0.0), (120, 0.6)), ((0, 0.2, 0.5, 1.0), (120, 1.0, 0.3, 0.0)), None)
    pictures = [drawn(from_above(noise(), function, scale), classification, backend) for scale in (1e-12, 1.0, 1e12)]
    assert pictures[1][..., 3].max() > 0.5
    for picture in pictures[::2]:
        worst = difference(picture, pictures[1]).largest
        record("V15", "world scaled by 1e-12 and 1e12, finer classifications: difference, levels", worst, 0.01, width)
