"""Reads voxels from a timer, a slice of work at a time, so that a window never waits for a file.

A backdrop that follows the scene asks for what a volume object shows now.  When nothing is asked for, the next frame
of one volume in time is read ahead.  Scripts and background mode do not wait for timers: they read at once.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass

import bpy

from ..rle_splat.runtime.steps import Progress
from ..rle_splat.scene import RleSplatError
from . import jobs, loading, volumes
from .canvas import redraw_sidebars
from .held import Held

PAUSE, BUSY = 0.01, 0.2  # seconds between slices, and between checks whether other work is done
LOOK_AROUND = 0.2  # seconds after a frame change until the next frame is read: the user may drag on


@dataclass(frozen=True, eq=False)
class Work:
    """Voxels that are being read.

    Attributes
    ----------
    steps : generator of Progress
    key : tuple
        Of the files, see ``loading.key_of``.
    owner : Held or None
        The volume object that waits; None when reading ahead.
    """

    steps: Generator
    key: tuple
    owner: Held | None


_work: list = []  # at most one Work
_progress: list = []  # its last Progress
_failed: set = set()  # keys of sources that could not be read; asking for them again tells why
_is_due = [False]  # whether the next frame may be read ahead; once for each frame, however many volumes there are


def want(owner, depsgraph=None) -> bool:
    """Ask for the voxels that a volume object shows now, and for its labels.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    depsgraph : bpy.types.Depsgraph, optional
        Gives the time.

    Returns
    -------
    bool
        Whether they are being read; the object is then tagged for an update when they are there. False if they are in
        memory or could not be read, so that ``load_volume`` returns or says why at once.
    """
    try:
        key = loading.key_of(owner, depsgraph)
    except RleSplatError:
        return False
    if loading.is_at_hand(owner, depsgraph) or key in _failed:
        return False
    if not any(work.key == key for work in _work):
        _drop()
        _work.append(Work(loading.load_steps(owner, depsgraph), key, Held(owner)))
        _start(PAUSE)
    elif _work[0].owner is None:  # it was read ahead, and is wanted now
        _work[0] = Work(_work[0].steps, key, Held(owner))
    return True


def consider() -> None:
    """Read the next frame ahead, if a volume in time follows the timeline or keyframes."""
    if not bpy.app.background:
        _is_due[0] = True
        _start(LOOK_AROUND)


def progress() -> Progress | None:
    """How far the reading is that somebody waits for; None if there is none."""
    waiting = _work and _work[0].owner is not None
    return _progress[0] if waiting and _progress else None


def stop() -> None:
    """Drop the work, and what is known of files."""
    _drop()
    _failed.clear()
    _is_due[0] = False
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _drop() -> None:
    for work in _work:
        work.steps.close()
    _work.clear()
    _progress.clear()


def _start(interval: float) -> None:
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=interval)


def _tick():
    """Timer function: Blender calls it again after the returned seconds, and stops after None."""
    if bpy.app.is_job_running("RENDER") or jobs.StepwiseOperator.is_running():
        return BUSY
    if not _work and _is_due[0]:
        _is_due[0] = False
        _work.extend(_next_frame())
    until = time.perf_counter() + jobs.READ_BUDGET
    while _work and time.perf_counter() < until:
        _advance(_work[0])
    if progress() is not None:
        redraw_sidebars(bpy.context)
    return PAUSE if _work or _is_due[0] else None


def _advance(work: Work) -> None:
    """Do one step."""
    try:
        _progress[:] = [next(work.steps)]
        return
    except StopIteration:
        pass
    except Exception:  # whoever needs the voxels reads them at once then, and reports what is wrong
        _failed.add(work.key)
    _drop()
    owner = work.owner.find() if work.owner is not None else None
    if owner is not None:
        owner.update_tag()


def _next_frame() -> list:
    """The work of reading the next frame of the first volume that needs one; empty if none does."""
    for window in bpy.context.window_manager.windows:
        for owner in volumes.volume_objects(window.scene):
            if owner.rle_splat.frame_count > 1 and volumes.is_at_hand(owner) and not volumes.is_at_hand(owner, ahead=1):
                try:
                    key = loading.key_of(owner, ahead=1)
                    return [] if key in _failed else [Work(volumes.load_ahead_steps(owner), key, None)]
                except RleSplatError:
                    return []  # the frame is missing; it is said when it is shown
    return []
