"""Kernels are compiled ahead, by a process of their own, so that the first picture does not wait for them.

It starts as soon as the extension is enabled in a window and the kernels of default pictures are not on disk, runs
Blender's own Python at low priority, and ends with Blender.  There is one at a time for all Blenders that share the
folder of kernels; the others show its state, and go on where it was ended.

A picture that is made meanwhile waits for the kernels that it needs and no more: those that are on disk are loaded,
the others numba compiles in Blender.  Both processes write each file whole or not at all, so that a kernel that both
compile at once is there once.
"""

from __future__ import annotations

import atexit
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface

from ..rle_splat.pipeline.prepare import is_needed
from ..rle_splat.runtime import child_python
from ..rle_splat.runtime.file_lock import only_one
from ..rle_splat.runtime.jit import cache_folder
from . import prepare_process
from .canvas import redraw
from .messages import tell
from .paths import EXTENSION
from .translations import filled

FIRST, POLL = 1.0, 1.0  # seconds until the first look, and between looks
LOG = "preparing.log"


class _Preparing:
    """The process of this Blender, and what the panel says."""

    process: subprocess.Popen | None = None
    text = ""
    missing: bool | None = None


def text() -> str:
    """What is going on, for people; "" when no kernels are prepared."""
    return _Preparing.text


def are_missing() -> bool:
    """Whether the kernels of default pictures are not on disk; looked up once in a session, and after a preparation."""
    if _Preparing.missing is None:
        _Preparing.missing = is_needed()
    return _Preparing.missing


def is_due() -> bool:
    """Whether kernels are being prepared, or will be as soon as the timer looks."""
    return _Preparing.process is not None or (bpy.app.timers.is_registered(_tick) and _is_wanted())


def register():
    atexit.register(end)
    begin()


def unregister():
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    end()
    atexit.unregister(end)


def begin() -> None:
    """Look from now on whether there is anything to prepare; not in background mode, where somebody waits for a
    picture and no timer runs."""
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=FIRST, persistent=True)


def end() -> None:
    """End the process, if there is one, and wait until it is gone."""
    process, _Preparing.process, _Preparing.text, _Preparing.missing = _Preparing.process, None, "", None
    if process is not None:
        process.kill()
        process.wait()
        process.stdout.close()


def _tick():
    """Blender calls this again after the seconds it returns, and no more after None."""
    before = _Preparing.text
    seconds = advance()
    if _Preparing.text != before:
        redraw(bpy.context)
    return seconds


def advance() -> float | None:
    """Start what is due, or look how far it is; seconds until the next call, None when nothing is left to do."""
    if not _is_wanted():
        end()
        return None
    code = None if _Preparing.process is None else _Preparing.process.poll()
    if code is not None:
        end()
        if code != prepare_process.BUSY:
            if code != 0:
                tell(f"Kernels could not be prepared (exit code {code}); {cache_folder() / LOG} says why.")
            return None
    try:
        if _Preparing.process is None:
            with only_one(cache_folder() / prepare_process.LOCK) as free:
                pass
            if free:
                _Preparing.process = start()
    except OSError as problem:
        tell(f"Kernels could not be prepared: {problem}.")
        return None
    _Preparing.text = describe(_seconds_left())
    return POLL


def _is_wanted() -> bool:
    """Whether there is anything to prepare, a Python to do it, and the user's consent."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    allowed = addon is not None and addon.preferences is not None and addon.preferences.prepare_kernels
    return allowed and is_needed() and child_python.is_python(sys.executable)


def start() -> subprocess.Popen:
    """Start the process.  Raises OSError."""
    folder = cache_folder()
    (folder / prepare_process.STATE).unlink(missing_ok=True)  # of a process that was ended
    flags = 0
    if sys.platform == "win32":
        flags = subprocess.BELOW_NORMAL_PRIORITY_CLASS | subprocess.CREATE_NO_WINDOW
    with open(folder / LOG, "wb") as log:
        return subprocess.Popen(
            command(folder), env=environ(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=log, cwd=folder,
            creationflags=flags,
        )


def command(folder: Path) -> list[str]:
    script = Path(prepare_process.__file__)
    return child_python.command(script, EXTENSION, str(script.parents[1]), str(folder))


def environ() -> dict[str, str]:
    """Blender's own, RLE_SPLAT_CACHE with it, so that both take the same folder."""
    return child_python.environ("numba", "llvmlite", "numpy")


def describe(seconds: float | None) -> str:
    """The line of the panel; ``seconds`` that are left, None where that is not known yet."""
    if seconds is None:
        return pgettext_iface("Preparing kernels: the first picture waits for those it needs")
    tens = 10 * max(round(seconds / 10), 1)
    if tens < 100:
        return filled(
            "Preparing kernels, about {seconds} s left: the first picture waits for those it needs", seconds=tens)
    return filled(
        "Preparing kernels, about {minutes} min left: the first picture waits for those it needs",
        minutes=round(seconds / 60))


def _seconds_left() -> float | None:
    with suppress(OSError, ValueError):  # not there yet, or being written
        return float((cache_folder() / prepare_process.STATE).read_text(encoding="ascii"))
    return None
