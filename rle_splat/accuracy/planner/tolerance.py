"""Pictures that err no more than was asked: a plan is chosen, rendered, measured against the truth and, where that says
so, replaced by a finer one (algorithm.md 2.4).

What is measured is the largest difference of any channel of premultiplied scene-linear RGBA, in levels of 1/255, at
probe pixels: random ones, which speak for all pixels; those where the picture is steepest; and those at which it
differs most from one with half as many sheet pixels along each side.  The truth is T1 for the classification pre and T2
for the others.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from ...effects.analyse import analyse, called_for
from ...effects.exposure import exposures
from ...effects.mixing import is_mixed
from ...encode.store import StoredVolume
from ...pipeline.render import render_steps
from ...pipeline.shadows import SHADOW_EFFECTS, shadow_count, without_shadows
from ...pipeline.single_rays import can_trace
from ...pipeline.stage_cache import StageCache
from ...runtime.steps import Progress, portion
from ...scene import MODES, Quality, Rendering, RleSplatError, Scene, truth_of
from ..probes import PROBES
from .candidates import check_plannable, check_tolerance, name_of
from .choose import CAUTION, NEARLY_BEST, Choice, Speed, choose, choose_with_rays, corrected
from .error_estimate import MOST_SLABS, Doubt, largest_of
from .features import Features, doubtful_pixels, features_of, pilots
from .model import Model, default_classification
from .need import need_of
from .probe_errors import Judge
from .retrace import ray_cost_steps, retrace_steps, with_rays

# (With two, an X-ray foot for 8 levels was left at 8.8, in 71 ms, where a finer plan keeps them.)
MOST_ESCALATIONS = 3
# Probes that pass by less than this leave too much to luck, as other pixels err more: the next finer plan is taken.
CLEAR = 0.9
HALF = 0.5
WORTH_SAYING_MS = 2000.0  # of a frame's expected time
LEFT_OUT = "pictures to a maximum error have none"  # why an effect is off, after its "off"
STRICTEST = 0.05  # levels; float32 sheets and an eye see no less
# Shares of the work after which the pilots and each of the rounds end.
PILOTED = 0.2


@dataclass(frozen=True, eq=False)
class _Round:
    """One picture: what was chosen for it, how many of its pixels are had by ``rays`` of their own and the ``rays_ms``
    that these took; ``measured``: levels, None without probes."""

    choice: Choice
    rendering: Rendering
    rays: int
    rays_ms: float
    measured: float | None
    judged: dict | None

    @property
    def milliseconds(self) -> float:
        return frame_ms(self.rendering) + self.rays_ms

    @property
    def share(self) -> float:
        """Of the picture's pixels, that are had by rays."""
        return self.rays / max(self.rendering.rgba[..., 0].size, 1)

    @property
    def plan(self) -> str:
        """Its name for people, with what of the picture it has by single rays."""
        name = name_of(self.choice.plan)
        return f"{name} + {100.0 * self.share:.2g} % by {self.choice.slabs}-slab rays" if self.rays else name

    def report(self) -> dict:
        return {
            "plan": self.plan, "predicted": self.choice.errors.total, "measured": self.measured,
            "predicted_ms": self.choice.milliseconds, "ms": self.milliseconds,
        }  # fmt: skip


