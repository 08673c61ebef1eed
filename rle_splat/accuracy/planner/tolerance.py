"""Pictures to a tolerance (algorithm.md 2.4): choose a plan, render it, measure it, and refine it where it errs more.

The error is the largest difference of any channel of premultiplied scene-linear RGBA, in 8-bit steps of 1/255.  It is
measured at probe pixels: random ones, which speak for all pixels; the steepest ones; and those of the largest error
estimate.  The truth is T1 for the classification ``pre`` and T2 for ``post``.
"""

import time
from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from ...effects.analyze import analyze, analyze_effects
from ...effects.glass import GLASS, Glass
from ...pipeline.plan_model import default_classification
from ...pipeline.shadows import SHADOW_EFFECTS, shadow_count, without_shadows
from ...pipeline.stage_cache import StageCache
from ...runtime.steps import Clock, Progress, drain, forward
from ...scene import Quality, QualityName, Rendering, Scene, as_quality, truth_of
from ...view.eye import index_view
from ..probes import PROBES
from .candidates import KEPT_KNOBS, candidate, check_tolerance, name_of
from .checks import check_tolerance_applies
from .choose import CAUTION, NEARLY_BEST, Choice, correct
from .error_estimate import largest_of
from .features import difference_of
from .probe_errors import ProbeErrors
from .ray_cost import MOST_SLABS
from .session import TRACING, PlannerSession, session_steps, with_pixels
from .tolerance_report import Round, with_report

# (With two, an X-ray foot for 8 levels was left at 8.8, in 71 ms, where a finer plan keeps them.)
MOST_ESCALATIONS = 3
# Of the tolerance: a plan is accepted when its probes err at most this, because other pixels may err more.  (In a sweep
# of 65 pictures, up to 1.24 times as much where the probes erred by more than a third of the tolerance.)
ACCEPTED = 0.8
HALF = 0.5
# Shadows of meshes come from sheets of one pixel per voxel, so their edges err at few pixels, more than at the probes.
MESH_SHADOWS = 2.0
WORTH_SAYING_MS = 2000.0  # frames expected to take longer say so in their progress message
FIRST_RAYS = 0.05  # the fraction of rays after which their time is predicted by what they took
LEFT_OUT = "it is not available with a maximum error"  # why an effect is off, after its "off"
PILOTS_END = 0.2  # the fraction of the work after which the pilots end


def render_within(
    scene: Scene, tolerance: float, quality: Quality | QualityName | None = None,
    progress: Callable[[Progress], object] | None = None, *, cache: StageCache | None = None, probes: int = PROBES,
    seed: int = 0, leave_out_shadows: bool = False,
) -> Rendering:  # fmt: skip
    """Render a scene in the least time in which its largest error is expected to stay within ``tolerance``.

    The error is measured at sample pixels. About half of them are random, by which at 95 % confidence up to 0.4 % of
    all pixels may exceed it; the others are where the largest errors are likely.

    Parameters
    ----------
    scene : Scene
        What the picture depends on.
    tolerance : float
        The largest error allowed of any channel of scene-linear, premultiplied RGBA, in 8-bit steps of 1/255.
    quality : Quality or str, optional
        What the tolerance does not decide, such as the classification, the record and the threads.
    progress : callable, optional
        As ``render`` takes it.
    cache : StageCache, optional
        As ``render`` takes it.
    probes : int
        Sample pixels at which the picture is measured, random or steep; 0 for a prediction alone. Each picture that is
        tried is also measured where its largest errors are likely, at up to half as many more.
    seed : int
        Seed of the random sample pixels.
    leave_out_shadows : bool
        With the classification ``pre``: render without shadows and ambient occlusion, which its reference lacks, and
        list that in the report's ``remarks`` and ``effects``.  Otherwise a scene with them raises an error.

    Returns
    -------
    Rendering
        The report's ``error`` holds the predicted and the measured error, the reference (``truth``), the number of
        sample pixels (``probes``), whether the tolerance is ``kept``, the ``floor`` if it is not, and the milliseconds
        of the picture and of planning and measuring.

    Raises
    ------
    RleSplatError
        For a tolerance that is no number above zero, and for scenes and qualities that have no reference.
    """
    steps = render_within_steps(
        scene, tolerance, quality, cache=cache, probes=probes, seed=seed, leave_out_shadows=leave_out_shadows
    )
    return drain(steps, progress)


def render_within_steps(
    scene: Scene, tolerance: float, quality: Quality | QualityName | None = None, *, cache: StageCache | None = None,
    refuse_empty_view: bool = True, probes: int = PROBES, seed: int = 0, leave_out_shadows: bool = False,
    earlier: dict | None = None,
) -> Generator[Progress, None, Rendering]:  # fmt: skip
    """Generator form of ``render_within``: yields Progress, returns the Rendering.

    ``earlier``: the ``plan`` of the report of the frame before, in an animation.  It is used as long as it is expected
    to meet the tolerance, so plans change from frame to frame only to finer ones.
    """
    quality = as_quality(quality or Quality(classification=default_classification()))
    return forward(_render_within_steps(
        scene, tolerance, quality, StageCache() if cache is None else cache, refuse_empty_view, probes, seed,
        leave_out_shadows, earlier,
    ))  # fmt: skip


