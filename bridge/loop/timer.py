"""The one timer: calls functions later, and again after the seconds that they return.

A function does one step of its work.  One that returns AT_ONCE is called again until its bite of time is over, and
between two bites a window draws and handles events.  The function that is due longest comes first.  In background mode,
where Blender runs no timers, nothing is called: the work is done at once there.
"""

import time
import traceback
from collections.abc import Callable

import bpy

from ..data.playback import is_playing
from . import jobs

BUSY = 0.2  # seconds until work that must wait looks again
BITE = 0.02  # seconds after which no further step is begun
PLAYING = 0.1  # the most during playback, also of a redraw
PAUSE = 0.005  # seconds between bites
AT_ONCE = 0.0

_due: dict = {}  # function -> when it is called, on the performance counter
_bites: dict = {}  # function -> seconds, where they are not BITE
_next = [0.0]  # when Blender calls ``_tick``
_called: list = []  # the function that is being called
_ended = [0.0]  # when the last bite ended


def start(function: Callable, after: float = 0.0, bite: float = BITE) -> None:
    """Call a function after some seconds, unless it is to be called sooner.

    Parameters
    ----------
    function : callable
        Without arguments; returns the seconds after which it is called again, AT_ONCE, or None.
    bite : float
        Seconds after which it is not called again at once.
    """
    due = time.perf_counter() + after
    if bpy.app.background or _due.get(function, due) < due:
        return
    _due[function] = due
    if bite != BITE:
        _bites[function] = bite
    if _called:
        return  # ``_tick`` looks at it when that function has returned
    if bpy.app.timers.is_registered(_tick):
        if _next[0] <= _due[function]:
            return
        bpy.app.timers.unregister(_tick)
    _next[0] = min(_due.values())
    bpy.app.timers.register(_tick, first_interval=max(_next[0] - time.perf_counter(), 0.0))


def stop(function: Callable) -> None:
    """Do not call a function."""
    _due.pop(function, None)


def stop_all() -> None:
    """Call nothing more, before another file is opened."""
    _due.clear()
    if not _called and bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def is_quiet(function: Callable, seconds: float) -> bool:
    """Whether no other function is called within some seconds."""
    until = time.perf_counter() + seconds
    return all(due > until for other, due in _due.items() if other is not function)


def must_wait() -> bool:
    """Whether a render or an operator of ours runs, before which other work waits."""
    return bpy.app.is_job_running("RENDER") or jobs.StepwiseOperator.is_running()


def _tick():
    """Timer function: call the functions that are due, longest first, for a bite: the next one in its first half."""
    start = now = time.perf_counter()
    least = min(now - _ended[0], PLAYING) if is_playing() else 0.0  # as long as the window took since the last bite
    while (function := min(_due, key=_due.get, default=None)) is not None and _due[function] <= now:
        bite = max(_bites.get(function, BITE), least)
        if now > start + 0.5 * bite:
            break
        del _due[function]
        _called.append(function)
        again, began, end = AT_ONCE, now, start + bite
        try:
            while again == AT_ONCE and 2.0 * now - began < end:  # no step that, as long as the last, ends after it
                began, again, now = now, function(), time.perf_counter()
        except Exception:  # the others are called all the same
            traceback.print_exc()
            again = None
        finally:
            _called.clear()
            _ended[0] = now = time.perf_counter()
        if again is not None:
            _due[function] = now + (again or PAUSE)
    if not _due:
        return None
    _next[0] = min(_due.values())
    return max(_next[0] - time.perf_counter(), 0.0)
