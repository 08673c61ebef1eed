"""The program of the process that compiles kernels ahead, which ``kernel_preparation`` starts as a file:

    python -P -s prepare_process.py PACKAGE EXTENSION FOLDER

PACKAGE is the extension's name in Blender, ``bl_ext.user_default.rle_splat``; EXTENSION the folder that it is in;
FOLDER the one for the lock and the state.

numba keeps a kernel under the name of its module, so the renderer has to be imported by the name that it has in
Blender.  Its parents there cannot be imported: the extension's own ``__init__`` wants bpy.  Empty packages stand for
them, the last with EXTENSION as its path, and Python's import finds the renderer below.

It ends when Blender does.  Its standard output is a pipe that Blender holds and never reads: once Blender is gone, by
whatever way, the next byte written to it fails, on every system.
"""

import importlib
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import ModuleType

BUSY = 3  # exit code: another process holds the lock
GONE = 4  # exit code: nobody holds the pipe any more
NICENESS = 10
FIRST_FRACTION = 0.1  # of the work: what is left of it cannot be told before
PULSE = 0.5  # seconds between bytes: the pipe, unread, has room for 4096 on Windows
LOCK, STATE = "preparing.lock", "preparing.txt"


def stand_in_for_parents(package: str, extension: str) -> None:
    """Make ``package`` and its parents importable without running them; what is below is found in ``extension``."""
    parts = package.split(".")
    for count in range(1, len(parts) + 1):
        parent = ModuleType(".".join(parts[:count]))
        parent.__path__ = [extension] if count == len(parts) else []
        sys.modules[parent.__name__] = parent


def main(package: str, extension: str, folder: str) -> int:
    if hasattr(os, "nice"):  # on Windows the parent has asked for it
        os.nice(NICENESS)
    stand_in_for_parents(package, extension)
    file_lock = importlib.import_module(f"{package}.rle_splat.runtime.file_lock")
    with file_lock.only_one(Path(folder, LOCK)) as free:
        if not free:
            return BUSY
        prepare = importlib.import_module(f"{package}.rle_splat.pipeline.prepare")
        return follow(prepare.prepare_steps(), Path(folder, STATE))


def follow(steps, state: Path) -> int:
    """Run a generator of Progress to its end, with the seconds that are left in a file; the exit code."""
    began, pulse = time.monotonic(), 0.0
    for progress in steps:
        now, done = time.monotonic(), progress.fraction
        if now > pulse + PULSE:
            pulse = now
            if done > FIRST_FRACTION:
                with suppress(OSError):  # on Windows where it is being read
                    state.write_text(f"{(now - began) * (1.0 - done) / done:.0f}", encoding="ascii")
            try:
                os.write(sys.stdout.fileno(), b".")
            except OSError:
                return GONE
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