def _render_within_steps(
    scene: Scene, tolerance: float, quality: Quality, cache: StageCache, refuse_empty_view: bool, probes: int,
    seed: int, leave_out_shadows: bool, earlier: dict | None,
):  # fmt: skip
    """``render_within_steps``, whose fractions may fall."""
    began = time.perf_counter()
    tolerance = check_tolerance(tolerance)
    left_out = []
    if leave_out_shadows:
        scene, left_out = without_shadows_of(scene, quality)
    through_glass, scene = scene, GLASS.without(scene)  # of which there is no truth; it makes no error larger
    check_tolerance_applies(scene, quality)
    session = yield from session_steps(scene, quality, cache, PILOTS_END, refuse_empty_view)
    probe_errors = ProbeErrors(session.shown, quality, probes, seed) if probes else None
    rounds_of = _plan_rounds if session.estimate is None else _ray_rounds
    has_meshes = scene.triangles is not None and len(scene.triangles) > 0
    margin = MESH_SHADOWS if has_meshes and shadow_count(scene) else 1.0
    first = _first_choice(session, tolerance / margin, earlier)
    rounds = yield from rounds_of(session, tolerance / margin, probe_errors, first)
    # Later rounds have more probes; the least error is only that of the best picture where all have the same.
    rounds = [
        replace(one, probed=probe_errors.summary(one.rendering.rgba, tolerance)) if one.probed else one
        for one in rounds
    ]
    yield Progress(1.0, "Done")
    spent = 1e3 * (time.perf_counter() - began)
    gave_up = len(rounds) > MOST_ESCALATIONS
    made = with_report(session, tolerance, rounds, spent, left_out, gave_up, earlier, margin)
    return _tint(made, through_glass, quality)


def _tint(rendering: Rendering, scene: Scene, quality: Quality) -> Rendering:
    """The rendering of a scene without its glass, seen through it."""
    effects, seen = analyze_effects(scene, quality)
    if not effects["glass"].on:
        return rendering
    clock = Clock()
    with clock.running(), clock.stage("glass"):
        view = index_view(seen.camera, seen.index_to_world, seen.width, seen.height)
        rgba = Glass(seen, view, quality).tint(rendering.rgba, rendering.depth, seen.region[:2])
    (row,) = (row for row in effects.report(clock) if row["name"] == "glass")
    rows = [row if other["name"] == "glass" else other for other in rendering.report["effects"]]
    return replace(rendering, rgba=rgba, report={**rendering.report, "effects": rows})


def without_shadows_of(scene: Scene, quality: Quality) -> tuple[Scene, list[str]]:
    """Leave out shadows and ambient occlusion where the truth of a quality has none.

    Returns
    -------
    scene : Scene
        It also holds the reason for reports; the scene itself where the truth has them.
    left_out : list of str
        Those of the two effects that the scene called for.
    """
    if truth_of(quality) != "T1":
        return scene, []
    effects = analyze(scene, quality)
    left_out = [name for name in SHADOW_EFFECTS if effects[name].on]
    reasons = {**scene.reasons_off, **dict.fromkeys(left_out, LEFT_OUT)}
    return replace(without_shadows(scene), reasons_off=reasons), left_out


def _first_choice(session: PlannerSession, tolerance: float, earlier: dict | None) -> Choice:
    """The plan to begin with; ``earlier``: see ``render_within_steps``."""
    if earlier is not None and earlier["classification"] == session.quality.classification:
        plan = candidate(session.quality, **{knob: earlier[knob] for knob in KEPT_KNOBS})
        kept = session.choose(tolerance, only=plan)
        if kept.keeps:
            return kept
    return session.choose(tolerance)


def _plan_rounds(session: PlannerSession, tolerance: float, probe_errors: ProbeErrors | None, choice: Choice):
    """Generator of Progress: rounds of finer and finer plans, until one keeps the tolerance or none is expected to."""
    rounds, correction = [], 1.0
    while True:
        begin, middle, end = _span(len(rounds))
        rendering = yield from _frame_steps(session, choice, begin, middle)
        session.latest = choice.plan, rendering.report["stages_ms"]
        found = None
        if probe_errors is not None:
            coarser = replace(choice.plan, sheet_density=HALF * choice.plan.sheet_density)
            other = yield from session.picture_steps(coarser, middle, middle, "Rendering a coarser one beside it")
            suspects = largest_of(difference_of(rendering, other), probe_errors.suspect_count)
            found = yield from probe_errors.steps(rendering.rgba, suspects, tolerance, middle, end)
        rounds.append(Round(choice, rendering, 0, 0.0, found))
        if _is_last(rounds, tolerance):
            return rounds
        measured = rounds[-1].measured
        correction = correct(choice.errors, measured, correction)
        following = session.choose(tolerance, correction, NEARLY_BEST if choice.keeps else 1.0)
        if following.plan == choice.plan or (measured <= tolerance and not following.keeps):
            return rounds
        choice = following


