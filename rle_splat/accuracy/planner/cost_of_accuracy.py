"""What accuracy costs in time: plans measured on one scene, each against the truth it promises (algorithm.md 2).

A plan's time is that of a frame, splat, warp and, of a plan for a tolerance, single rays, with its tables made.  Its
errors are those of the same probe pixels for every plan, and of one crop, where the picture is steepest, of which whole
pictures can be shown and compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from statistics import median

import numpy as np

from ...effects.analyse import analyse, called_for
from ...effects.ray_mode import mode_quality
from ...encode.store import StoredVolume
from ...pipeline.render import render_steps
from ...pipeline.shadows import shadow_count
from ...pipeline.single_rays import can_trace
from ...pipeline.stage_cache import StageCache
from ...runtime.steps import FRAME, Progress, portion
from ...scene import CLASSIFICATIONS, QUALITY_PRESETS, Quality, RleSplatError, Scene, truth_of
from ..lighting import shading_of
from ..measure import TOLERANCE
from ..metrics import ERRORS, LEVEL, SSIM_WINDOW, difference, ssim
from ..probes import PROBES, choose_probes, probe_errors
from ..truths import check_shown, truth_steps
from .candidates import check_plannable
from .choose import Choice, Speed, choose, choose_with_rays
from .error_estimate import Doubt
from .features import features_of, pilots
from .model import Model
from .retrace import ray_cost_steps, retrace_steps, with_rays

REPEATS = 5  # frames that the median is of
CROP_SIDE = 96  # pixels
TOLERANCES = (8.0, 4.0, 2.0, 1.0, 0.5)  # levels; the plans that would be chosen for these are measured too
LONGEST = 1000.0  # milliseconds a frame that such a plan may be expected to take, to be worth measuring
PILOTS_SHARE = 0.05
SINGLE_RAYS = "Following single rays"
FRAMES_SHARE = 0.6  # of the whole work, as progress shows it; the rest is the truths
# What a plan's error is of, for people.
TRUTH_TEXTS = {
    "T1": "the exact integral of the interpolated classified medium, which is what classifying voxels first promises",
    "T2": "the exact integral of the classified interpolated scalar, which is what a ray caster shows",
}
MACHINE = ("threads", "backend", "name")  # what two plans that are the same may differ in
REFINED = "refined"  # too long to encode to be measured where nobody asked for it
# Depth rules and sheet densities of plans between the qualities; what a classification does not have is left out.
BETWEEN = (
    ("slice", 1.0), ("slice", 1.5), ("gauss2", 1.5), ("midpoint-2", 2.0), ("midpoint-4", 2.0), ("midpoint-4", 3.0),
    ("preintegrated", 2.0), ("preintegrated-2", 1.5), ("preintegrated-4", 3.0),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Sweep:
    """``report``: JSON-ready, see ``sweep_steps``.  ``truths``: truth's name -> (h, w, 4) float64 of the crop;
    ``pictures``: plan's name -> (h, w, 4) float32 of the crop.  ``chosen``: the Rendering of the chosen plan."""

    report: dict
    truths: dict
    pictures: dict
    chosen: object

    def plan(self, name: str) -> dict:
        """The entry of a plan."""
        return next(entry for entry in self.report["plans"] if entry["name"] == name)


def sensible_plans(base: Quality) -> list[Quality]:
    """Plans worth their time on some scene, each with a name of its own, those with the same tables one after the
    other: the paper's own, the qualities of the other way to classify, and, as ``base`` classifies, some plans between
    the qualities and these.  The machine and, where there is a choice, the record are those of ``base``."""
    machine = dict(threads=base.threads, backend=base.backend)
    plans = [Quality.paper(record=base.record, **machine)]
    for classification in CLASSIFICATIONS:
        if classification not in (REFINED, base.classification):
            plans += _qualities(base, classification)
    mine = _qualities(base, base.classification)
    known = {(plan.depth_rule, plan.sheet_density) for plan in mine}
    for rule, density in BETWEEN:
        fields = dict(depth_rule=rule, sheet_density=density, termination=1 / 4096)
        plan = possible(mine[-1], name=_named(base.classification, f"{rule} {density:.1f}"), **fields)
        if plan is not None and (rule, density) not in known:
            plans.append(plan)
    return plans + mine


