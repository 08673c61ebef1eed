"""What decides which part of a slice on a cut is shown, as plain data."""

import numpy as np

from ...rle_splat.classify.points import pieces, positive_intervals
from ...rle_splat.effects.clips import half_spaces
from ...rle_splat.segment.cut_faces import CutFace
from ..look import transfer
from ..volumes import labels
from . import clip_objects


def read_face(cut, owner, volume, depsgraph, frame: np.ndarray, ahead: int) -> CutFace:
    """What decides which part of a slice is shown.

    Parameters
    ----------
    cut : bpy.types.Object
        The cutting object that the slice is on.
    owner : bpy.types.Object
        The volume object.
    frame : (4, 4) ndarray of float64
        Voxel indices to the world.
    ahead : int
        Frames of the timeline after the depsgraph's time.

    Raises
    ------
    RleSplatError
        If the volume has no usable transfer function, its label file is missing, or a cutting object is of no use.
    """
    cutting = clip_objects.read_cutting(depsgraph, owner)
    if cut not in [other for other, _ in cutting]:
        return CutFace(())
    function = transfer.read_transfer(owner, depsgraph)
    cuts = (_ends_of(volume), *(
        (clip.kind == "box" and clip.keep == "outside", tuple(map(tuple, half_spaces(clip, frame).tolist())))
        for other, clip in cutting if other != cut))  # fmt: skip
    found = labels.read_labels(owner, depsgraph, volume, function, ahead)
    if found is None:
        return CutFace(_shown(function), cuts)
    shown_of = {}
    for number, of in found.functions.items():
        shown_of.setdefault(() if of is None else _shown(of), []).append(number)
    key = labels.file_of(owner, depsgraph, ahead).key(volume)
    return CutFace(
        _shown(function), cuts, tuple((shown, tuple(of)) for shown, of in shown_of.items()), key, found.volume.voxels
    )


def _ends_of(volume) -> tuple:
    """The box of voxel centers, as one of the cuts of a CutFace: pictures end there, slices half a voxel beyond."""
    ends = zip(np.eye(3).tolist(), volume.shape_xyz)
    return False, tuple(side for axis, count in ends for side in ((*axis, 1.0 - count), (*(-one for one in axis), 0.0)))


def _shown(function) -> tuple:
    """The intervals of values that a transfer function shows."""
    return tuple(map(tuple, positive_intervals(pieces(function.opacity)).tolist()))