def _ray_rounds(session: PlannerSession, tolerance: float, probe_errors: ProbeErrors | None, choice: Choice):
    """Generator of Progress: rounds that trace more and more pixels of one picture by single rays of more slabs."""
    rounds, correction = [], 1.0
    begin, middle, _ = _span(0)
    picture = yield from _frame_steps(session, choice, begin, 0.5 * (begin + middle))
    traced, rays_ms = np.zeros(picture.rgba.shape[:2], bool), 0.0
    while True:
        begin, middle, end = _span(len(rounds))
        new = session.ray_pixels(choice, correction) & ~traced
        if new.any():
            rows, columns = np.nonzero(new)
            part = 0.5 * (begin + middle), middle
            message = _say_rays(session.ray_cost.expected_ms(len(rows), choice.slabs))
            values, spent = yield from session.traced_steps(columns, rows, choice.slabs, choice.plan, *part, message)
            picture = with_pixels(picture, columns, rows, values)
            rays_ms += spent
            traced |= new
        levels, found = session.estimate.levels(session.model, choice.plan, correction), None
        if probe_errors is not None:
            suspects = _suspects(levels, traced, probe_errors.suspect_count)
            found = yield from probe_errors.steps(picture.rgba, suspects, tolerance, middle, end)
        rounds.append(Round(choice, picture, int(traced.sum()), rays_ms, found))
        if _is_last(rounds, tolerance):
            return rounds
        rows, columns = probe_errors.rows, probe_errors.columns
        errors, by_ray = probe_errors.errors_of(picture.rgba), traced[rows, columns]
        more_slabs = errors[by_ray].max(initial=0.0) > ACCEPTED * tolerance
        if more_slabs:
            if choice.slabs >= MOST_SLABS:
                return rounds
            session.ray_cost = session.ray_cost.found(errors[by_ray].max(), choice.slabs)
        wrong = ~by_ray & (errors > ACCEPTED * tolerance)
        if wrong.any():
            beyond = errors[wrong] / levels[rows[wrong], columns[wrong]]
            correction *= CAUTION * max(float(beyond.max()), 1.0)
        choice = session.choose(tolerance, correction, only=choice.plan)
        if more_slabs:
            traced[:], rays_ms = False, 0.0


def _frame_steps(session: PlannerSession, choice: Choice, begin: float, end: float):
    """Generator of Progress: the Rendering of a choice's sheets."""
    message = _say_time(f"Rendering {name_of(choice.plan)}", choice.splat_ms + choice.warp_ms)
    return session.picture_steps(choice.plan, begin, end, message)


def _say_time(message: str, milliseconds: float) -> str:
    """A message of progress, with how long the work is expected to take if that is worth saying."""
    return f"{message}, about {milliseconds / 1e3:.0f} s" if milliseconds > WORTH_SAYING_MS else message


def _say_rays(expected_ms: float):
    """The message of progress of rays, as a function of the fraction done: their time as expected, then as found."""
    began = time.perf_counter()

    def message(done: float) -> str:
        found_ms = 1e3 * (time.perf_counter() - began)
        return _say_time(TRACING, found_ms / done if done > FIRST_RAYS else expected_ms)

    return message


def _is_last(rounds: list[Round], tolerance: float) -> bool:
    """Whether the last round needs no further one: it was not measured, is accepted, or was the last one allowed."""
    measured = rounds[-1].measured
    return measured is None or measured <= ACCEPTED * tolerance or len(rounds) > MOST_ESCALATIONS


def _suspects(levels, traced, count: int):
    """Columns and rows of ``count`` pixels to probe: the largest error estimates ``levels`` (H, W) of the pixels not
    ``traced`` (H, W), and up to a quarter of those traced."""
    by_ray = largest_of(levels, count // 4, ~traced) if traced.any() else (np.empty(0, np.int64),) * 2
    by_sheets = largest_of(levels, count - len(by_ray[0]), traced)
    return tuple(np.concatenate(both) for both in zip(by_sheets, by_ray, strict=True))


def _span(number: int) -> tuple[float, float, float]:
    """Begin, middle and end of round ``number`` as fractions of the work; each is taken to be the last but one."""
    begin = 1.0 - (1.0 - PILOTS_END) * 0.4**number
    end = 1.0 - (1.0 - begin) * 0.4
    return begin, 0.5 * (begin + end), end
