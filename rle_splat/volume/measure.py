"""Measuring a volume in steps: what its keys, its histogram and its range need of every voxel."""

from ..runtime.steps import announce
from .counts import count_steps, counts_values
from .volume import Volume, key_steps, range_steps


def measure_steps(volume: Volume):
    """Generator of Progress: compute the properties of a volume that read all its voxels, and keep them in it.

    Afterward ``voxel_key``, ``value_range`` and, for 8 and 16 bits, ``value_counts`` take no time.
    """
    counted = counts_values(volume.voxels.dtype)
    works = {
        "voxel_key": key_steps(volume),
        "value_counts" if counted else "value_range": count_steps(volume.voxels) if counted else range_steps(volume),
    }
    for i, (name, steps) in enumerate(works.items()):
        if name not in volume.measured:
            steps = announce(steps, i / len(works), (i + 1) / len(works), "measuring the values")
            volume.measured[name] = yield from steps
