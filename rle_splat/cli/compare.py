"""``rle-splat compare``: this renderer and the other methods that the paper names, on one volume and view."""

from time import perf_counter

from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files
from ..scene import RleSplatError
from . import options
from .progress import ProgressLine
from .report import say_beginning
from .viewing import check_scene_options, read_scene, read_scene_files

PROBES = 256
REPEATS = 3


def add_arguments(parser) -> None:
    from ..comparison.table import SYSTEMS

    options.add_volume_argument(parser)
    parser.add_argument(
        "--system", action="append", metavar="NAME",
        help=f"compare only this system: {', '.join(SYSTEMS)}; repeatable, the others are measured against the first",
    )  # fmt: skip
    parser.add_argument("--probes", type=int, default=PROBES, metavar="N", help=f"pixels to measure ({PROBES})")
    parser.add_argument("--repeats", type=int, default=REPEATS, metavar="N", help=f"frames to time ({REPEATS})")
    options.add_size_option(parser)
    options.add_report_options(parser)
    options.add_scene_options(parser)
    options.add_quality_options(parser)


def run(args) -> None:
    start = perf_counter()
    outputs = [args.json] if args.json else []
    check_outputs(outputs, inputs=options.scene_inputs(args))
    check_scene_options(args)
    if args.probes < 1 or args.repeats < 1:
        raise RleSplatError("--probes and --repeats take whole numbers above zero.")
    quality = options.quality_from(args, "pre")
    files = read_scene_files(args)
    from ..comparison.compare import compare_steps, table_lines
    from ..comparison.table import system_of

    for name in args.system or ():
        system_of(name)
    with ProgressLine(args.progress) as line:
        scene, _, described = read_scene(args, line, files)
        with line.compiling():
            report = line.follow(compare_steps(scene, quality, args.system, args.probes, args.repeats), start=0.05)
        report = {
            "command": "compare", "input": {"path": str(args.volume)}, **report,
            "transfer_function": described,
            "remarks": [*scene.volume.remarks, *options.remark_on_removed(args)],
            "total_ms": 1e3 * (perf_counter() - start),
        }  # fmt: skip
        with whole_files(outputs) as parts:
            if parts:
                write_report(parts[0], report)
    say_beginning(report)
    print("\n".join(table_lines(report)))
