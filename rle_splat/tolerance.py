"""Pictures that err no more than was asked: a plan is chosen, rendered, measured against the truth and, where that says
so, replaced by a finer one (algorithm.md 2.4).

What is measured is the largest difference of any channel of premultiplied scene-linear RGBA, in levels of 1/255, at
probe pixels: random ones, which speak for all pixels; those where the picture is steepest; and those at which it
differs most from one with half as many sheet pixels along each side.  The truth is T1 for the classification pre and T2
for the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .accuracy.lighting import shading_of
from .accuracy.measure import PROBES, TOLERANCE
from .accuracy.probes import choose_probes, judge, probe_errors
from .accuracy.truths import truth
from .effects.analyse import analyse, called_for
from .effects.mesh_depth import mesh_depth
from .encode.store import StoredVolume
from .exposure import exposures
from .kept import Kept
from .kept_shadows import shadow_count
from .plan.candidates import check_plannable, check_tolerance, name_of
from .plan.choose import NEARLY_BEST, Choice, Speed, choose, corrected
from .plan.features import Features, doubtful_pixels, features_of, pilots
from .plan.model import Model, default_classification
from .plan.need import need_of
from .render import render_steps, truth_of
from .scene import MODES, Quality, Rendering, RleSplatError, Scene
from .steps import Progress
from .view.eye import index_view
from .view.footprints import FOOTPRINTS
from .view.ray_limits import box_depths

MOST_ESCALATIONS = 2
# Probes that pass by less than this leave too much to luck, as other pixels err more: the next finer plan is taken.
CLEAR = 0.9
DOUBTFUL_SHARE = 0.5  # as many probes more, of the ordinary ones, go to where half the density makes a difference
HALF = 0.5
WORTH_SAYING_MS = 2000.0  # of a frame's expected time
STRICTEST = 0.05  # levels; float32 sheets and an eye see no less
PIXELS_FROM_MESHES = 6  # that the warp's filter and its prefilter may reach from a pixel whose ray ends at a mesh
RAYS_AT_ONCE = 256  # of a truth: a tenth of a second or so between two looks at the user's Esc
# Shares of the work after which the pilots and each of the rounds end.
PILOTED = 0.2


@dataclass(frozen=True, eq=False)
class _Round:
    """One plan's picture; ``measured``: levels, None without probes."""

    choice: Choice
    rendering: Rendering
    measured: float | None
    judged: dict | None

    def report(self) -> dict:
        return {
            "plan": name_of(self.choice.plan), "predicted": self.choice.errors.total, "measured": self.measured,
            "predicted_ms": self.choice.milliseconds, "ms": frame_ms(self.rendering),
        }  # fmt: skip


def render_within(
    scene: Scene, tolerance: float, quality: Quality | None = None, progress=None, kept: Kept | None = None, *,
    probes: int = PROBES, seed: int = 0,
) -> Rendering:  # fmt: skip
    """The picture of a scene whose largest error is at most ``tolerance`` levels, 1/255, at the least expense.

    ``quality``: what the tolerance does not decide, such as the classification, the record and the threads.
    ``probes``: ordinary probe pixels that the picture is measured at, 0 for a prediction alone.  ``progress``,
    ``kept``: as ``render`` has them.
    The report's ``error`` says what was predicted and measured, against which truth, on how many probes, whether the
    tolerance is ``kept`` and, if not, which ``floor`` there is.  Raises RleSplatError for a tolerance that is none, and
    for scenes and qualities of which none can be promised.
    """
    quality = quality or Quality(classification=default_classification())
    steps = tolerance_steps(scene, tolerance, quality, kept, probes=probes, seed=seed)
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        if progress is not None:
            progress(step)


