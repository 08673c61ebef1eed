"""Proves that the body is found and the table is not, on phantoms whose parts are known."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat import TransferFunction, body_labels
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError
from rle_splat.segment.body import body_steps
from rle_splat.volume.volume import PATIENT, Volume

SPACING = (3.0, 2.5, 4.0)  # mm, x, y, z
SHAPE = (14, 104, 120)  # z, y, x
LPS = np.diag((*SPACING, 1.0))


def places():
    """x, y, z of the voxels in mm from the middle of the scan; y grows to the back."""
    z, y, x = (np.arange(count) - 0.5 * (count - 1) for count in SHAPE)
    return SPACING[0] * x[None, None], SPACING[1] * y[None, :, None], SPACING[2] * z[:, None, None]


def ellipse(x, y, middle_x, middle_y, width, height):
    return ((x - middle_x) / width) ** 2 + ((y - middle_y) / height) ** 2 <= 1.0


def chest(gap=12.0, noise=15.0):
    """(values, body, table): a chest with lungs, arms that touch it, and a table with a mat ``gap`` mm behind it."""
    x, y, z = places()
    trunk = ellipse(x, y, 0.0, -20.0, 120.0, 80.0) & (z < 1e9)
    arms = ellipse(np.abs(x), y, 138.0, -20.0, 24.0, 26.0) & (z < 1e9)
    lungs = ellipse(np.abs(x), y, 50.0, -25.0, 36.0, 48.0) & (z < 1e9)
    top = 60.0 + gap
    shell = (np.abs(y - top - 3.0) <= 3.0) | (np.abs(y - top - 40.0) <= 3.0)  # the two faces of the table, 6 mm thick
    table = shell & (np.abs(x) < 165.0) & (z < 1e9)
    foam = (y > top) & (y < top + 43.0) & (np.abs(x) < 165.0) & ~table & (z < 1e9)
    body = trunk | arms
    values = np.full(SHAPE, -1000.0)
    values[foam], values[table] = -940.0, 150.0
    values[body], values[lungs] = 30.0, -850.0
    vessels = lungs & (np.sin(0.4 * x) + np.sin(0.5 * y) > 1.5)
    values[vessels] = 40.0
    return values + np.random.default_rng(1).normal(0.0, noise, SHAPE), body, table & ~body


def volume_of(values, **more):
    return Volume(np.rint(values).astype(np.int16), LPS, value_unit="HU", space=PATIENT, **more)


def shares(values, body, table, **more):
    """Which shares of the body and of the table are in what was found."""
    found = drain(body_steps(volume_of(values, **more)))
    return found[body].mean(), found[table].mean()


def test_a_table_behind_the_body_is_left_out_and_lungs_and_arms_are_not():
    body, table = shares(*chest())
    assert body > 0.995 and table == 0.0


def test_a_table_that_touches_the_body_is_cut_off():
    """But for what lies right beneath the back."""
    values, body, table = chest(gap=-4.0)
    kept, left = shares(values, body, table)
    assert kept > 0.995 and left < 0.1


def test_a_nose_is_no_table_but_a_board_that_touches_the_body_is():
    values, body, table = chest(gap=1.0)
    x, y, z = places()
    nose = ellipse(x, y, 0.0, -100.0, 6.0, 22.0) & (np.abs(z) < 14.0) & ~body  # 12 mm wide, 22 long
    values[nose] = 40.0
    found = drain(body_steps(volume_of(values)))
    assert found[body].mean() > 0.995 and found[nose].all()
    assert found[table & (np.abs(x) > 40.0) & (z < 1e9)].mean() < 0.01


def test_what_is_beyond_the_field_of_view_is_air():
    values, body, table = chest()
    x, y, _ = places()
    outside = np.broadcast_to(x**2 + y**2 > 160.0**2, SHAPE)
    values[outside] = -3024.0
    kept, left = shares(values, body & ~outside, table & ~outside)
    assert kept > 0.99 and left == 0.0


@pytest.mark.parametrize("is_round", [True, False])
def test_a_chest_wall_that_the_field_of_view_cuts_thin_belongs_to_the_body(is_round):
    """6 mm of it are left beside the lungs; the table, which the field of view cuts too, is left out."""
    (x, y, _), parts, reach = places(), chest(gap=4.0), 92.0
    rows, columns = (np.flatnonzero(np.abs(at.ravel()) < reach) for at in (y + 20.0, x))
    values, body, table = (one[:, rows][:, :, columns] for one in parts)
    if is_round:
        beyond = np.broadcast_to(x**2 + (y + 20.0) ** 2 > reach**2, SHAPE)[:, rows][:, :, columns]
        values[beyond] = -3024.0
        body, table = body & ~beyond, table & ~beyond
    kept, left = shares(values, body, table)
    assert table.any() and kept > 0.995 and left < 0.02


def test_slices_lie_across_the_body_whatever_the_order_of_axes():
    values, body, table = chest()
    turned = [np.ascontiguousarray(one.transpose(2, 0, 1)) for one in (values, body, table)]  # z, y, x: x, z, y
    affine = np.zeros((4, 4))
    affine[1, 0], affine[2, 1], affine[0, 2], affine[3, 3] = SPACING[1], SPACING[2], SPACING[0], 1.0
    one = Volume(np.rint(turned[0]).astype(np.int16), affine, value_unit="HU", space=PATIENT)
    found = drain(body_steps(one))
    assert found[turned[1]].mean() > 0.995 and not found[turned[2]].any()


def test_a_thin_walled_skull_is_found_without_its_holder():
    x, y, z = places()
    radius = np.sqrt(x**2 + (0.9 * y) ** 2 + z**2)
    skull = (radius > 74.0) & (radius <= 84.0)
    holder = (np.abs(np.hypot(x, y) - 108.0) <= 2.5) & (y > -20.0) & (z < 1e9)
    values = np.full(SHAPE, -1000.0)
    values[skull], values[holder] = 700.0, 200.0
    found = drain(body_steps(volume_of(values)))
    assert found[skull].mean() > 0.99 and not found[holder].any()
    assert found[(radius < 74.0) & np.ones(SHAPE, bool)].mean() > 0.99, "what the skull encloses belongs to it"


def test_stored_slope_nan_and_small_scans():
    """Values of an unknown unit, of which some are missing, of a mouse a tenth as large."""
    values, body, table = chest()
    values = np.maximum(values + 1000.0, 0.0).astype(np.float32)
    values[0, :3] = np.nan
    small = Volume(values, np.diag((0.3, 0.25, 0.4, 1.0)), slope=0.1)
    found = drain(body_steps(small))
    assert found[body].mean() > 0.995 and not found[table].any()


@pytest.mark.parametrize(
    "values", [np.full(SHAPE, 40.0), np.random.default_rng(2).normal(100.0, 20.0, SHAPE), np.full(SHAPE, -1000.0)]
)
def test_without_a_body_in_air_there_is_one_sentence(values):
    with pytest.raises(RleSplatError, match="No body with air around it was found"):
        drain(body_steps(volume_of(values)))


def test_it_can_be_stopped_and_its_progress_never_falls():
    steps = body_steps(volume_of(chest()[0]))
    fractions = [step.fraction for step in steps]
    assert len(fractions) > 10 and fractions == sorted(fractions) and fractions[-1] <= 1.0
    steps = body_steps(volume_of(chest()[0]))
    next(steps)
    steps.close()


def test_what_a_transfer_function_shows_beside_the_body_is_hidden():
    values, body, table = chest()
    volume = volume_of(values)
    soft, lungs = (
        TransferFunction(opacity=((low, 0.0), (low, 0.5), (high, 0.5), (high, 0.0)), color=((0.0, 1.0, 1.0, 1.0),))
        for low, high in ((0.0, 300.0), (-900.0, -800.0))
    )
    found = body_labels(volume, soft)
    shown = found.volume.voxels == 1
    assert found.functions == {0: None} and shown[body].mean() > 0.995 and not shown[table].any()
    assert body_labels(volume, lungs) is None  # nothing beside the body is seen
    assert body_labels(volume_of(np.full(SHAPE, 40.0)), soft) is None  # no body
    assert body_labels(replace(volume, value_unit=None), soft) is None  # no CT
    assert body_labels(replace(volume, frames=2), soft) is None
