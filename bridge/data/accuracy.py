"""The measured plans of a scene, saved in the .blend as rows of a list, and the image of the error map."""

import json
from dataclasses import replace

import bpy
from bpy.props import BoolProperty, FloatProperty, StringProperty

from ...rle_splat.accuracy.planner.plans import same_plan
from ...rle_splat.accuracy.planner.table import TRUTH_TEXTS
from ...rle_splat.runtime.figures import figure_text
from ...rle_splat.scene import QUALITY_PRESETS, Quality, RleSplatError, without_removed
from .. import linked, messages
from ..pictures import pictures
from .decimals import typed
from .settings import quality_of, tolerance_of

ERROR_KIND = "error"  # a key of pictures.SUFFIXES


class AccuracyRowProperties(bpy.types.PropertyGroup):
    """A plan with its measured time and error; ``name`` is the plan's name."""

    knobs: StringProperty(name="Settings", description="Settings as JSON")
    truth: StringProperty(name="Reference", description="Exact result that the error is measured against")
    frame_ms: FloatProperty(name="Time", description="Milliseconds for one frame", min=0.0)
    rmse: FloatProperty(name="RMSE", description="Root mean square error in 8-bit steps", min=0.0)
    largest: FloatProperty(name="Largest Error", description="Largest error in 8-bit steps", min=0.0)
    on_front: BoolProperty(name="On the Front", description="No other settings are both faster and more accurate")


def note_sweep(settings, report: dict, what: str) -> None:
    """Save the plans of a sweep that are on a front, and the chosen one, in the scene's settings.

    The rows are ordered by truth, that of the chosen plan first, and by time.

    Parameters
    ----------
    settings : SceneSettings
        ``scene.rle_splat``; its rows and its note are replaced.
    report : dict
        ``Sweep.report``, with ``plans``, ``image``, ``probes`` and ``threads``.
    what : str
        The volume and the camera that were measured, for the note.
    """
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
        f"{what}, {image['width']} x {image['height']} pixels, {report['threads']} thread(s). Errors are in 8-bit "
        f"steps, at {probes['random']} random pixels and {probes['steep']} pixels on edges."
    )


def truth_sentence(name: str) -> str:
    """The reference that errors are measured against, "T1" or "T2", as the start of a sentence without a period.

    Any other name is used as it is.
    """
    return f"Against {TRUTH_TEXTS.get(name, name)}"


def plan_of(row) -> Quality:
    """The Quality of a row; RleSplatError when another version saved it and it cannot be read."""
    try:
        return Quality(name=row.name, **without_removed(json.loads(row.knobs))[0])
    except (AttributeError, TypeError, ValueError):
        raise RleSplatError(f"{row.name!r} was measured by another version; click Measure Accuracy again.") from None


def is_current(scene, row) -> bool:
    """Whether the scene's settings are those of a row's plan.

    False for a row that cannot be read, and with a maximum error, which chooses a plan by itself.
    """
    try:
        return tolerance_of(scene) is None and _same(quality_of(scene), plan_of(row))
    except RleSplatError:
        return False


def choose(scene, row) -> None:
    """Set the scene's settings to a row's plan; ``quality`` becomes "custom" unless a preset equals the plan.

    Raises
    ------
    RleSplatError
        If the scene is linked, or the plan cannot be read.
    """
    if scene.library is not None:
        raise RleSplatError(
            f"The scene {scene.name!r} is linked from {linked.file_name(scene.library)}, so its quality cannot be "
            "changed here; make the scene local."
        )
    settings, plan = scene.rle_splat, plan_of(row)
    for sentence in without_removed(json.loads(row.knobs))[1]:
        messages.complain(settings, sentence)
    settings.max_error = 0.0  # a maximum error would choose a plan by itself
    # The classification first: setting it changes knobs that it does not support.
    settings.quality, settings.classification = "custom", plan.classification
    for name in (set(json.loads(row.knobs)) & set(settings.bl_rna.properties.keys())) - {"classification"}:
        value = getattr(plan, name)
        setattr(settings, name, str(value) if isinstance(getattr(settings, name), str) else value)
    for settings.quality in (*QUALITY_PRESETS, "paper", "custom"):
        if is_current(scene, row):
            return


def _same(one: Quality, other: Quality) -> bool:
    """Whether two plans are equal in single precision, as Blender stores their numbers."""
    single = ("sheet_density", "termination", "rays")
    both = (replace(q, **{name: typed(getattr(q, name)) for name in single}) for q in (one, other))
    return same_plan(*both)


def keep_error_map(scene, volume_object, errors, report: dict):
    """Write an error map into the volume's error image and save its summary in the scene's settings.

    Parameters
    ----------
    errors : ndarray, shape (height, width)
        Errors in levels of 1/255, row 0 on top.
    report : dict
        The report of the error map, with ``error``.
    """
    settings, image = scene.rle_splat, pictures.keep_numbers(scene, volume_object, errors, ERROR_KIND)
    found, settings.error_image = report["error"], image
    every = "every pixel" if found["step"] == 1 else f"one pixel in each {found['step']} x {found['step']}"
    settings.error_note = (
        f"{truth_sentence(found['truth'])}, in 8-bit steps: largest {figure_text(found['measured'])}, RMSE "
        f"{figure_text(found['rmse'])} at {every}. White in the image is an error of 1 or more."
    )
    return image
