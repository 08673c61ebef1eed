"""A mask put into a label map as one of its segments."""

from dataclasses import replace

import numpy as np

from ..scene import RleSplatError
from ..volume.counts import counts_values, list_stored_values
from ..volume.volume import Volume

WIDTHS = (np.uint8, np.int16, np.uint16, np.int32)  # types of label maps, the narrowest first
BACKGROUND = 0
MOST_LABELS = 512  # a file with more different values is a scan, not a label map


def value_steps(labels: Volume):
    """Generator of fractions done: the stored values of a label map, ascending; of one that is none, more than
    MOST_LABELS of them."""
    if counts_values(labels.voxels.dtype):
        return list_stored_values(labels.voxels.dtype)[labels.value_counts > 0]
    found = np.zeros(0, labels.voxels.dtype)
    for z, plane in enumerate(labels.voxels):
        found = np.union1d(found, plane)
        if len(found) > MOST_LABELS:
            break
        yield z / len(labels.voxels)
    return found


def empty_map(volume: Volume) -> Volume:
    """A label map without segments on the grid of a volume."""
    return Volume(
        voxels=np.zeros(volume.voxels.shape, np.uint8), affine=volume.affine, unit=volume.unit, name=volume.name,
        space=volume.space,
    )  # fmt: skip


def free_number(labels: Volume) -> int:
    """The number above all labels of a map."""
    return max(int(labels.voxels.max()), BACKGROUND) + 1


def put_segment(labels: Volume, number: int, mask: np.ndarray, over_others: bool = True) -> Volume:
    """Make the voxels of a mask those of a segment of a new label map, of a wider type if the number needs one.

    Parameters
    ----------
    labels : Volume
        Label map.
    number : int
        The segment's label. Its voxels outside of the mask become background, 0.
    mask : (nz, ny, nx) ndarray of bool
    over_others : bool
        Whether the segment takes the voxels of other segments; otherwise it takes those of the background alone.

    Raises
    ------
    RleSplatError
        If no voxel would be in the segment, or a label is too large.
    """
    taken = mask if over_others else mask & np.isin(labels.voxels, (BACKGROUND, number))
    if not taken.any():
        raise RleSplatError("No voxel would be in the segment; choose another size, value or place.")
    low, high = min(int(labels.voxels.min()), number), max(int(labels.voxels.max()), number)
    fits = [kind for kind in WIDTHS if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max]
    if not fits:
        raise RleSplatError(
            f"The label map has the number {high}; a segment can be added where all are below 2^31 - 1."
        )
    voxels = labels.voxels.astype(fits[0])
    voxels[voxels == number] = BACKGROUND
    voxels[taken] = number
    return replace(labels, voxels=voxels)