def possible(base: Quality, **fields) -> Quality | None:
    """The plan with these fields changed, None where they do not go together."""
    try:
        return replace(base, **fields)
    except RleSplatError:
        return None


def _qualities(base: Quality, classification: str) -> list[Quality]:
    """The quality presets of a classification, the last one the most accurate."""
    fields = dict(threads=base.threads, backend=base.backend, refinement=base.refinement)
    if classification != "post":  # which keeps the volume's own values
        fields["record"] = base.record
    return [
        replace(Quality.preset(name, classification=classification, **fields), name=_named(classification, name))
        for name in QUALITY_PRESETS
    ]


def _named(classification: str, name: str) -> str:
    """``name`` alone for what a quality means by itself, else with its classification before it."""
    return name if classification == Quality.preset("standard").classification else f"{classification} {name}"


def same_plan(one: Quality, other: Quality) -> bool:
    """Whether two plans make the same picture in the same way."""
    shared = {name: getattr(other, name) for name in MACHINE}
    return replace(one, **shared) == other


def knobs_of(plan: Quality) -> dict:
    """A plan as JSON: every field but those of MACHINE."""
    return {name: value for name, value in asdict(plan).items() if name not in MACHINE}


@dataclass(frozen=True, eq=False)
class Singles:
    """Pixels of a plan's picture, ``columns`` and ``rows``, that are had by rays of their own, of so many ``slabs``."""

    columns: np.ndarray
    rows: np.ndarray
    slabs: int

    def report(self) -> dict:
        return {"pixels": len(self.columns), "slabs": self.slabs}


def planned_steps(scene: Scene, base: Quality, tolerances, cache: StageCache, end: float):
    """Generator of Progress up to ``end``: name -> Choice, the plans that each tolerance, in levels, would choose, and
    name -> Singles, of those that have pixels by single rays."""
    model = Model.of(base.classification)
    drawn, frames = {}, []
    for number, (name, plan) in enumerate(pilots(base).items()):
        drawn[name] = yield from _rendered(scene, plan, cache, end * number / 3, end * (number + 1) / 3)
        frames.append((plan, drawn[name].report["stages_ms"]))
    features = features_of(scene, base, drawn)
    speed = Speed.of(model, features, frames[1:])  # the first one also filled the caches
    doubt, seen = None, called_for(scene, analyse(scene, base))
    if can_trace(seen, base):
        doubt = Doubt.of(drawn)
        cost = yield from portion(ray_cost_steps(seen, base, doubt, cache), end, end, SINGLE_RAYS)
    chosen, singles = {}, {}
    for tolerance in tolerances:
        name = f"for {tolerance:g} level{'' if tolerance == 1 else 's'}"
        if doubt is None:
            choice = choose(features, base, tolerance, model, speed)
        else:
            choice = choose_with_rays(features, base, tolerance, model, doubt, cost, speed)
            rows, columns = np.nonzero(doubt.modelled(model, choice.plan) > choice.allowed)
            if len(rows):
                singles[name] = Singles(columns, rows, choice.slabs)
        chosen[name] = replace(choice, plan=replace(choice.plan, name=name))
    return chosen, singles


def with_plan(plans, chosen: Quality) -> tuple[list[Quality], str]:
    """The plans with ``chosen`` among them, and the name it goes by there."""
    for plan in plans:
        if same_plan(plan, chosen):
            return list(plans), plan.name
    name = chosen.name
    while any(plan.name == name for plan in plans):
        name = f"your {name}"
    return [*plans, replace(chosen, name=name)], name


