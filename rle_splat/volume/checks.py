"""What a volume must hold for any picture of it to be made."""

from __future__ import annotations

import numpy as np

from ..scene import RleSplatError
from .volume import Volume


def check_values(volume: Volume) -> None:
    """Refuse a volume in which no voxel holds a number: whatever the transfer function, nothing could be seen."""
    if volume.voxels.dtype.kind == "f" and not any(np.isfinite(plane).any() for plane in volume.voxels):
        raise RleSplatError(
            "No voxel of the volume holds a finite number, all are NaN or infinite; check its type and byte order."
        )
