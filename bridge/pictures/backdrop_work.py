"""Runs the work of a backdrop that follows the scene: a draft at once, the rest from a timer.

During playback, scrubbing and edits a slow picture would block the window.  So a draft is shown at once and a timer
continues until the picture is done or something changes.  Scripts that set a frame, and background mode, get
the full picture at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass

import bpy

from ..loop import timer
from .canvas import redraw
from .drafts import Draft

BITE = 0.03  # seconds of work per tick of the timer; short, so that scrubbing stays smooth
PAUSE, WAIT = 0.01, 0.2  # seconds between ticks, and between checks whether playback has ended


@dataclass(frozen=True, eq=False)
class Refinement:
    """A picture in progress.

    Attributes
    ----------
    steps : generator
        The work: yields Progress and at most one Draft, returns a Rendering.
    show : callable
        ``show(rendering)`` shows the draft.
    finish : callable
        ``finish(rendering)`` shows the finished picture.
    fail : callable
        ``fail(problem)`` is called with the exception that ended the work.
    wish : MadeFrom
        The inputs of the picture.
    """

    steps: Generator
    show: Callable
    finish: Callable
    fail: Callable
    wish: object


_unfinished: list = []  # at most one Refinement in progress


def is_playing() -> bool:
    """Whether the user plays the animation."""
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)


def is_moving() -> bool:
    """Whether the user plays the animation or drags through it."""
    if bpy.app.background:
        return False
    return is_playing() or any(window.screen.is_scrubbing for window in bpy.context.window_manager.windows)


def begin(work: Refinement) -> None:
    """Work until the draft and leave the rest to a timer; earlier work is dropped."""
    stop()
    while (step := _advance(work)) is not None:
        if isinstance(step, Draft):
            _unfinished.append(work)
            timer.start(_tick, PAUSE)
            return


def is_making(wish) -> bool:
    """Whether a picture with these inputs is in progress."""
    return any(work.wish == wish for work in _unfinished)


def stop() -> None:
    """Drop the work in progress.

    The render thread may call this during a step, when the generator cannot be closed.  So the generator is only
    released, and ends after that step.
    """
    _unfinished.clear()


def _tick():
    """Timer function: Blender calls it again after the returned seconds, and stops after None."""
    if _unfinished and is_playing():
        return WAIT
    until = time.perf_counter() + BITE
    while (works := _unfinished[:1]) and time.perf_counter() < until:
        step = _advance(works[0])
        if step is None:
            _unfinished.clear()
        if step is None or isinstance(step, Draft):
            redraw(bpy.context)
    return PAUSE if _unfinished else None


def _advance(work: Refinement):
    """Do one step and show the draft if it is one; return the step, or None at the end."""
    try:
        try:
            step = next(work.steps)
        except StopIteration as finished:
            work.finish(finished.value)
            return None
        if isinstance(step, Draft):
            work.show(step.rendering)
        return step
    except Exception as problem:
        work.fail(problem)
        return None
