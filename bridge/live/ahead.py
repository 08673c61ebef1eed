"""Drafts of the frames to come, of time series: made while nothing else is done, for what is kept of them.

New voxels need their normals and a new label map its boundaries, for a draft of which a frame of playback is too short.
So each viewport makes drafts of the frames that were read ahead once its own view is refined, and shows none of them.
"""

from dataclasses import replace
from functools import partial

from ...rle_splat.scene import RleSplatError
from ..data.playback import frames_until, is_playing, round_of
from ..loop import timer
from ..scene.render_scene import KEPT
from ..volumes import labels, loading, volumes
from . import shown

LOOK = 0.5  # seconds in which nothing else is due; more than the pause of ``loop.work``, which waits for others, too


class _Work:
    """The steps that go on and what they were begun for, and the pictures of viewports beside which all is done."""

    steps, begun, done = None, None, None


def work(function, views: list) -> float | None:
    """Do one step for viewports that are idle; seconds until the next one, None for none.

    Parameters
    ----------
    function : callable
        The timer function that calls this.
    views : list of (Viewport, bpy.types.Object, bpy.types.Depsgraph)
        Viewports, each with a volume that it shows.
    """
    pictures = [(id(viewport), viewport.version) for viewport, *_ in views]
    if not views or is_playing() or pictures == _Work.done:
        return None
    if timer.must_wait():
        return timer.BUSY
    if not timer.is_quiet(function, LOOK):
        return LOOK
    if _Work.begun != (shown.stamp(), pictures):  # objects may be gone since then
        _Work.steps, _Work.begun = _draft_steps(views), (shown.stamp(), pictures)
    try:
        next(_Work.steps)
        return timer.AT_ONCE
    except (StopIteration, RleSplatError):  # what is wrong with a frame is said when it is shown
        pass
    _Work.done, _Work.begun, _Work.steps = pictures, None, None
    return None


def stop() -> None:
    """Drop the work, before another file is opened."""
    _Work.done = _Work.begun = _Work.steps = None


def _draft_steps(views: list):
    """Generator: make drafts of the frames in memory, in the order of playback, while there is room to keep them."""
    for viewport, owner, depsgraph in views:
        volume, scene = volumes.at_hand(owner, depsgraph), depsgraph.scene
        first, last = round_of(scene)
        known = set()
        for n in range(last - first + 1):
            yield
            if len(known) == owner.rle_splat.frame_count:
                break
            found = loading.found_ahead(owner, frames_until(scene, n))
            if found is None or found[0] in known:
                continue
            before, at_frame = KEPT.nbytes, partial(_at_frame, owner, depsgraph, *found)
            yield from viewport.prepare_steps(volume, at_frame, is_first=not known)
            known.add(found[0])
            if 2 * KEPT.nbytes - before > KEPT.most_bytes:
                return


def _at_frame(owner, depsgraph, volume, label_map, plain):
    """The scene of another frame of a volume: its Volume and its label map, None for that of all frames."""
    if plain.labels is None:
        return replace(plain, volume=volume)
    own = plain.labels.volume if label_map is None else label_map
    return replace(plain, volume=volume, labels=labels.shown_as(owner, depsgraph, own, volume, plain.transfer_function))
