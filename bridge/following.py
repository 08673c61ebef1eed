"""The work of a backdrop that follows the scene: a preview at once, refined from a timer when the scene rests.

While the user plays, scrubs or edits, a picture that takes long would hold up the window.  There the scene gets the
first preview, and a timer makes the rest, until something changes or the picture is there.  Scripts that set a frame,
and background mode, get the picture at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import bpy

from ..rle_splat.pipeline.previews import Preview
from .canvas import redraw

BITE = 0.03  # seconds of work in each tick of the timer, so that scrubbing stays smooth
PAUSE, WAIT = 0.01, 0.2  # seconds between ticks, and between looks whether playing is over


@dataclass(frozen=True, eq=False)
class Refinement:
    """``steps``: the work, a generator of Progress and Previews.  ``show(rendering)`` shows a preview of it,
    ``finish(rendering)`` the picture, ``fail(problem)`` that there is none.  ``wish``: what it will be made from."""

    steps: Generator
    show: Callable
    finish: Callable
    fail: Callable
    wish: object


_unfinished: list = []  # the one Refinement that is not done, if any


def is_playing() -> bool:
    """Whether the user plays the animation."""
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)


def is_moving() -> bool:
    """Whether the user plays the animation or drags through it."""
    if bpy.app.background:
        return False
    return is_playing() or any(window.screen.is_scrubbing for window in bpy.context.window_manager.windows)


def begin(work: Refinement) -> None:
    """Work until something can be shown, and leave the rest to a timer."""
    stop()
    while (step := _advance(work)) is not None:
        if isinstance(step, Preview):
            _unfinished.append(work)
            if not bpy.app.timers.is_registered(_tick):
                bpy.app.timers.register(_tick, first_interval=PAUSE)
            return


def is_making(wish) -> bool:
    """Whether a picture made from that is on its way."""
    return any(work.wish == wish for work in _unfinished)


def stop() -> None:
    """Drop what is not done: its frame is no longer wanted.

    A render's own thread may ask for that in the middle of a step, which a generator cannot be closed in: it is let
    go of, and ends with that step.
    """
    _unfinished.clear()


def _tick():
    """Blender calls this again after the seconds it returns, and no more after None."""
    if _unfinished and is_playing():
        return WAIT
    until = time.perf_counter() + BITE
    while (works := _unfinished[:1]) and time.perf_counter() < until:
        step = _advance(works[0])
        if step is None:
            _unfinished.clear()
        if step is None or isinstance(step, Preview):
            redraw(bpy.context)
    return PAUSE if _unfinished else None


def _advance(work: Refinement):
    """One step of the work, shown if it can be; None when it is over."""
    try:
        try:
            step = next(work.steps)
        except StopIteration as finished:
            work.finish(finished.value)
            return None
        if isinstance(step, Preview):
            work.show(step.rendering)
        return step
    except Exception as problem:
        work.fail(problem)
        return None
