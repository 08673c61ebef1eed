"""A small picture of the histogram with the opacity curve and the colors of the transfer function."""

import numpy as np

TILES = 3  # squares side by side, because Blender draws icons as squares and a histogram is wide
TILE, GAP = 96, 5  # pixels: a tile with the border that Blender leaves around an icon, and that border
WIDTH, HEIGHT = TILES * TILE, TILE - 2 * GAP
GROUND = np.array((0.10, 0.10, 0.11))
BAR = np.array((0.36, 0.36, 0.38))
CURVE = np.array((1.0, 1.0, 1.0))
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
        The window: physical values at the left and the right edge.

    Returns
    -------
    ndarray, shape (HEIGHT, WIDTH, 4), float32
        Display-encoded RGBA, row 0 at the bottom as in Blender's images.
    """
    values = low + (np.arange(WIDTH) + 0.5) / WIDTH * (high - low)
    table = transfer_function.table(values)
    colors, alphas = _display(np.clip(table[:, :3], 0.0, 1.0)), table[:, 3]
    picture = np.empty((HEIGHT, WIDTH, 4), dtype=np.float32)
    picture[..., :3] = GROUND
    picture[..., 3] = 1.0
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


def tiles_of(picture: np.ndarray) -> list[np.ndarray]:
    """Cut a picture into the squares that Blender shows side by side.

    The columns under the icons' borders are left out, so that values line up with the curve below.

    Parameters
    ----------
    picture : ndarray, shape (HEIGHT, WIDTH, 4)
        The result of ``draw``.

    Returns
    -------
    list of ndarray
        TILES arrays of HEIGHT by HEIGHT pixels.
    """
    return [
        np.ascontiguousarray(picture[:, i * TILE + GAP : (i + 1) * TILE - GAP]) for i in range(TILES)
    ]


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