def render_within(
    scene: Scene, tolerance: float, quality: Quality | None = None, progress=None, cache: StageCache | None = None, *,
    probes: int = PROBES, seed: int = 0, leave_out_shadows: bool = False,
) -> Rendering:  # fmt: skip
    """The picture of a scene whose largest error is at most ``tolerance`` levels, 1/255, at the least expense.

    ``quality``: what the tolerance does not decide, such as the classification, the record and the threads.
    ``probes``: ordinary probe pixels that the picture is measured at, 0 for a prediction alone.  ``progress``,
    ``cache``: as ``render`` has them.  ``leave_out_shadows``: make it without shadows and ambient occlusion, of
    which there is no truth, and say so in the report's ``remarks`` and ``effects``; else a scene with them is refused.
    The report's ``error`` says what was predicted and measured, against which truth, on how many probes, whether the
    tolerance is ``kept`` and, if not, which ``floor`` there is; and in milliseconds what the picture and what planning
    and measuring took.  Raises RleSplatError for a tolerance that is none, and for scenes and qualities of which none
    can be promised.
    """
    quality = quality or Quality(classification=default_classification())
    knobs = dict(probes=probes, seed=seed, leave_out_shadows=leave_out_shadows)
    steps = tolerance_steps(scene, tolerance, quality, cache, **knobs)
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        if progress is not None:
            progress(step)


def tolerance_steps(
    scene: Scene, tolerance: float, quality: Quality, cache: StageCache | None = None, *,
    refuse_empty_view: bool = True, probes: int = PROBES, seed: int = 0, leave_out_shadows: bool = False,
):  # fmt: skip
    """Generator form of ``render_within``: yields Progress, returns the Rendering."""
    began = time.perf_counter()
    tolerance = check_tolerance(tolerance)
    left_out = []
    if leave_out_shadows:
        scene, left_out = without_shadows_of(scene, quality)
    check_measurable(scene, quality)
    cache = StageCache() if cache is None else cache
    model = Model.of(quality.classification)
    drawn, frames = {}, []
    for number, (name, plan) in enumerate(pilots(quality).items()):
        ends = PILOTED * number / 3, PILOTED * (number + 1) / 3
        drawn[name] = yield from _rendered(scene, plan, cache, refuse_empty_view, *ends, "Looking at the scene")
        frames.append((plan, drawn[name].report["stages_ms"]))
    features = features_of(scene, quality, drawn)
    seen = called_for(scene, analyse(scene, quality))
    judge = Judge(seen, quality, probes, seed) if probes else None
    wanted = _Wanted(scene, seen, tolerance, quality, cache, refuse_empty_view, model, features, frames[1:])
    if can_trace(seen, quality):
        rounds = yield from _rounds_with_rays(wanted, Doubt.of(drawn), judge)
    else:
        rounds = yield from _rounds(wanted, judge)
    yield Progress(1.0, "Done")
    spent = 1e3 * (time.perf_counter() - began)
    return _finished(seen, tolerance, quality, features, rounds, spent, left_out)


def without_shadows_of(scene: Scene, quality: Quality) -> tuple[Scene, list[str]]:
    """The scene without shadows and ambient occlusion, of which no truth has any, and which of them it called for.

    The scene that is returned gives the reason for reports.
    """
    effects = analyse(scene, quality)
    left_out = [name for name in SHADOW_EFFECTS if effects[name].on]
    reasons = {**scene.reasons_off, **dict.fromkeys(left_out, LEFT_OUT)}
    return replace(without_shadows(scene), reasons_off=reasons), left_out


@dataclass(frozen=True, eq=False)
class _Wanted:
    """What all rounds have in common.  ``frames``: pairs of a plan and the ``stages_ms`` of a frame by it; the first
    frame of all filled the caches, and is not among them.  ``seen``: the scene without the effects that are off."""

    scene: Scene
    seen: Scene
    tolerance: float
    quality: Quality
    cache: StageCache
    refuse_empty_view: bool
    model: Model
    features: Features
    frames: list

    @property
    def speed(self) -> Speed:
        return Speed.of(self.model, self.features, self.frames)

    def drawn(self, choice: Choice, begin: float, end: float, text: str = ""):
        """Generator of Progress: the Rendering of a plan, its rays left out."""
        text = text or f"Rendering {name_of(choice.plan)}"
        if choice.milliseconds > WORTH_SAYING_MS:
            text += f", about {choice.milliseconds / 1e3:.0f} s"
        found = yield from _rendered(
            self.scene, choice.plan, self.cache, self.refuse_empty_view, begin, end, text
        )  # fmt: skip
        self.frames.append((choice.plan, found.report["stages_ms"]))
        return found

    def traced(self, columns, rows, slabs: int, termination: float, begin: float, end: float):
        """Generator of Progress: (n, 4) values of pixels of the picture by rays of their own, and milliseconds."""
        quality = replace(self.quality, termination=termination)
        steps = retrace_steps(self.seen, quality, columns, rows, slabs, self.cache)
        return (yield from portion(steps, begin, end, "Following single rays"))


