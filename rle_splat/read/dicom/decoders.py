"""Decoding compressed frames in child processes, so that a damaged frame cannot end or block this one.

The children's answers come through files that no process waits for: on Windows, too, nothing here blocks, and work can
be cancelled at any time.
"""

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from ..header import lacking
from . import decode_child
from .refusals import Refused, frame_damage_error

SLOTS = 2  # orders that a child has at once
MOST_CHILDREN = 4
# A child that is waited for longer than this for a frame hangs; measured: 0.1 s a megapixel.
SECONDS, SECONDS_PER_MEGAPIXEL = 10.0, 5.0
POLL, PATIENCE = 0.001, 0.03  # seconds between looks, and until the caller learns that nothing came
PAUSES = 0.0, 0.1, 0.3  # seconds before the folder of decoded pixels is deleted, once more
# Codec -> the package that has it, and what needs it.
PACKAGES = {
    "openjpeg": ("pylibjpeg-openjpeg", "JPEG 2000 DICOM"),
    "libjpeg": ("pylibjpeg-libjpeg", "JPEG DICOM"),
}


# -P keeps the folder of the script, whose modules are ours, out of the names that Python imports; -s what the user has
# installed for another Python.
ISOLATED = "-P", "-s"


@dataclass(frozen=True)
class Order:
    """One frame to decode: its number for the caller, its file, its number there, its fragments in the file."""

    index: int
    path: Path
    frame: int
    codec: str
    fragments: tuple


def decode_frames(orders, limit: int):
    """Generator: decode frames; Refused if a frame cannot be decoded.

    Parameters
    ----------
    orders : sequence of Order
    limit : int
        Largest number of bytes of a decoded frame.

    Yields
    ------
    (Order, bytes) or None
        Frames in the order in which they are ready; None when none is, a few times in 0.2 s.
    """
    if not orders:
        return
    # In Blender it is Blender's own Python, where it has one.
    if not Path(sys.executable or "").stem.lower().startswith("python"):
        raise Refused(
            "Compressed DICOM files are decoded by a Python of their own, which this Blender lacks; convert the files "
            "to uncompressed ones."
        )
    for codec in dict.fromkeys(order.codec for order in orders):
        if find_spec(codec) is None:
            raise lacking(*PACKAGES[codec])
    waiting = list(reversed(orders))
    count = min(MOST_CHILDREN, os.cpu_count() or 1, -(-len(orders) // SLOTS))
    seconds = SECONDS + SECONDS_PER_MEGAPIXEL * limit / 1e6
    children = []
    try:
        with _own_folder() as folder:
            try:
                for number in range(count):
                    children.append(_Child(folder, number, limit, seconds))
                yield from _run(children, waiting, len(orders))
            finally:
                for child in children:
                    child.end()
    except OSError as problem:
        raise Refused(
            f"Compressed files cannot be decoded: {problem.strerror or 'no process can be started'}."
        ) from None


@contextmanager
def _own_folder():
    """Context manager: a folder for decoded pixels, which is deleted; at the end of the program if not before."""
    folder = Path(tempfile.mkdtemp(prefix="rle-splat-"))
    try:
        yield folder
    finally:
        for pause in PAUSES:  # Windows locks the files of a process that has just ended
            time.sleep(pause)
            shutil.rmtree(folder, ignore_errors=True)
            if not folder.exists():
                break
        else:
            atexit.register(shutil.rmtree, folder, ignore_errors=True)


def _environ(*packages: str) -> dict[str, str]:
    """Environment variables of a child that imports ``packages`` from where this process has them.

    Python's own variables, which Blender does not read, are left out. Packages that are not installed are, too.
    """
    found = [find_spec(name) for name in packages]
    folders = dict.fromkeys(str(Path(spec.origin).parents[1]) for spec in found if spec is not None)
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return {**own, "PYTHONPATH": os.pathsep.join(folders)}


def _run(children, waiting: list, left: int):
    """Generator, as ``decode_frames``: hand out orders from the end of ``waiting`` until ``left`` came back."""
    last = time.monotonic()
    while left:
        came = False
        for child in children:
            while waiting and child.free:
                child.give(waiting.pop())
            for answer in child.answers():
                left -= 1
                came = True
                yield answer
        if came:
            last = time.monotonic()
        elif time.monotonic() - last > PATIENCE:
            yield None
            last = time.monotonic()
        else:
            time.sleep(POLL)
            for child in children:
                child.waited += POLL


class _Child:
    """A child process, the files through which it answers, and the orders that it has.

    ``waited``: seconds slept for its next answer. Time in which the caller does something else is not counted.
    """

    def __init__(self, folder: Path, number: int, limit: int, seconds: float):
        self.limit, self.seconds = limit, seconds
        self.at_work: dict[int, Order] = {}
        self.waited = 0.0
        self.rest = b""
        paths = [folder / f"{number}.{kind}" for kind in ("pixels", "answers")]
        flags = subprocess.CREATE_NO_WINDOW if sys.platform == "win32" else 0
        with open(paths[0], "wb") as pixels, open(paths[1], "wb") as answers:
            self.process = subprocess.Popen(
                [sys.executable, *ISOLATED, decode_child.__file__], env=_environ("numpy", *PACKAGES),
                stdin=subprocess.PIPE, stdout=pixels, stderr=answers, creationflags=flags,
            )  # fmt: skip
        self.pixels, self.reports = (open(path, "rb", buffering=0) for path in paths)
        for path in paths:
            with suppress(OSError):  # Windows removes them with their folder
                path.unlink()

    @property
    def free(self) -> bool:
        return len(self.at_work) < SLOTS

    def give(self, order: Order) -> None:
        slot = next(slot for slot in range(SLOTS) if slot not in self.at_work)
        if not self.at_work:
            self.waited = 0.0
        self.at_work[slot] = order
        places = " ".join(f"{offset} {length}" for offset, length in order.fragments)
        path = os.fsencode(order.path).hex()
        with suppress(OSError):  # of a child that ended; answers() tells
            self.process.stdin.write(f"{order.codec} {slot} {self.limit} {path} {places}\n".encode("ascii"))
            self.process.stdin.flush()

    def answers(self):
        """Generator: (order, bytes) of what has been decoded since the last call."""
        ended = self.process.poll() is not None  # asked first: what it wrote before its end is read below
        *lines, self.rest = (self.rest + self.reports.read()).split(b"\n")
        for line in lines:
            slot, count = (int(word) for word in line.split())
            order = self.at_work.pop(slot)
            self.waited = 0.0
            if count < 0:
                raise frame_damage_error(order.path, order.frame)
            self.pixels.seek(slot * self.limit)
            yield order, self.pixels.read(count)
        if self.at_work and (ended or self.waited > self.seconds):
            order = next(iter(self.at_work.values()))
            raise frame_damage_error(order.path, order.frame)

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        with suppress(OSError):  # a pipe that nobody reads any more
            self.process.stdin.close()
        self.pixels.close()
        self.reports.close()
