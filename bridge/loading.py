"""What a picture of a volume object needs in memory: its voxels, its labels and its channels."""

from __future__ import annotations

from ..rle_splat.runtime.steps import part
from . import labels, volumes
from .playback import shown_frame

VOXELS = 0.7  # share of the time until the voxels are read; the rest is for the labels


def key_of(owner, depsgraph=None, ahead: int = 0) -> tuple:
    """What decides which files are read for a volume object; RleSplatError if its file is missing.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    depsgraph : bpy.types.Depsgraph, optional
        Gives the time.
    ahead : int
        Frames of the timeline after that time.

    Returns
    -------
    tuple
    """
    file = labels.file_of(owner) if labels.are_used(owner) else None
    return (*volumes.source_of(owner, shown_frame(owner, depsgraph, ahead)).key, file and file.path)


def is_at_hand(owner, depsgraph=None) -> bool:
    """Whether nothing need be read for a picture of a volume object but its channels.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    depsgraph : bpy.types.Depsgraph, optional
        Gives the time.

    Returns
    -------
    bool
        Labels whose file is missing are not waited for: whoever needs them is told at once.
    """
    volume = volumes.at_hand(owner, depsgraph)
    return volume is not None and (not labels.are_used(owner) or labels.are_at_hand(owner, volume))


def load_steps(owner, depsgraph=None, with_labels: bool | None = None):
    """Generator of Progress: load the voxels of a volume object, and its labels; return the Volume.

    The object is read before the first step, so it may be deleted meanwhile.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    depsgraph : bpy.types.Depsgraph, optional
        Gives the time.
    with_labels : bool, optional
        Whether to load the labels; without it, if a picture shows them.
    """
    with_labels = labels.are_used(owner) if with_labels is None else with_labels
    return _both_steps(volumes.load_steps(owner, depsgraph), labels.file_of(owner) if with_labels else None)


def _both_steps(steps, file):
    volume = yield from part(steps, 0.0, VOXELS)
    if file is not None:
        yield from part(labels.load_steps(file, volume), VOXELS, 1.0)
    return volume


def missing_steps(owner, with_labels: bool | None = None):
    """Generator of Progress: load what a picture of a volume object needs and is not in memory; None if all is there.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object. Its channels are loaded too.
    with_labels : bool, optional
        As for ``load_steps``.

    Raises
    ------
    RleSplatError
        If a file is missing.
    """
    rows = owner.rle_splat.channels
    sources = [row.source for row in rows if row.show and row.source is not None]
    works = [volumes.load_steps(one) for one in sources if not volumes.is_at_hand(one)]
    with_labels = labels.are_used(owner) if with_labels is None else with_labels
    volume = volumes.at_hand(owner)
    if volume is None or (with_labels and not labels.are_at_hand(owner, volume)):
        works.insert(0, load_steps(owner, with_labels=with_labels))
    return _one_after_another(works) if works else None


def _one_after_another(works: list):
    for i, steps in enumerate(works):
        yield from part(steps, i / len(works), (i + 1) / len(works))