def _rounds(wanted: _Wanted, judge: Judge | None):
    """Generator of Progress: rounds of ever finer plans, until one keeps the tolerance or none is expected to."""
    rounds: list[_Round] = []
    tolerance, correction, slack = wanted.tolerance, 1.0, NEARLY_BEST
    chosen = wanted.features, wanted.quality, tolerance, wanted.model
    while True:
        choice = choose(*chosen, wanted.speed, correction, slack)
        begin, end = _span(len(rounds))
        middle = 0.5 * (begin + end)
        rendering = yield from wanted.drawn(choice, begin, middle)
        measured, judged = None, None
        if judge is not None:
            halved = replace(choice, plan=replace(choice.plan, sheet_density=HALF * choice.plan.sheet_density))
            other = yield from wanted.drawn(halved, middle, middle, "Rendering a coarser one beside it")
            wanted.frames.pop()
            doubtful = doubtful_pixels(rendering, other, judge.doubtful)
            judged = yield from judge.steps(rendering.rgba, doubtful, tolerance, middle, end)
            measured = judged["largest"] if judged else None
        rounds.append(_Round(choice, rendering, 0, 0.0, measured, judged))
        if measured is None or measured <= CLEAR * tolerance or len(rounds) > MOST_ESCALATIONS:
            return rounds
        correction = corrected(choice.errors, measured, correction)
        slack = 1.0 if not choice.keeps else NEARLY_BEST
        following = choose(*chosen, correction=correction, slack=slack)
        if following.plan == choice.plan or (measured <= tolerance and not following.keeps):
            return rounds


def _rounds_with_rays(wanted: _Wanted, doubt: Doubt, judge: Judge | None):
    """Generator of Progress: rounds in which ever more pixels are had by rays of their own, of ever more slabs."""
    rounds: list[_Round] = []
    tolerance, correction = wanted.tolerance, 1.0
    chosen = wanted.features, wanted.quality, tolerance, wanted.model, doubt
    steps = ray_cost_steps(wanted.seen, wanted.quality, doubt, wanted.cache)
    cost = yield from portion(steps, PILOTED, PILOTED, "Following single rays")
    choice = choose_with_rays(*chosen, cost, wanted.speed)
    begin, end = _span(0)
    rendering = yield from wanted.drawn(choice, begin, 0.5 * (begin + end))
    rgba, traced, rays_ms = rendering.rgba.copy(), np.zeros(rendering.rgba.shape[:2], bool), 0.0
    while True:
        begin, end = _span(len(rounds))
        middle = 0.5 * (begin + end)
        modelled = doubt.modelled(wanted.model, choice.plan, correction)
        new = (modelled > choice.allowed) & ~traced
        if new.any():
            rows, columns = np.nonzero(new)
            arguments = columns, rows, choice.slabs, choice.plan.termination
            values, spent = yield from wanted.traced(*arguments, 0.5 * (begin + middle), middle)
            rgba[rows, columns] = values
            rays_ms += spent
            traced |= new
        picture = replace(rendering, rgba=rgba.copy())
        measured, judged = None, None
        if judge is not None:
            doubtful = _still_doubtful(modelled, traced, judge.doubtful)
            judged = yield from judge.steps(picture.rgba, doubtful, tolerance, middle, end)
            measured = judged["largest"] if judged else None
        rounds.append(_Round(choice, picture, int(traced.sum()), rays_ms, measured, judged))
        if measured is None or measured <= CLEAR * tolerance or len(rounds) > MOST_ESCALATIONS:
            return rounds
        errors, by_ray = judge.errors_of(rgba), traced[judge.rows, judge.columns]
        finer = errors[by_ray].max(initial=0.0) > CLEAR * tolerance
        if finer:
            if choice.slabs >= MOST_SLABS:
                return rounds
            cost = cost.found(errors[by_ray].max(), choice.slabs)
        wrong = ~by_ray & (errors > CLEAR * tolerance)
        if wrong.any():
            beyond = errors[wrong] / modelled[judge.rows[wrong], judge.columns[wrong]]
            correction *= CAUTION * max(float(beyond.max()), 1.0)
        following = choose_with_rays(*chosen, cost, wanted.speed, correction, only=choice.plan)
        if finer:
            traced[:], rays_ms = False, 0.0
        choice = following


