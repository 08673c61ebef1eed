"""What accuracy costs in time, as measured for a scene: kept in the .blend as rows of a list, one for each plan."""

from __future__ import annotations

import json
from dataclasses import replace

import bpy
from bpy.props import BoolProperty, FloatProperty, StringProperty

from ..rle_splat.accuracy.planner.plans import same_plan
from ..rle_splat.accuracy.planner.table import TRUTH_TEXTS
from ..rle_splat.scene import QUALITY_PRESETS, Quality, RleSplatError
from . import linked, pictures
from .decimals import typed
from .settings import quality_of, tolerance_of

ERROR_KIND = "error"  # of pictures.SUFFIXES


class AccuracyRowProperties(bpy.types.PropertyGroup):
    """A plan and what was measured of it; ``name`` is the plan's."""

    knobs: StringProperty(name="Knobs", description="The plan's knobs, JSON")
    truth: StringProperty(name="Truth", description="What the plan's errors are measured against")
    frame_ms: FloatProperty(name="Time", description="Milliseconds of splat and warp", min=0.0)
    rmse: FloatProperty(name="RMSE", description="Root mean square error, levels of 1/255", min=0.0)
    largest: FloatProperty(name="Largest Error", description="Levels of 1/255", min=0.0)
    on_front: BoolProperty(name="On the Front", description="No other plan is both quicker and nearer to its truth")


def note_sweep(settings, report: dict, what: str) -> None:
    """Keep a sweep's fronts and its chosen plan in the scene's settings, that plan's truth first, quickest first;
    ``what`` was measured."""
    settings.accuracy_rows.clear()
    first = next(entry["truth"] for entry in report["plans"] if entry["chosen"])
    for entry in sorted(report["plans"], key=lambda e: (e["truth"] != first, e["truth"], e["frame_ms"])):
        if not (entry["on_front"] or entry["chosen"]):
            continue
        row = settings.accuracy_rows.add()
        row.name, row.knobs, row.truth = entry["name"], json.dumps(entry["knobs"]), entry["truth"]
        row.frame_ms, row.on_front = entry["frame_ms"], entry["on_front"]
        row.rmse, row.largest = entry["error"]["rmse"], entry["error"]["largest"]
    image, probes = report["image"], report["probes"]
    settings.accuracy_note = (
        f"{what}, {image['width']} x {image['height']} pixels, {report['threads']} thread(s). Errors are levels "
        f"(1/255) at {probes['random']} random and {probes['steep']} steep pixels."
    )


def truth_sentence(name: str) -> str:
    """Which truth errors are of, for people."""
    return f"Against {name}, {TRUTH_TEXTS[name]}" if name in TRUTH_TEXTS else f"Against {name}"


def plan_of(row) -> Quality:
    """The plan of a row.  Raises RleSplatError when it was kept by another version and cannot be read."""
    try:
        return Quality(name=row.name, **json.loads(row.knobs))
    except (TypeError, ValueError):
        raise RleSplatError(f"The plan {row.name!r} cannot be read any more; measure the accuracy again.") from None


def is_current(scene, row) -> bool:
    """Whether the scene's settings make the row's plan."""
    try:
        return tolerance_of(scene) is None and _same(quality_of(scene), plan_of(row))
    except RleSplatError:
        return False


def choose(scene, row) -> None:
    """Set the scene's knobs to a row's plan, and its quality to the one of that plan, "custom" where there is none."""
    if scene.library is not None:
        raise RleSplatError(
            f"The scene {scene.name!r} is linked from {linked.file_name(scene.library)}, where its quality is kept; "
            "make it local."
        )
    settings, plan = scene.rle_splat, plan_of(row)
    settings.max_error = 0.0  # which would choose a plan by itself
    settings.quality, settings.classification = "custom", plan.classification  # first: others then suit it
    for name in (set(json.loads(row.knobs)) & set(settings.bl_rna.properties.keys())) - {"classification"}:
        value = getattr(plan, name)
        setattr(settings, name, str(value) if isinstance(getattr(settings, name), str) else value)
    for settings.quality in (*QUALITY_PRESETS, "paper", "custom"):
        if is_current(scene, row):
            return


def _same(one: Quality, other: Quality) -> bool:
    """Whether two plans are the same to Blender, which keeps single precision."""
    single = ("sheet_density", "termination", "rays")
    both = (replace(q, **{name: typed(getattr(q, name)) for name in single}) for q in (one, other))
    return same_plan(*both)


def keep_error_map(scene, volume_object, errors, report: dict):
    """Put (h, w) levels, row 0 on top, into the volume's image of errors; returns the image."""
    settings, image = scene.rle_splat, pictures.keep_numbers(scene, volume_object, errors, ERROR_KIND)
    found, settings.error_image = report["error"], image
    every = "every pixel" if found["step"] == 1 else f"one pixel of each {found['step']} x {found['step']}"
    settings.error_note = (
        f"{truth_sentence(found['truth'])}: largest {found['measured']:.3g}, RMSE {found['rmse']:.3g} levels at "
        f"{every}. The image holds levels (1/255): white is one level or more."
    )
    return image
