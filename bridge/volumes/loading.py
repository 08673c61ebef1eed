"""What a picture of a volume object needs in memory: its voxels, its labels and its channels."""

from ...rle_splat.runtime.steps import rescale
from ...rle_splat.scene import RleSplatError
from ..data.playback import shown_frame
from ..loop import store
from . import channels, labels, volumes

VOXELS = 0.7  # share of a channel's time until its voxels are read; the rest is for bringing it onto the volume's grid


def key_of(owner, depsgraph=None, ahead: int = 0) -> tuple:
    """What decides which files are read for a volume object; RleSplatError if a file of voxels is missing.

    Parameters
    ----------
    ahead : int
        Frames of the timeline after that time.
    """
    wanted = [owner, *channels.sources_of(owner, depsgraph)]
    keys = tuple(volumes.source_of(one, shown_frame(one, depsgraph, ahead)).key for one in wanted)
    return (*keys, labels.file_of(owner, depsgraph, ahead) if labels.are_used(owner) else None)


def is_at_hand(owner, depsgraph=None, with_labels: bool | None = None, further=(), ahead: int = 0) -> bool:
    """Whether nothing need be read for a picture of a volume object, ``ahead`` frames of the timeline later.

    Labels and channels whose file is missing are not waited for: what needs them fails at once.
    """
    volume = volumes.at_hand(owner, depsgraph, ahead)
    with_labels = labels.are_used(owner) if with_labels is None else with_labels
    if volume is None or (with_labels and not labels.are_at_hand(owner, volume, depsgraph, ahead)):
        return False
    return all(_is_placed(one, volume, depsgraph) for one in (*channels.sources_of(owner, depsgraph), *further))


def _is_placed(source, volume, depsgraph) -> bool:
    """Whether a channel is in memory on the grid of a volume, or its file is missing."""
    try:
        volumes.source_of(source, shown_frame(source, depsgraph))
    except RleSplatError:
        return True
    found = volumes.at_hand(source, depsgraph)
    return found is not None and channels.is_placed(found, volume)


def load_steps(owner, depsgraph=None, with_labels: bool | None = None, further=()):
    """Generator of Progress: load the voxels of a volume object, its labels and its channels; return the Volume.

    The objects are read before the first step, so they may be deleted meanwhile.

    Parameters
    ----------
    with_labels : bool, optional
        Whether to load the labels; without it, if a picture shows them.
    further : sequence of bpy.types.Object
        Volume objects that are about to become channels.

    Raises
    ------
    RleSplatError
        If a file is missing.
    """
    with_labels = labels.are_used(owner) if with_labels is None else with_labels
    file = labels.file_of(owner, depsgraph) if with_labels else None
    sources = [*channels.sources_of(owner, depsgraph), *further]
    return _one_after_another(
        volumes.load_steps(owner, depsgraph), file, store.wish_of(owner, depsgraph, labels.PURPOSE),
        [(volumes.load_steps(one, depsgraph), channels.wish_of(owner, one, depsgraph)) for one in sources],
    )  # fmt: skip


def load_ahead_steps(owner, ahead: int):
    """Generator of Progress: read what a volume object shows some frames later, and its labels if they change."""
    file = labels.file_of(owner, ahead=ahead) if _labels_change(owner) else None
    return _one_after_another(volumes.load_ahead_steps(owner, ahead), file, store.frame_wish(owner, file), [])


def is_ahead(owner, ahead: int) -> bool:
    """Whether what ``load_ahead_steps`` reads is in memory, and stays; RleSplatError if its file is missing."""
    keys = [volumes.source_of(owner, shown_frame(owner, ahead=ahead)).key]
    keys += [labels.file_of(owner, ahead=ahead)] if _labels_change(owner) else []
    return all(store.has_any(store.frame_wish(owner, key)) for key in keys)


def found_ahead(owner, ahead: int) -> tuple | None:
    """The Volume that a volume object shows some frames later, and its label map, None where it is that of all frames;
    None if they are not in memory."""
    volume, label_map = volumes.at_hand(owner, ahead=ahead), None
    if volume is not None and _labels_change(owner):
        found = store.find(labels.file_of(owner, ahead=ahead).key(volume))
        if found is None:
            return None
        label_map = found.volume
    return None if volume is None else (volume, label_map)


def _labels_change(owner) -> bool:
    """Whether each frame of a volume object has labels of its own."""
    return labels.are_used(owner) and owner.rle_splat.label_frames > 1


def withdraw_unused(owner, depsgraph) -> None:
    """Let a volume object no longer want labels and channels that it has no more; hidden channels stay."""
    purposes = {volumes.PURPOSE, *(row.source.session_uid for row in owner.rle_splat.channels if row.source)}
    store.withdraw_others(owner, depsgraph, purposes | ({labels.PURPOSE} if labels.are_used(owner) else set()))


def _one_after_another(steps, file, labels_wish, channel_steps):
    """Generator of Progress, as ``load_steps``; ``file``: LabelFile or None; ``channel_steps``: (steps, Wish)."""
    each = 1.0 / (1 + (file is not None) + len(channel_steps))
    volume = yield from rescale(steps, 0.0, each)
    done = each
    if file is not None:
        yield from rescale(labels.load_steps(labels_wish, file, volume), done, done + each)
        done += each
    for one, wish in channel_steps:
        channel = yield from rescale(one, done, done + VOXELS * each)
        yield from rescale(channels.placed_steps(wish, channel, volume), done + VOXELS * each, done + each)
        done += each
    return volume


def missing_steps(owner, with_labels: bool | None = None, further=()):
    """Generator of Progress, as ``load_steps`` without a depsgraph; None if all is in memory."""
    if is_at_hand(owner, None, with_labels, further):
        return None
    return load_steps(owner, None, with_labels, further)
