"""``rle-splat render``: render a volume file to picture files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from ..scene import Quality, RleSplatError, Scene, checked_crop
from ..volume.checks import check_values
from .appearance import choose_transfer_function, read_transfer_function
from .images import WRITERS, writer_for
from .light_options import add_light_effect_options, check_light_effects, refuse_light_effects, with_light_effects
from .mixing import add_mixing_options, mixed, mixing_inputs, read_mixing
from .options import (
    add_clip_option,
    add_image_options,
    add_mist_option,
    add_mode_option,
    add_quality_options,
    add_report_options,
    add_scene_options,
    add_tolerance_options,
    add_volume_argument,
    quality_from,
    quality_remarks,
    read_input,
    scene_inputs,
    volume_options,
)
from .output import check_outputs, whole_files
from .progress import ProgressLine
from .report import write_report
from .viewing import check_scene_options, make_scene, moving, place, read_lights, read_motion, read_placement

ENCODED_SUFFIX = ".rle"


def add_arguments(parser) -> None:
    add_volume_argument(parser, also=(ENCODED_SUFFIX,))
    parser.add_argument(
        "-o", "--output", action="append", required=True, metavar=f"OUT.{{{','.join(s[1:] for s in WRITERS)}}}",
        help="the picture to write; may be given several times",
    )
    add_image_options(parser)
    add_mode_option(parser)
    add_mist_option(parser)
    add_report_options(parser)
    add_scene_options(parser)
    parser.add_argument(
        "--motion", metavar="FILE.json",
        help="motion blur: a list of poses, each with camera_matrix, volume_matrix or both, equally spaced in time "
        "while the shutter is open",
    )
    add_clip_option(parser)
    add_light_effect_options(parser)
    add_mixing_options(parser)
    add_tolerance_options(parser)
    add_quality_options(parser)


@dataclass(frozen=True)
class Prepared:
    """A scene to render, its quality, and entries for the report.

    Attributes
    ----------
    scene : Scene
        The scene.
    quality : Quality
        The knobs.
    read_ms : float
        Milliseconds for reading the volume.
    transfer_function : dict
        Its ``name`` and the ``reason`` for it.
    remarks : tuple of str
        Further remarks.
    """

    scene: Scene
    quality: Quality
    read_ms: float
    transfer_function: dict
    remarks: tuple = ()


def run(args) -> None:
    start = perf_counter()
    passes = [] if args.shadow_pass is None else [args.shadow_pass]
    writers = [writer_for(path) for path in (*args.output, *passes)]
    outputs = [*args.output, *passes, *([args.json] if args.json else [])]
    check_outputs(outputs, inputs=(*scene_inputs(args), args.motion, *mixing_inputs(args)))
    _check_background(args.background)
    check_scene_options(args)
    check_light_effects(args)
    crop = None if args.crop is None else checked_crop(args.crop, *args.size)
    poses, mixing = read_motion(args.motion), read_mixing(args)
    is_encoded = Path(args.volume).suffix.lower() == ENCODED_SUFFIX
    if is_encoded and any(mixing_inputs(args)):
        raise RleSplatError(
            "The voxels of a .rle file are classified already; render the original volume with labels or channels.")
    quality = quality_from(args, "pre" if is_encoded else None)
    with ProgressLine(args.progress) as line:
        line.show(0.0, f"reading {Path(args.volume).name}")
        prepared = _prepare_tables(args, quality) if is_encoded else _prepare_voxels(args, quality, line)
        scene, noticed = mixed(args, moving(prepared.scene, poses), *mixing, line)
        prepared = replace(prepared, scene=replace(scene, crop=crop), remarks=(*prepared.remarks, *noticed))
        line.show(0.1, "loading the renderer")
        with line.compiling():
            rendering, taken = line.follow(_steps(args, prepared), start=0.1)
        line.show(1.0, "writing")
        with whole_files(outputs) as parts:
            began = perf_counter()
            for writer, part in zip(writers, parts[: len(args.output)]):
                writer(part, rendering.rgba, rendering.depth, args.background)
            if taken is not None:
                from ..pipeline.shadow_pass import as_picture

                writers[-1](parts[len(args.output)], as_picture(taken, rendering.rgba), rendering.depth, None)
            write_ms = 1e3 * (perf_counter() - began)
            report = _report(args, prepared, rendering, write_ms, start)
            if args.json:
                write_report(parts[-1], report)
    _say(report)


def _steps(args, prepared: Prepared):
    """Generator of Progress: render with the tolerance or the quality; return (Rendering, shadow pass or None)."""
    if args.shadow_pass is not None:
        from ..pipeline.shadow_pass import shadow_pass_steps

        return (yield from shadow_pass_steps(prepared.scene, prepared.quality))
    if args.tolerance is None:
        from ..pipeline.render import render_steps

        return (yield from render_steps(prepared.scene, prepared.quality)), None
    from ..accuracy.planner.tolerance import tolerance_steps

    count = {} if args.probes is None else {"probes": args.probes}
    return (yield from tolerance_steps(prepared.scene, args.tolerance, prepared.quality, **count)), None


def _check_background(background) -> None:
    if background is not None and not all(np.isfinite(c) and c >= 0.0 for c in background):
        numbers = " ".join(f"{c:g}" for c in background)
        raise RleSplatError(f"--background is {numbers}; give three finite numbers that are not below zero.")


def _prepare_voxels(args, quality, line) -> Prepared:
    """Read a volume and make its scene; options are checked before the volume is read."""
    camera, matrix = read_placement(args)
    given_function = read_transfer_function(args)
    lights, headlight = read_lights(args)
    began = perf_counter()
    volume = read_input(args, line)
    read_ms = 1e3 * (perf_counter() - began)
    check_values(volume)
    function, reason = choose_transfer_function(args, volume, given_function)
    camera, matrix = place(args, volume, camera, matrix)
    scene = with_light_effects(args, make_scene(args, volume, function, camera, matrix, lights, headlight))
    remarks = quality_remarks(args, quality)
    return Prepared(scene, quality, read_ms, {"name": function.name, "reason": reason}, remarks)


def _prepare_tables(args, quality) -> Prepared:
    """Load a .rle file, with its own transfer function, lights, model and record, and make its scene."""
    from ..classify.transfer_function import TransferFunction
    from ..encode.store import load
    from .lighting import check_lighting

    camera, matrix = read_placement(args)
    given_function = read_transfer_function(args)
    lights, _ = read_lights(args)
    refuse_light_effects(args)
    if volume_options(args):
        option = next(iter(volume_options(args))).replace("_", "-")
        raise RleSplatError(f"--{option} has no effect on a .rle file, which describes its own layout; remove it.")
    if quality.classification != "pre":
        raise RleSplatError(
            "The voxels of a .rle file are classified already; leave --classification "
            f"{quality.classification} out, or render the original volume."
        )
    began = perf_counter()
    stored = load(args.volume)
    read_ms = 1e3 * (perf_counter() - began)
    if stored.transfer_function is None or not isinstance(stored.lighting, dict):
        raise RleSplatError(f"{args.volume} lacks its transfer function or its lights; encode the volume again.")
    function = TransferFunction.from_json(stored.transfer_function)
    if args.preset is not None or (given_function is not None and given_function.key != function.key):
        raise RleSplatError(
            f"{args.volume} was classified with {function.name or 'its own transfer function'}; remove --preset or "
            "--transfer-function, or encode the volume again."
        )
    camera, matrix = place(args, stored, camera, matrix)
    check_lighting(args, stored.lighting, lights, camera)
    if args.model is None and not args.paper:
        quality = replace(quality, model=stored.model)
    if args.record not in (None, stored.record):
        raise RleSplatError(
            f"{args.volume} holds records of {stored.record} bytes; remove --record, or encode the volume again."
        )
    quality = replace(quality, record=stored.record)
    scene = make_scene(args, stored, function, camera, matrix, (), False)
    remark = "The light is that of the .rle file." if stored.lighting.get("shaded") else "The .rle file is unshaded."
    return Prepared(scene, quality, read_ms, {"name": function.name, "reason": "stored in the .rle file"}, (remark,))


def _report(args, prepared: Prepared, rendering, write_ms: float, start: float) -> dict:
    """The renderer's report with the command's entries; ``total`` includes reading and writing."""
    report = {"command": "render", "input": {"path": str(args.volume)}, **rendering.report}
    rendered = dict(report["stages_ms"])
    report["stages_ms"] = {
        "read": prepared.read_ms, **rendered, "render": rendered["total"], "write": write_ms,
        "total": 1e3 * (perf_counter() - start),
    }
    report["transfer_function"] = prepared.transfer_function
    report["remarks"] = [*report["remarks"], *prepared.remarks]
    report["background"] = args.background
    report["outputs"] = [str(path) for path in args.output]
    return report


def _say(report: dict) -> None:
    """Print a summary of the report."""
    from ..pipeline.single_rays import rays_lines

    for remark in report["remarks"]:
        print(remark)
    function, image = report["transfer_function"], report["image"]
    print(f"Transfer function {function['name']}: {function['reason']}")
    if report["error"]["tolerance"] is not None:
        print(f"{report['plan']['name']}: {report['error']['sentence']}, against {report['error']['truth']}.")
    for line in rays_lines(report["rays"]):
        print(line)
    seconds = report["stages_ms"]["total"] / 1e3
    print(f"Wrote {', '.join(report['outputs'])} ({image['width']} x {image['height']}) in {seconds:.2f} s.")
