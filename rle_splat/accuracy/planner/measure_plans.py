"""An accuracy sweep: time and error of several plans on one scene, each against the truth it promises (algorithm.md 2).

A plan's time is that of one frame with its tables made: splat, warp and, for a plan chosen for a tolerance, single
rays.  Its errors are measured at the same probe pixels for all plans, and in one crop, where the picture is steepest.
The crop is a whole picture that can be shown and compared.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np

from ...pipeline.plan_model import Model
from ...pipeline.shadows import shadow_count
from ...pipeline.stage_cache import StageCache
from ...runtime.steps import FRAME, Progress
from ...scene import Quality, Rendering, RleSplatError, Scene
from ..metrics import LEVEL, SSIM_WINDOW, difference, ssim
from ..probes import PROBES, Probes, choose_probes
from .candidates import check_plannable
from .checks import lacks_channels, lacks_shadows, measurable_scene
from .choose import Choice
from .plans import knobs_of, same_plan, with_plan
from .probe_errors import true_pixel_steps
from .session import PlannerSession, picture_steps, session_steps, with_pixels
from .single_rays import with_rays
from .table import TRUTH_TEXTS

REPEATS = 5  # frames; their median counts
CROP_SIDE = 96  # pixels
TOLERANCES = (8.0, 4.0, 2.0, 1.0, 0.5)  # levels: the plans that these would choose are measured too
LONGEST = 2000.0  # milliseconds: such a plan is not measured when a frame of it is expected to take longer
PILOTS_END = 0.05  # the fraction of the work after which the pilots end
WITHOUT_PRE = "Plans of pre are left out, because their reference has no shadows and no channels."
FRAMES_END = 0.6  # the fraction of the work after which the frames end and the truths begin


@dataclass(frozen=True, eq=False)
class AccuracySweep:
    """The result of an accuracy sweep.

    Attributes
    ----------
    report : dict
        JSON-ready, see ``sweep_steps``.
    truths : dict of (h, w, 4) float64
        The crop of each truth, by name.
    pictures : dict of (h, w, 4) float32
        The crop of each plan's picture, by name.
    chosen : Rendering
        The chosen plan's picture.
    """

    report: dict
    truths: dict
    pictures: dict
    chosen: Rendering

    def plan(self, name: str) -> dict:
        """The report's entry of a plan."""
        return next(entry for entry in self.report["plans"] if entry["name"] == name)


@dataclass(frozen=True)
class PictureWindow:
    """A part of a picture, as slices of its rows and columns."""

    rows: slice
    columns: slice

    @property
    def centers(self) -> tuple[np.ndarray, np.ndarray]:
        """(columns, rows) of its pixels' centers, row by row."""
        rows, columns = np.mgrid[self.rows, self.columns]
        return columns.ravel() + 0.5, rows.ravel() + 0.5

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start


@dataclass(frozen=True, eq=False)
class _RayPixels:
    """Pixels of a plan's picture that single rays of ``slabs`` slabs trace; ``columns``, ``rows``: (n,) int."""

    columns: np.ndarray
    rows: np.ndarray
    slabs: int

    def report(self) -> dict:
        return {"pixels": len(self.columns), "slabs": self.slabs}


@dataclass(frozen=True, eq=False)
class _Wished:
    """The plans that tolerances would choose: ``choices`` and, for those with single rays, ``rays``, by name."""

    session: PlannerSession | None = None
    choices: dict[str, Choice] = field(default_factory=dict)
    rays: dict[str, _RayPixels] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Frames:
    """A plan's frames: the ``report`` of the first one, its values (n, 4) at the ``probes`` and its ``crop``
    (h, w, 4); and the ``stages_ms`` of all others."""

    plan: Quality
    report: dict
    probes: np.ndarray
    crop: np.ndarray
    stages: list[dict]


