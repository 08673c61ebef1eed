"""The table that sheets of the scalar are classified by, against the truth's own reading of transfer functions."""

import numpy as np
import pytest

from rle_splat.accuracy.transfer import TAU_CAP, extinction_and_color
from rle_splat.classify.lookup_table import MOST, extinction_of, extinction_steps, lookup_table
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.volume.volume import Volume

DISTANCE = 2.5
COLOR = ((-1e5, 0.1, 0.9, 0.4), (0.0, 0.9, 0.3, 0.1), (50.0, 0.2, 0.8, 3.0), (1e5, 0.3, 0.1, 0.7))


def function(*points, color=COLOR):
    return TransferFunction(opacity=points, color=color)


def volume(dtype=np.uint8, slope=1.0, intercept=0.0):
    return Volume(np.zeros((2, 2, 2), dtype), np.eye(4), slope=slope, intercept=intercept)


def look_up(table, values):
    """(n, 4) float64 entries that stored ``values`` get: the rule written down once more."""
    values = np.asarray(values, np.float64)
    with np.errstate(invalid="ignore"):
        which = np.clip(np.floor((values - table.origin) * table.rate), 0, len(table.entries) - 2)
    inside = (values >= table.low) & (values <= table.high)
    return table.entries[np.where(inside, which, len(table.entries) - 1).astype(int)].astype(np.float64)


def true(tf, volume, values):
    """(n, 4) extinction * RGB and extinction of stored values."""
    sigma, color = extinction_and_color(tf, volume.physical(values), DISTANCE)
    return np.concatenate((sigma[:, None] * color, sigma[:, None]), axis=1)


CURVES = {
    "ramps": ((20, 0.0), (50, 0.6), (90, 0.1), (120, 0.0)),
    "steps on numbers": ((30, 0.0), (30, 0.5), (60, 0.5), (60, 0.1), (61, 0.1), (61, 0.0)),
    "steps between numbers": ((30.5, 0.0), (30.5, 0.5), (60.2, 0.5), (60.2, 0.0)),
    "narrow": ((40, 0.0), (41, 0.9), (42, 0.0)),
    "shown everywhere": ((10, 0.2), (100, 0.7)),
    "low end": ((10, 0.8), (100, 0.0)),
    "constant": ((10, 0.3),),
    "opaque": ((10, 0.0), (20, 1.0)),
    "far apart": ((-100, 0.0), (-90, 0.3), (-80, 0.0), (80, 0.0), (90, 0.6), (100, 0.0)),
}


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("dtype", (np.uint8, np.int8, np.uint16, np.int16, np.float32))
def test_whole_numbers_get_what_the_function_says(dtype, curve):
    """Exactly, to float32; and the same from a little beside, so that rounding never chooses another."""
    whole = np.dtype(dtype).kind != "f"
    values = np.arange(-128, 256) if np.dtype(dtype).kind != "u" else np.arange(0, 256)
    values = values[values < 128] if dtype == np.int8 else values
    for slope, intercept in ((1.0, 0.0), (-1.0, 3.0), (0.5, -20.0)):
        grid = volume(dtype, slope, intercept)
        points = [(grid.physical(value), alpha) for value, alpha in CURVES[curve]]
        tf = function(*(points if slope > 0.0 else points[::-1]))
        table = lookup_table(grid, tf, (values[0], values[-1]), DISTANCE)
        right = true(tf, grid, values)
        if whole:
            little = min(1e-4, 0.4 / table.rate)
            for aside in (0.0, little, -little):
                np.testing.assert_allclose(look_up(table, values + aside), right, rtol=2e-6, atol=1e-12)
        else:
            off = np.abs(look_up(table, values) - right)[~np.isin(values, [v for v, _ in CURVES[curve]])]
            assert off.max() < 0.02
        assert table.entries.dtype == np.float32 and len(table.entries) <= MOST + 2
        assert not table.entries[-1].any() and np.isfinite(table.entries).all()


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@pytest.mark.parametrize("curve", ("ramps", "narrow", "opaque", "low end"))
def test_between_numbers_too(curve, dtype):
    """From one entry to the next opacity changes by a 1/500 at most, so the nearest is off by half of that."""
    grid, tf = volume(dtype), function(*CURVES[curve], color=((0, 1, 1, 1),))
    table = lookup_table(grid, tf, (0, 255), DISTANCE)
    values = np.random.default_rng(1).uniform(0.0, 255.0, 20000)
    alpha, right = (-np.expm1(-DISTANCE * found[:, 3]) for found in (look_up(table, values), true(tf, grid, values)))
    assert np.abs(alpha - right).max() < 1.1e-3
    assert abs((alpha - right).mean()) < 5e-5  # none is taken from one side


