"""Keeps the pictures of slices up to date: after edits, frame changes, undo and loading, and before rendered frames.

In a window a large slice is made with fewer pixels while it is dragged, and in full by a timer once it is still.

Undo restores a slice's place but not its pixels, and an image that undo has removed comes back without them.  So what
each image shows is recorded outside Blender's data, and the record is dropped after undo.  Images are saved as other
pictures are, see ``picture_files.py``.
"""

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.runtime.steps import drain
from .. import messages
from ..held import Held
from ..loop import store, timer, work
from ..pictures import images
from . import cut_slices, slices

SIZE = 64  # pixels along a side of a placeholder
MOST_OF_DRAFT = 1 << 15  # pixels of a slice while it is dragged: 8 ms, where 512 x 512 take 28 to 54
STILL = 0.15  # seconds without a change until a slice is made in full

_shown: dict = {}  # session id of an image -> what it shows
_drafts: dict = {}  # session id of an image -> Held slice that it shows with fewer pixels
_problems: dict = {}  # session id of a slice -> sentence
_updating: list = []  # not empty while images are written, whose own updates must not start another round


@persistent
def _on_update(scene=None, depsgraph=None):
    if scene is not None and depsgraph is not None and depsgraph.mode != "RENDER":
        update(scene, depsgraph, may_wait=not bpy.app.background)


@persistent
def _on_frame_change_post(scene=None, depsgraph=None):
    """Handler: also before each rendered frame, on the render thread, when voxels are read at once."""
    if scene is not None and depsgraph is not None:
        update(scene, depsgraph, may_wait=not bpy.app.background and depsgraph.mode != "RENDER")


@persistent
def _on_other_data(*_arguments):
    """Handler: after undo or loading, when images may have lost their pixels."""
    forget()
    if not bpy.app.background:
        timer.start(_tick)
    elif bpy.context.scene is not None:
        update(bpy.context.scene, bpy.context.evaluated_depsgraph_get(), may_wait=False)


HANDLERS = (
    ("depsgraph_update_post", _on_update),
    ("frame_change_post", _on_frame_change_post),
    ("undo_post", _on_other_data),
    ("redo_post", _on_other_data),
    ("load_post", _on_other_data),
)


def _tick() -> None:
    """Timer function: update the scenes of all windows once."""
    if bpy.app.is_job_running("RENDER"):
        return
    for window in bpy.context.window_manager.windows:
        if window.view_layer.depsgraph is not None:
            update(window.scene, window.view_layer.depsgraph, may_wait=True)


def forget() -> None:
    """Drop all records."""
    for held in (_shown, _drafts, _problems):
        held.clear()
    work.drop(work.SLICES)


def stop() -> None:
    """Drop all records and what is to be done."""
    forget()
    timer.stop(_tick)


def problem_of(one) -> str:
    """Why a slice shows stripes instead of its volume; "" if it does not."""
    return _problems.get(one.session_uid, "")


def update(scene, depsgraph, may_wait: bool) -> None:
    """Make the pictures of a scene's slices that have changed.

    Parameters
    ----------
    may_wait : bool
        Whether voxels that are not in memory are read in steps, after which this is called again, and large slices are
        made with fewer pixels first.
    """
    found = [] if _updating else slices.slice_objects(scene)
    if not found:
        return
    is_render = depsgraph.mode == "RENDER"
    _updating.append(scene)
    try:
        if not is_render:  # a handler of a render must create no datablock
            slices.settle_copies({one for each in bpy.data.scenes for one in slices.slice_objects(each)})
            cut_slices.settle(scene)
        late = work.late(depsgraph) if may_wait else 0
        for one in found:
            hidden = one.hide_render if is_render else not one.visible_get(view_layer=depsgraph.view_layer)
            owner = slices.volume_of(one)
            if one.rle_splat.slice_image is None or hidden or cut_slices.is_lost(one):
                continue
            if may_wait and owner is not None and work.want(owner, depsgraph, late):
                continue
            changed = _update(scene, one, depsgraph, MOST_OF_DRAFT if may_wait else None, late)
            if changed and not is_render:
                one.rle_splat.slice_image.update_tag()
    finally:
        _updating.clear()


def _update(scene, one, depsgraph, most: int | None, late: int) -> bool:
    """Make the picture of one slice if it has changed, of at most so many pixels; on failure stripes and a message.

    Return whether there are other pixels now.
    """
    uid = one.rle_splat.slice_image.session_uid
    try:
        volume, matrix, look = slices.content(one, depsgraph, late)
        full, size = (slices.size_of(volume, matrix, look, limit) for limit in (None, most))
        shows = volume.key, matrix.tobytes(), look.key
        if _shown.get(uid) == shows and (uid not in _drafts or size != full):
            return False
        work.drop(work.SLICES)
        drain(_picture_steps(one, depsgraph, size, volume, matrix, look))
        _drafts.pop(uid, None)
        if size != full:
            _drafts[uid] = Held(one)
        if scene.rle_splat.message == _problems.pop(one.session_uid, None):
            scene.rle_splat.message = ""
    except Exception as problem:  # handlers run often: one sentence instead of many tracebacks
        shows = sentence = messages.sentence_of(problem)
        if _shown.get(uid) == shows:
            return False
        _drafts.pop(uid, None)
        slices.show(one, images.placeholder(SIZE, SIZE))
        _problems[one.session_uid] = sentence
        messages.complain(scene.rle_splat, sentence)
    _shown[uid] = shows
    if _drafts:
        work.begin(work.SLICES, None, _refine_steps(), STILL)
    return True


def _picture_steps(one, depsgraph, size, volume, matrix, look):
    """Generator: make and show the picture of one slice.

    Its values stay in memory, since windows change more often than places.
    """
    is_full = size == slices.size_of(volume, matrix, look)
    key = "slice", volume.key, matrix.tobytes(), size, look.face is None
    found = store.find(key)
    if found is None:
        found = yield from slices.sampled_steps(volume, matrix, look, size)
    store.put(store.wish_of(one, depsgraph, ("slice", is_full)), key, found)
    sampled, around = found
    share = slices.share_of(sampled, around, look)
    slices.show(one, (yield from slices.picture_steps(sampled.values, share, look)))
    wish = store.wish_of(one, depsgraph, "opaque")
    if slices.is_whole(look):
        store.withdraw([wish])
    else:
        store.put(wish, slices.opaque_key(volume, matrix, look), slices.opaque_part(sampled.values, share, look))


def _refine_steps():
    """Generator: make slices in full that are shown with fewer pixels."""
    try:
        while _drafts:
            yield from _full_steps(*next(iter(_drafts.items())))
    except Exception as problem:  # the draft stays; the next edit tells what is wrong with the slice
        _drafts.clear()
        messages.tell(messages.sentence_of(problem))


def _full_steps(uid, held: Held):
    """Generator: make one slice in full; without it or its volume in any window the draft is forgotten."""
    one = held.find()
    for window in bpy.context.window_manager.windows:
        depsgraph = window.view_layer.depsgraph
        if one is not None and depsgraph is not None and one.name in window.view_layer.objects:
            volume, matrix, seen = slices.content(one, depsgraph, work.late(depsgraph))
            if _shown.get(uid) == (volume.key, matrix.tobytes(), seen.key):
                yield from _picture_steps(one, depsgraph, slices.size_of(volume, matrix, seen), volume, matrix, seen)
                one.rle_splat.slice_image.update_tag()
            break
    _drafts.pop(uid, None)
