"""``rle-splat convert``: write a volume in another format and report what that format cannot store."""

from pathlib import Path
from shlex import quote
from time import perf_counter

from ..read.formats import format_named, read_steps, suffixes, write_steps
from ..runtime.memory import bytes_text
from ..runtime.outputs import check_outputs, write_report
from ..runtime.whole_files import whole_files
from ..scene import RleSplatError
from .options import add_report_options, add_volume_argument, add_volume_options, volume_options
from .progress import ProgressLine
from .report import number_text


def add_arguments(parser) -> None:
    add_volume_argument(parser)
    parser.add_argument("output", metavar="OUT", help=f"the file to write: {', '.join(suffixes(writable=True))}")
    add_report_options(parser)
    add_volume_options(parser)


def run(args) -> None:
    target = format_named(args.output)
    if target is None or target.write_steps is None:
        raise RleSplatError(
            f"{args.output} has no suffix of a format that can be written; use {', '.join(suffixes(writable=True))}."
        )
    check_outputs([args.output, *([args.json] if args.json else [])], inputs=(args.volume,))
    start = perf_counter()
    with ProgressLine(args.progress) as line:
        volume = line.follow(read_steps(args.volume, **volume_options(args)))
        check_outputs([args.output], inputs=volume.data_files)
        options = line.follow(write_steps(volume, args.output))
    lost = target.lost(volume)
    report = {
        "command": "convert",
        "input": {"path": str(args.volume), "remarks": list(volume.remarks)},
        "output": {"path": str(args.output), "format": target.name, "bytes": Path(args.output).stat().st_size},
        "volume": {"shape_xyz": volume.shape_xyz, "type": volume.voxels.dtype.name, "affine": volume.affine},
        "read_back_with": options,
        "lost": lost,
        "stages_ms": {"total": 1e3 * (perf_counter() - start)},
    }
    if args.json:
        with whole_files([args.json]) as parts:
            write_report(parts[0], report)
    for remark in volume.remarks:
        print(remark)
    print(f"Wrote {args.output} ({target.name}, {bytes_text(report['output']['bytes'])}).")
    for sentence in lost:
        print(sentence)
    if options:
        print(f"Read it back with: {_as_words(options)}")


def _as_words(options: dict) -> str:
    """Options of ``read_volume`` as command-line options."""
    words = []
    for name, value in options.items():
        if value is None:
            continue
        words.append("--" + name.replace("_", "-"))
        entries = value if isinstance(value, (tuple, list)) else (value,)
        words += [quote(entry) if isinstance(entry, str) else _exact(entry) for entry in entries]
    return " ".join(words)


def _exact(number) -> str:
    """A number as the shortest text that gives the same number when it is read."""
    return number_text(number) if float(number_text(number)) == number else repr(float(number))
