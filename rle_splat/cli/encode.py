"""``rle-splat encode``: a volume classified, shaded and run-length encoded, kept in a .rle file."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import numpy as np

from ..axes import AXIS_NAMES
from ..scene import RleSplatError
from .appearance import check_values, choose_transfer_function, read_transfer_function
from .lighting import describe_lighting
from .options import (
    add_light_options, add_machine_options, add_model_option, add_placement_options, add_report_options,
    add_transfer_function_options, add_turntable_options, add_volume_argument, add_volume_options, encoding_quality,
    volume_options,
)
from .output import check_outputs, whole_files
from .progress import ProgressLine
from .report import bytes_text, write_report
from .viewing import check_light_options, check_placement, place, read_lights, read_placement

SUFFIX = ".rle"


def add_arguments(parser) -> None:
    add_volume_argument(parser)
    parser.add_argument("-o", "--output", required=True, metavar=f"FILE{SUFFIX}", help="where the tables go")
    parser.add_argument("--axes", default="xyz", metavar="xyz", help="principal axes to encode for (all three)")
    add_report_options(parser)
    add_volume_options(parser)
    add_transfer_function_options(parser)
    add_light_options(parser)
    add_turntable_options(parser)
    add_placement_options(parser)
    add_model_option(parser)
    add_machine_options(parser)


def run(args) -> None:
    start = perf_counter()
    if Path(args.output).suffix.lower() != SUFFIX:
        raise RleSplatError(f"{args.output} has another suffix than {SUFFIX}; end its name in {SUFFIX}.")
    axes = _axes(args.axes)
    outputs = [args.output, *([args.json] if args.json else [])]
    check_outputs(outputs, inputs=(args.volume, args.transfer_function, args.lights, args.camera, args.volume_matrix))
    check_light_options(args)
    check_placement(args)
    quality = encoding_quality(args)
    placement = read_placement(args)
    given_function = read_transfer_function(args)
    lights, headlight = read_lights(args)
    from ..read.formats import read_volume

    with ProgressLine(args.progress) as line:
        line.show(0.0, f"reading {Path(args.volume).name}")
        volume = read_volume(args.volume, **volume_options(args))
        read_ms = 1e3 * (perf_counter() - start)
        check_values(volume)
        function, reason = choose_transfer_function(args, volume, given_function)
        camera, matrix = place(args, volume, *placement)
        lighting = describe_lighting(function, lights, headlight, camera)
        stored, report = encode_axes(args, volume, function, lights, lighting, camera, matrix, quality, axes, line)
        line.show(0.95, "writing")
        from ..encode.store import save

        with whole_files(outputs) as parts:
            began = perf_counter()
            save(parts[0], stored)
            stages = {"read": read_ms, **report["stages_ms"], "write": 1e3 * (perf_counter() - began)}
            report["command"] = "encode"
            report["input"] = {"path": str(args.volume), "remarks": list(volume.remarks)}
            report["output"] = {"path": str(args.output), "bytes": parts[0].stat().st_size}
            report["transfer_function"] = {"name": function.name, "reason": reason}
            report["lighting"] = lighting
            report["stages_ms"] = {**stages, "total": 1e3 * (perf_counter() - start)}
            if args.json:
                write_report(parts[1], report)
    _say(report)


def _axes(names: str) -> list[int]:
    """Axis numbers from letters, each at most once."""
    if not names or len(set(names)) != len(names) or not set(names) <= set(AXIS_NAMES):
        raise RleSplatError(f"--axes takes one to three of the letters xyz, each once, not {names!r}.")
    return sorted(AXIS_NAMES.index(name) for name in names)


def encode_axes(args, volume, function, lights, lighting, camera, matrix, quality, axes, line):
    """(StoredVolume, report): classify and shade once, encode once for each principal axis."""
    from ..classify.classification import classify
    from ..classify.shading import is_shaded, normals, shade
    from ..encode.encode import encode
    from ..encode.store import StoredVolume

    machine = {"backend": quality.backend, "threads": quality.threads}
    scale = np.diag((args.scene_scale, args.scene_scale, args.scene_scale, 1.0))
    index_to_world = matrix @ scale @ volume.affine
    headlight = lighting["headlight_direction"]
    times, began = {}, perf_counter()

    def lap(stage):
        nonlocal began
        now = perf_counter()
        times[stage], began = 1e3 * (now - began), now

    line.show(0.2, "classifying")
    classified = classify(volume, function, index_to_world, **machine)
    lap("classify")
    line.show(0.4, "shading")
    found = None
    if is_shaded(function.shade, lights, headlight):
        found = normals(classified, volume, index_to_world, **machine)
    colors = shade(
        classified, found, index_to_world, function.shade, lights,
        headlight_direction=headlight, eye=lighting["eye"], **machine,
    )
    lap("shade")
    encoded = {}
    for done, axis in enumerate(axes):
        line.show(0.6 + 0.3 * done / len(axes), f"encoding along {AXIS_NAMES[axis]}")
        encoded[axis] = encode(classified, colors, axis, quality.model, **machine)
    lap("encode")
    stored = StoredVolume(
        encoded, volume.affine, volume.unit, classified.unit_length, function.to_json(), lighting,
        Path(args.volume).name, tuple(volume.remarks),
    )
    report = {
        "stages_ms": times,
        "volume": {
            "shape_xyz": volume.shape_xyz,
            "visible_voxels": classified.visible_voxels,
            "visible_fraction": classified.visible_fraction,
        },
        "model": quality.model,
        "axes": {
            AXIS_NAMES[axis]: {
                "runs": len(tables.runs),
                "memory_bytes": {**tables.table_bytes, "total": tables.nbytes},
            }
            for axis, tables in encoded.items()
        },
    }
    return stored, report


def _say(report: dict) -> None:
    """The sizes of the four tables of each principal axis, on stdout."""
    for remark in report["input"]["remarks"]:
        print(remark)
    function, volume = report["transfer_function"], report["volume"]
    print(f"Transfer function {function['name']}: {function['reason']}")
    print(f"{volume['visible_voxels']} of the voxels are not transparent ({volume['visible_fraction']:.2%}).")
    print(f"{'principal axis':<16}{'scanline pointers':>18}{'data pointers':>15}{'runs':>12}{'voxel data':>13}")
    for name, entry in report["axes"].items():
        memory = entry["memory_bytes"]
        sizes = [bytes_text(memory[key]) for key in ("scanline_pointers", "data_pointers", "runs", "voxel_data")]
        print(f"{name:<16}{sizes[0]:>18}{sizes[1]:>15}{sizes[2]:>12}{sizes[3]:>13}   {entry['runs']} runs")
    print(f"Wrote {report['output']['path']} ({bytes_text(report['output']['bytes'])}).")
