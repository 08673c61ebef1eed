"""Long work as generators of steps, and the time that each stage takes."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass

# "kernels" is loading the splat kernel, and compiling it the first time ever: once in a process, not per picture.
STAGES = (
    "classify", "mixing", "gradients", "shadows", "ambient occlusion", "shade", "encode", "occlusion", "clipping",
    "clip objects",
    "kernels", "splat", "warp", "rays",
)  # fmt: skip
FRAME = ("splat", "warp", "rays")  # what every frame takes; rays where it has pixels by single ones


@dataclass(frozen=True)
class Progress:
    """How far a long job is: ``fraction`` in [0, 1], and what it is doing, in words for a person."""

    fraction: float
    message: str


class Clock:
    """Milliseconds spent per stage."""

    def __init__(self):
        self.started = time.perf_counter()
        self.stages = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def stage(self, name: str):
        begun = time.perf_counter()
        try:
            yield
        finally:
            self.stages[name] += 1e3 * (time.perf_counter() - begun)

    def timing(self, name: str, function):
        """The function with its time counted for a stage."""

        def timed_function(*arguments):
            with self.stage(name):
                return function(*arguments)

        return timed_function

    def report(self) -> dict:
        return {**self.stages, "total": 1e3 * (time.perf_counter() - self.started)}


def drain(steps, on_step=None):
    """Run a generator of steps to its end; return its result. ``on_step``: called with each step."""
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        if on_step is not None:
            on_step(step)


def mapped(steps, function):
    """Generator: the steps, each as ``function(step)``; return their result."""
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        yield function(step)


def within(steps, context):
    """Generator: the steps, each made within ``context()``, a context manager; return their result."""
    while True:
        try:
            with context():
                step = next(steps)
        except StopIteration as finished:
            return finished.value
        yield step


def portion(steps, start: float, end: float, message: str):
    """Generator: fractions done as Progress from ``start`` to ``end`` with a message; return the steps' result."""
    return mapped(steps, lambda done: Progress(start + (end - start) * done, message))


def part(steps, start: float, end: float, message: str = ""):
    """Generator: Progress from 0 to 1 as Progress from ``start`` to ``end``; return the steps' result.

    ``message``: in place of each step's own, if given.
    """
    return mapped(steps, lambda step: Progress(start + (end - start) * step.fraction, message or step.message))


def timed(steps, clock: Clock, stage: str, without: str | None = None):
    """Generator: the same steps, the time that they take counted for a stage of the clock; return their result.

    ``without``: a stage that is timed within these steps by itself, and not counted twice.
    """
    before = clock.stages[without] if without else 0.0
    result = yield from within(steps, lambda: clock.stage(stage))
    if without:
        clock.stages[stage] -= clock.stages[without] - before
    return result
