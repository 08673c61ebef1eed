"""What surrounds the steps of every picture: messages for a person, kernels' names, files cut short, memory run out."""

from __future__ import annotations

from ..runtime.jit import NotingKernels, compiled, first_load_steps, nothing_compiled_yet
from ..runtime.steps import Clock, Progress, announce, map_steps, step_within
from ..scene import RleSplatError, Scene
from ..splat.splat import LOADING
from ..volume.mapped_files import list_mapped_files, refuse_cut_files

LOADING_KERNELS = "Compiling, which takes a while the first time"
COMPILING = "; compiling, the first time only"


def watch_steps(steps, scene: Scene, clock: Clock):
    """Generator of Progress that never falls: what ``steps`` returns, and the sorted names of the kernels that ran.

    ``clock``: what passes between the steps is not counted.

    Raises
    ------
    RleSplatError
        When memory runs out half-way, caused by the MemoryError; when a mapped file of the scene is cut short.
    """
    kernels: set[str] = set()
    files, reached = list_mapped_files(scene), 0.0
    first_ever = compiled() and nothing_compiled_yet()
    if compiled():
        yield from announce(first_load_steps(), 0.0, 0.0, LOADING_KERNELS)
    while True:
        try:
            refuse_cut_files(files)
            with clock.running(), NotingKernels(kernels):
                step = next(steps)
        except StopIteration as finished:
            return finished.value, sorted(kernels)
        except MemoryError as problem:
            reason = f" ({problem})" if str(problem) else ""
            raise RleSplatError(
                f"Memory ran out half-way through the picture{reason}; free some, or make the picture, the sheet "
                "density or the volume smaller."
            ) from problem
        reached = max(step.fraction, reached)  # of several axes or base planes each begins anew
        yield Progress(reached, _say_compiling(step) if first_ever else step.message)


def _say_compiling(step: Progress) -> str:
    """The message of the first picture ever, which compiles kernels; the last step and kernels' own say enough."""
    says_enough = step.fraction >= 1.0 or step.message == LOADING_KERNELS
    return step.message if says_enough else step.message + COMPILING


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
