"""``rle-splat render``: render a volume file to picture files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files, writing
from ..scene import Cancelled, Quality, RleSplatError, Scene, check_crop
from . import light_options, options
from .appearance import read_transfer_function
from .dask_option import add_dask_option, check_dask
from .frames import add_frames_option, each_frame
from .images import writer_for
from .made import describe_kept, mark_of, outputs_of, write_mark
from .mixing import add_mixing_options, hide_table, mix, mixing_inputs, read_further, read_mixing
from .progress import ProgressLine
from .report import say_beginning
from .rows import ROW_WRITERS
from .tiling import add_tile_option, check_tiles, render_tiles, side_of_tiles
from .viewing import (
    Like,
    check_scene_options,
    make_scene,
    moving,
    place,
    read_lights,
    read_motion,
    read_placement,
    read_scene,
    read_scene_files,
)

if TYPE_CHECKING:
    from ..pipeline.stage_cache import StageCache

ENCODED_SUFFIX = ".rle"
CHOSEN = "classification", "depth_rule", "sheet_density", "warp_filter"  # settings that a tolerance chooses


def add_arguments(parser) -> None:
    options.add_volume_argument(parser, also=(ENCODED_SUFFIX,))
    parser.add_argument(
        "-o", "--output", action="append", required=True, metavar=f"OUT.{{{','.join(s[1:] for s in ROW_WRITERS)}}}",
        help="the picture to write; may be given several times",
    )  # fmt: skip
    options.add_image_options(parser)
    add_tile_option(parser)
    options.add_mode_option(parser)
    options.add_mist_option(parser)
    options.add_report_options(parser)
    options.add_scene_options(parser)
    add_frames_option(parser)
    add_dask_option(parser)
    parser.add_argument(
        "--motion",
        metavar="FILE.json",
        help="motion blur: a list of poses, each with camera_matrix, volume_matrix or both, equally spaced in time "
        "while the shutter is open",
    )
    parser.add_argument(
        "--antialias", action="store_true",
        help="no steps at the edges of the volume: the mean of four pictures, shifted by parts of a pixel")  # fmt: skip
    options.add_clip_option(parser)
    light_options.add_light_effect_options(parser)
    add_mixing_options(parser)
    options.add_tolerance_options(parser)
    options.add_quality_options(parser)


@dataclass(frozen=True)
class PreparedScene:
    """A scene to render, its quality, and entries for the report.

    Attributes
    ----------
    read_ms : float
        Milliseconds for reading the volume.
    transfer_function : dict
        Its ``name`` and the ``reason`` for it.
    """

    scene: Scene
    quality: Quality
    read_ms: float
    transfer_function: dict
    remarks: tuple = ()


@dataclass(frozen=True)
class Checked:
    """What was read and checked before any volume.

    Attributes
    ----------
    poses, mixing, sky
        The results of ``read_motion``, ``read_mixing`` and ``read_sky``.
    is_encoded : bool
        Whether the volume is a .rle file.
    """

    quality: Quality
    poses: list
    mixing: tuple
    sky: tuple | None
    crop: tuple | None
    is_encoded: bool


@dataclass(frozen=True)
class RenderJob:
    """How a picture is made, beside its scene.

    Attributes
    ----------
    start : float
        When it was begun, by ``perf_counter``.
    earlier : dict or None
        The plan of the frame before.
    cache : StageCache or None
        Results of stages that are kept from frame to frame.
    scene_hash : str or None
        Of a frame, by which its picture is known again.
    refuse_empty_view : bool
        Whether a camera that sees nothing of the volume is an error.
    """

    start: float
    earlier: dict | None = None
    cache: StageCache | None = None
    scene_hash: str | None = None
    refuse_empty_view: bool = True


def run(args) -> None:
    start = perf_counter()
    frames = each_frame(args)
    checked = _check(args, frames)
    with ProgressLine(args.progress) as line:
        if frames[0] is args and args.dask is not None:
            from .cluster import picture_on_cluster

            reports = [picture_on_cluster(args, checked, line, start, _report)]
        elif frames[0] is args:
            prepared, _ = prepare(args, checked, line)
            reports = [render_prepared(args, prepared, line, RenderJob(start))]
        else:
            reports = _render_frames(args, frames, checked, line)
    made = [report for report in reports if not report.get("kept")]
    for say, report in zip((_say, *[_say_outputs] * len(made)), made):
        say(report)
    for line in describe_kept(reports):
        print(line)


def _render_frames(args, frames, checked: Checked, line) -> list[dict]:
    """Render several frames; return their reports."""
    try:
        if args.dask is not None:
            from .cluster import frames_on_cluster

            reports = frames_on_cluster(args, frames, checked, line, _write_frame)
        else:
            from .series import FrameSeries

            series = FrameSeries(args, checked, line)
            reports = [series.make(own, perf_counter()) for own in frames]
    except KeyboardInterrupt:
        raise Cancelled("Stopped; complete frames stay.") from None
    if args.json:
        with whole_files([args.json]) as parts:
            write_report(parts[0], {"command": "render", "input": {"path": str(args.volume)}, "frames": reports})
    return reports


def _check(args, frames) -> Checked:
    """Check the options of all frames before any volume is read."""
    for path in outputs_of(args):
        writer_for(path)
    inputs = (*options.scene_inputs(args), args.motion, args.camera_path, *mixing_inputs(args))
    report = [args.json] if args.json else []
    outputs = outputs_of(args) if frames[0] is args else frames.find_outputs_at_stake(report)
    check_outputs([*outputs, *report], inputs=inputs)
    check_scene_options(args)
    light_options.check_light_effects(args)
    check_tiles(args)
    check_dask(args)
    crop = None if args.crop is None else check_crop(args.crop, *args.size)
    poses, mixing, sky = read_motion(args.motion), read_mixing(args), light_options.read_sky(args)
    is_encoded = Path(args.volume).suffix.lower() == ENCODED_SUFFIX
    if is_encoded and any(mixing_inputs(args)):
        raise RleSplatError(
            "The voxels of a .rle file are classified already; render the original volume with labels or channels."
        )
    usual = None
    if is_encoded:
        from ..encode.stored import classification_of

        usual = classification_of(args.volume)
    return Checked(options.quality_from(args, usual), poses, mixing, sky, crop, is_encoded)


def prepare(args, checked: Checked, line, like: Like | None = None) -> tuple[PreparedScene, Like | None]:
    """Read a frame and make its scene; ``like``: what it has from the first."""
    line.show(0.0, f"reading {Path(args.volume).name}")
    if checked.is_encoded:
        prepared = _prepare_tables(args, checked.quality)
    else:
        prepared, like = _prepare_voxels(args, checked, line, like)
    further = read_further(args, prepared.scene.volume, line)
    scene = replace(prepared.scene, antialias=args.antialias)
    scene = mix(args, moving(scene, checked.poses), checked.mixing, further)
    remarks, table = (*prepared.remarks, *further.remarks), None
    if not checked.is_encoded:
        table, more = hide_table(args, scene.volume, scene.transfer_function, line)
        remarks += more
    scene = replace(scene, crop=checked.crop, labels=table or scene.labels)
    scene = light_options.with_light_recipe(args, scene)
    return replace(prepared, scene=scene, remarks=remarks), like


def render_prepared(args, prepared: PreparedScene, line, job: RenderJob) -> dict:
    """Render a picture or a frame and write its outputs; return the report."""
    line.show(0.1, "loading the renderer")
    side = side_of_tiles(args, prepared.scene, prepared.quality)
    outputs = outputs_of(args)
    marks = [] if job.scene_hash is None else [mark_of(path) for path in outputs]
    with whole_files([*outputs, *([args.json] if args.json else []), *marks]) as parts:
        with line.compiling():
            if side is not None:
                report, write_ms = line.follow(render_tiles(args, prepared, side, parts, job), start=0.1), 0.0
            else:
                rendering, taken = line.follow(picture_steps(args, prepared, job), start=0.1)
        if side is None:
            line.show(1.0, "writing")
            report, write_ms = rendering.report, _write(args, rendering, taken, parts)
        report = _report(args, prepared, report, write_ms, job.start)
        if args.json:
            write_report(parts[len(outputs)], report)
        for mark, part in zip(parts[len(parts) - len(marks) :], parts, strict=False):
            write_mark(mark, job.scene_hash, part)
    return report


def _write_frame(own, made, parts, start: float) -> dict:
    """Write a frame that a worker of a cluster has made; return its report."""
    write_ms = _write(own, made.rendering, None, parts)
    return _report(own, made.prepared, made.rendering.report, write_ms, start)


def _write(args, rendering, taken, parts) -> float:
    """Write the pictures of a Rendering to ``parts``, and its shadow pass ``taken``; return the milliseconds."""
    began = perf_counter()
    for path, part in zip(args.output, parts):
        with writing(path):
            writer_for(path)(part, rendering.rgba, rendering.depth, args.background)
    if taken is not None:
        from ..pipeline.shadow_pass import as_picture

        write = writer_for(args.shadow_pass)
        with writing(args.shadow_pass):
            write(parts[len(args.output)], as_picture(taken, rendering.rgba), rendering.depth, None)
    return 1e3 * (perf_counter() - began)


def picture_steps(args, prepared: PreparedScene, job: RenderJob):
    """Generator of Progress: render with the tolerance or the quality; return (Rendering, shadow pass or None)."""
    scene, quality = prepared.scene, prepared.quality
    if args.shadow_pass is not None:
        from ..pipeline.shadow_pass import shadow_pass_steps

        return (yield from shadow_pass_steps(scene, quality, job.cache))
    refuse = {"refuse_empty_view": job.refuse_empty_view}
    if args.tolerance is None:
        from ..pipeline.render import render_steps

        return (yield from render_steps(scene, quality, cache=job.cache, **refuse)), None
    from ..accuracy.planner.tolerance import render_within_steps

    own = {"earlier": job.earlier, **({} if args.probes is None else {"probes": args.probes})}
    return (yield from render_within_steps(scene, args.tolerance, quality, cache=job.cache, **refuse, **own)), None


def see_anew(args, checked: Checked, first: PreparedScene) -> PreparedScene:
    """The scene of the first frame, seen by the camera of another; nothing is read."""
    volume = first.scene.volume
    camera, matrix = place(args, volume, *read_placement(args))
    if checked.is_encoded:
        light_options.check_lighting(args, volume.lighting, read_lights(args)[0], camera)
    scene = replace(first.scene, camera=camera, volume_matrix=matrix, motion=())
    scene = light_options.with_light_recipe(args, scene)
    return replace(first, scene=moving(scene, checked.poses), read_ms=0.0)


def _prepare_voxels(args, checked: Checked, line, like: Like | None) -> tuple[PreparedScene, Like]:
    """Read a volume and make its scene; options are checked before the volume is read."""
    scene, read_ms, described = read_scene(args, line, read_scene_files(args), like)
    like = like or Like(scene.transfer_function, described["reason"], scene.camera, scene.volume_matrix)
    scene = light_options.with_light_effects(args, scene, checked.sky)
    remarks = options.quality_remarks(args, checked.quality)
    return PreparedScene(scene, checked.quality, read_ms, described, remarks), like


def _prepare_tables(args, quality) -> PreparedScene:
    """Load a .rle file, with its own transfer function, lights, model and record, and make its scene."""
    from ..classify.transfer_function import TransferFunction
    from ..encode.store import read_encoded

    camera, matrix = read_placement(args)
    given_function = read_transfer_function(args)
    lights, _ = read_lights(args)
    light_options.refuse_light_effects(args)
    if options.volume_options(args):
        option = next(iter(options.volume_options(args))).replace("_", "-")
        raise RleSplatError(f"--{option} has no effect on a .rle file, which describes its own layout; remove it.")
    began = perf_counter()
    stored = read_encoded(args.volume)
    read_ms = 1e3 * (perf_counter() - began)
    if quality.classification != stored.classification:
        asked = args.classification or quality.classification
        raise RleSplatError(
            "The voxels of a .rle file are classified already; leave --classification "
            f"{asked} out, or render the original volume."
            if stored.classification == "pre"
            else f"{args.volume} holds post-classified tables; leave --classification {asked} out."
        )
    if stored.transfer_function is None or not isinstance(stored.lighting, dict):
        raise RleSplatError(f"{args.volume} lacks its transfer function or its lights; encode the volume again.")
    function = TransferFunction.from_json(stored.transfer_function)
    if args.preset is not None or (given_function is not None and given_function.function.key != function.key):
        raise RleSplatError(
            f"{args.volume} was classified with {function.name or 'its own transfer function'}; remove --preset or "
            "--transfer-function, or encode the volume again."
        )
    camera, matrix = place(args, stored, camera, matrix)
    light_options.check_lighting(args, stored.lighting, lights, camera)
    if args.model is None and not args.paper:
        quality = replace(quality, model=stored.model)
    if args.record is not None and quality.record != stored.record:
        raise RleSplatError(
            f"{args.volume} holds records of {stored.record} bytes; remove --record, or encode the volume again."
        )
    quality = replace(quality, record=stored.record)
    scene = make_scene(args, stored, function, camera, matrix, (), False)
    remark = "The light is that of the .rle file." if stored.lighting.get("shaded") else "The .rle file is unshaded."
    described = {"name": function.name, "reason": "stored in the .rle file"}
    return PreparedScene(scene, quality, read_ms, described, (*options.remark_on_removed(args), remark))


def _report(args, prepared: PreparedScene, rendered: dict, write_ms: float, start: float) -> dict:
    """The renderer's report with the command's entries; ``total`` includes reading and writing."""
    report = {"command": "render", "input": {"path": str(args.volume)}, **rendered}
    stages = rendered["stages_ms"]
    report["stages_ms"] = {
        "read": prepared.read_ms, **stages, "render": stages["total"], "write": write_ms,
        "total": 1e3 * (perf_counter() - start),
    }  # fmt: skip
    report["transfer_function"] = prepared.transfer_function
    report["remarks"] = [*report["remarks"], *prepared.remarks]
    report["background"] = args.background
    report["outputs"] = [str(path) for path in args.output]
    return report


def _say(report: dict) -> None:
    """Print a summary of the report."""
    from ..pipeline.single_rays import describe_rays

    say_beginning(report)
    if report["plan"]["aim"] is not None:
        print(report["plan"]["why"])
    if report["error"]["tolerance"] is not None:
        error = report["error"]
        print(f"Error in 8-bit steps against the reference: {error['sentence']}.")
        chosen = (f"--{name.replace('_', '-')} {report['plan'][name]}" for name in CHOSEN)
        print(f"Settings: {' '.join(chosen)}.")
    for line in describe_rays(report["rays"]):
        print(line)
    _say_outputs(report)


def _say_outputs(report: dict) -> None:
    image, seconds = report["image"], report["stages_ms"]["total"] / 1e3
    print(f"Wrote {', '.join(report['outputs'])} ({image['width']} x {image['height']}) in {seconds:.2f} s.")
