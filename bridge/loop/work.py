"""A queue that reads files and makes pictures from a timer, a step at a time, so that a window never waits for them.

Viewports, slices and a backdrop that follows the scene ask for what a volume object shows now.  What is wanted stays in
the queue until it is read, or until the object shows something else.  Slices in full and the backdrop come next.  When
nothing else is done, the frames that follow of time series are read ahead, until all are in memory or it is full.
During playback frames are read in turn and shown in turn, some late: packed files can only be read in turn.
Scripts and background mode do not wait for timers: they read at once.
"""

import math
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import NamedTuple

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.runtime.steps import Progress
from ...rle_splat.scene import RleSplatError
from ..data.playback import frames_until, is_playing, round_of, shown_frame
from ..held import Held
from ..pictures.canvas import redraw_sidebars
from ..volumes import loading, volumes
from . import store, timer

PURPOSE = "picture"  # of a wish, see ``store.Wish``
BACKDROP, SLICES = "backdrop", "slices"  # names of pictures
LOOK_AROUND = 0.2  # seconds after a frame change, and before other work, in which nothing is read ahead
MOST_AHEAD = 8  # frames that are looked at in a step for one to be read ahead
MOST_LATE = 24  # frames of the timeline by which playback shows one late; beyond, what comes between is left out


@dataclass(eq=False)
class ReadingWork:
    """Files that are being read.

    Attributes
    ----------
    waiting : dict
        ``store.Wish`` -> Held volume object that waits; empty when reading ahead.
    progress : Progress or None
        The last one.
    """

    steps: Generator
    waiting: dict = field(default_factory=dict)
    progress: Progress | None = None


class PictureWork(NamedTuple):
    """A picture that is made: of which inputs, when it begins on the performance counter, and its steps."""

    made_from: object
    due: float
    steps: Generator


_pictures: dict = {}  # name of who shows it -> PictureWork
_queue: dict = {}  # key of the files, see ``loading.key_of`` -> ReadingWork; the first one is worked on
_failed: set = set()  # keys of sources that could not be read; asking for them again tells why
_ahead = [0]  # frame from where on one is looked for to be read ahead: 1 is the one that is shown; 0 for none
_looked: set = set()  # (session id of a volume object, its frame) that were looked at
_playing: dict = {}  # store.Wish -> Held volume object in time that was asked for during playback
_shown: dict = {}  # session id of a scene -> frame of the timeline whose volumes playback shows


def want(owner, depsgraph=None, ahead: int = 0) -> bool:
    """Ask for the voxels that a volume object shows, and for its labels.

    Whether they are being read; the object is then tagged for an update when they are there, or when playback stops.
    False if they are in memory or could not be read, so that ``load_volume`` returns or says why at once.

    Parameters
    ----------
    ahead : int
        Frames of the timeline from now on; see ``late``.
    """
    try:
        key = loading.key_of(owner, depsgraph, ahead)
    except RleSplatError:
        return False
    wish = store.wish_of(owner, depsgraph, PURPOSE)
    waits = _waits(owner, depsgraph, ahead)
    if owner.rle_splat.frame_count > 1 and is_playing():
        _playing[wish] = Held(owner)
        timer.start(_tick)
        if waits and not volumes.is_at_hand(owner, depsgraph, ahead):
            return True  # frames are read in turn
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


def late(depsgraph) -> int:
    """Frames of the timeline from now to the time of which playback shows volumes: 0 or less.

    That is the last time up to now of which all that it shows is in memory, or cannot be read, which is then said.
    """
    if not is_playing():
        return 0
    scene = depsgraph.scene
    now, owners = scene.frame_current, _followed(scene, True)
    before = now + _late(scene)
    for frame in range(now, before, -1):
        if not any(_waits(one, depsgraph, frame - now) for one in owners):
            before = frame
            break
    _shown[scene.session_uid] = before
    return before - now


def _waits(owner, depsgraph, ahead: int) -> bool:
    """Whether files have to be read for what a volume object shows, and may be there."""
    try:
        return not loading.is_at_hand(owner, depsgraph, ahead=ahead) and (
            loading.key_of(owner, depsgraph, ahead) not in _failed)  # fmt: skip
    except RleSplatError:
        return False


