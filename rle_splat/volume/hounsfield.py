"""Whether values are Hounsfield units, by the peaks of air or lungs, and of water, in their histogram."""

import numpy as np

from .volume import Volume

SAMPLES = 1 << 20  # voxels that are looked at
AIR = (-1030.0, -700.0)  # HU; scanners round, and pad with -1024; a scan cut off within a chest has lungs alone
SOFT = (-150.0, 150.0)  # fat, water, muscle
BETWEEN = (-650.0, -250.0)  # nothing in a body or around it has these values, but for borders
LEAST_SHARE = 0.03  # of the voxels, in each of the two peaks
VALLEY = 0.5  # voxels for each HU in between, relative to the smaller peak: at most this
HIGHEST = 32767.0  # HU; with metal, scanners store up to this


def looks_like_hounsfield(volume: Volume) -> bool:
    """Whether the histogram of a volume has the peaks of air or lungs and of water (0), and a valley in between.

    Parameters
    ----------
    volume : Volume
        Volumes of 8 bits cannot hold Hounsfield units and never qualify.
    """
    if volume.voxels.dtype.itemsize < 2:
        return False
    values = _sample(volume)
    if values.size == 0 or values.min() > AIR[1] or not SOFT[1] < values.max() <= HIGHEST:
        return False

    def density(low, high):
        return float(np.mean((values >= low) & (values <= high))) / (high - low)

    peaks = [(density(*AIR), AIR), (density(*SOFT), SOFT)]
    if any(found * (high - low) < LEAST_SHARE for found, (low, high) in peaks):
        return False
    return density(*BETWEEN) <= VALLEY * min(found for found, _ in peaks)


def _sample(volume: Volume) -> np.ndarray:
    """Finite physical values of evenly spread voxels, float64."""
    voxels = volume.voxels
    step = max(1, int(np.ceil((voxels.size / SAMPLES) ** (1.0 / 3.0))))
    with np.errstate(over="ignore", invalid="ignore"):  # absurd slopes; what overflows is left out
        values = volume.physical(voxels[::step, ::step, ::step].ravel())
    return values[np.isfinite(values)]
