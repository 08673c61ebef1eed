"""The frames of ``--frames A B``: the options of each, with numbered outputs."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..scene import RleSplatError

DIGITS = 4  # of a frame's number in a file's name, as Blender writes them


def add_frames_option(parser) -> None:
    """Add the option for several frames."""
    parser.add_argument(
        "--frames", nargs=2, type=int, metavar=("A", "B"),
        help="render the frames A to B of a volume in time, each to its own pictures: OUT_0001.png, OUT_0002.png, ...; "
        "all are seen as the first, with its transfer function",
    )


def each_frame(args) -> list[argparse.Namespace]:
    """The options of every frame to render.

    Parameters
    ----------
    args : argparse.Namespace
        With ``frame``, ``frames``, ``output``, ``shadow_pass`` and ``json``.

    Returns
    -------
    list of argparse.Namespace
        ``args`` itself without --frames. Else one for each frame: with its number as ``frame``, numbered outputs, and
        no ``json``, since one report is written for all.

    Raises
    ------
    RleSplatError
        If the numbers are not in order, or contradict --frame.
    """
    if args.frames is None:
        return [args]
    first, last = args.frames
    if args.frame is not None:
        raise RleSplatError("--frame and --frames contradict each other; give one of the two.")
    if not 1 <= first <= last:
        raise RleSplatError(f"--frames is {first} {last}; give the first and the last frame, counted from 1.")
    return [
        argparse.Namespace(**{
            **vars(args), "frame": frame, "json": None, "output": [numbered(path, frame) for path in args.output],
            "shadow_pass": None if args.shadow_pass is None else numbered(args.shadow_pass, frame),
        })
        for frame in range(first, last + 1)
    ]  # fmt: skip


def numbered(path, frame: int) -> str:
    """A file's name with the number of a frame before its suffix: out_0012.png."""
    path = Path(path)
    return str(path.with_name(f"{path.stem}_{frame:0{DIGITS}}{path.suffix}"))
