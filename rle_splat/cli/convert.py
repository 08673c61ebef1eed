"""``rle-splat convert``: a volume from one format to another, saying what the new file cannot keep."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from time import perf_counter

import numpy as np

from ..read.formats import format_of, read_volume, suffixes, write_volume
from ..read.vdb import rounded_on_writing
from ..runtime.memory import bytes_text
from ..scene import RleSplatError
from .options import add_report_options, add_volume_argument, add_volume_options, volume_options
from .output import check_outputs, whole_files
from .progress import ProgressLine
from .report import number_text, write_report


def add_arguments(parser) -> None:
    add_volume_argument(parser)
    parser.add_argument("output", metavar="OUT", help=f"the file to write: {', '.join(suffixes(writable=True))}")
    add_report_options(parser)
    add_volume_options(parser)


def run(args) -> None:
    target = format_of(args.output)
    if target is None or target.writer is None:
        raise RleSplatError(
            f"{args.output} has no suffix that can be written; end its name in {', '.join(suffixes(writable=True))}."
        )
    check_outputs([args.output, *([args.json] if args.json else [])], inputs=(args.volume,))
    start = perf_counter()
    with ProgressLine(args.progress) as line:
        line.show(None, f"reading {Path(args.volume).name}")
        volume = read_volume(args.volume, **volume_options(args))
        line.show(None, f"writing {Path(args.output).name}")
        options = write_volume(volume, args.output)
    lost = _lost(volume, options)
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


def _lost(volume, options: dict) -> list[str]:
    """Sentences on what the new file does not hold; ``options`` are those it must be read back with."""
    lost = []
    if "shape" in options:
        lost.append("A raw file holds voxels only: shape, type, spacing and scaling have to be given again.")
        if not np.allclose(volume.affine, np.diag((*volume.spacing, 1.0))):
            lost.append("The affine's rotation, mirroring or offset is lost; only its spacing can be given again.")
        return lost
    lost.append("Voxels at the background's value are not stored, so what is read back may span a smaller box.")
    if volume.slope != 1.0 or volume.intercept != 0.0:
        lost.append("Physical values were written; the stored ones, with their slope and intercept, are lost.")
    if volume.voxels.dtype.kind != "f":
        lost.append(f"The type {volume.voxels.dtype.name} is lost: a grid of floating-point numbers was written.")
    rounded = rounded_on_writing(volume)
    if rounded:
        lost.append(rounded)
    return lost


def _as_words(options: dict) -> str:
    """Options of read_volume as words of this command line."""
    words = []
    for name, value in options.items():
        if value is None:
            continue
        words.append("--" + name.replace("_", "-"))
        entries = value if isinstance(value, (tuple, list)) else (value,)
        words += [quote(entry) if isinstance(entry, str) else _exact(entry) for entry in entries]
    return " ".join(words)


def _exact(number) -> str:
    """The shortest text that reads back as the same number."""
    return number_text(number) if float(number_text(number)) == number else repr(float(number))
