"""``rle-splat render``: a volume on disk to a picture on disk."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

from ..scene import RleSplatError, Scene
from .appearance import choose_transfer_function, read_transfer_function
from .images import WRITERS, writer_for
from .options import (
    add_light_options, add_quality_options, add_report_options, add_transfer_function_options, add_view_options,
    add_volume_argument, add_volume_options, quality_from, quality_report, volume_options,
)
from .output import check_outputs, whole_files
from .progress import ProgressLine
from .report import write_report
from .viewing import check_view, place, read_lights, read_placement

ENCODED_SUFFIX = ".rle"


def add_arguments(parser) -> None:
    add_volume_argument(parser)
    parser.add_argument(
        "-o", "--output", action="append", required=True, metavar=f"OUT.{{{','.join(s[1:] for s in WRITERS)}}}",
        help="where the picture goes; may be given several times",
    )
    add_report_options(parser)
    add_volume_options(parser)
    add_transfer_function_options(parser)
    add_light_options(parser)
    add_view_options(parser)
    add_quality_options(parser)


def run(args) -> None:
    start = perf_counter()
    writers = [writer_for(path) for path in args.output]
    outputs = [*args.output, *([args.json] if args.json else [])]
    check_outputs(outputs, inputs=(args.volume, args.transfer_function, args.lights, args.camera, args.volume_matrix))
    check_view(args)
    quality = quality_from(args)
    placement = read_placement(args)
    road = _from_tables if Path(args.volume).suffix.lower() == ENCODED_SUFFIX else _from_voxels
    with ProgressLine(args.progress) as line:
        rendering, notes = road(args, quality, placement, line)
        report = dict(rendering.report)
        report["stages_ms"] = {**report.get("stages_ms", {}), **notes.pop("stages_ms")}
        report.update(notes)
        report["command"] = "render"
        report["quality"] = quality_report(quality)
        report["background"] = args.background
        report["outputs"] = [str(path) for path in args.output]
        line.show(None, "writing")
        with whole_files(outputs) as parts:
            began = perf_counter()
            for writer, part in zip(writers, parts):
                writer(part, rendering.rgba, rendering.depth, args.background)
            report["stages_ms"]["write"] = 1e3 * (perf_counter() - began)
            report["stages_ms"]["total"] = 1e3 * (perf_counter() - start)
            if args.json:
                write_report(parts[-1], report)
    _say(report)


def _from_voxels(args, quality, placement, line):
    """Read, choose a look, and walk the whole road."""
    given_function = read_transfer_function(args)
    lights, headlight = read_lights(args)
    line.show(None, f"reading {Path(args.volume).name}")
    from ..read.formats import read_volume

    began = perf_counter()
    volume = read_volume(args.volume, **volume_options(args))
    read_ms = 1e3 * (perf_counter() - began)
    line.show(None, "looking at the values")
    function, reason = choose_transfer_function(args, volume, given_function)
    camera, matrix = place(args, volume, *placement)
    width, height = args.size
    scene = Scene(
        volume=volume, transfer_function=function, camera=camera, width=width, height=height, volume_matrix=matrix,
        scene_scale=args.scene_scale, lights=lights, headlight=headlight, background=args.background,
    )
    line.show(None, "loading the renderer")
    from ..render import render_steps

    rendering = line.follow(render_steps(scene, quality))
    notes = {
        "stages_ms": {"read": read_ms},
        "input": {"path": str(args.volume), "remarks": list(volume.remarks)},
        "transfer_function": {"name": function.name, "reason": reason},
    }
    return rendering, notes


def _say(report: dict) -> None:
    """What came of it, on stdout: a few lines."""
    for remark in report["input"]["remarks"]:
        print(remark)
    function = report["transfer_function"]
    print(f"Transfer function {function['name']}: {function['reason']}")
    stages = report["stages_ms"]
    image = report["image"]
    print(f"Wrote {', '.join(report['outputs'])} ({image['width']} x {image['height']}) in {stages['total']:.0f} ms.")
