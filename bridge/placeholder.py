"""The picture of a frame that could not be drawn: stripes that nobody takes for a result."""

from __future__ import annotations

import numpy as np

STRIPES = np.array(((1.0, 0.0, 0.6, 1.0), (0.02, 0.02, 0.02, 1.0)), dtype=np.float32)  # scene-linear, opaque
ACROSS = 32  # stripes along the longer side, about


def placeholder(width: int, height: int) -> np.ndarray:
    """(H, W, 4) float32, premultiplied scene-linear: opaque diagonal stripes of magenta and near-black."""
    thickness = max(1, max(width, height) // ACROSS)
    rows, columns = np.ogrid[:height, :width]
    return STRIPES[(rows + columns) // thickness % 2]
