"""``rle-splat encode``: classify, shade and run-length encode a volume into a .rle file, or a folder of tables."""

from contextlib import contextmanager, suppress
from pathlib import Path
from time import perf_counter

from ..runtime.memory import bytes_text
from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files, writing
from ..scene import CLASSIFICATIONS, Cancelled, RleSplatError
from ..volume.axes import AXIS_NAMES
from . import options
from .progress import ProgressLine
from .report import say_beginning
from .viewing import check_scene_options, read_scene, read_scene_files

SUFFIX = ".rle"


def add_arguments(parser) -> None:
    options.add_volume_argument(parser)
    parser.add_argument("-o", "--output", required=True, metavar=f"FILE{SUFFIX}", help="the file to write")
    parser.add_argument(
        "--folder",
        action="store_true",
        help="write a folder of tables, some planes at a time, for a volume larger than memory; the same command goes "
        "on where it was killed",
    )
    parser.add_argument(
        "--classification", metavar="|".join(CLASSIFICATIONS), default="pre",
        help="pre (the default), or post, which a folder of tables alone can hold")  # fmt: skip
    parser.add_argument("--axes", default="xyz", metavar="xyz", help="principal axes to encode for (default all three)")
    options.add_report_options(parser)
    options.add_scene_options(parser)
    options.add_model_option(parser)
    options.add_machine_options(parser)
    parser.set_defaults(size=options.DEFAULT_SIZE)  # a Scene needs a size, but the encoded colors do not depend on it


def run(args) -> None:
    start = perf_counter()
    if Path(args.output).suffix.lower() != SUFFIX:
        raise RleSplatError(f"{args.output} does not have the suffix {SUFFIX}; end the name in {SUFFIX}.")
    axes = _axes(args.axes)
    classification = options.encoding_quality(args).classification
    if classification != "pre" and not args.folder:
        raise RleSplatError(
            f"A .rle file holds no {classification} classification; add --folder, or leave --classification out."
        )
    reports = [args.json] if args.json else []
    check_outputs([*([] if args.folder else [args.output]), *reports], inputs=options.scene_inputs(args))
    check_scene_options(args)
    if args.folder:
        _run_folder(args, axes, start)
        return
    outputs = [args.output, *reports]
    quality, files = options.encoding_quality(args), read_scene_files(args)
    from ..encode.store import write
    from ..pipeline.encode_scene import encode_steps

    with ProgressLine(args.progress) as line:
        scene, read_ms, described = read_scene(args, line, files)
        with line.compiling():
            steps = encode_steps(scene, quality, axes, Path(args.volume).name)
            stored, report = line.follow(steps, start=0.1)
        line.show(1.0, "writing")
        with whole_files(outputs) as parts:
            began = perf_counter()
            with writing(args.output):
                write(parts[0], stored)
            write_ms = 1e3 * (perf_counter() - began)
            report = {
                "command": "encode",
                "input": {"path": str(args.volume)},
                "output": {"path": str(args.output), "bytes": parts[0].stat().st_size},
                **report,
                "stages_ms": {
                    "read": read_ms, **report["stages_ms"], "write": write_ms, "total": 1e3 * (perf_counter() - start)
                },
                "transfer_function": described,
                "lighting": stored.lighting,
                "remarks": [*scene.volume.remarks, *options.remark_on_removed(args)],
            }  # fmt: skip
            if args.json:
                write_report(parts[1], report)
    _say(report)


def _run_folder(args, axes: list[int], start: float) -> None:
    """Encode into a folder of tables."""
    from ..encode.folder import FolderWriter, can_go_on

    output = Path(args.output)
    try:
        with FolderWriter(output) as writer, _scratch_of(output) as scratch:
            report = _folder_report(args, axes, writer, scratch, start)
    except KeyboardInterrupt:
        if not can_go_on(output):
            raise
        raise Cancelled("Stopped; finished planes stay, and the same command goes on after them.") from None
    _say_folder(report)


@contextmanager
def _scratch_of(output: Path):
    """Context manager: a file beside a folder, for the voxels of formats that cannot be mapped as they are."""
    scratch = output.with_name(f".{output.name}.voxels")
    try:
        yield scratch
    finally:
        with suppress(OSError):  # Windows removes no file that is still mapped, as after an error
            scratch.unlink()


def _folder_report(args, axes: list[int], writer, scratch: Path, start: float) -> dict:
    """Encode into the folder of a FolderWriter; return the report."""
    from ..pipeline.encode_folder import write_folder_steps

    quality, files = options.encoding_quality(args), read_scene_files(args)
    with ProgressLine(args.progress) as line, whole_files([args.json] if args.json else []) as parts:
        level = {"level": 0} if args.level is None else {}
        scene, read_ms, described = read_scene(args, line, files, scratch=scratch, **level)
        with suppress(OSError):  # else it is removed when the mapping is closed
            scratch.unlink()
        with line.compiling():
            report = line.follow(write_folder_steps(scene, quality, writer, axes, Path(args.volume).name))
        report = {
            "command": "encode", "input": {"path": str(args.volume)}, "output": {"path": str(args.output)},
            **report, "transfer_function": described,
            "remarks": [*scene.volume.remarks, *options.remark_on_removed(args)],
        }  # fmt: skip
        report["stages_ms"] |= {"read": read_ms, "total": 1e3 * (perf_counter() - start)}
        if args.json:
            write_report(parts[0], report)
    return report


def _say_folder(report: dict) -> None:
    """Print what a folder holds."""
    say_beginning(report)
    volume, folder = report["volume"], report["folder"]
    print(f"{volume['visible_voxels']} voxels are visible ({volume['visible_fraction']:.2%}).")
    if folder["resumed_at_plane"]:
        print(f"Planes up to {folder['resumed_at_plane']} were there from a run that was stopped.")
    print(f"Wrote the folder {report['output']['path']} ({bytes_text(folder['bytes'])}).")


def _axes(names: str) -> list[int]:
    """Axis numbers from letters; RleSplatError for a repeated or unknown letter."""
    if not names or len(set(names)) != len(names) or not set(names) <= set(AXIS_NAMES):
        raise RleSplatError(f"--axes is {names!r}; give one to three of the letters x, y and z, each once.")
    return sorted(AXIS_NAMES.index(name) for name in names)


def _say(report: dict) -> None:
    """Print the sizes of the four tables of each principal axis."""
    say_beginning(report)
    volume = report["volume"]
    print(f"{volume['visible_voxels']} of the voxels are visible ({volume['visible_fraction']:.2%}).")
    print(f"{'principal axis':<16}{'scanline pointers':>18}{'data pointers':>15}{'runs':>12}{'voxel data':>13}")
    for name, entry in report["axes"].items():
        memory = entry["memory_bytes"]
        sizes = [bytes_text(memory[key]) for key in ("scanline_pointers", "data_pointers", "runs", "voxel_data")]
        print(f"{name:<16}{sizes[0]:>18}{sizes[1]:>15}{sizes[2]:>12}{sizes[3]:>13}   {entry['runs']} runs")
    print(f"Wrote {report['output']['path']} ({bytes_text(report['output']['bytes'])}).")
