"""Checks of the values of a volume."""

import numpy as np

from ..scene import RleSplatError
from .volume import Volume


def check_values(volume: Volume) -> None:
    """Raise a RleSplatError if no voxel of ``volume`` holds a finite number, since nothing could be visible."""
    if volume.voxels.dtype.kind == "f" and not any(np.isfinite(plane).any() for plane in volume.voxels):
        raise RleSplatError(
            "No voxel of the volume holds a finite number (all are NaN or infinite); check its type and byte order."
        )