def sweep_steps(
    scene: Scene, plans, chosen: Quality, *, probes: int = PROBES, repeats: int = REPEATS, error: str = "rmse",
    tolerances=(), crop_side: int = CROP_SIDE, flip: Callable | None = None,
    cache: StageCache | None = None,
):  # fmt: skip
    """Measure time and error of plans.  Generator of Progress; returns a AccuracySweep.

    Parameters
    ----------
    plans : sequence of Quality
        Each with a name of its own.
    chosen : Quality
        Is measured too, and marked in the report.
    probes : int
        Probe pixels.
    repeats : int
        Frames of each plan, of which the median time counts.
    error : str
        The key of ``metrics.ERRORS`` that the fronts go by.
    tolerances : sequence of float
        Levels.  The plans that would be chosen for them, with ``chosen``'s other knobs, are measured too; their
        entries hold what was ``predicted``.
    crop_side : int
        Pixels.
    flip : callable, optional
        A further metric of the crop, a function of (picture, truth).

    Returns
    -------
    AccuracySweep
        Each of the report's ``plans`` holds its knobs, ``frame_ms``, its ``truth`` and ``error``.  ``rmse``, ``p999``,
        ``bias`` and ``psnr`` are those at the random probes; ``largest`` is that of all probes and the crop; ``crop``
        holds the errors of the crop, and ``ssim`` and ``flip`` of its display-encoded color.  ``as_ray_caster`` is the
        error against T2 of a plan that promises T1.

    Raises
    ------
    RleSplatError
        As ``checks.measurable_scene``.
    """
    scene = measurable_scene(scene, chosen)
    if probes < 1 or repeats < 1:
        raise RleSplatError("Measuring takes one sample pixel and one repeat at least.")
    cache = StageCache() if cache is None else cache
    wished, remarks = _Wished(), []
    if shadow_count(scene) or scene.channels:
        count = len(plans)
        plans = [plan for plan in plans if not (lacks_shadows(scene, plan) or lacks_channels(scene, plan))]
        remarks = [WITHOUT_PRE] * (len(plans) < count)
    if tolerances:
        problems = _why_no_tolerance(chosen)
        if not problems:
            wished = yield from _choose_steps(scene, chosen, tolerances, cache)
            plans, problems = _with_choices(plans, wished.choices)
        remarks += problems
    plans, chosen_name = with_plan(plans, chosen)
    # The last plan's picture is the most accurate one: it decides where all are measured.
    begin = PILOTS_END if tolerances else 0.0
    share = (FRAMES_END - begin) / (len(plans) + 1)
    finest = yield from _frame_steps(scene, plans[-1], wished, cache, begin, begin + share)
    where, window = choose_probes(finest.rgba, probes), steepest_window(finest.rgba, crop_side)
    measured, picture = [], finest
    for number, plan in enumerate(plans, start=1):
        part = begin + share * number, begin + share * (number + 1)
        one, first = yield from _measure_steps(scene, plan, wished, cache, where, window, repeats, *part)
        measured.append(one)
        if plan.name == chosen_name:
            picture = first
    promised = {one.report["error"]["truth"] for one in measured}
    began = time.perf_counter()
    true = yield from _truth_steps(scene, sorted({*promised, "T2"}), where, window)
    truth_ms = 1e3 * (time.perf_counter() - began)
    entries = [_entry(one, true, where.random, flip, wished, chosen_name) for one in measured]
    fronts = {name: front([e for e in entries if e["truth"] == name], error) for name in sorted(promised)}
    for entry in entries:
        entry["on_front"] = entry["name"] in fronts[entry["truth"]]
    report = {
        **{name: picture.report[name] for name in ("image", "volume", "threads")},
        "repeats": repeats, "truth_ms": truth_ms, "front_by": error, "chosen": chosen_name,
        "probes": {"random": where.random, "steep": len(where.columns) - where.random},
        "crop": [window.columns.start, window.rows.start, window.columns.stop, window.rows.stop],
        "truths": {name: TRUTH_TEXTS[name] for name in fronts}, "fronts": fronts, "plans": entries,
        "remarks": [*picture.report["remarks"], *remarks],
    }  # fmt: skip
    yield Progress(1.0, "Done")
    crops = {one.plan.name: one.crop for one in measured}
    return AccuracySweep(report, {name: crop for name, (_, crop) in true.items()}, crops, picture)


