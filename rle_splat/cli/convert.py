"""``rle-splat convert``: write a volume in another format and report what that format cannot store."""

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
            f"{args.output} has no suffix of a format that can be written; use {', '.join(suffixes(writable=True))}."
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
    """Sentences on what the new file does not store; ``options``: those needed to read it back."""
    lost = []
    if "shape" in options:
        lost.append("A raw file holds only voxels; give shape, type, spacing and scaling again when you read it.")
        if not np.allclose(volume.affine, np.diag((*volume.spacing, 1.0))):
            lost.append("The rotation, mirroring or offset of the affine is lost; only the spacing can be given again.")
        return lost
    lost.append("Voxels with the background value are not stored, so the volume that is read back may be smaller.")
    if volume.slope != 1.0 or volume.intercept != 0.0:
        lost.append("Physical values were written; the stored values, slope and intercept are lost.")
    if volume.voxels.dtype.kind != "f":
        lost.append(f"The type {volume.voxels.dtype.name} is lost; a floating-point grid was written.")
    rounded = rounded_on_writing(volume)
    if rounded:
        lost.append(rounded)
    return lost


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