def tolerance_steps(
    scene: Scene, tolerance: float, quality: Quality, kept: Kept | None = None, *, refuse_empty_view: bool = True,
    probes: int = PROBES, seed: int = 0,
):  # fmt: skip
    """Generator form of ``render_within``: yields Progress, returns the Rendering."""
    tolerance = check_tolerance(tolerance)
    check_measurable(scene, quality)
    kept = Kept() if kept is None else kept
    model = Model.of(quality.classification)
    drawn, frames = {}, []
    for number, (name, plan) in enumerate(pilots(quality).items()):
        ends = PILOTED * number / 3, PILOTED * (number + 1) / 3
        drawn[name] = yield from _rendered(scene, plan, kept, refuse_empty_view, *ends, "Looking at the scene")
        frames.append((plan, drawn[name].report["stages_ms"]))
    features = features_of(scene, quality, drawn)
    judge_of = _Judge(called_for(scene, analyse(scene, quality)), quality, probes, seed) if probes else None

    rounds: list[_Round] = []
    correction, slack, frames = 1.0, NEARLY_BEST, frames[1:]  # the first one also filled the caches
    while True:
        choice = choose(features, quality, tolerance, model, Speed.of(model, features, frames), correction, slack)
        begin, end = _span(len(rounds))
        middle = 0.5 * (begin + end)
        text = f"Rendering {name_of(choice.plan)}"
        if choice.milliseconds > WORTH_SAYING_MS:
            text += f", about {choice.milliseconds / 1e3:.0f} s"
        rendering = yield from _rendered(scene, choice.plan, kept, refuse_empty_view, begin, middle, text)
        measured, judged = None, None
        if judge_of is not None:
            halved = replace(choice.plan, sheet_density=HALF * choice.plan.sheet_density)
            text = "Rendering a coarser one beside it"
            other = yield from _rendered(scene, halved, kept, refuse_empty_view, middle, middle, text)
            judged = yield from judge_of.steps(rendering, other, tolerance, middle, end)
            measured = judged["largest"] if judged else None
        rounds.append(_Round(choice, rendering, measured, judged))
        frames = [*frames, (choice.plan, rendering.report["stages_ms"])]
        if measured is None or measured <= CLEAR * tolerance or len(rounds) > MOST_ESCALATIONS:
            break
        correction = corrected(choice.errors, measured, correction)
        slack = 1.0 if not choice.keeps else NEARLY_BEST
        following = choose(features, quality, tolerance, model, correction=correction, slack=slack)
        if following.plan == choice.plan or (measured <= tolerance and not following.keeps):
            break
    yield Progress(1.0, "Done")
    return _finished(scene, tolerance, quality, features, rounds)


def check_measurable(scene: Scene, quality: Quality) -> None:
    """RleSplatError when nothing can be promised of a scene's picture."""
    check_plannable(quality)
    if scene.mode != MODES[0]:
        raise RleSplatError(f"A tolerance cannot be kept in the mode {scene.mode}; choose a quality, or composite.")
    if isinstance(scene.volume, StoredVolume):
        raise RleSplatError(
            "A tolerance needs the voxels, which a .rle file has no longer; give the volume it was encoded from, or "
            "choose a quality."
        )
    if shadow_count(called_for(scene, analyse(scene, quality))):
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


def _rendered(scene, plan, kept, refuse_empty_view, begin, end, text):
    """Generator: the steps of one picture, as a part of the whole work; returns its Rendering."""
    steps = render_steps(scene, plan, kept, refuse_empty_view=refuse_empty_view)
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        message = step.message if "kernels" in step.message else text
        yield Progress(begin + (end - begin) * step.fraction, message)


class _Judge:
    """Probe pixels of a scene and their truth, each looked up once for all rounds."""

    def __init__(self, scene: Scene, quality: Quality, count: int, seed: int):
        self._scene, self._name = scene, truth_of(quality)
        self._count, self._seed = count, seed
        self._free = _free_of_meshes(scene, quality)
        self._shading = shading_of(scene, self._name)
        self._random = 0  # of the probes, the first ones
        self._columns, self._rows, self._true = np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 4))

    def steps(self, rendering: Rendering, coarser: Rendering, tolerance: float, begin: float, end: float):
        """Generator of Progress; returns what ``probes.judge`` says of the picture, None without a pixel to look at.

        ``coarser``: the same with half the density, which tells where to look.
        """
        if not len(self._columns):
            probes = choose_probes(rendering.rgba, self._count, self._seed)
            free = self._free[probes.rows, probes.columns]
            self._random = int(free[: probes.random].sum())
            yield from self._look_up(probes.columns, probes.rows, begin, 0.5 * (begin + end))
        doubtful = doubtful_pixels(rendering, coarser, int(DOUBTFUL_SHARE * self._count))
        yield from self._look_up(*doubtful, 0.5 * (begin + end), end)
        if not len(self._columns):
            return None
        errors = probe_errors(rendering.rgba[self._rows, self._columns], self._true)
        return judge(errors, self._random, tolerance)

    def _look_up(self, columns, rows, begin: float, end: float):
        """Generator of Progress: more probes, where no mesh has a part in them."""
        free = self._free[rows, columns]
        columns, rows = columns[free], rows[free]
        left, top = self._scene.region[:2]
        found = [self._true]
        for first in range(0, len(columns), RAYS_AT_ONCE):
            yield Progress(begin + (end - begin) * first / len(columns), "Measuring the error at probe pixels")
            part = slice(first, first + RAYS_AT_ONCE)
            centres = columns[part] + left + 0.5, rows[part] + top + 0.5
            found.append(truth(self._scene, self._name, pixels=centres, tolerance=TOLERANCE, **self._shading)[0])
        self._columns, self._rows = np.concatenate((self._columns, columns)), np.concatenate((self._rows, rows))
        self._true = np.concatenate(found)