@pytest.mark.parametrize("dtype", (np.uint16, np.int16))
def test_no_whole_number_lies_where_two_entries_meet(dtype):
    """Spans up to those of which several numbers share an entry."""
    for span in (1, 2, 3, 255, 1000, 1025, 4096, 20001, 65535):
        for entries in (0, 100, 1024, 5000):
            first = 0 if dtype == np.uint16 else -32768
            table = lookup_table(volume(dtype), function((first, 0.3)), (first, first + span), DISTANCE, entries)
            positions = (np.arange(first, first + span + 1) - table.origin) * table.rate
            beside = np.abs(positions - np.rint(positions))
            assert beside.min() > 0.49 * min(table.rate, 1.0)
            assert (positions >= 0.0).all() and (positions < len(table.entries) - 1).all()


def test_a_step_of_whole_numbers_is_where_it_is():
    """Wherever it lies: the number before it and the one on it get either side, from 8-bit to wide 16-bit spans that
    fit the table."""
    for dtype, last in ((np.uint8, 255), (np.int16, 1023), (np.uint16, 1023)):
        for step in (1.0, 77.0, 100.5, 254.99, 255.0):
            tf = function((step, 0.0), (step, 0.5), color=((0, 1, 1, 1),))
            table = lookup_table(volume(dtype), tf, (0, last), DISTANCE)
            before, on = np.ceil(step) - 1, np.ceil(step)
            little = min(1e-4, 0.4 / table.rate)
            found = look_up(table, [at + aside for at in (before, on) for aside in (-little, 0.0, little)])[:, 3]
            assert not found[:3].any() and (found[3:] > 0.27).all()


@pytest.mark.parametrize("far", (1e4, 1e30, -1e30))
def test_one_far_value_shows_nothing_beyond_a_step(far):
    """What rounding may take from a value is in proportion to the function's points, not to the volume's largest."""
    tf = function((30, 0.0), (30, 0.5), (60, 0.5), (60, 0.0), color=((0, 1, 1, 1),))
    table = lookup_table(volume(np.float32), tf, (min(0.0, far), max(255.0, far)), DISTANCE)
    found = look_up(table, (29.9, 29.99999, 30.0, 59.9, 60.1))[:, 3]
    assert not found[0] and found[1:4].all() and not found[4]


@pytest.mark.parametrize("slope", (1e-300, 1e300, 1e305))
def test_any_slope_gives_the_same_entries(slope):
    plain, scaled = (
        lookup_table(volume(slope=by), function((10 * by, 0.0), (200 * by, 0.8), color=((0, 1, 1, 1),)), (0, 255), 1.0)
        for by in (1.0, slope)
    )
    np.testing.assert_allclose(look_up(scaled, np.arange(256)), look_up(plain, np.arange(256)), rtol=1e-6)


def test_values_that_are_too_close_for_a_table_are_refused():
    with pytest.raises(RleSplatError, match=r"lie within 1e-40 of each other.*classification pre\.$"):
        lookup_table(volume(np.float32), function((0, 0.0), (1e-40, 0.5)), (0.0, 1e-40), DISTANCE)


