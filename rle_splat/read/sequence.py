"""Numbered files, such as smoke_0001.vdb and smoke_0002.vdb, as a time series: one file, one time point."""

import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from ..scene import RleSplatError

NUMBER = re.compile(r"\d+")
LISTED = 8  # numbers in a message
# Types, shapes and spacings, which names of raw files hold.
NO_FRAME = re.compile(r"u?int\d+|float\d+|\d+(\.\d+)?(x\d+(\.\d+)?)+")


@dataclass(frozen=True)
class Sequence:
    """Files whose names differ in their last number alone.

    Attributes
    ----------
    files : dict of int to Path
        By number, ascending.
    step : int
        Distance of the numbers; frame k has the first number plus (k - 1) steps.
    """

    files: dict
    step: int

    @property
    def count(self) -> int:
        """Number of frames, missing ones included."""
        return (max(self.files) - min(self.files)) // self.step + 1

    @property
    def missing(self) -> tuple[int, ...]:
        """Frames without a file."""
        first = min(self.files)
        return tuple(k + 1 for k in range(self.count) if first + k * self.step not in self.files)

    @property
    def first(self) -> Path:
        """The file of the first frame."""
        return self.files[min(self.files)]

    def frame_of(self, path) -> int:
        """The frame of one of the files."""
        number = next(number for number, file in self.files.items() if file.name == Path(path).name)
        return (number - min(self.files)) // self.step + 1

    def file(self, frame: int) -> Path:
        """The file of a frame, from 1; RleSplatError if there is none."""
        if not 1 <= frame <= self.count:
            raise RleSplatError(
                f"There is no time point {frame}: {self.first.name} is the first of {self.count} files; "
                f"choose one from 1 to {self.count}."
            )
        number = min(self.files) + (frame - 1) * self.step
        if number not in self.files:
            raise RleSplatError(
                f"Time point {frame} is missing: there is no file with the number {number} beside {self.first.name}; "
                "export it again, or choose another time point."
            )
        return self.files[number]


def _parts(path: Path):
    """(text before, last number, text after) of a file's name without its suffixes; None without a number."""
    stem = path.name[: len(path.name) - len("".join(_suffixes(path)))]
    found = list(NUMBER.finditer(NO_FRAME.sub(lambda clue: "#" * len(clue[0]), stem)))
    if not found:
        return None
    begin, end = found[-1].span()
    return stem[:begin], stem[begin:end], path.name[end:]


def _suffixes(path: Path) -> list[str]:
    """The suffixes at the end of a name that are no numbers, such as [".raw", ".gz"]."""
    kept = []
    for suffix in reversed(path.suffixes):
        if suffix[1:].isdigit() or len(kept) == 2:
            break
        kept.insert(0, suffix)
    return kept


def sequence_of(path) -> Sequence | None:
    """The numbered files that a file belongs to.

    Parameters
    ----------
    path : str or Path
        Any file of the sequence.

    Returns
    -------
    Sequence or None
        None if its name has no number, or no other file differs from it in the last number alone. Numbers with
        leading zeros must have the same length.
    """
    path = Path(path)
    parts = _parts(path)
    if parts is None or not path.parent.is_dir():
        return None
    before, _, after = parts
    found = {}
    for other in path.parent.iterdir():
        name = other.name
        digits = name[len(before) : len(name) - len(after)]
        if name == before + digits + after and digits.isascii() and digits.isdigit() and _same_width(digits, parts[1]):
            found[int(digits)] = other
    if len(found) < 2 or not path.exists():
        return None
    numbers = sorted(found)
    step = math.gcd(*(b - a for a, b in pairwise(numbers)))
    return Sequence({number: found[number] for number in numbers}, step)


def join_numbers(numbers) -> str:
    """Numbers for a message; the first of many."""
    return ", ".join(map(str, numbers[:LISTED])) + (" and others" if len(numbers) > LISTED else "")


def _same_width(digits: str, given: str) -> bool:
    """Whether two numbers can be of one sequence: one of them padded with zeros only if both have the same length."""
    return len(digits) == len(given) or not (digits.startswith("0") or given.startswith("0"))
