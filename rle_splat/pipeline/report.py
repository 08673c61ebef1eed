"""The report of a picture: what was made, by which plan, in which time and memory, and what is worth a remark."""

from __future__ import annotations

import math

from ..effects.clips import NOTHING_LEFT
from ..encode.tables import TABLES
from ..runtime.jit import NUMBA_PROBLEM, PLAIN_NUMBA, compiled, shipped_problem, thread_count
from ..scene import NO_DEPTH, truth_of
from ..volume.axes import AXIS_NAMES
from .medium import Medium
from .picture import Picture
from .scalar_source import ONE_VOXEL_THICK
from .source import ALL_TRANSPARENT, Source
from .views import View

EMPTY_REMARKS = (ONE_VOXEL_THICK, ALL_TRANSPARENT, NOTHING_LEFT)  # those that say why a picture is empty


def make_report(picture: Picture, medium: Medium, tables: dict, made, traced: dict) -> dict:
    """The JSON-ready report of a Rendering; ends the work on the picture, whose results are kept from now on.

    Parameters
    ----------
    tables : dict
        Principal axis -> the tables that the picture was splatted from.
    made : (rgba, depth)
    traced : dict
        What ``single_rays`` says of its rays.
    """
    source, wanted, effects, clock = picture.source, picture.wanted, picture.ray_effects, picture.work.clock
    quality = source.quality
    with clock.stage("report"):
        remarks = (
            *source.remarks, *source.notes, *effects.remarks(made, medium.visible_voxels > 0),
            *_remarks(source, picture.view, medium),
        )  # fmt: skip
        report = {
            "image": report_image(wanted.crop, wanted.width, wanted.height),
            "volume": _volume_report(wanted.volume.shape_xyz, medium),
            "memory_bytes": _memory_report(tables),
            "memory_estimate_bytes": None if medium.estimate is None else medium.estimate.report(),
            "plan": _plan_report(source, picture.view) | source.plan,
            "rays": dict(traced),
            "effects": effects.effects.report(clock),
            "error": {
                "tolerance": None, "predicted": None, "measured": None, "truth": truth_of(quality), "probes": 0,
            },
            "threads": thread_count(quality.threads) if compiled() else 1,
            "remarks": list(remarks),
        }  # fmt: skip
    report["stages_ms"] = clock.report()
    return report


def report_image(crop, width: int, height: int) -> dict:
    """The report's ``image``: the size of the picture; of a crop also ``width`` x ``height``, that of the frame."""
    if crop is None:
        return {"width": width, "height": height}
    left, top, right, bottom = crop
    size = {"width": right - left, "height": bottom - top}
    return {**size, "full_width": width, "full_height": height, "crop": list(crop)}


def _volume_report(shape_xyz, medium: Medium) -> dict:
    shape = [int(n) for n in shape_xyz]
    return {
        "shape_xyz": shape,
        "visible_voxels": medium.visible_voxels,
        "visible_fraction": medium.visible_voxels / math.prod(shape),
        "nan_voxels": medium.nan_voxels,
    }


def _memory_report(held: dict) -> dict:
    tables, sizes = (*TABLES, "scanline_data_pointers"), [encoded.table_bytes for encoded in held.values()]
    return {
        **{name: sum(bytes_of[name] for bytes_of in sizes) for name in tables},
        "total": sum(sum(bytes_of.values()) for bytes_of in sizes),
        "axes_held": [AXIS_NAMES[axis] for axis in sorted(held)],
    }


def _plan_report(source: Source, view: View) -> dict:
    knobs = dict(vars(source.quality))  # flat; ``asdict`` would copy every value in depth
    knobs["quality"] = knobs.pop("name")
    knobs["backend"] = "numba" if compiled() else "numpy"
    knobs["base_planes"] = [
        {
            "principal_axis": ("+" if plane.sign > 0 else "-") + AXIS_NAMES[plane.axis],
            "sheets": len(plane.sheets), "width": plane.width, "height": plane.height, "share": fade.share,
        }
        for fade in view.fades for plane in fade.planes
    ]  # fmt: skip
    return knobs


def _remarks(source: Source, view: View, medium: Medium) -> list[str]:
    remarks = list(source.remarks_on(medium))
    if view.furthest >= NO_DEPTH:
        remarks.append(
            f"The volume reaches {view.furthest:.3g} world units from the camera, and depths of {NO_DEPTH:g} or more "
            "stand for none; give the scene a smaller scale where depths are wanted."
        )
    if medium.nan_voxels:
        remarks.append(f"{medium.nan_voxels} voxels are not numbers (NaN) and were left transparent.")
    if not compiled():
        reason = f" ({NUMBA_PROBLEM})" if NUMBA_PROBLEM else ""
        remarks.append(f"Rendered without compiled code{reason}: slow, but the same picture.")
    elif PLAIN_NUMBA:
        remarks.append(
            f"{PLAIN_NUMBA}: compiled code runs on one thread and is not stored, so each session compiles again."
        )
    elif shipped_problem():
        remarks.append(shipped_problem())
    return remarks
