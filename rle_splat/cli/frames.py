"""Several frames in one command: the options of each, with numbered outputs."""

import argparse
import os
import re
from collections.abc import Sequence
from pathlib import Path

from ..runtime.whole_files import writing
from ..scene import Camera, RleSplatError, from_mapping, read_json
from .made import outputs_of

DIGITS = 4  # of a frame's number in a file's name, as Blender writes them; more where it is larger
MOST = 10**9  # number of a frame
TURNTABLE = ("azimuth", "elevation", "fit", "perspective", "fov")


def add_frames_option(parser) -> None:
    """Add the options for several frames."""
    group = parser.add_argument_group("frames", "several pictures, OUT_0001.png, OUT_0002.png, ...")
    group.add_argument(
        "--frames", nargs=2, type=int, metavar=("A", "B"),
        help="render frames A to B, counted from 1; of --turn, of --camera-path, or else of a time series; pictures "
        "that are there already, whole and of the same scene, are not made again",
    )  # fmt: skip
    group.add_argument("--turn", type=float, metavar="DEG", help="degrees by which the turntable turns each frame")
    group.add_argument(
        "--camera-path",
        metavar="FILE.json",
        help="a list of cameras as of --camera, one for each frame; without --frames all of them",
    )
    group.add_argument(
        "--like", type=int, metavar="N",
        help="the frame whose transfer function and view all frames of a time series have (default: the first of "
        "--frames)",
    )  # fmt: skip
    group.add_argument("--again", action="store_true", help="make all frames, also those that are there already")


class Frames(Sequence):
    """The options of every frame to render, each made when it is asked for.

    Attributes
    ----------
    args : argparse.Namespace
        Of the command.
    first, last : int
        Numbers of frames.
    path : list of Camera or None
        Of --camera-path.
    """

    def __init__(self, args, first: int, last: int, path: list[Camera] | None):
        self.args, self.first, self.last, self.path = args, first, last, path

    def __len__(self) -> int:
        return self.last - self.first + 1

    def __getitem__(self, index: int) -> argparse.Namespace:
        return _frame(self.args, range(self.first, self.last + 1)[index], self.path)

    def find_outputs_at_stake(self, others) -> list[str]:
        """Outputs of the first frame, and of all frames those that are there already or have the name of one of
        ``others``: what has to be checked before any is made."""
        first, found = outputs_of(self[0]), {}
        for path in map(Path, outputs_of(self.args)):
            pattern = re.compile(f"{re.escape(path.stem)}_([0-9]{{{DIGITS},}}){re.escape(path.suffix)}", re.IGNORECASE)
            names = [Path(other).name for other in others]
            if path.parent.is_dir():
                with writing(path):
                    names += os.listdir(path.parent)
            numbers = {int(match[1]) for match in map(pattern.fullmatch, names) if match}
            among = (number for number in sorted(numbers) if self.first <= number <= self.last)
            found |= dict.fromkeys(number_name(path, number) for number in among)
        return [*first, *(path for path in found if path not in first)]


def each_frame(args) -> Sequence:
    """The options of every frame to render.

    Parameters
    ----------
    args : argparse.Namespace
        With the options of ``add_frames_option``, ``frame``, ``output``, ``shadow_pass``, ``json``, ``camera`` and
        those of the turntable.

    Returns
    -------
    sequence of argparse.Namespace
        ``args`` itself without frames. Else Frames, one for each: with its number as ``number``, its own ``frame`` of
        the volume, ``azimuth`` or ``camera``, numbered outputs, and no ``json``, since one report is written for all.

    Raises
    ------
    RleSplatError
        If the numbers are not in order, or options contradict each other.
    """
    path = None if args.camera_path is None else _cameras(args)
    _check(args)
    first, last = args.frames or ((1, len(path)) if path else (None, None))
    if first is None:
        return [args]
    if not 1 <= first <= last <= MOST:
        raise RleSplatError(
            f"--frames is {first} {last}; give the first and the last frame, counted from 1 to {MOST} at most."
        )
    if path and last > len(path):
        raise RleSplatError(f"--frames is {first} {last}, and {args.camera_path} holds {len(path)} cameras.")
    return Frames(args, first, last, path)


def is_in_time(args) -> bool:
    """Whether frames are those of a time series; else they differ in their view alone."""
    return args.turn is None and args.camera_path is None


def _check(args) -> None:
    """Refuse options that contradict each other."""
    if args.frames is None and args.camera_path is None:
        given = [f"--{name}" for name in ("turn", "like") if getattr(args, name) is not None]
        if given or args.again:
            raise RleSplatError(f"{(*given, '--again')[0]} has no effect on one picture; add --frames, or remove it.")
    if args.frame is not None and args.frames is not None and is_in_time(args):
        raise RleSplatError("--frame and --frames contradict each other; give one of the two.")
    if args.like is not None and not is_in_time(args):
        raise RleSplatError("--like is for a time series; remove it, or --turn and --camera-path.")
    if args.like is not None and args.like < 1:
        raise RleSplatError(f"--like is {args.like}; give the number of a frame, counted from 1.")
    if args.turn is not None and not abs(args.turn) <= 360.0:
        raise RleSplatError(f"--turn is {args.turn:g}; give degrees from -360 to 360.")
    for option, value in (("--camera", args.camera), ("--camera-path", args.camera_path)):
        if args.turn is not None and value is not None:
            raise RleSplatError(f"--turn and {option} contradict each other; give one of the two.")


def _cameras(args) -> list[Camera]:
    """The cameras of --camera-path."""
    entries = read_json(args.camera_path, "the camera path")
    if not isinstance(entries, list) or not entries:
        raise RleSplatError(f"The camera path {args.camera_path} does not hold a list; give a list of cameras.")
    given = [name for name in ("camera", *TURNTABLE) if getattr(args, name) is not None]
    if given:
        raise RleSplatError(f"--camera-path and --{given[0]} contradict each other; give one of the two.")
    return [from_mapping(Camera, one, f"Camera {n} of {args.camera_path}") for n, one in enumerate(entries, 1)]


def _frame(args, number: int, path: list[Camera] | None) -> argparse.Namespace:
    own = {
        "number": number, "json": None, "output": [number_name(name, number) for name in args.output],
        "shadow_pass": None if args.shadow_pass is None else number_name(args.shadow_pass, number),
    }  # fmt: skip
    if args.turn is not None:
        own["azimuth"] = (args.azimuth or 0.0) + args.turn * (number - 1)
    elif path:
        own["camera"] = path[number - 1]
    else:
        own["frame"] = number
    return argparse.Namespace(**{**vars(args), **own})


def number_name(path, frame: int) -> str:
    """A file's name with the number of a frame before its suffix: out_0012.png."""
    path = Path(path)
    return str(path.with_name(f"{path.stem}_{frame:0{DIGITS}}{path.suffix}"))
