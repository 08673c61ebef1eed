"""What a worker of a cluster does: it reads the volume by its path, and renders tiles or frames.

Tasks name a job by its key.  A worker prepares a job when its first task arrives, and keeps it for the next ones: the
volume, and the results of stages that the tiles or frames have in common.  Several commands may use a worker at the
same time.  What it keeps for one of them goes when the command ends, or, if it was killed, when the next one begins.
"""

import queue
from argparse import Namespace
from dataclasses import dataclass, replace
from time import perf_counter

from ..runtime.steps import drain
from .progress import ProgressLine
from .render import Checked, PreparedScene, picture_steps, prepare
from .series import FrameSeries

_JOBS: dict[str, object] = {}
# Tasks of a worker with several threads: one at a time prepares a job.
_TOKEN: queue.SimpleQueue = queue.SimpleQueue()
_TOKEN.put(None)


@dataclass(frozen=True)
class Command:
    """What all tasks of a command have in common.

    Attributes
    ----------
    key : str
        Of the client whose command it is, by which the scheduler knows whether it is still there.
    args : argparse.Namespace
        Its options, with absolute paths.
    """

    key: str
    args: Namespace
    checked: Checked


@dataclass(frozen=True)
class Made:
    """What a task returns.

    Attributes
    ----------
    prepared : PreparedScene or None
        Without its scene, for the report; None for a frame that is there already.
    rendering : Rendering or None
    scene_hash : str or None
        Of a frame.
    """

    prepared: PreparedScene | None
    rendering: object
    scene_hash: str | None = None


def make_tile(job: Command, tile) -> Made:
    """Render a tile, (left, top, right, bottom), of the picture of a job."""
    from ..pipeline.render import render_steps

    prepared, cache = _keep(job.key, lambda: _picture_of(job))
    scene = replace(prepared.scene, crop=tile)
    steps = render_steps(scene, prepared.quality, cache=cache, refuse_empty_view=False)
    return Made(replace(prepared, scene=None), drain(steps))


def make_section(job: Command, tile, number: int, count: int):
    """Draw one of ``count`` sections of a tile of the picture of a job; return its SectionImages."""
    from ..pipeline.sections import section_steps

    prepared, _ = _keep(job.key, lambda: _picture_of(job))
    return drain(section_steps(replace(prepared.scene, crop=tile), prepared.quality, number, count))


def cover(job: Command, front, back):
    """Composite the SectionImages of sections that lie behind one another."""
    from ..pipeline.sections import over

    return over(front, back)


def finish_tile(job: Command, tile, sections) -> Made:
    """Warp a tile of the picture of a job from the SectionImages of all sections."""
    from ..pipeline.sections import composite_steps

    prepared, _ = _keep(job.key, lambda: _picture_of(job))
    steps = composite_steps(replace(prepared.scene, crop=tile), prepared.quality, sections)
    return Made(replace(prepared, scene=None), drain(steps))


def make_frame(job: Command, own: Namespace, made: str | None) -> Made:
    """Render a frame of a job; ``own``: its options, ``made``: the scene of the picture that is there, or None."""
    began = perf_counter()
    series = _keep(job.key, lambda: FrameSeries(job.args, job.checked, ProgressLine(False)))
    _TOKEN.get()  # a FrameSeries makes one frame after the other
    try:
        prepared, scene_hash = series.ready(own)
    finally:
        _TOKEN.put(None)
    if made == scene_hash:
        return Made(None, None, scene_hash)
    rendering, _ = drain(picture_steps(own, prepared, series.job(began, scene_hash)))
    return Made(replace(prepared, scene=None), rendering, scene_hash)


def list_jobs() -> list[str]:
    """The keys of the jobs for which something is kept."""
    return list(_JOBS)


def forget(keys) -> None:
    """Drop what was kept for jobs."""
    for key in keys:
        _JOBS.pop(key, None)


def _picture_of(job: Command) -> tuple:
    """The PreparedScene of a picture, and the cache that its tiles share; the view is checked once."""
    from ..pipeline.stage_cache import StageCache
    from ..pipeline.tiles import check_view

    prepared, _ = prepare(job.args, job.checked, ProgressLine(False))
    check_view(prepared.scene, prepared.quality)
    return prepared, StageCache()


def _keep(key: str, make):
    """What a job has in common, made by the first of its tasks."""
    _TOKEN.get()
    try:
        if key not in _JOBS:
            _JOBS[key] = make()
        return _JOBS[key]
    finally:
        _TOKEN.put(None)
