"""The plan that a quality preset takes for a scene: the cheapest one that is expected to keep the preset's error.

The choice depends on the volume and the transfer function alone: not on the camera, so that it stays while a view is
moved and through a turn or a zoom; and not on clocks, cores or free memory, so that every machine makes the same one.
What it needs, ``classify.roughness``, is measured once for a volume and a transfer function and kept in the stage
cache.

Only the knobs of a preset as it is are replaced.  A Quality that differs from a preset in one of PRESET_KNOBS, or that
has another name, is rendered as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..classify.roughness import LEVELS, roughness
from ..effects.mixing import is_mixed
from ..scene import MODES, NO_RAYS, PRESET_AIMS, PRESET_KNOBS, Quality, Scene
from ..warp.steep import UNLIMITED
from .choose_source import choose_source
from .single_rays import can_trace
from .source import Source
from .stage_cache import StageCache

# Costs this near to each other are equal: what they are depends that much on the day and on the scene.
EQUAL_COSTS = 1.05
LEAST_ROUGHNESS = 0.1  # levels: the model of errors is not extrapolated to smoother media
OF_999 = "at 999 of 1000 pixels"
AS_GIVEN, FIRST_FRAMES = "The knobs are as they were given.", "The plan of the first frame is kept."
BY_PRE = "The qualities of classified voxels have one plan for all scenes."
HELD = ", held"  # after the name of a preset whose plan is kept from picture to picture


@dataclass(frozen=True)
class Candidate:
    """A plan, its cost and its expected error.

    Attributes
    ----------
    knobs : tuple
        Values of PRESET_KNOBS.
    cost : float
        The time of a frame over that of the knobs of ``standard``, the geometric mean over scenes.
    factor, power : float
        The error that 999 of 1000 pixels stay below, in levels, is expected to be ``factor * roughness ** power``.
    """

    knobs: tuple
    cost: float
    factor: float
    power: float

    def error(self, rough: float) -> float:
        """The expected error in levels, for a roughness in levels."""
        return min(self.factor * max(rough, LEAST_ROUGHNESS) ** self.power, LEVELS)

    @property
    def rays(self) -> float:
        """The threshold of single rays; 0 for none."""
        return self.knobs[-1]

    def describe(self) -> str:
        """In words for a person."""
        rule, density, _, _, rays = self.knobs
        text = f"{rule} sheets of density {density:g}"
        if rays == NO_RAYS:
            return text
        where = "wherever something is seen" if rays <= UNLIMITED else f"where neighbors differ by {100.0 * rays:.0f} %"
        return f"{text} and single rays {where}"


# Measured on the synthetic volumes of the planner's calibration, whose walls are soft or steps to opaque, by
# `dev.py bench plans --calibrate`, which prints this table.  Half of the errors there were smaller than expected.
CANDIDATES = (
    Candidate(("preintegrated", 1.0, "cubic", 1 / 1024, NO_RAYS), 1.0, 1.2, 1.16),
    Candidate(("preintegrated", 1.0, "cubic", 1 / 1024, 0.6), 1.21, 1.53, 0.85),
    Candidate(("gauss2", 1.25, "cubic", 1 / 2048, NO_RAYS), 1.16, 0.8, 1.2),
    Candidate(("gauss2", 1.25, "cubic", 1 / 2048, 0.6), 1.39, 0.44, 1.09),
    Candidate(("gauss2", 1.25, "cubic", 1 / 2048, 0.3), 1.78, 0.42, 1.04),
    Candidate(("simpson", 1.5, "cubic", 1 / 2048, 0.3), 2.17, 0.41, 1.01),
    Candidate(("midpoint-4", 1.5, "cubic", 1 / 8192, 0.4), 2.79, 0.33, 0.94),
    Candidate(("midpoint-4", 2.0, "cubic", 1 / 8192, NO_RAYS), 3.63, 0.43, 1.2),
    Candidate(("midpoint-4", 2.0, "cubic", 1 / 8192, 0.45), 4.0, 0.26, 1.02),
    Candidate(("midpoint-4", 2.0, "cubic", 1 / 8192, 0.2), 4.76, 0.26, 0.91),
    Candidate(("preintegrated", 0.7, "cubic", 1 / 1024, UNLIMITED), 8.75, 0.55, 0.69),
    Candidate(("midpoint-4", 1.0, "cubic", 1 / 8192, UNLIMITED), 11.18, 0.35, 0.61),
    Candidate(("midpoint-8", 1.0, "cubic", 1 / 8192, UNLIMITED), 15.11, 0.43, 0.49),
)


def choose_plan(source: Source, cache: StageCache) -> Source:
    """Replace the knobs of a preset by those of the plan that it takes for a scene.

    Parameters
    ----------
    source : Source
    cache : StageCache
        Keeps the roughness of the volume under its transfer function.

    Returns
    -------
    Source
        ``plan`` says why, and holds the error that is aimed at and the one that is expected.
    """
    quality = source.quality
    if not quality.is_preset or quality.classification != "post":
        why = FIRST_FRAMES if quality.name.endswith(HELD) else BY_PRE if quality.is_preset else AS_GIVEN
        return replace(source, plan={"why": why, "aim": None, "expected": None})
    aim, name = PRESET_AIMS[quality.name], quality.name.capitalize()
    said = f"{name} aims at an error of at most {aim:g} levels {OF_999}"
    own = tuple(getattr(quality, knob) for knob in PRESET_KNOBS)
    is_known = any(one.knobs == own for one in CANDIDATES)
    why_not = _why_not(source.scene) if is_known else "it has one plan for all scenes"
    if why_not:
        return replace(source, plan={"why": f"{said}; {why_not}.", "aim": aim, "expected": None})
    job, volume, function = cache.job(), source.scene.volume, source.scene.transfer_function
    key = (volume.key, function.classification_key) if cache.keeps else ()
    rough = job.get("roughness", key, lambda: roughness(volume, function), lambda _: 8)
    job.keep()
    if rough is None:
        why = f"{said}; too little of the volume is visible to tell more, so it takes its usual plan."
        return replace(source, plan={"why": why, "aim": aim, "expected": None})
    usual, chosen = choose(own, aim, rough, can_trace(source))
    expected = chosen.error(rough)
    if chosen.knobs == own:
        why = f"{said}; its usual plan is expected to err by {expected:.2g} here."
    else:
        why = (
            f"{said}. Its usual plan is expected to err by {usual.error(rough):.2g}, because the walls are hard here: "
            f"{rough:.2g} levels within half a voxel. It takes {chosen.describe()}, and {expected:.2g} are expected."
        )
    if expected > aim:
        why += " No plan is expected to err less."
    knobs = dict(zip(PRESET_KNOBS, chosen.knobs, strict=True))
    return replace(source, quality=replace(quality, **knobs), plan={"why": why, "aim": aim, "expected": expected})


def choose(own: tuple, aim: float, rough: float, traces: bool) -> tuple[Candidate, Candidate]:
    """Choose the plan of a preset.

    Parameters
    ----------
    own : tuple
        The preset's values of PRESET_KNOBS: its usual plan, which is taken if it is expected to keep the error.
    aim : float
        The error that the preset aims at, in levels.
    rough : float
        The roughness of the scene, in levels.
    traces : bool
        Whether the scene has single rays.

    Returns
    -------
    usual : Candidate
        The usual plan; without single rays where the scene has none.
    chosen : Candidate
        The cheapest one that is expected to keep the error, of several equally cheap ones the most accurate; without
        one, the one with the least expected error.
    """
    seen = own if traces else (*own[:-1], NO_RAYS)
    usual = next(one for one in CANDIDATES if one.knobs == seen)
    possible = [one for one in CANDIDATES if traces or one.rays == NO_RAYS]
    enough = [one for one in possible if one.error(rough) <= aim]
    if usual in enough:
        chosen = usual
    elif enough:
        least = min(one.cost for one in enough)
        chosen = min((one for one in enough if one.cost <= EQUAL_COSTS * least), key=lambda one: one.error(rough))
    else:
        chosen = min(possible, key=lambda one: one.error(rough))
    usual = replace(usual, knobs=own)
    return usual, usual if chosen.knobs == seen else chosen


def held(quality: Quality, plan: dict) -> Quality:
    """The quality with the plan of a picture for good, so that an animation keeps the plan of its first frame.

    Parameters
    ----------
    quality : Quality
        By which the picture was rendered.
    plan : dict
        ``plan`` of the picture's report.

    Returns
    -------
    Quality
        The same one where the picture's plan was not chosen by its scene.
    """
    if plan["expected"] is None or plan["classification"] != quality.classification:
        return quality
    return replace(quality, name=f"{quality.name}{HELD}", **{knob: plan[knob] for knob in PRESET_KNOBS})


def held_for(scene: Scene, quality: Quality, cache: StageCache | None = None) -> Quality:
    """``held``, from the scene of a picture that need not be rendered."""
    source = choose_plan(choose_source(scene, quality), StageCache(0) if cache is None else cache)
    if source.plan["expected"] is None or source.quality.classification != quality.classification:
        return quality
    knobs = {knob: getattr(source.quality, knob) for knob in PRESET_KNOBS}
    return replace(quality, name=f"{quality.name}{HELD}", **knobs)


def _why_not(scene: Scene) -> str:
    """Why a scene's plan cannot be chosen; empty where it can."""
    if not scene.volume.holds_values:
        return "for tables in a folder it has one plan for all scenes"
    if scene.mode != MODES[0]:
        return f"in the mode {scene.mode} it has one plan for all scenes"
    if is_mixed(scene):
        return "with labels or channels it has one plan for all scenes"
    if scene.transfer_function.gradient_opacity is not None:
        return "with a gradient opacity it has one plan for all scenes"
    return ""