def _free_of_meshes(scene: Scene, quality: Quality) -> np.ndarray:
    """(H, W) bool: pixels whose picture no mesh has any part in."""
    left, top, right, bottom = scene.region
    if scene.triangles is None or len(scene.triangles) == 0:
        return np.ones((bottom - top, right - left), dtype=bool)
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    furthest = box_depths(view, scene.volume.shape_xyz, FOOTPRINTS[quality.kernel].radius)[1]
    reach = PIXELS_FROM_MESHES
    around = (
        max(left - reach, 0), max(top - reach, 0), min(right + reach, scene.width), min(bottom + reach, scene.height)
    )  # fmt: skip
    samples = mesh_depth(
        scene.triangles, scene.camera, scene.width, scene.height, region=around, backend=quality.backend,
        threads=quality.threads,
    )  # fmt: skip
    ended = (samples < furthest).any(axis=-1)
    padded = np.pad(ended, reach)
    near = np.zeros_like(ended)
    for down in range(2 * reach + 1):
        for across in range(2 * reach + 1):
            near |= padded[down : down + ended.shape[0], across : across + ended.shape[1]]
    return ~near[top - around[1] : bottom - around[1], left - around[0] : right - around[0]]


# --- the report -----------------------------------------------------------------------------------------------


def _finished(scene: Scene, tolerance: float, quality: Quality, features: Features, rounds: list[_Round]) -> Rendering:
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
        "ms": frame_ms(rendering),
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
    plan = {**rendering.report["plan"], "name": name_of(choice.plan)}
    return replace(rendering, report={**rendering.report, "plan": plan, "error": error, "remarks": remarks})


def _badness(one: _Round) -> float:
    """The round that errs least counts; without a measurement there is one round."""
    return one.measured if one.measured is not None else 0.0


def sentence(error: dict) -> str:
    """Prediction and measurement of an ``error`` report for people: ``predicted 0.4, measured 0.31 on 1000 probes,
    84 ms``, in levels."""
    parts = [f"predicted {error['predicted']:.2g}"]
    if error["measured"] is not None:
        parts.append(f"measured {error['measured']:.2g} on {error['probes']} probes")
    return f"{', '.join(parts)}, {error['ms']:.0f} ms"


def _remarks(scene: Scene, tolerance: float, quality: Quality, error: dict) -> list[str]:
    remarks = []
    if quality.classification == "pre" and error["need"]["classification"] != "pre":
        remarks.append(error["need"]["sentence"])
    if not error["kept"]:
        how = "measured" if error["measured"] is not None else "predicted"
        remarks.append(
            f"A largest error of {tolerance:g} level{'' if tolerance == 1 else 's'} is not reachable for this scene; "
            f"the floor is {error['floor']:.2g}, {how} against {error['truth']}."
        )
    elif tolerance < STRICTEST:
        remarks.append(f"A tolerance below {STRICTEST:g} levels is finer than a picture of 32-bit numbers can show.")
    if error["measured"] is None:
        remarks.append("The error is predicted and was not measured.")
    if scene.triangles is not None and len(scene.triangles) and error["measured"] is not None:
        remarks.append("The error was measured where no mesh ends or borders a ray.")
    return remarks
