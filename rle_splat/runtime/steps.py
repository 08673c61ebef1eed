"""Long work as generators of steps, and the time that each stage takes."""

from __future__ import annotations

import time
from typing import NamedTuple

SETUP = "setup"  # what belongs to no other stage: settling effects, the view, memory, finding results of earlier frames
# "plan" is choosing what a quality preset takes for the scene, once for a volume and its transfer function.
# "kernels" is loading the splat kernel, and compiling it the first time ever: once in a process, not per picture.
STAGES = (
    SETUP, "plan", "classify", "mixing", "gradients", "shadows", "ambient occlusion", "shade", "encode", "occlusion",
    "clipping", "clip objects", "kernels", "splat", "warp", "rays", "glass", "report",
)  # fmt: skip
FRAME = ("splat", "warp", "rays")  # what every frame takes; rays where it has pixels by single ones


class Progress(NamedTuple):
    """How far a long job is: ``fraction`` in [0, 1], and what it is doing, in words for a person."""

    fraction: float
    message: str


# The context managers of a Clock are no generators, which take twice as long: a frame enters dozens.


class _Running:
    """``Clock.running``."""

    __slots__ = ("_clock",)

    def __init__(self, clock: Clock):
        self._clock = clock

    def __enter__(self) -> None:
        self._clock._since = self._clock._now()

    def __exit__(self, *_) -> None:
        self._clock._turn_to(self._clock._stage)


class _Stage:
    """``Clock.stage``."""

    __slots__ = ("_before", "_clock", "_name")

    def __init__(self, clock: Clock, name: str):
        self._clock, self._name = clock, name

    def __enter__(self) -> None:
        self._before = self._clock._turn_to(self._name)

    def __exit__(self, *_) -> None:
        self._clock._turn_to(self._before)


class Clock:
    """Milliseconds spent per stage.

    All time belongs to exactly one stage: the innermost that is open, ``SETUP`` where none is.  So the stages add up
    to the whole.

    Parameters
    ----------
    now : callable
        Returns seconds.

    Attributes
    ----------
    stages : dict
        Name of a stage -> milliseconds until its last change.
    """

    def __init__(self, now=time.perf_counter):
        self.stages = dict.fromkeys(STAGES, 0.0)
        self._now, self._stage, self._since = now, SETUP, now()

    def _turn_to(self, stage: str) -> str:
        """Count the time until now, and what follows for another stage; return the one that it was."""
        before, now = self._stage, self._now()
        self.stages[before] += 1e3 * (now - self._since)
        self._stage, self._since = stage, now
        return before

    def stage(self, name: str) -> _Stage:
        """A block whose time is counted for a stage, but for the stages within it; it may hold a ``yield``."""
        return _Stage(self, name)

    def running(self) -> _Running:
        """A block of work; what passes before it, since the block before, is not counted."""
        return _Running(self)

    def timing(self, name: str, function):
        """The function with its time counted for a stage."""

        def timed_function(*arguments):
            with self.stage(name):
                return function(*arguments)

        return timed_function

    def report(self) -> dict:
        """Milliseconds of each stage until now, and their sum, ``total``."""
        self._turn_to(self._stage)
        return {**self.stages, "total": sum(self.stages.values())}


def drain(steps, on_step=None):
    """Run a generator of steps to its end; return its result. ``on_step``: called with each step."""
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        if on_step is not None:
            on_step(step)


def map_steps(steps, function):
    """Generator: the steps, each as ``function(step)``; return their result."""
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return finished.value
        yield function(step)


def forward(steps):
    """Generator of Progress whose fractions never fall, from one whose fractions may; return its result."""
    reached = 0.0

    def raise_fraction(step: Progress) -> Progress:
        nonlocal reached
        if step.fraction < reached:
            return Progress(reached, step.message)
        reached = step.fraction
        return step

    return map_steps(steps, raise_fraction)


def step_within(steps, context):
    """Generator: the steps, each made within ``context()``, a context manager; return their result."""
    while True:
        try:
            with context():
                step = next(steps)
        except StopIteration as finished:
            return finished.value
        yield step


def announce(steps, start: float, end: float, message: str):
    """Generator: fractions done as Progress from ``start`` to ``end`` with a message; return the steps' result."""
    return map_steps(steps, lambda done: Progress(start + (end - start) * done, message))


def rescale(steps, start: float, end: float, message: str = ""):
    """Generator: Progress from 0 to 1 as Progress from ``start`` to ``end``; return the steps' result.

    ``message``: in place of each step's own, if given.
    """
    return map_steps(steps, lambda step: Progress(start + (end - start) * step.fraction, message or step.message))
