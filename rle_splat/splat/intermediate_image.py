"""The intermediate image: what the sheets add up to on the base plane, before the warp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..view.base_plane import BasePlane


@dataclass(frozen=True, eq=False)
class IntermediateImage:
    """``pixels``: (H, W, 4) float32, premultiplied scene-linear colour and *transmittance*.

    ``half_depth``: (H, W) float32, position along the viewing direction of the principal axis (``sign *
    position``, voxels) at which the transmittance falls below one half; inf where it does not.
    """

    base_plane: BasePlane
    pixels: np.ndarray
    half_depth: np.ndarray
