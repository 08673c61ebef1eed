"""The one timer: calls functions later, and again after the seconds that they return.

One function is called at a time, the one that is due longest, so that a window draws and handles events between any two
of them.  In background mode, where Blender runs no timers, nothing is called: the work is done at once there.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable

import bpy

from . import jobs

BUSY = 0.2  # seconds until work that must wait looks again

_due: dict = {}  # function -> when it is called, on the performance counter
_next = [0.0]  # when Blender calls ``_tick``
_called: list = []  # the function that is being called


def start(function: Callable, after: float = 0.0) -> None:
    """Call a function after some seconds, unless it is to be called already.

    Parameters
    ----------
    function : callable
        Without arguments; returns the seconds after which it is called again, or None.
    after : float
        Seconds.
    """
    if bpy.app.background or function in _due:
        return
    _due[function] = time.perf_counter() + after
    if _called:
        return  # ``_tick`` looks at it when that function has returned
    if bpy.app.timers.is_registered(_tick):
        if _next[0] <= _due[function]:
            return
        bpy.app.timers.unregister(_tick)
    _next[0] = min(_due.values())
    bpy.app.timers.register(_tick, first_interval=max(_next[0] - time.perf_counter(), 0.0))


def is_waiting(function: Callable) -> bool:
    """Whether a function is to be called, or is being called."""
    return function in _due or function in _called


def stop(function: Callable) -> None:
    """Do not call a function."""
    _due.pop(function, None)


def stop_all() -> None:
    """Call nothing more, before another file is opened."""
    _due.clear()
    if not _called and bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def must_wait() -> bool:
    """Whether a render or an operator of ours runs, before which other work waits."""
    return bpy.app.is_job_running("RENDER") or jobs.StepwiseOperator.is_running()


def _tick():
    """Timer function: call the function that is due longest."""
    function = min(_due, key=_due.get, default=None)
    if function is not None and _due[function] <= time.perf_counter():
        del _due[function]
        _called.append(function)
        again = None
        try:
            again = function()
        except Exception:  # the others are called all the same
            traceback.print_exc()
        finally:
            _called.clear()
        if again is not None:
            _due[function] = time.perf_counter() + again
    if not _due:
        return None
    _next[0] = min(_due.values())
    return max(_next[0] - time.perf_counter(), 0.0)