def _late(scene) -> int:
    """Frames of the timeline from now to those that playback showed last: 0 for others, too, as in a new round."""
    frames = _shown.get(scene.session_uid, scene.frame_current) - scene.frame_current
    return frames if -MOST_LATE <= frames <= 0 else 0


def _followed(scene, playing: bool) -> list:
    """The volume objects in time of a scene whose frames are read: those that playback shows, or that are in memory."""
    return [owner for owner in volumes.volume_objects(scene) if owner.rle_splat.frame_count > 1 and (
            store.Wish(owner.session_uid, scene.session_uid, PURPOSE) in _playing if playing
            else volumes.is_at_hand(owner))]  # fmt: skip


@persistent
def consider(_scene=None, depsgraph=None) -> None:
    """Handler: read the frames that follow ahead, of time series that follow the timeline or keyframes."""
    if not bpy.app.background and (depsgraph is None or depsgraph.mode != "RENDER"):
        _ahead[0] = 1
        _looked.clear()
        timer.start(_tick, 0.0 if is_playing() else LOOK_AROUND)


HANDLERS = ("depsgraph_update_post", consider), ("frame_change_post", consider)


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


def is_reading() -> bool:
    """Whether files are being read."""
    return bool(_queue)


def progress() -> Progress | None:
    """How far the reading is that an object waits for; None if there is none."""
    return next((work.progress for work in _queue.values() if work.waiting), None)


def stop() -> None:
    """Drop all work, and what is known of files."""
    for key in list(_queue):
        _drop(key)
    _pictures.clear()
    _failed.clear()
    _playing.clear()
    _shown.clear()
    _ahead[0] = 0
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
    is_asked = playing or any(work.waiting for work in _queue.values())
    may_read = is_asked or (wait > 0.0 and timer.is_quiet(_tick, LOOK_AROUND))
    if may_read and not _queue and (_ahead[0] or playing) and wait > 0.0:
        _queue.update(_next_frame(playing))
    if may_read and _queue:
        _advance(next(iter(_queue)))
    elif wait <= 0.0:
        if next(one.steps, None) is None and _pictures.get(name) is one:
            drop(name)
    if progress() is not None:
        redraw_sidebars(bpy.context)
    if _playing and not playing:
        _end_playback()
    if wait <= 0.0 or (may_read and (_queue or (_ahead[0] and not playing))):
        return timer.AT_ONCE
    wait = min(wait, LOOK_AROUND if _playing or _queue or _ahead[0] else math.inf)
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
    for owner in _drop(key).waiting.values():
        if (found := owner.find()) is not None:
            found.update_tag()


def _end_playback() -> None:
    """Tag the objects that playback showed: what they show now may not have been there in time."""
    for held in _playing.values():
        if (owner := held.find()) is not None:
            owner.update_tag()
    _playing.clear()
    _shown.clear()


def _next_frame(playing: bool = False) -> dict:
    """Key and ReadingWork of the next frame that is not in memory, of MOST_AHEAD that are looked at; else empty."""
    scenes = dict.fromkeys(window.scene for window in bpy.context.window_manager.windows)
    followed = [(scene, owner) for scene in scenes for owner in _followed(scene, playing)]
    first = 1 if playing else _ahead[0] - 1  # what is shown stays, too
    for n in range(first, first + MOST_AHEAD):
        for scene, owner in followed:
            ahead = frames_until(scene, n + (_late(scene) if playing else 0))
            frame = owner.session_uid, shown_frame(owner, ahead=ahead)
            if not playing:
                if frame in _looked:
                    continue
                _looked.add(frame)
            try:
                key = loading.key_of(owner, ahead=ahead)
                if key in _failed or loading.is_ahead(owner, ahead):
                    continue
            except RleSplatError:
                continue  # the frame is missing; it is said when it is shown
            if playing or n <= 1 or store.has_room(owner):
                return {key: ReadingWork(loading.load_ahead_steps(owner, ahead))}
            _ahead[0] = 0
            return {}
    if not playing:
        longest = max((last - min(first, scene.frame_current) for scene, _ in followed
                       for first, last in [round_of(scene)]), default=0)  # fmt: skip
        _ahead[0] = _ahead[0] + MOST_AHEAD if _ahead[0] + MOST_AHEAD <= longest + 2 else 0
    return {}
