"""A small picture of the histogram with the opacity curve and the colors of the transfer function."""

import numpy as np

WIDTH = 320  # pixels of a square icon, about those that a sidebar gives it
ASPECT = 3.2  # width of the picture over its height
HEIGHT = round(WIDTH / ASPECT)
EDGE = 3.0 / 240.0  # share of the panel's width that Blender leaves free on either side of an icon
GROUND = np.array((0.10, 0.10, 0.11))
BAR = np.array((0.36, 0.36, 0.38))
CURVE = np.array((1.0, 1.0, 1.0))
TICK = np.array((0.22, 0.22, 0.24))
TICKS = (0.25, 0.5, 0.75)  # shares of the range, at lines of Blender's own grid behind the curve
RAMP_ROWS = 8  # pixels at the bottom that show only the colors


def draw(stored, transfer_function, low: float, high: float) -> np.ndarray:
    """Draw the histogram; the bars are logarithmic and tinted by the transfer function's colors where it is opaque.

    Parameters
    ----------
    stored : StoredHistogram or None
        The histogram.
    transfer_function : TransferFunction
        Colors and opacities.
    low, high : float
        The window: physical values at the left and the right edge of the curve below.

    Returns
    -------
    ndarray, shape (HEIGHT, WIDTH, 4), float32
        Display-encoded RGBA, row 0 at the bottom as in Blender's images.
    """
    low, high = low + EDGE * (high - low), high - EDGE * (high - low)  # what lies between the free edges
    values = low + (np.arange(WIDTH) + 0.5) / WIDTH * (high - low)
    table = transfer_function.table(values)
    colors, alphas = _display(np.clip(table[:, :3], 0.0, 1.0)), table[:, 3]
    picture = np.empty((HEIGHT, WIDTH, 4), dtype=np.float32)
    picture[..., :3] = GROUND
    picture[..., 3] = 1.0
    columns = (np.array(TICKS) - EDGE) / (1.0 - 2.0 * EDGE) * WIDTH
    picture[:, columns.astype(int), :3] = TICK
    rows = (np.arange(HEIGHT) + 0.5 - RAMP_ROWS) / (HEIGHT - RAMP_ROWS)
    bars = rows[:, None] < _bar_heights(stored, low, high)[None, :]
    weight = np.sqrt(alphas)[:, None]  # a faint opacity still tints its bar
    tinted = BAR * (1.0 - weight) + colors * weight
    picture[..., :3] = np.where(bars[..., None], tinted[None], picture[..., :3])
    line = (alphas * (HEIGHT - RAMP_ROWS - 1)).round().astype(int) + RAMP_ROWS
    before = np.concatenate((line[:1], line[:-1]))
    indices = np.arange(HEIGHT)[:, None]
    picture[(indices >= np.minimum(line, before)) & (indices <= np.maximum(line, before)), :3] = CURVE
    picture[:RAMP_ROWS, :, :3] = colors[None]
    return picture


def as_icon(picture: np.ndarray) -> np.ndarray:
    """A picture at the top of a square, which is transparent below, because Blender's icons are squares.

    Parameters
    ----------
    picture : ndarray, shape (HEIGHT, WIDTH, 4)
        The result of ``draw``.

    Returns
    -------
    ndarray, shape (WIDTH, WIDTH, 4), float32
    """
    square = np.zeros((WIDTH, WIDTH, 4), np.float32)
    square[-HEIGHT:] = picture
    return square


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
