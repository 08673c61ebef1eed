"""Pictures for display: scene-linear, premultiplied floats as sRGB bytes."""

import numpy as np

from .color import to_display

ROWS = 32  # encoded together


def encode_srgb(linear) -> np.ndarray:
    """sRGB-encode scene-linear values.

    Parameters
    ----------
    linear : array_like
        Scene-linear values; they are clamped to [0, 1].

    Returns
    -------
    ndarray, float32
        Encoded values in [0, 1], of the same shape.
    """
    return to_display(np.asarray(linear, dtype=np.float32))


def over_background(rgba, background) -> np.ndarray:
    """(H, W, 3) float32 scene-linear: the premultiplied picture over one background color."""
    return rgba[..., :3] + (1.0 - rgba[..., 3:4]) * np.asarray(background, dtype=np.float32)


def straight_alpha(rgba) -> np.ndarray:
    """(H, W, 4) float32: colors divided by alpha, as PNG wants them; black where alpha is zero."""
    alpha = rgba[..., 3:4]
    color = np.divide(rgba[..., :3], alpha, out=np.zeros_like(rgba[..., :3]), where=alpha > 0.0)
    return np.concatenate((color, alpha), axis=-1)


def to_bytes(rgba, background=None) -> np.ndarray:
    """(H, W, 3) uint8 sRGB over ``background``, or without one (H, W, 4) with straight linear alpha."""
    # In bands of rows, whose intermediate arrays fit into the processor's cache (measured: half the time).
    return np.concatenate([to_levels(rgba[top : top + ROWS], background) for top in range(0, len(rgba), ROWS)])


def to_levels(rgba, background=None, dtype=np.uint8) -> np.ndarray:
    """As ``to_bytes``, for few rows at a time, in levels of any unsigned type: (H, W, 3) or (H, W, 4)."""
    if background is not None:
        encoded = encode_srgb(over_background(rgba, background))
    else:
        straight = straight_alpha(rgba)
        encoded = np.concatenate((encode_srgb(straight[..., :3]), np.clip(straight[..., 3:], 0.0, 1.0)), axis=-1)
    return np.rint(encoded * np.float32(np.iinfo(dtype).max)).astype(dtype)
