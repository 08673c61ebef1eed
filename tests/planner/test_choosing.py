"""Proves the planner's own reckoning, without a renderer: names, budgets, bounds, and that the plan chosen is the
cheapest of those expected to keep the tolerance, whatever the tolerance."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rle_splat.accuracy.planner.candidates import candidates, check_plannable, check_tolerance, depth_rules, name_of
from rle_splat.accuracy.planner.choose import SAFETY, Speed, choose, correct, termination_for
from rle_splat.accuracy.planner.features import pilots
from rle_splat.accuracy.planner.machine import MachineProfile
from rle_splat.pipeline.plan_model import CALIBRATION, ErrorBudget, Features, Model, family_of
from rle_splat.scene import NO_RAYS, Quality, RleSplatError

CALIBRATED = tuple(json.loads(CALIBRATION.read_text())["classifications"])


MACHINE = MachineProfile(splat=1.0, warp=1.0, cell_us=0.05, slab_us=0.02, memory=1 << 35)


def features(**changes) -> Features:
    """Of a scan of middling hardness."""
    of_a_scan = dict(
        classification="pre", depth_step=30.0, sheet_step=40.0, pixels_per_voxel=1.3, sheets=256,
        row_sheets=1.5e5, pixel_sheets=8e7, sheet_pixels=3e5, pixels=262_144, kept_voxels=1_500_000, runs=120_000,
        largest_color=1.0,
    )  # fmt: skip
    return Features(**(of_a_scan | changes))


def base(classification: str) -> Quality:
    return Quality(classification=classification)


@pytest.mark.parametrize(
    "knobs, name",
    [
        (
            dict(classification="post", depth_rule="slice", sheet_density=1.0, warp_filter="cubic"),
            "post slice 1.0 cubic",
        ),
        (dict(depth_rule="midpoint-12", sheet_density=1.25, warp_filter="keys"), "pre midpoint-12 1.25 keys"),
    ],
)  # fmt: skip
def test_names(knobs, name):
    assert name_of(Quality(**({"classification": "pre"} | knobs))) == name


@pytest.mark.parametrize("classification", CALIBRATED)
def test_the_grid_differs_in_its_own_knobs_and_every_plan_has_its_name(classification):
    quality = replace(base(classification), threads=1)
    grid = candidates(quality)
    assert len({name_of(plan) for plan in grid}) == len(grid) > 300
    assert {plan.classification for plan in grid} == {classification} and {plan.threads for plan in grid} == {1}
    assert {plan.depth_rule for plan in grid} == set(depth_rules(classification))
    for plan in (*grid, *pilots(quality).values()):  # of one axis and sheets alone, by which they are compared
        assert plan.axis_fade == 0.0 and plan.rays == NO_RAYS
    assert [family_of(rule) for rule in ("slice", "simpson", "midpoint-6")] == [
        ("slice", 1), ("simpson", 2), ("midpoint", 6),
    ]  # fmt: skip


@pytest.mark.parametrize("classification", CALIBRATED)
def test_finer_plans_are_expected_to_err_less_and_to_take_longer(classification):
    model, seen, quality = Model.of(classification), features(classification=classification), base(classification)

    def along(**knobs):
        name, values = next(iter(knobs.items()))
        plans = [replace(quality, **{"depth_rule": "midpoint-2", "sheet_density": 1.0, name: v}) for v in values]
        return [model.errors(seen, p).modeled for p in plans], [model.milliseconds(seen, p)[0] for p in plans]

    for errors, times in (
        along(depth_rule=("midpoint-1", "midpoint-2", "midpoint-4", "midpoint-8", "midpoint-16", "midpoint-32")),
        along(sheet_density=(0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)),
    ):
        assert all(finer < coarser for coarser, finer in pairwise(errors))
        assert all(longer > shorter > 0.0 for shorter, longer in pairwise(times))


def test_the_budget_adds_up_and_its_bounds_hold_by_themselves():
    model, quality = Model.of("pre"), replace(base("pre"), termination=1e-3, record=8)
    budget = model.errors(features(largest_color=1.5), quality)
    assert budget.total == pytest.approx(
        np.hypot(budget.depth, budget.warp) + budget.termination + budget.records + budget.rounding
    )
    assert budget.termination == pytest.approx(255 * 1e-3 * 1.5)
    assert 0.0 < budget.records < 0.5
    assert model.errors(features(), replace(quality, record=16)).records == 0.0
    assert 0.0 < budget.rounding < 0.1
    assert budget.report()["total"] == budget.total


@pytest.mark.parametrize("classification", CALIBRATED)
@pytest.mark.parametrize("tolerance", (16.0, 8.0, 4.0, 2.0, 1.0, 0.5))
def test_the_cheapest_plan_that_keeps_a_tolerance_is_chosen(classification, tolerance):
    model, seen = Model.of(classification), features(classification=classification, depth_step=8.0, sheet_step=10.0)
    choice = choose(seen, base(classification), tolerance, model, MACHINE)
    assert choice.keeps and choice.errors.total <= SAFETY * tolerance
    assert 255 * choice.plan.termination <= 0.1001 * tolerance  # the floor nobody sees
    for other in candidates(choice.plan):
        if model.errors(seen, other).total <= SAFETY * tolerance:
            assert sum(model.milliseconds(seen, other)) >= choice.milliseconds * (1 - 1e-9)


def test_stricter_wishes_cost_more_and_what_no_plan_keeps_is_said():
    model, seen = Model.of("pre"), features()
    times = [choose(seen, base("pre"), tolerance, model, MACHINE).milliseconds for tolerance in (16.0, 4.0, 1.0)]
    assert times[0] < times[1] < times[2]
    hopeless = choose(seen, base("pre"), 1e-4, model, MACHINE)
    assert not hopeless.keeps
    best = min(model.errors(seen, plan).total for plan in candidates(hopeless.plan))
    assert best <= hopeless.errors.total <= 1.26 * best


def test_memory_bounds_the_sheets():
    small = replace(MACHINE, memory=int(3e5 * 40 * 2.5**2))
    assert choose(features(), base("pre"), 1e-4, Model.of("pre"), small).plan.sheet_density <= 2.5


def test_what_a_measurement_says_is_believed():
    budget = ErrorBudget(depth=3.0, warp=4.0, termination=0.1, records=0.0, rounding=0.0)
    assert correct(budget, 5.1) == pytest.approx(1.15)
    assert correct(budget, 10.1) == pytest.approx(2.3) and correct(budget, 10.1, 2.0) == pytest.approx(4.6)
    assert correct(budget, 0.5) == 1.0  # a lucky plan is no reason to hope
    model, seen = Model.of("pre"), features()
    first, second = (choose(seen, base("pre"), 2.0, model, MACHINE, correction=c) for c in (1.0, 3.0))
    assert second.milliseconds > first.milliseconds and second.errors.total <= SAFETY * 2.0


@pytest.mark.parametrize(("density", "rule", "splat"), (
    (0.7, "slice", 1.0), (1.4, "slice", 3.0), (0.7, "midpoint-2", 2.0), (1.4, "gauss2", 6.0), (0.35, "slice", 1 / 3),
    (0.99, "midpoint-1", 3.0**0.5), (0.1, "slice", 1 / 3), (8.0, "midpoint-8", 6.0),
))  # fmt: skip
def test_the_speed_of_a_plan_is_interpolated_between_the_pilots(density, rule, splat):
    model, seen, timed = Model.of("pre"), features(), {}
    factors = {"coarse": (1.0, 1.0), "deep": (2.0, 50.0), "dense": (3.0, 2.0)}
    for name, plan in pilots(base("pre")).items():
        expected = model.milliseconds(seen, plan)
        timed[name] = plan, {stage: by * ms for stage, by, ms in zip(("splat", "warp"), factors[name], expected)}
    plan = replace(base("pre"), depth_rule=rule, sheet_density=density)
    speed = Speed.of(model, seen, timed, plan)
    assert speed.splat == pytest.approx(splat, rel=0.01) and speed.warp == pytest.approx(2.0)
    latest = pilots(base("pre"))["deep"], dict(zip(("splat", "warp"), expected_of_deep(model, seen, 7.0, 0.3)))
    speed = Speed.of(model, seen, timed, plan, latest)
    assert speed.splat == pytest.approx(7.0) and speed.warp == pytest.approx(0.3)


def expected_of_deep(model, seen, *times):
    """So many times what the pilot ``deep`` is expected to take."""
    return [by * ms for by, ms in zip(times, model.milliseconds(seen, pilots(base("pre"))["deep"]))]


def test_termination_comes_from_the_tolerance():
    assert 255 * termination_for(1.0, 1.0) == pytest.approx(0.1)
    assert 255 * 2.0 * termination_for(1.0, 2.0) == pytest.approx(0.1)
    assert termination_for(1000.0, 1.0) <= 1 / 256 and termination_for(1e-9, 1.0) > 0.0


@pytest.mark.parametrize("wish", (0.0, -1.0, float("nan"), float("inf"), "fine", None))
def test_a_wish_that_is_none_is_refused(wish):
    with pytest.raises(RleSplatError, match="8-bit steps"):
        check_tolerance(wish)


@pytest.mark.parametrize("knobs", (dict(model="opacity"), dict(kernel="bspline2"), dict(minification="widen")))
def test_knobs_without_a_truth_are_refused(knobs):
    with pytest.raises(RleSplatError, match="A tolerance cannot be met"):
        check_plannable(Quality(classification="pre", **knobs))


def test_an_uncalibrated_classification_is_refused(monkeypatch):
    monkeypatch.setattr("rle_splat.pipeline.plan_model._calibration", lambda: {"classifications": {"pre": {}}})
    with pytest.raises(RleSplatError, match="'post'; a tolerance can be asked of pre"):
        Model.of("post")