def front(plans, key: str = "rmse") -> list[str]:
    """Names of the plans that no other beats in both time and error, quickest first.

    ``plans``: entries of a report, all against one truth.  ``key``: of ERRORS.
    """
    names, least = [], np.inf
    for entry in sorted(plans, key=lambda entry: (entry["frame_ms"], entry["error"][key])):
        if entry["error"][key] < least:
            least = entry["error"][key]
            names.append(entry["name"])
    return names


def sweep_steps(
    scene: Scene, plans, chosen: Quality, *, probes: int = PROBES, repeats: int = REPEATS, error: str = "rmse",
    tolerances=(), crop_side: int = CROP_SIDE, flip: Callable | None = None,
    cache: StageCache | None = None, seed: int = 0,
):  # fmt: skip
    """Generator: yields Progress, returns a Sweep of the plans, with ``chosen`` among them.

    ``tolerances``: levels; the plans that would be chosen for them beside ``chosen``'s other knobs are measured too,
    and their entries say what was ``predicted``.
    ``flip``: a function of (picture, truth), for a metric that is not ours; or None.  ``error``: of ERRORS, by which
    the fronts are told.  The report's ``plans`` hold for each its knobs, ``frame_ms`` (the median), its ``truth``
    and ``error``: at the probe pixels ``rmse``, ``p999``, ``bias`` and ``psnr`` are of the random ones, ``largest`` of
    all of them and the crop; ``crop`` are those of the crop, on display-encoded colour ``ssim`` and ``flip``.
    ``as_ray_caster`` is the error against T2 of a plan that promises T1.
    Raises RleSplatError for scenes without voxels or with meshes.
    """
    scene = _measurable(scene, chosen)
    if probes < 1 or repeats < 1:
        raise RleSplatError("Measuring takes one probe and one repeat at least.")
    cache = StageCache() if cache is None else cache
    choices, singles, remarks = {}, {}, []
    if tolerances:
        remarks = [f"No plans for tolerances: {why}" for why in _no_promise(chosen)]
    if tolerances and not remarks:
        choices, singles = yield from planned_steps(scene, chosen, tolerances, cache, PILOTS_SHARE)
        plans, remarks = _with_choices(plans, choices)
    plans, chosen_name = with_plan(plans, chosen)
    # The last plan is rendered first: where its picture is steep, all are looked at.
    began_at = PILOTS_SHARE if tolerances else 0.0
    share = (FRAMES_SHARE - began_at) / (len(plans) + 1)
    finest = yield from _drawn(scene, plans[-1], singles, cache, began_at, began_at + share)
    where = choose_probes(finest.rgba, probes, seed)
    window = steepest_window(finest.rgba, crop_side)
    looks, reports, stages, chosen_rendering = {}, {}, {}, None
    for number, plan in enumerate(plans, start=1):
        begin = began_at + share * number
        rendering = yield from _drawn(scene, plan, singles, cache, begin, begin + 0.5 * share)
        looks[plan.name] = (where.of(rendering.rgba), rendering.rgba[window.rows, window.columns].copy())
        reports[plan.name] = rendering.report
        if plan.name == chosen_name:
            chosen_rendering = rendering
        # One plan after the other, not in turns: a store keeps the tables of a few plans at most.
        stages[plan.name] = []
        for turn in range(repeats):
            done = begin + share * (0.5 + 0.5 * turn / repeats)
            rendering = yield from _drawn(scene, plan, singles, cache, done, done)
            stages[plan.name].append(rendering.report["stages_ms"])
    promised = {name: report["error"]["truth"] for name, report in reports.items()}
    began = time.perf_counter()
    true = yield from _truths(scene, sorted({*promised.values(), "T2"}), where.centres, window)
    truth_ms = 1e3 * (time.perf_counter() - began)
    entries = []
    for plan in plans:
        truth_name = promised[plan.name]
        entry = {"name": plan.name, "chosen": plan.name == chosen_name, "truth": truth_name, "knobs": knobs_of(plan)}
        entry.update({f"{stage}_ms": median(s.get(stage, 0.0) for s in stages[plan.name]) for stage in FRAME})
        entry["frame_ms"] = median(sum(s.get(stage, 0.0) for stage in FRAME) for s in stages[plan.name])
        own = reports[plan.name]["rays"]
        entry["rays"] = singles[plan.name].report() if plan.name in singles else own if own["pixels"] else None
        entry["error"] = _errors(looks[plan.name], true[truth_name], where.random, flip)
        beside = truth_name != "T2"
        entry["as_ray_caster"] = _errors(looks[plan.name], true["T2"], where.random, None) if beside else None
        entry["predicted"] = _prediction(choices.get(plan.name))
        entries.append(entry)
    fronts = {
        name: front([entry for entry in entries if entry["truth"] == name], error)
        for name in sorted(set(promised.values()))
    }
    for entry in entries:
        entry["on_front"] = entry["name"] in fronts[entry["truth"]]
    any_report = reports[chosen_name]
    report = {
        "image": any_report["image"], "volume": any_report["volume"], "threads": any_report["threads"],
        "repeats": repeats, "truth_ms": truth_ms, "front_by": error, "chosen": chosen_name,
        "probes": {"random": where.random, "steep": len(where.columns) - where.random},
        "crop": [window.columns.start, window.rows.start, window.columns.stop, window.rows.stop],
        "truths": {name: TRUTH_TEXTS[name] for name in fronts}, "fronts": fronts, "plans": entries,
        "remarks": [*any_report["remarks"], *remarks],
    }  # fmt: skip
    yield Progress(1.0, "Done")
    crops = {name: look[1] for name, look in looks.items()}
    return Sweep(report, {name: values[1] for name, values in true.items()}, crops, chosen_rendering)


