"""Measure the plans of the quality presets on the synthetic scenes of the planner's calibration.

Errors are levels at random probe pixels, times the processor time of the one thread that renders.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain

import numpy as np

from rle_splat.classify.roughness import roughness
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.plan_model import PresetPlan, preset_plans
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Scene

from .frames import best_frame, time_by_processor, view_scene
from .planning_scenes import CALIBRATION_VIEWS, RAINBOW, calibration_scenes, calibration_volumes
from .plans import REPEATS, SIZE, VIEW, Judge, plan_of

PROBES = 4000  # of a picture: enough for the middle of many scenes
QUANTILE = 0.5  # share of the calibration scenes whose errors are below the expected ones
FAINTEST = 0.3  # levels: scenes below that are not fitted
# Calibration volumes that are calibrated with a step to opaque too: vessels are rougher than all others.
STEPPED = ("smooth", "thin", "blobs", "noise, bands", "cloud", "part", "signal")


def calibrate_presets() -> tuple[list[PresetPlan], dict]:
    """Measure the plans of the calibration at hand anew; returns them with new constants, and JSON-ready errors."""
    rough, observed, names = [], [], []
    for name, scene in chain(calibration_scenes(), steep_scenes()):
        value = roughness(scene.volume, scene.transfer_function)
        if value is not None and value > FAINTEST:
            names.append(name)
            rough.append(value)
            observed.append(observe(scene))
            print(f"{name:<24}{value:6.1f}" + "".join(f"{error:7.1f}" for error in observed[-1]), flush=True)
    return fit(rough, observed, measure_costs()), {"scenes": names, "roughness": rough, "p999": observed}


def observe(scene: Scene) -> list[float]:
    """The error of each plan that 999 of 1000 pixels stay below, in levels."""
    judge, cache = Judge(scene, PROBES), StageCache()
    return [judge.errors(render(scene, plan_of(one.knobs), cache=cache).rgba)["p999"] for one in preset_plans()]


def measure_costs() -> list[float]:
    """The time of a frame of each plan over that of the first: geometric means over the calibration volumes."""
    time_by_processor()
    found = []
    for _, volume, function, shaded in calibration_volumes():
        for perspective in (False, True):
            scene, cache = view_scene(volume, function, VIEW, SIZE, perspective, shaded), StageCache()
            spent = [best_frame(scene, plan_of(one.knobs), REPEATS, cache)[1] for one in preset_plans()]
            found.append(np.log(spent) - np.log(spent[0]))
    return [float(cost) for cost in np.exp(np.mean(found, axis=0))]


def steep_scenes():
    """Yield name and scene for calibration volumes with a step to opaque in the middle of their values."""
    for name, volume, _, _ in calibration_volumes():
        if name in STEPPED:
            low, high = volume.value_range
            wall = 0.5 * (low + high)
            color = tuple((low + (high - low) * position, *rgb) for position, *rgb in RAINBOW)
            function = TransferFunction("step", None, ((low, 0.0), (wall, 0.0), (wall, 1.0)), color, None, Shade())
            for number, view in enumerate(CALIBRATION_VIEWS):
                yield f"{name}, step, view {number}", view.of(volume, function, True)


def fit(rough: list[float], observed: list[list[float]], costs: list[float]) -> list[PresetPlan]:
    """The plans with constants fitted to scenes of these roughnesses, which have a row of errors each."""
    found = []
    for one, errors, cost in zip(preset_plans(), np.transpose(observed), costs, strict=True):
        x, y = np.log(rough), np.log(np.maximum(errors, FAINTEST))
        power = float(np.clip(np.polyfit(x, y, 1)[0], 0.0, 1.2))
        factor = float(np.exp(np.quantile(y - power * x, QUANTILE)))
        found.append(replace(one, cost=round(cost, 2), factor=round(factor, 2), power=round(power, 2)))
    return found
