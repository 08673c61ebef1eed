"""A queue that reads files and makes pictures from a timer, a step at a time, so that a window never waits for them.

Viewports, slices and a backdrop that follows the scene ask for what a volume object shows now.  What is wanted stays in
the queue until it is read, or until the object shows something else.  Slices in full and the backdrop come next.  When
nothing is asked for, the next frame of one volume in time is read ahead.  During playback only frames are read that
will be shown when they are there; those that come before are dropped.  Scripts and background mode do not wait for
timers: they read at once.
"""

import math
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import NamedTuple

import bpy

from ...rle_splat.runtime.steps import Progress
from ...rle_splat.scene import RleSplatError
from ..data.playback import frames_until, is_playing
from ..held import Held
from ..pictures.canvas import redraw_sidebars
from ..volumes import loading, volumes
from . import store, timer

PURPOSE = "picture"  # of a wish, see ``store.Wish``
BACKDROP, SLICES = "backdrop", "slices"  # names of pictures
LOOK_AROUND = 0.2  # seconds after a frame change until the next frame is read: the user may drag on
MOST_AHEAD = 8  # frames that are looked at for one to be read ahead during playback


@dataclass(eq=False)
class ReadingWork:
    """Files that are being read.

    Attributes
    ----------
    waiting : dict
        ``store.Wish`` -> Held volume object that waits; empty when reading ahead.
    progress : Progress or None
        The last one.
    began : int or None
        Frame of the timeline when it began, where it reads ahead.
    """

    steps: Generator
    waiting: dict = field(default_factory=dict)
    progress: Progress | None = None
    began: int | None = None


class PictureWork(NamedTuple):
    """A picture that is made: of which inputs, when it begins on the performance counter, and its steps."""

    made_from: object
    due: float
    steps: Generator


_pictures: dict = {}  # name of who shows it -> PictureWork
_queue: dict = {}  # key of the files, see ``loading.key_of`` -> ReadingWork; the first one is worked on
_failed: set = set()  # keys of sources that could not be read; asking for them again tells why
_is_due = [False]  # whether the next frame may be read ahead; once for each frame, however many volumes there are
_behind: dict = {}  # store.Wish -> Held volume object whose frame was not there in time during playback
_moved = [0]  # frames that playback went on by while the last one was read; negative backward or after a new round


def want(owner, depsgraph=None) -> bool:
    """Ask for the voxels that a volume object shows now, and for its labels.

    Whether they are being read; the object is then tagged for an update when they are there.  False if they are in
    memory or could not be read, so that ``load_volume`` returns or says why at once.
    """
    try:
        key = loading.key_of(owner, depsgraph)
    except RleSplatError:
        return False
    wish = store.wish_of(owner, depsgraph, PURPOSE)
    waits = not loading.is_at_hand(owner, depsgraph) and key not in _failed
    _behind.pop(wish, None)
    if waits and key not in _queue and is_playing() and not volumes.is_at_hand(owner, depsgraph):
        _behind[wish] = Held(owner)
        timer.start(_tick)
        return True
    for other in [other for other in _queue if other != key]:
        showed = _queue[other].waiting.pop(wish, None)  # and shows something else now
        if not _queue[other].waiting and (showed or waits):
            _drop(other)
    if waits:
        if key not in _queue:
            _queue[key] = ReadingWork(loading.load_steps(owner, depsgraph))
            timer.start(_tick)
        _queue[key].waiting[wish] = Held(owner)
    return waits


def consider() -> None:
    """Read the next frame ahead, if a volume in time follows the timeline or keyframes."""
    if not bpy.app.background:
        _is_due[0] = True
        timer.start(_tick, 0.0 if is_playing() else LOOK_AROUND)


def begin(name: str, made_from, steps: Generator, after: float = 0.0) -> None:
    """Make a picture after some seconds, in place of the one of that name that is not done; ``steps`` shows it."""
    drop(name)
    _pictures[name] = PictureWork(made_from, time.perf_counter() + after, steps)
    timer.start(_tick, after)


def is_making(name: str, made_from) -> bool:
    """Whether the picture of that name is being made from these inputs."""
    return name in _pictures and _pictures[name].made_from == made_from


def drop(name: str) -> None:
    """Do not make a picture.

    The render thread may call this during a step, when a generator cannot be closed.  So it is only released, and ends
    after that step.
    """
    _pictures.pop(name, None)


def progress() -> Progress | None:
    """How far the reading is that an object waits for; None if there is none."""
    return next((work.progress for work in _queue.values() if work.waiting), None)


def stop() -> None:
    """Drop all work, and what is known of files."""
    for key in list(_queue):
        _drop(key)
    _pictures.clear()
    _failed.clear()
    _behind.clear()
    _is_due[0] = False
    timer.stop(_tick)


def _drop(key: tuple) -> ReadingWork:
    work = _queue.pop(key)
    work.steps.close()
    return work


def _tick():
    """Timer function: do one step."""
    if timer.must_wait():
        return timer.BUSY
    playing = is_playing()
    name, one = min(_pictures.items(), key=lambda item: item[1].due, default=(None, None))
    wait = math.inf if one is None else one.due - time.perf_counter()
    if not _queue and (_is_due[0] or playing) and wait > 0.0:
        _is_due[0] = False
        _queue.update(_next_frame(playing))
    if _queue:
        _advance(next(iter(_queue)))
    elif wait <= 0.0:
        if next(one.steps, None) is None and _pictures.get(name) is one:
            drop(name)
    if progress() is not None:
        redraw_sidebars(bpy.context)
    if _behind and not (playing and _queue):
        _tag_behind(playing)
    if _queue or _is_due[0] or wait <= 0.0:
        return timer.AT_ONCE
    wait = min(wait, LOOK_AROUND if _behind else math.inf)
    return wait if wait < math.inf else None


def _advance(key: tuple) -> None:
    """Do one step of a ReadingWork; objects that waited for it are tagged when it is done."""
    try:
        _queue[key].progress = next(_queue[key].steps)
        return
    except StopIteration:
        pass
    except Exception:  # whoever needs the voxels reads them at once then, and reports what is wrong
        _failed.add(key)
    work = _drop(key)
    if work.began is not None:
        _moved[0] = bpy.context.scene.frame_current - work.began
    for owner in work.waiting.values():
        if (found := owner.find()) is not None:
            found.update_tag()


def _tag_behind(playing: bool) -> None:
    """Tag the objects whose frame came late, or all that wait for one once playback has stopped."""
    for wish, held in list(_behind.items()):
        owner = held.find()
        if owner is None or not playing or volumes.is_at_hand(owner):
            del _behind[wish]
            if owner is not None:
                owner.update_tag()


def _next_frame(playing: bool = False) -> dict:
    """Key and ReadingWork of the next frame of the first volume that needs one; empty if none does."""
    for window in bpy.context.window_manager.windows:
        scene = window.scene
        first = 1 + (_moved[0] if playing else 0)
        for owner in volumes.volume_objects(scene):
            if owner.rle_splat.frame_count == 1 or not (playing or volumes.is_at_hand(owner)):
                continue
            for n in range(first, first + MOST_AHEAD if playing else 2):
                ahead = frames_until(scene, n) if playing else n
                try:
                    key = loading.key_of(owner, ahead=ahead)
                except RleSplatError:
                    continue  # the frame is missing; it is said when it is shown
                if key not in _failed and not loading.is_ahead(owner, ahead):
                    return {key: ReadingWork(loading.load_ahead_steps(owner, ahead), began=scene.frame_current)}
    return {}
