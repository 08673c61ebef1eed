"""The picture shown for a frame that could not be rendered: stripes that cannot be mistaken for a result."""

from __future__ import annotations

import numpy as np

STRIPES = np.array(((1.0, 0.0, 0.6, 1.0), (0.02, 0.02, 0.02, 1.0)), dtype=np.float32)  # scene-linear, opaque
ACROSS = 32  # approximate number of stripes along the longer side


def placeholder(width: int, height: int) -> np.ndarray:
    """Opaque diagonal stripes of magenta and near-black.

    Parameters
    ----------
    width, height : int
        Size in pixels.

    Returns
    -------
    ndarray, shape (height, width, 4), float32
        Premultiplied scene-linear colors.
    """
    thickness = max(1, max(width, height) // ACROSS)
    rows, columns = np.ogrid[:height, :width]
    return STRIPES[(rows + columns) // thickness % 2]