def front(plans, key: str = "rmse") -> list[str]:
    """Find the plans that no other plan beats in both time and error.

    Parameters
    ----------
    plans : sequence of dict
        Entries of a report, all against one truth.
    key : str
        Of ``metrics.ERRORS``.

    Returns
    -------
    list of str
        Names, quickest first.
    """
    names, least = [], np.inf
    for entry in sorted(plans, key=lambda entry: (entry["frame_ms"], entry["error"][key])):
        if entry["error"][key] < least:
            least = entry["error"][key]
            names.append(entry["name"])
    return names


def steepest_window(rgba, side: int) -> PictureWindow:
    """The square of at most ``side`` pixels in which neighbors of a picture (H, W, 4) differ most, on average."""
    height, width = np.shape(rgba)[:2]
    tall, wide = min(side, height), min(side, width)
    steep = np.zeros((height, width))
    steep[:-1] += np.abs(np.diff(rgba, axis=0)).max(axis=-1)
    steep[:, :-1] += np.abs(np.diff(rgba, axis=1)).max(axis=-1)
    total = np.zeros((height + 1, width + 1))
    total[1:, 1:] = steep.cumsum(axis=0).cumsum(axis=1)
    inside = total[tall:, wide:] - total[:-tall, wide:] - total[tall:, :-wide] + total[:-tall, :-wide]
    top, left = (int(n) for n in np.unravel_index(np.argmax(inside), inside.shape))
    return PictureWindow(slice(top, top + tall), slice(left, left + wide))


# --- plans for tolerances -------------------------------------------------------------------------------------


def _why_no_tolerance(quality: Quality) -> list[str]:
    """A remark where no tolerance can be kept with a quality's knobs; else nothing."""
    try:
        check_plannable(quality)
        Model.of(quality.classification)
    except RleSplatError as problem:
        return [f"No plans for tolerances: {problem}"]
    return []


def _choose_steps(scene: Scene, base: Quality, tolerances, cache: StageCache):
    """Generator of Progress up to PILOTS_END: choose a plan for each tolerance, in levels; returns a _Wished."""
    session = yield from session_steps(scene, base, cache, PILOTS_END)
    choices, rays = {}, {}
    for tolerance in tolerances:
        name = f"for {tolerance:g} step{'' if tolerance == 1 else 's'}"
        choice = session.choose(tolerance)
        if choice.rays:
            rows, columns = np.nonzero(session.ray_pixels(choice))
            if len(rows):  # fewer than choice.rays, which counts bins by their upper edges
                rays[name] = _RayPixels(columns, rows, choice.slabs)
        choices[name] = replace(choice, plan=replace(choice.plan, name=name))
    return _Wished(session, choices, rays)


def _with_choices(plans, choices: dict[str, Choice]) -> tuple[list[Quality], list[str]]:
    """Put the plans chosen for tolerances before the others; returns all plans, and remarks on those left out."""
    found, hopeless, slow = [], [], []
    for name, choice in choices.items():
        if not choice.keeps:
            hopeless.append(name)
        elif choice.milliseconds > LONGEST:
            slow.append(f"{name} ({choice.milliseconds / 1e3:.1f} s)")
        elif choice.rays or not any(same_plan(choice.plan, other) for other in found):
            found.append(choice.plan)
    remarks = [f"No plan is expected to meet a tolerance {', '.join(hopeless)}."] if hopeless else []
    if slow:
        remarks.append(f"Expected to take more than {LONGEST / 1e3:g} s a frame, and not measured: {', '.join(slow)}.")
    return [*found, *plans], remarks


def _prediction(choice: Choice | None) -> dict | None:
    if choice is None:
        return None
    return {"largest": choice.errors.total, "frame_ms": choice.milliseconds, "keeps": choice.keeps}


# --- frames and truths ----------------------------------------------------------------------------------------