def test_nothing_is_shown_where_the_function_shows_nothing():
    """Below, above and between what is shown, and what stands for voxels that are not kept."""
    tf = function(*CURVES["far apart"])
    for dtype in (np.int16, np.float32):
        table = lookup_table(volume(dtype), tf, (-200.0, 200.0), DISTANCE)
        values = np.concatenate(([-1e9, -3e38, 1e30, 3e38], np.linspace(-200, -100.5), np.linspace(-79.5, 79.5),
                                 np.linspace(100.5, 200)))  # fmt: skip
        assert not look_up(table, values).any()
        assert look_up(table, (-90.0, 90.0))[:, 3].all()


@pytest.mark.parametrize("dtype", (np.uint8, np.int16, np.float32, np.float64))
def test_what_is_not_kept_is_transparent_whatever_is_shown(dtype):
    """The number that stands for voxels which are not kept, and any share of it, is below all that is shown, also where
    the function shows all values down to minus infinity."""
    for points in (CURVES["low end"], CURVES["constant"]):
        table = lookup_table(volume(dtype), function(*points), (0.0, 200.0), DISTANCE)
        missing = -3e38 * 2.0 ** -np.arange(0.0, 25.0)
        assert (missing < table.low).all()
        assert not look_up(table, missing).any() and look_up(table, (0.0, 10.0))[:, 3].all()


def test_ranges_of_one_value_and_of_none():
    """V11: nothing is divided by a width of zero."""
    for dtype in (np.uint8, np.float32, np.float64):
        for value in (0.0, 37.0, 100.0):
            for curve in ("ramps", "constant", "steps on numbers"):
                grid, tf = volume(dtype), function(*CURVES[curve])
                with np.errstate(all="raise"):
                    table = lookup_table(grid, tf, (value, value), DISTANCE)
                np.testing.assert_allclose(look_up(table, [value]), true(tf, grid, [value]), rtol=2e-6)
        hidden = lookup_table(volume(dtype), function((500, 0.0), (600, 0.5)), (0.0, 100.0), DISTANCE)
        assert not hidden.entries.any() and hidden.most_color == 0.0
        assert not look_up(hidden, np.linspace(-1e3, 1e3)).any()


@pytest.mark.parametrize("dtype", (np.uint8, np.int8, np.int16, np.float32, np.float64))
def test_extinction_is_the_same_whatever_is_looked_up_at_once(dtype, monkeypatch):
    grid, stored = volume(dtype), np.arange(100).astype(dtype)
    table = lookup_table(grid, function(*CURVES["ramps"]), (0.0, 200.0), DISTANCE)
    whole, steps = extinction_of(table, stored, dtype), []
    monkeypatch.setattr("rle_splat.classify.lookup_table.AT_ONCE", 5)
    monkeypatch.setattr("rle_splat.classify.lookup_table.FOUND_AT_ONCE", 10)
    np.testing.assert_array_equal(drain(extinction_steps(table, stored, dtype), steps.append), whole)
    np.testing.assert_allclose(steps, np.arange(0.0, 1.0, 0.1))
    np.testing.assert_allclose(whole, look_up(table, stored)[:, 3])


def test_an_opaque_medium_is_capped_and_distances_count():
    grid, tf = volume(), function((0, 0.0), (100, 1.0), color=((0, 1, 1, 1),))
    near, far = (lookup_table(grid, tf, (0, 200), distance) for distance in (0.5, 5.0))
    assert near.entries[:, 3].max() == pytest.approx(TAU_CAP / 0.5, rel=1e-6)
    np.testing.assert_allclose(near.entries, 10.0 * far.entries, rtol=1e-6)


def test_the_brightest_color_is_of_what_is_shown():
    color = ((0, 9.0, 9.0, 9.0), (50, 0.2, 0.5, 0.1), (100, 0.1, 0.1, 0.8), (200, 7.0, 7.0, 7.0))
    for dtype in (np.uint8, np.float32):
        table = lookup_table(volume(dtype), function((50, 0.0), (60, 0.5), (100, 0.0), color=color), (0, 255), DISTANCE)
        assert table.most_color == pytest.approx(0.8, abs=0.02)
        seen = table.entries[:, 3] > 0.0
        assert (table.entries[seen, :3].max(axis=1) <= table.most_color * table.entries[seen, 3] * (1 + 1e-6)).all()
