"""The plan that a quality preset takes for a scene: the cheapest one that is expected to keep the preset's error.

The choice depends on the volume and the transfer function alone: not on the camera, so that it stays while a view is
moved and through a turn or a zoom; and not on clocks, cores or free memory, so that every machine makes the same one.
What it needs, ``classify.roughness``, is measured once for a volume and a transfer function and kept in the stage
cache.

Only the knobs of a preset as it is are replaced.  A Quality that differs from a preset in one of PRESET_KNOBS, or that
has another name, is rendered as it is.
"""

from dataclasses import replace
from functools import partial

from ..classify.roughness import roughness
from ..runtime.figures import figure_text
from ..scene import MODES, NO_RAYS, PRESET_AIMS, PRESET_KNOBS, Quality, Scene
from .choose_source import choose_source
from .plan_model import PresetPlan, preset_plans
from .single_rays import can_trace
from .source import Source
from .stage_cache import StageCache

# Costs this near to each other are equal: what they are depends more than that on the day and on the scene.
EQUAL_COSTS = 1.1
# Of a preset's aim, what a plan may be expected to err by. What is expected is the middle of the calibration scenes;
# other scenes, under lamps, err up to 3 times as much.
EXPECTED_SHARE = 0.4
AS_GIVEN, FIRST_FRAMES = "The settings are as they were given.", "The settings of the first frame are used."
BY_PRE = "With classified voxels a quality has the same settings for all scenes."


def choose_plan(source: Source, cache: StageCache) -> Source:
    """Replace the knobs of a preset by those of the plan that it takes for a scene.

    Parameters
    ----------
    cache : StageCache
        Keeps the roughness of the volume under its transfer function.

    Returns
    -------
    Source
        ``plan`` says why, and holds the error that is aimed at and the one that is expected.
    """
    quality = source.quality
    if not quality.is_preset or quality.classification != "post":
        why = FIRST_FRAMES if quality.held else BY_PRE if quality.is_preset else AS_GIVEN
        return replace(source, plan={"why": why, "aim": None, "expected": None})
    aim, name = PRESET_AIMS[quality.name], {"strict": "Very fine (strict)"}.get(quality.name, quality.name.capitalize())
    said = f"{name} aims at an error, in 8-bit steps, of at most {aim:g} in 99.9% of pixels"
    own = tuple(getattr(quality, knob) for knob in PRESET_KNOBS)
    is_known = any(one.knobs == own for one in preset_plans())
    why_not = _explain_no_choice(source.scene) if is_known else "its settings are the same for all scenes"
    if why_not:
        return replace(source, plan={"why": f"{said}; {why_not}.", "aim": aim, "expected": None})
    rough = _measure_roughness(source.scene, cache)
    if rough is None:
        why = f"{said}; too little of the volume is visible to estimate it, so the usual settings are used."
        return replace(source, plan={"why": why, "aim": aim, "expected": None})
    usual, chosen = choose(own, aim, rough, can_trace(source))
    expected = chosen.error(rough)
    if chosen.knobs == own:
        why = f"{said}; about {figure_text(expected)} is expected."
    else:
        why = (
            f"{said}; about {figure_text(expected)} is expected. Edges are sharp here ({figure_text(rough)} within "
            f"half a voxel), so the settings are {chosen.describe()}. The usual settings would "
            f"give about {figure_text(usual.error(rough))}."
        )
    if expected > EXPECTED_SHARE * aim:
        why += " No settings are expected to have less error."
    knobs = dict(zip(PRESET_KNOBS, chosen.knobs, strict=True))
    return replace(source, quality=replace(quality, **knobs), plan={"why": why, "aim": aim, "expected": expected})


def _measure_roughness(scene: Scene, cache: StageCache) -> float | None:
    """The roughness of the roughest channel of a scene; None where too little is visible of all of them."""
    job, found = cache.job(), []
    for one in (scene, *scene.channels):
        volume, function = one.volume, one.transfer_function
        key = (volume.key, function.classification_key) if cache.keeps else len(found)
        found.append(job.get("roughness", key, partial(roughness, volume, function), lambda _: 8))
    job.keep()
    return max((rough for rough in found if rough is not None), default=None)


def choose(own: tuple, aim: float, rough: float, traces: bool) -> tuple[PresetPlan, PresetPlan]:
    """Choose the plan of a preset.

    Parameters
    ----------
    own : tuple
        The preset's values of PRESET_KNOBS: its usual plan, which is taken if it is expected to keep the error.
    aim : float
        The error that the preset aims at, in 8-bit steps.
    rough : float
        The roughness of the scene, in 8-bit steps.
    traces : bool
        Whether the scene has single rays.

    Returns
    -------
    usual : PresetPlan
        The usual plan; without single rays where the scene has none.
    chosen : PresetPlan
        The cheapest one that is expected to keep the error, of several equally cheap ones the most accurate; without
        one, the one with the least expected error.
    """
    seen = own if traces else (*own[:-1], NO_RAYS)
    usual = next(one for one in preset_plans() if one.knobs == seen)
    possible = [one for one in preset_plans() if traces or one.rays == NO_RAYS]
    enough = [one for one in possible if one.error(rough) <= EXPECTED_SHARE * aim]
    if usual in enough:
        chosen = usual
    elif enough:
        least = min(one.cost for one in enough)
        chosen = min((one for one in enough if one.cost <= EQUAL_COSTS * least), key=lambda one: one.error(rough))
    else:
        chosen = min(possible, key=lambda one: one.error(rough))
    usual = replace(usual, knobs=own)
    return usual, usual if chosen.knobs == seen else chosen


def hold_plan(quality: Quality, plan: dict) -> Quality:
    """Keep the plan of a picture for good, so that an animation has the plan of its first frame.

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
    return replace(quality, held=True, **{knob: plan[knob] for knob in PRESET_KNOBS})


def hold_plan_of(scene: Scene, quality: Quality, cache: StageCache | None = None) -> Quality:
    """``hold_plan``, from the scene of a picture that need not be rendered."""
    source = choose_plan(choose_source(scene, quality), StageCache(0) if cache is None else cache)
    return hold_plan(quality, {**vars(source.quality), **source.plan})


def _explain_no_choice(scene: Scene) -> str:
    """Why a scene's plan cannot be chosen; empty where it can."""
    if not scene.volume.holds_values:
        return "for tables in a folder its settings are the same for all scenes"
    if scene.mode != MODES[0]:
        return f"in the mode {scene.mode} its settings are the same for all scenes"
    if scene.labels is not None:
        return "with segments its settings are the same for all scenes"
    if scene.transfer_function.gradient_opacity is not None:
        return "with a gradient opacity its settings are the same for all scenes"
    return ""
