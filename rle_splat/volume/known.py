"""What every use of a volume needs to know of its voxels, worked out in steps, so that it can be canceled."""

from __future__ import annotations

from ..runtime.steps import portion
from .counts import count_steps, counts_values
from .volume import Volume, hash_steps

DOING = "looking at the values"


def known_steps(volume: Volume):
    """Generator of Progress: the hash of the voxels and, for 8 and 16 bits, their counts, kept on the volume.

    Returns
    -------
    Volume
        The same volume, whose ``voxel_key`` and ``value_counts`` take no more time.
    """
    found = {"voxel_key": (yield from portion(hash_steps(volume.voxels), 0.0, 0.5, DOING))}
    if counts_values(volume.voxels.dtype):
        found["value_counts"] = yield from portion(count_steps(volume.voxels), 0.5, 1.0, DOING)
    vars(volume).update(found)  # where cached properties keep their values
    return volume
