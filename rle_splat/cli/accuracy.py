"""``rle-splat accuracy``: error against time of several plans on one volume and view, as table and report."""

from time import perf_counter

from ..accuracy.metrics import ERRORS
from ..accuracy.probes import PROBES
from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files, writing
from ..scene import RleSplatError
from . import options
from .images import writer_for
from .progress import ProgressLine
from .report import say_beginning
from .viewing import check_scene_options, read_scene, read_scene_files

REPEATS = 5
ERROR_NAMES = tuple(ERRORS)


def add_arguments(parser) -> None:
    options.add_volume_argument(parser)
    parser.add_argument(
        "-o", "--output", action="append", default=[], metavar="OUT", help="write the chosen plan's picture to OUT"
    )
    parser.add_argument(
        "--front", default=ERROR_NAMES[0], metavar="|".join(ERROR_NAMES),
        help=f"the error that decides which plans are on the front ({ERROR_NAMES[0]})",
    )  # fmt: skip
    parser.add_argument("--probes", type=int, default=PROBES, metavar="N", help=f"pixels to measure ({PROBES})")
    parser.add_argument("--repeats", type=int, default=REPEATS, metavar="N", help=f"frames to time ({REPEATS})")
    options.add_size_option(parser)
    options.add_report_options(parser)
    options.add_scene_options(parser)
    options.add_clip_option(parser)
    options.add_quality_options(parser)


def run(args) -> None:
    start = perf_counter()
    writers = [writer_for(path) for path in args.output]
    outputs = [*args.output, *([args.json] if args.json else [])]
    check_outputs(outputs, inputs=options.scene_inputs(args))
    check_scene_options(args)
    if args.probes < 1 or args.repeats < 1:
        raise RleSplatError("--probes and --repeats take whole numbers above zero.")
    if args.front not in ERROR_NAMES:
        raise RleSplatError(f"There is no error called {args.front!r}; choose {', '.join(ERROR_NAMES)}.")
    quality = options.quality_from(args)
    files = read_scene_files(args)
    from ..accuracy.planner.measure_plans import TOLERANCES, sweep_steps
    from ..accuracy.planner.plans import sensible_plans
    from ..accuracy.planner.table import table_lines

    with ProgressLine(args.progress) as line:
        scene, _, described = read_scene(args, line, files)
        steps = sweep_steps(
            scene, sensible_plans(quality), quality, probes=args.probes, repeats=args.repeats, error=args.front,
            tolerances=TOLERANCES,
        )  # fmt: skip
        with line.compiling():
            sweep = line.follow(steps, start=0.05)
        report = {
            "command": "accuracy", "input": {"path": str(args.volume)}, **sweep.report,
            "transfer_function": described,
            "total_ms": 1e3 * (perf_counter() - start),
        }  # fmt: skip
        report["remarks"] = [*report["remarks"], *options.quality_remarks(args, quality)]
        with whole_files(outputs) as parts:
            for writer, path, part in zip(writers, args.output, parts):
                with writing(path):
                    writer(part, sweep.chosen.rgba, sweep.chosen.depth)
            if args.json:
                write_report(parts[len(args.output)], report)
    say_beginning(report)
    print("\n".join(table_lines(report)))