def _no_promise(quality: Quality) -> list[str]:
    """Why no tolerance can be promised beside a quality's knobs: a sentence, or nothing."""
    try:
        check_plannable(quality)
        Model.of(quality.classification)
    except RleSplatError as problem:
        return [str(problem)]
    return []


def _with_choices(plans, choices: dict[str, Choice]) -> tuple[list[Quality], list[str]]:
    """The plans with those that were chosen for tolerances before them, and a sentence on those that were not."""
    found, hopeless, slow = [], [], []
    for name, choice in choices.items():
        if not choice.keeps:
            hopeless.append(name)
        elif choice.milliseconds > LONGEST:
            slow.append(f"{name} ({choice.milliseconds / 1e3:.1f} s)")
        elif choice.rays or not any(same_plan(choice.plan, other) for other in found):
            found.append(choice.plan)
    remarks = [f"No plan is expected to keep a tolerance {', '.join(hopeless)}."] if hopeless else []
    if slow:
        remarks.append(f"Expected to take more than {LONGEST / 1e3:g} s a frame, and not measured: {', '.join(slow)}.")
    return [*found, *plans], remarks


def _prediction(choice: Choice | None) -> dict | None:
    if choice is None:
        return None
    return {"largest": choice.errors.total, "frame_ms": choice.milliseconds, "keeps": choice.keeps}