def _frame_steps(scene: Scene, plan: Quality, wished: _Wished, cache: StageCache, begin: float, end: float):
    """Generator of Progress: one frame of a plan, with its single rays; returns the Rendering."""
    rendering = yield from picture_steps(scene, plan, cache, begin, end, f"Measuring {plan.name}")
    rays = wished.rays.get(plan.name)
    if rays is None:
        return rendering
    values, spent = yield from wished.session.traced_steps(rays.columns, rays.rows, rays.slabs, plan, end, end)
    rendering = with_pixels(rendering, rays.columns, rays.rows, values)
    stages = with_rays(rendering.report["stages_ms"], spent)
    return replace(rendering, report={**rendering.report, "stages_ms": stages})


def _measure_steps(
    scene: Scene, plan: Quality, wished: _Wished, cache: StageCache, where: Probes, window: PictureWindow, repeats: int,
    begin: float, end: float,
):  # fmt: skip
    """Generator of Progress: the first frame of a plan, which makes its tables, and ``repeats`` more.

    Returns _Frames and the Rendering of the first one.  Plans are measured one after the other and not in turns,
    because a stage cache holds the tables of few plans.
    """
    middle = 0.5 * (begin + end)
    first = yield from _frame_steps(scene, plan, wished, cache, begin, middle)
    stages = []
    for turn in range(repeats):
        done = middle + (end - middle) * turn / repeats
        rendering = yield from _frame_steps(scene, plan, wished, cache, done, done)
        stages.append(rendering.report["stages_ms"])
    crop = first.rgba[window.rows, window.columns].copy()
    return _Frames(plan, first.report, where.of(first.rgba), crop, stages), first


def _truth_steps(scene: Scene, names, where: Probes, window: PictureWindow):
    """Generator of Progress: values (n, 4) of each truth at the probes and (h, w, 4) in the window, by name."""
    columns, rows = (np.concatenate(both) for both in zip(where.centers, window.centers))
    count, found = len(where.columns), {}
    for number, name in enumerate(names):
        part = (FRAMES_END + (1.0 - FRAMES_END) * n / len(names) for n in (number, number + 1))
        values = yield from true_pixel_steps(scene, name, columns, rows, *part)
        found[name] = values[:count], values[count:].reshape(*window.shape, 4)
    return found


# --- the report -----------------------------------------------------------------------------------------------


def _entry(one: _Frames, true: dict, random: int, flip, wished: _Wished, chosen_name: str) -> dict:
    """A plan's entry of the report.  ``true``: as ``_truth_steps`` returns it."""
    name, report = one.plan.name, one.report
    truth_name, rays = report["error"]["truth"], report["rays"]
    beside = truth_name != "T2"
    return {
        "name": name, "chosen": name == chosen_name, "truth": truth_name, "knobs": knobs_of(one.plan),
        **{f"{stage}_ms": median(stages.get(stage, 0.0) for stages in one.stages) for stage in FRAME},
        "frame_ms": median(sum(stages.get(stage, 0.0) for stage in FRAME) for stages in one.stages),
        "rays": wished.rays[name].report() if name in wished.rays else rays if rays["pixels"] else None,
        "error": _errors(one, true[truth_name], random, flip),
        "as_ray_caster": _errors(one, true["T2"], random, None) if beside else None,
        "predicted": _prediction(wished.choices.get(name)),
    }  # fmt: skip


def _errors(one: _Frames, true, random: int, flip) -> dict:
    """JSON-ready errors of a plan, in levels where nothing else is said; ``true``: values at the probes, and crop."""
    true_values, true_crop = true
    drawn, inside = difference(one.probes[:random], true_values[:random]), difference(one.crop, true_crop)
    largest = max(float(np.abs(one.probes - true_values).max()) / LEVEL, inside.largest)
    small = min(one.crop.shape[:2]) < SSIM_WINDOW
    return {
        "largest": largest, "rmse": drawn.rmse, "p999": drawn.p999, "bias": drawn.bias, "psnr": drawn.psnr,
        "crop": {
            "largest": inside.largest, "rmse": inside.rmse, "ssim": None if small else ssim(one.crop, true_crop),
            "flip": None if flip is None or small else flip(one.crop, true_crop),
        },
    }  # fmt: skip
