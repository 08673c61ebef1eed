"""Fit the constants of all plans, rle_splat/pipeline/calibration.json, on synthetic scenes.

The plans of the quality presets are measured by ``calibrate_presets``.  For the planner, errors are measured against
the truth at probe pixels.  The error of a depth rule is measured with dense sheets, that of a warp filter and a sheet
density with many sheets; both are divided by the difference of the scene's pilots.  The constants are the same quantile
over all scenes, scaled together so that this share of all plans has an error no larger than predicted.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.planner.candidates import WARP_FILTERS
from rle_splat.accuracy.planner.error_estimate import largest_of
from rle_splat.accuracy.planner.features import difference_of, features_of, pilots
from rle_splat.accuracy.probes import choose_probes, probe_errors
from rle_splat.accuracy.truths import truth
from rle_splat.pipeline import plan_model
from rle_splat.pipeline.plan_model import Features, Model, splat_terms, warp_terms
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import CLASSIFICATIONS, Quality, Scene, truth_of

from .calibrate_presets import calibrate_presets
from .frames import best_frame
from .planning_scenes import calibration_scenes

QUANTILE = 0.8  # share of the errors on the calibration scenes that are below the prediction
RULES = ("slice", "simpson", "gauss2", "midpoint-1", "midpoint-2", "midpoint-3", "midpoint-4")
PREINTEGRATED = ("preintegrated", "preintegrated-2", "preintegrated-4")
DENSE = 4.0  # sheet density at which depth rules are measured
# Sheet density -> depth rule for measuring filters, fine enough that the depth error does not matter.
DENSITIES = {
    0.5: "midpoint-4", 0.7: "midpoint-4", 1.0: "midpoint-4", 1.5: "midpoint-4", 2.0: "midpoint-6", 3.0: "midpoint-8",
    4.0: "midpoint-8", 6.0: "midpoint-8",
}  # fmt: skip
DENSEST = {"bilinear": 2.0, "keys": 3.0, "cubic": 6.0}  # measured of each filter
CARRIED = (3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # densities that constants are carried on to
NO_TERMINATION = 1e-5
PRESETS = "presets"
FAINTEST = 0.02  # levels: pilots that differ by less tell nothing
# Plans whose errors come from depth and density alike.
VALIDATION = (
    ("slice", 0.7, "bilinear"), ("slice", 1.0, "cubic"), ("simpson", 1.0, "cubic"), ("simpson", 1.5, "cubic"),
    ("midpoint-2", 1.5, "keys"), ("midpoint-2", 2.0, "cubic"), ("midpoint-4", 2.0, "cubic"),
    ("midpoint-4", 3.0, "cubic"), ("midpoint-6", 3.0, "cubic"), ("midpoint-8", 4.0, "cubic"),
)  # fmt: skip
# Plans whose times alone count: what a sheet costs where it is large and nearly empty.
LARGE = (("slice", 8.0, "keys"), ("midpoint-4", 8.0, "keys"), ("midpoint-8", 10.0, "keys"))
PROBES, SUSPECTS = 1000, 500
REPEATS = 2  # frames of each plan, of which the quicker one counts


def rules_of(classification: str) -> tuple[str, ...]:
    """The depth rules that are measured."""
    return (*RULES, *PREINTEGRATED) if classification == "post" else RULES


def observe(scene: Scene, base: Quality) -> dict:
    """Measure one scene, with the classification and threads of ``base``.

    JSON-ready: ``features``, and ``plans`` as tuples (depth rule, sheet density, warp filter, largest error in levels,
    milliseconds of splat, milliseconds of warp).
    """
    cache = StageCache()

    def draw(rule, density, warp_filter, repeats=1):
        plan = replace(
            base, name="calibration", depth_rule=rule, sheet_density=density, warp_filter=warp_filter,
            termination=NO_TERMINATION,
        )  # fmt: skip
        return best_frame(scene, plan, repeats, cache)[0]

    for plan in pilots(base).values():  # a first run makes the tables and allocates memory
        render(scene, plan, cache=cache)
    drawn = {name: render(scene, plan, cache=cache) for name, plan in pilots(base).items()}
    features = features_of(scene, base, drawn)
    fine = draw("midpoint-4", 2.0, "cubic").rgba
    probes, which = choose_probes(fine, PROBES), truth_of(base)
    suspects = [largest_of(difference_of(drawn["coarse"], drawn[other]), SUSPECTS // 2) for other in ("deep", "dense")]
    columns, rows = (np.concatenate(parts) for parts in zip((probes.columns, probes.rows), *suspects))
    true, _ = truth(scene, which, pixels=(columns + 0.5, rows + 0.5), tolerance=1e-7, **shading_of(scene, which))
    wanted = [(rule, DENSE, "cubic") for rule in rules_of(base.classification)]
    wanted += [
        (rule, density, name) for density, rule in DENSITIES.items() for name in WARP_FILTERS
        if density <= DENSEST[name]
    ]  # fmt: skip
    plans = []
    for plan in dict.fromkeys((*wanted, *VALIDATION, *LARGE)):
        rendering = draw(*plan, REPEATS)
        stages = rendering.report["stages_ms"]
        error = float(probe_errors(rendering.rgba[rows, columns], true).max())
        plans.append((*plan, error, stages["splat"], stages["warp"]))
    return {"features": features.report(), "plans": plans}


def fitted(observations: list[dict], base: Quality) -> tuple[dict, dict]:
    """(keyword arguments of Model, JSON-ready statistics of the fit) of a classification, as ``observe`` saw it."""
    scenes = [(Features(**seen["features"]), {tuple(p[:3]): p[3] for p in seen["plans"]}) for seen in observations]
    cubic = _densities(scenes, "cubic")
    warp = {name: cubic if name == "cubic" else _densities(scenes, name, cubic) for name in WARP_FILTERS}
    at_dense = dict(cubic)[DENSE]
    depth = {
        rule: _envelope(
            _without(errors[rule, DENSE, "cubic"], at_dense * f.sheet_step) / f.depth_step for f, errors in scenes
            if f.depth_step > FAINTEST
        )
        for rule in rules_of(base.classification)
    }  # fmt: skip
    times = [(number, f, *plan) for number, (f, _) in enumerate(scenes) for plan in observations[number]["plans"]]
    of_scene = [entry[0] for entry in times]
    sheets = [entry for entry in times if entry[2] not in PREINTEGRATED]
    splat = _nonnegative_fit(
        [splat_terms(f, rule, density) for _, f, rule, density, *_ in sheets], [entry[-2] for entry in sheets],
        [entry[0] for entry in sheets],
    )  # fmt: skip
    warped = _nonnegative_fit(
        [warp_terms(f, name, density) for _, f, _, density, name, *_ in times], [entry[-1] for entry in times], of_scene
    )
    constants = {"depth": depth, "warp": warp, "splat_ms": splat, "warp_ms": warped}
    if base.classification == "post":
        constants["family_factor"] = {"preintegrated": _family_factor(times, splat)}
    factor = float(np.quantile(_against_truth(constants, scenes, base), QUANTILE))
    constants["depth"] = {rule: _rounded(factor * value) for rule, value in depth.items()}
    constants["warp"] = {name: [[d, _rounded(factor * value)] for d, value in table] for name, table in warp.items()}
    ratios = _against_truth(constants, scenes, base)
    quantiles = {f"{share:.0%}": _rounded(np.quantile(ratios, share)) for share in (0.1, 0.5, 0.8, 0.95, 1.0)}
    return constants, {"scenes": len(scenes), "factor": _rounded(factor), "measured_over_predicted": quantiles}


def _without(error: float, other: float) -> float:
    """An error with another one subtracted in quadrature; at least a tenth of it."""
    return max(np.sqrt(max(error**2 - other**2, 0.0)), 0.1 * error)


def _envelope(ratios) -> float:
    return float(np.quantile(list(ratios), QUANTILE))


def _densities(scenes, name: str, cubic=None) -> list[list[float]]:
    """[[density, constant], ...] of one filter, extrapolated beyond the measured densities with the last slope.

    Its ratio to the ``cubic`` filter's table never falls below that at the last measured density.
    """
    table = []
    for density, rule in DENSITIES.items():
        if density > DENSEST[name]:
            continue
        ratios = [errors[rule, density, name] / f.sheet_step for f, errors in scenes if f.sheet_step > FAINTEST]
        table.append([density, _envelope(ratios)])
    for number in range(1, len(table)):  # denser is never worse
        table[number][1] = min(table[number][1], table[number - 1][1])
    (before, high), (last, low) = table[-2:]
    order = max(np.log(high / low) / np.log(last / before), 1.0)
    best = dict(cubic or ())
    for density in CARRIED:
        if density > last:
            least = low / best[last] * best[density] if best else 0.0
            table.append([density, max(low * (last / density) ** order, least)])
    return table


def _against_truth(constants, scenes, base: Quality) -> list[float]:
    """Measured over predicted error of all plans in VALIDATION whose predicted error is above the noise."""
    model = Model(base.classification, **constants)
    ratios = []
    for f, errors in scenes:
        for rule, density, warp_filter in VALIDATION:
            plan = replace(
                base, depth_rule=rule, sheet_density=density, warp_filter=warp_filter, termination=NO_TERMINATION
            )
            budget = model.errors(f, plan)
            if budget.modeled > 0.1:
                ratios.append(max(errors[rule, density, warp_filter] - budget.bounds, 0.0) / budget.modeled)
    return ratios


def _family_factor(times, splat_ms) -> float:
    """The median ratio of the time of pre-integrated sheets to that of as many other sheets in the same scene."""
    ratios = [
        (number, rule in PREINTEGRATED, spent / float(np.dot(splat_ms, splat_terms(f, rule, density))))
        for number, f, rule, density, _, _, spent, _ in times
    ]
    plain = {number: [r for n, special, r in ratios if n == number and not special] for number, *_ in ratios}
    return _rounded(float(np.median([r / np.median(plain[n]) for n, special, r in ratios if special])))


def _nonnegative_fit(terms, milliseconds, scene_of) -> list[float]:
    """Non-negative coefficients of terms that add up to milliseconds, by relative least squares.

    Each scene gets its own factor on the speed, because the planner takes that from the pilots.
    """
    terms, spent, scene_of = np.array(terms), np.maximum(np.array(milliseconds), 0.02), np.array(scene_of)
    scale, expected = np.ones(scene_of.max() + 1), spent
    for _ in range(12):
        goal = spent / scale[scene_of]
        weight = 1.0 / np.sqrt(goal * expected)  # weighs a factor too high and a factor too low equally
        coefficients = _nonnegative(terms * weight[:, None], goal * weight)
        expected = np.maximum(terms @ coefficients, 1e-3)
        ratio = spent / expected
        scale = np.array([np.median(ratio[scene_of == number]) for number in range(len(scale))])
        scale /= np.median(scale)
    return [_rounded(value) for value in coefficients]


def _nonnegative(terms: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Non-negative least squares by coordinate descent."""
    size = np.maximum(np.linalg.norm(terms, axis=0), 1e-30)
    among, wanted = (terms / size).T @ (terms / size), (terms / size).T @ goal
    found = np.zeros(len(wanted))
    for _ in range(3000):
        for number in range(len(found)):
            found[number] = max(found[number] + wanted[number] - among[number] @ found, 0.0)
    return found / size


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def main(arguments) -> int:
    parser = argparse.ArgumentParser(prog="dev.py calibrate", description=__doc__)
    parser.add_argument("--part", nargs="*", choices=(*CLASSIFICATIONS, PRESETS), default=(*CLASSIFICATIONS, PRESETS))
    parser.add_argument("--output", type=Path, default=plan_model.CALIBRATION)
    parser.add_argument("--observations", type=Path, help="write the measurements to this file too")
    options = parser.parse_args(arguments)
    written = json.loads((options.output if options.output.exists() else plan_model.CALIBRATION).read_text())
    observed, began = {}, time.perf_counter()
    for classification in (part for part in CLASSIFICATIONS if part in options.part):
        base = Quality(classification=classification)
        observed[classification] = []
        for name, scene in calibration_scenes():
            start = time.perf_counter()
            observed[classification].append({"name": name, **observe(scene, base)})
            spent = time.perf_counter() - start
            print(f"{classification}: {name}, {spent:.1f} s", flush=True)
        constants, fit = fitted(observed[classification], base)
        written["classifications"][classification], written["fit"][classification] = constants, fit
        for share, ratio in fit["measured_over_predicted"].items():
            print(f"{classification}: the error of {share} of the plans is at most {ratio:.2f} times the prediction")
    if PRESETS in options.part:  # last, since it changes the clock
        plans, observed[PRESETS] = calibrate_presets()
        written[PRESETS] = [plan.report() for plan in plans]
    if options.observations:
        options.observations.write_text(json.dumps(observed))
    options.output.write_text(json.dumps(written, indent=1) + "\n", encoding="utf-8")
    print(f"Wrote {options.output} in {time.perf_counter() - began:.0f} s.")
    return 0