def error_map_steps(scene: Scene, quality: Quality, *, step: int = 1, cache: StageCache | None = None):
    """Generator: yields Progress, returns ((h, w) float32 levels, report) of the plan's picture of the scene.

    Each value is the largest error of any channel at the middle pixel of a block of ``step`` x ``step``; a block that
    the picture's edge cuts off before its middle has none.  ``report`` is the picture's, its ``error`` filled in.
    """
    scene = _measurable(scene, quality)
    cache = StageCache() if cache is None else cache
    rendering = yield from _rendered(scene, quality, cache, 0.0, 0.3)
    first = min(step // 2, scene.height - 1, scene.width - 1)
    rows, columns = np.mgrid[first : scene.height : step, first : scene.width : step]
    name = rendering.report["error"]["truth"]
    centres = columns.ravel() + 0.5, rows.ravel() + 0.5
    true = yield from _integrated(scene, name, *centres, 0.3, 1.0)
    errors = probe_errors(rendering.rgba[rows, columns].reshape(-1, 4), true)
    report = dict(rendering.report)
    report["error"] = {
        **report["error"], "measured": float(errors.max()), "rmse": float(np.sqrt((errors**2).mean())),
        "truth": name, "probes": len(errors), "step": step,
    }  # fmt: skip
    return errors.reshape(rows.shape).astype(np.float32), report


@dataclass(frozen=True)
class Window:
    """A part of a picture, as slices of its rows and columns."""

    rows: slice
    columns: slice

    @property
    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """(columns, rows) of its pixels' centres, row by row."""
        rows, columns = np.mgrid[self.rows, self.columns]
        return columns.ravel() + 0.5, rows.ravel() + 0.5

    @property
    def shape(self) -> tuple[int, int]:
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start


def steepest_window(rgba, side: int) -> Window:
    """The square of at most ``side`` pixels in which neighbours of a picture (H, W, 4) differ most, on average."""
    height, width = np.shape(rgba)[:2]
    tall, wide = min(side, height), min(side, width)
    steep = np.zeros((height, width))
    steep[:-1] += np.abs(np.diff(rgba, axis=0)).max(axis=-1)
    steep[:, :-1] += np.abs(np.diff(rgba, axis=1)).max(axis=-1)
    total = np.zeros((height + 1, width + 1))
    total[1:, 1:] = steep.cumsum(axis=0).cumsum(axis=1)
    inside = total[tall:, wide:] - total[:-tall, wide:] - total[tall:, :-wide] + total[:-tall, :-wide]
    top, left = (int(n) for n in np.unravel_index(np.argmax(inside), inside.shape))
    return Window(slice(top, top + tall), slice(left, left + wide))


def table_lines(report: dict) -> list[str]:
    """The report as lines of text for a person, one table for each truth."""
    image, volume, probes = report["image"], report["volume"], report["probes"]
    has_flip = any(entry["error"]["crop"]["flip"] is not None for entry in report["plans"])
    lines = [
        f"{' x '.join(map(str, volume['shape_xyz']))} voxels, {volume['visible_fraction']:.1%} kept; "
        f"{image['width']} x {image['height']} pixels; {report['threads']} thread(s).",
    ]
    for name, text in report["truths"].items():
        mine = sorted((e for e in report["plans"] if e["truth"] == name), key=lambda entry: entry["frame_ms"])
        beside = f"{'T2 RMSE':>9}" if name != "T2" else ""
        lines += [
            "", f"Against {name}, {text}:",
            f"{'plan':<22}{'ms':>8}{'RMSE':>9}{'99.9 %':>9}{'max':>9}{'bias':>9}{'PSNR':>8}{'SSIM':>9}"
            + (f"{'FLIP':>9}" if has_flip else "") + beside,
        ]  # fmt: skip
        for entry in mine:
            error, crop = entry["error"], entry["error"]["crop"]
            marks = ("*" if entry["on_front"] else " ") + (">" if entry["chosen"] else " ")
            lines.append(
                f"{marks + entry['name']:<22}{entry['frame_ms']:8.1f}{error['rmse']:9.3f}{error['p999']:9.2f}"
                f"{error['largest']:9.2f}{error['bias']:9.4f}{error['psnr']:8.1f}{_cell(crop['ssim'], 9, 5)}"
                + (_cell(crop["flip"], 9, 4) if has_flip else "")
                + (f"{entry['as_ray_caster']['rmse']:9.3f}" if beside else "")
            )
    title = ERRORS[report["front_by"]]
    lines += [
        "",
        f"*: on the front, no other plan is both quicker and nearer to its truth ({title}).  >: the chosen plan.",
        f"ms: splat, warp and single rays, the median of {report['repeats']} frames. Errors: levels, 1/255 of "
        "premultiplied linear "
        f"RGBA; RMSE, 99.9 %, bias and PSNR at {probes['random']} random pixels, max over these, {probes['steep']} "
        "steep ones and the crop; SSIM"
        + (" and FLIP" if has_flip else "") + f" of the crop {_by(report['crop'])}, as a display shows it.",
    ]  # fmt: skip
    return lines


def _cell(value, width: int, digits: int) -> str:
    return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"


def _by(crop) -> str:
    left, top, right, bottom = crop
    return f"of {right - left} x {bottom - top} pixels at {left}, {top}"


def _measurable(scene: Scene, quality: Quality) -> Scene:
    """The scene's whole frame with the effects that are on, or a RleSplatError where there is no truth of it."""
    if isinstance(scene.volume, StoredVolume):
        raise RleSplatError("A .rle file has no voxels to take the truth from; give the volume it was made from.")
    scene = called_for(scene, analyse(scene, quality))
    check_shown(scene, truth_of(mode_quality(scene, quality)[0]))
    if scene.triangles is not None and len(scene.triangles):
        raise RleSplatError("Accuracy is measured without meshes; take the meshes out of the scene.")
    if shadow_count(scene):
        raise RleSplatError("Accuracy is measured without shadows; turn off shadows and ambient occlusion.")
    return replace(scene, crop=None)


def _rendered(scene, plan, cache, start: float, end: float):
    """Generator of Progress from ``start`` to ``end``: the Rendering of a plan."""
    steps = render_steps(scene, plan, cache)
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        yield Progress(start + (end - start) * step.fraction, f"{plan.name}: {step.message}")


def _drawn(scene, plan, singles, cache, start: float, end: float):
    """As ``_rendered``, with the plan's Singles, if it has some, and in the report's ``stages_ms`` what they took."""
    rendering = yield from _rendered(scene, plan, cache, start, end)
    single = singles.get(plan.name)
    if single is None:
        return rendering
    seen = called_for(scene, analyse(scene, plan))
    steps = retrace_steps(seen, plan, single.columns, single.rows, single.slabs, cache)
    values, spent = yield from portion(steps, end, end, SINGLE_RAYS)
    rgba = rendering.rgba.copy()
    rgba[single.rows, single.columns] = values
    stages = with_rays(rendering.report["stages_ms"], spent)
    return replace(rendering, rgba=rgba, report={**rendering.report, "stages_ms": stages})


def _truths(scene, names, probes, window):
    """Generator of Progress: each truth's (N, 4) values at the probes and (h, w, 4) of the window, by name."""
    columns, rows = (np.concatenate(both) for both in zip(probes, window.centres))
    found = {}
    for number, name in enumerate(names):
        spans = (FRAMES_SHARE + (1.0 - FRAMES_SHARE) * n / len(names) for n in (number, number + 1))
        values = yield from _integrated(scene, name, columns, rows, *spans)
        count = len(probes[0])
        found[name] = values[:count], values[count:].reshape(*window.shape, 4)
    return found


def _integrated(scene, name: str, columns, rows, start: float, end: float):
    """Generator of Progress: (N, 4) float64, a truth at pixels."""
    steps = truth_steps(scene, name, columns, rows, TOLERANCE, **shading_of(scene, name))
    return (yield from portion(steps, start, end, f"Integrating the truth {name}"))


def _errors(look, true, random: int, flip) -> dict:
    """JSON-ready errors of a plan, in levels where nothing else is said."""
    (values, crop), (true_values, true_crop) = look, true
    drawn = difference(values[:random], true_values[:random])
    inside = difference(crop, true_crop)
    largest = max(float(np.abs(values - true_values).max()) / LEVEL, inside.largest)
    small = min(crop.shape[:2]) < SSIM_WINDOW
    return {
        "largest": largest, "rmse": drawn.rmse, "p999": drawn.p999, "bias": drawn.bias, "psnr": drawn.psnr,
        "crop": {
            "largest": inside.largest, "rmse": inside.rmse, "ssim": None if small else ssim(crop, true_crop),
            "flip": None if flip is None or small else flip(crop, true_crop),
        },
    }  # fmt: skip
