"""What surrounds the steps of every picture: messages for a person, kernels' names, files cut short, memory run out."""

from __future__ import annotations

from ..runtime.jit import NotingKernels, compiled, nothing_compiled_yet
from ..runtime.steps import Clock, Progress, forward, map_steps, step_within
from ..scene import RleSplatError, Scene
from ..splat.splat import LOADING
from ..volume.mapped_files import whole_steps

LOADING_KERNELS = "Compiling, which takes a while the first time"
COMPILING = "; compiling, the first time only"


def watch_steps(steps, scene: Scene):
    """Generator of Progress that never falls: what ``steps`` returns, and the sorted names of the kernels that ran.

    Raises
    ------
    RleSplatError
        When memory runs out half-way, caused by the MemoryError; when a mapped file of the scene is cut short.
    """
    kernels: set[str] = set()
    steps = whole_steps(steps, scene)
    first_ever = compiled() and nothing_compiled_yet()
    steps = step_within(steps, lambda: NotingKernels(kernels))
    if first_ever:
        steps = map_steps(steps, _say_compiling)
    try:
        made = yield from forward(steps)  # of several axes or base planes each begins anew
    except MemoryError as problem:
        reason = f" ({problem})" if str(problem) else ""
        raise RleSplatError(
            f"Memory ran out half-way through the picture{reason}; free some, or make the picture, the sheet density "
            "or the volume smaller."
        ) from problem
    return made, sorted(kernels)


def _say_compiling(step: Progress) -> Progress:
    """A step of the first picture ever, which compiles kernels; the last step and kernels' own say enough."""
    if step.fraction >= 1.0 or step.message == LOADING_KERNELS:
        return step
    return step._replace(message=step.message + COMPILING)


def watch_splat_steps(steps, clock: Clock, begin: float, share: float):
    """Generator of Progress from ``begin`` on: the splat of one base plane; returns the IntermediateImage.

    Loading the kernel, or compiling it the first time ever, has its own message and its own stage of the clock.
    """
    stage, done = "splat", 0.0

    def say(step) -> Progress:
        nonlocal stage, done
        stage, message = ("kernels", LOADING_KERNELS) if step is LOADING else ("splat", "Splatting")
        done = done if step is LOADING else step
        return Progress(begin + share * done, message)

    return (yield from map_steps(step_within(steps, lambda: clock.stage(stage)), say))
