"""A picture of the histogram in the colors of the transfer function, to be laid over the opacity curve."""

import numpy as np

WIDTH = 320  # pixels of a square icon, about those that a sidebar gives it
EDGE = 3.0 / 240.0  # share of the panel's width that Blender leaves free on either side of an icon
BAR = np.array((0.62, 0.62, 0.65))  # gray where nothing is shown
ALPHA = 0.45  # of a bar, through which the curve and its points are seen


def draw(stored, transfer_function, low: float, high: float, height: int) -> np.ndarray:
    """Draw the histogram; the bars are logarithmic and tinted by the transfer function's colors where it is opaque.

    Parameters
    ----------
    stored : StoredHistogram or None
        The histogram.
    transfer_function : TransferFunction
        Colors and opacities.
    low, high : float
        The window: physical values at the left and the right edge of the curve.
    height : int
        Rows of pixels that are as high as the curve, at most WIDTH.

    Returns
    -------
    ndarray, shape (WIDTH, WIDTH, 4), float32
        Display-encoded RGBA, multiplied by alpha, row 0 at the bottom as in Blender's images.  Blender's icons are
        squares: rows below the ``height`` upper ones are transparent.
    """
    low, high = low + EDGE * (high - low), high - EDGE * (high - low)  # what lies between the free edges
    values = low + (np.arange(WIDTH) + 0.5) / WIDTH * (high - low)
    table = transfer_function.table(values)
    weight = np.sqrt(table[:, 3:])  # a faint opacity still tints its bar
    rows = (np.arange(height) + 0.5) / height
    bars = np.ones((WIDTH, 4))
    bars[:, :3] = BAR * (1.0 - weight) + _display(np.clip(table[:, :3], 0.0, 1.0)) * weight
    picture = np.zeros((WIDTH, WIDTH, 4), np.float32)
    picture[WIDTH - height :] = ALPHA * (rows[:, None] < _bar_heights(stored, low, high))[..., None] * bars
    return picture


def _bar_heights(stored, low: float, high: float) -> np.ndarray:
    """(WIDTH,) float64 in [0, 1]: logarithm of the counts in each column, scaled to a maximum of 0.95."""
    if stored is None or not stored.counts.any():
        return np.zeros(WIDTH)
    edges = np.linspace(stored.low, stored.high, stored.counts.size + 1)
    running = np.concatenate(((0,), np.cumsum(stored.counts)))
    at = np.interp(np.linspace(low, high, WIDTH + 1), edges, running)
    heights = np.log1p(np.diff(at))
    return 0.95 * heights / heights.max() if heights.max() > 0.0 else heights


def _display(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