def _still_doubtful(modelled, traced, count: int):
    """Columns and rows of pixels to look at: mostly those of sheets that are most likely to be wrong, and some that
    rays were followed to."""
    by_ray = largest_of(modelled, count // 4, ~traced) if traced.any() else (np.empty(0, np.int64),) * 2
    by_sheets = largest_of(modelled, count - len(by_ray[0]), traced)
    return tuple(np.concatenate(both) for both in zip(by_sheets, by_ray, strict=True))


def check_measurable(scene: Scene, quality: Quality) -> None:
    """RleSplatError when nothing can be promised of a scene's picture, of the effects that are on."""
    check_plannable(quality)
    if isinstance(scene.volume, StoredVolume):
        raise RleSplatError(
            "A tolerance needs the voxels, which a .rle file has no longer; give the volume it was encoded from, or "
            "choose a quality."
        )
    scene = called_for(scene, analyse(scene, quality))
    if scene.mode != MODES[0]:
        raise RleSplatError(f"A tolerance cannot be kept in the mode {scene.mode}; choose a quality, or composite.")
    if is_mixed(scene):
        raise RleSplatError(
            "A tolerance is measured against a truth of one volume and one transfer function; choose a quality for "
            "labels and channels."
        )
    if scene.mist is not None:
        raise RleSplatError("A tolerance cannot be kept in mist, of which there is no truth; turn the mist off.")
    if scene.transfer_function.gradient_opacity is not None:
        raise RleSplatError("A tolerance cannot be kept with a gradient_opacity, of which there is no truth.")
    if shadow_count(scene):
        raise RleSplatError(
            "A tolerance is of light without shadows, as the truths have it: turn off shadows and ambient occlusion, "
            "or choose a quality."
        )
    if len(exposures(scene)) > 1:
        raise RleSplatError(
            "A tolerance is of a sharp picture: turn off depth of field and motion blur, or choose a quality."
        )


def frame_ms(rendering: Rendering) -> float:
    """Milliseconds of splat and warp, which every frame takes."""
    stages = rendering.report["stages_ms"]
    return stages["splat"] + stages["warp"]


def _span(number: int) -> tuple[float, float]:
    """What share of the work round ``number`` is: each is taken to be the last but one."""
    begin = 1.0 - (1.0 - PILOTED) * 0.4**number
    return begin, 1.0 - (1.0 - begin) * 0.4


def _rendered(scene, plan, cache, refuse_empty_view, begin, end, text):
    """Generator: the steps of one picture, as a part of the whole work; returns its Rendering."""
    steps = render_steps(scene, plan, cache, refuse_empty_view=refuse_empty_view)
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        message = step.message if "kernels" in step.message else text
        yield Progress(begin + (end - begin) * step.fraction, message)


# --- the report -----------------------------------------------------------------------------------------------


def _finished(
    scene: Scene, tolerance: float, quality: Quality, features: Features, rounds: list[_Round], spent: float,
    left_out: list[str],
) -> Rendering:  # fmt: skip
    """``scene``: without the effects that are off.  ``left_out``: names of those that it was asked for with."""
    best = min(rounds, key=_badness)
    rendering, choice = best.rendering, best.choice
    kept = best.measured <= tolerance if best.measured is not None else choice.keeps
    probes = sum(best.judged[kind]["count"] for kind in ("random", "steep")) if best.judged else 0
    error = {
        "tolerance": tolerance,
        "predicted": choice.errors.total,
        "measured": best.measured,
        "truth": truth_of(quality),
        "probes": probes,
        "kept": bool(kept),
        "floor": None if kept else (best.measured if best.measured is not None else choice.errors.total),
        "predicted_ms": choice.milliseconds,
        "ms": best.milliseconds,
        "planning_ms": max(spent - frame_ms(rendering) - best.rays_ms, 0.0),
        "rays": {
            "pixels": best.rays, "share": best.share,
            "slabs": choice.slabs if best.rays else 0, "ms": best.rays_ms,
        },
        "budget": choice.errors.report(),
        "rounds": [one.report() for one in rounds],
        "features": features.report(),
        "need": need_of(scene.volume, scene.transfer_function).report(),
    }
    if best.judged:
        error |= {name: best.judged[name] for name in ("random", "steep", "share", "confidence")}
        error["statement"] = best.judged["sentence"]
    error["sentence"] = sentence(error)
    remarks = [*rendering.report["remarks"], *_remarks(scene, tolerance, quality, error)]
    if left_out:
        remarks.append(
            f"A picture to a maximum error has no {' and no '.join(left_out)}, as the truth that it is measured "
            "against has none; render by a quality alone to see what is missing."
        )
    found = {"plan": {**rendering.report["plan"], "name": best.plan}, "error": error, "remarks": remarks}
    found["stages_ms"] = with_rays(rendering.report["stages_ms"], best.rays_ms)
    found["rays"] = {name: error["rays"][name] for name in rendering.report["rays"]}
    return replace(rendering, report={**rendering.report, **found})


def _badness(one: _Round) -> float:
    """The round that errs least counts; without a measurement there is one round."""
    return one.measured if one.measured is not None else 0.0


def sentence(error: dict) -> str:
    """Prediction and measurement of an ``error`` report for people: ``predicted 0.4, measured 0.31 on 1000 probes,
    84 ms (planned and measured in 2.1 s)``, in levels."""
    parts = [f"predicted {error['predicted']:.2g}"]
    if error["measured"] is not None:
        parts.append(f"measured {error['measured']:.2g} on {error['probes']} probes")
    done = "planned" if error["measured"] is None else "planned and measured"
    return f"{', '.join(parts)}, {error['ms']:.0f} ms ({done} in {error['planning_ms'] / 1e3:.1f} s)"


def _remarks(scene: Scene, tolerance: float, quality: Quality, error: dict) -> list[str]:
    remarks = []
    if quality.classification == "pre" and error["need"]["classification"] != "pre":
        remarks.append(error["need"]["sentence"])
    if not error["kept"]:
        how = "measured" if error["measured"] is not None else "predicted"
        found, tried = "is not reachable for this scene; the floor is", len(error["rounds"])
        if tried > MOST_ESCALATIONS:
            found = f"was not reached in {tried} ever finer pictures; their least error is"
        remarks.append(
            f"A largest error of {tolerance:g} level{'' if tolerance == 1 else 's'} {found} {error['floor']:.2g}, "
            f"{how} against {error['truth']}."
        )
    elif tolerance < STRICTEST:
        remarks.append(f"A tolerance below {STRICTEST:g} levels is finer than a picture of 32-bit numbers can show.")
    if error["measured"] is None:
        remarks.append("The error is predicted and was not measured.")
    if scene.triangles is not None and len(scene.triangles) and error["measured"] is not None:
        remarks.append("The error was measured where no mesh ends or borders a ray.")
    return remarks
