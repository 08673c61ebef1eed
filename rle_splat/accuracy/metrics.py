"""How far two pictures are apart: in levels, 1/255 of full scale in scene-linear premultiplied values; and to the
eye, on display-encoded colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEVEL = 1.0 / 255.0
# Errors that pictures are told apart by: field of Difference -> title, all of them in levels.
ERRORS = {"rmse": "RMSE", "largest": "largest error", "p999": "99.9th percentile of the error"}
# Of SSIM, as Wang, Bovik, Sheikh and Simoncelli published it in 2004: a Gaussian window 11 pixels a side, 1.5 wide,
# and constants that keep flat parts of a picture from dividing by zero, for values from 0 to 1.
SSIM_WINDOW, SSIM_WIDTH, SSIM_C1, SSIM_C2 = 11, 1.5, 0.01**2, 0.03**2


@dataclass(frozen=True)
class Difference:
    """``largest``, ``rmse``, ``p999`` (99.9th percentile) and ``bias`` (mean signed) in levels, over all channels
    and pixels; ``psnr`` in dB for a peak of 1, infinite when equal; ``count`` of values compared."""

    largest: float
    rmse: float
    p999: float
    bias: float
    psnr: float
    count: int


def difference(image, reference) -> Difference:
    """Compare arrays of the same shape, every value counted, transparent pixels included."""
    image, reference = np.asarray(image, np.float64), np.asarray(reference, np.float64)
    if image.shape != reference.shape:
        raise ValueError(f"shapes differ: {image.shape} and {reference.shape}")
    error = image - reference
    size, mean_square = np.abs(error), float((error**2).mean())
    return Difference(
        largest=float(size.max()) / LEVEL,
        rmse=float(np.sqrt(mean_square)) / LEVEL,
        p999=float(np.quantile(size, 0.999)) / LEVEL,
        bias=float(error.mean()) / LEVEL,
        psnr=float(-10.0 * np.log10(mean_square)) if mean_square > 0.0 else float("inf"),
        count=error.size,
    )


def display_encoded(rgba, background=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Premultiplied scene-linear (H, W, 4) over a scene-linear background -> (H, W, 3) as sRGB encodes it, 0 to 1."""
    rgba = np.asarray(rgba, dtype=np.float64)
    linear = np.clip(rgba[..., :3] + (1.0 - rgba[..., 3:]) * np.asarray(background), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def ssim(image, reference, background=(0.0, 0.0, 0.0)) -> float:
    """Mean structural similarity of premultiplied scene-linear pictures (H, W, 4) as a display shows them: 1 when
    they are equal.  How different they look is cli/flip.py's to say, by a package that is not shipped."""
    return float(ssim_map(display_encoded(image, background), display_encoded(reference, background)).mean())


def ssim_map(image, reference) -> np.ndarray:
    """Structural similarity (H - 10, W - 10, C) of (H, W, C) pictures of values 0 to 1, wherever the window fits."""
    if min(np.shape(image)[:2]) < SSIM_WINDOW or np.shape(image) != np.shape(reference):
        raise ValueError(f"SSIM needs two pictures of one size, {SSIM_WINDOW} pixels a side or more")
    mean_i, mean_r = _smoothed(image), _smoothed(reference)
    # Subtracting means of like size would lose what flat pictures differ by, so both are centred first.
    centre = reference.mean(axis=(0, 1))
    i, r = image - centre, reference - centre
    off_i, off_r = mean_i - centre, mean_r - centre
    variance_i, variance_r = _smoothed(i * i) - off_i**2, _smoothed(r * r) - off_r**2
    covariance = _smoothed(i * r) - off_i * off_r
    similar = (2.0 * mean_i * mean_r + SSIM_C1) * (2.0 * covariance + SSIM_C2)
    return similar / ((mean_i**2 + mean_r**2 + SSIM_C1) * (variance_i + variance_r + SSIM_C2))


def _smoothed(picture: np.ndarray) -> np.ndarray:
    """Gaussian means over SSIM's window, along both axes in turn."""
    at = np.arange(SSIM_WINDOW) - SSIM_WINDOW // 2
    weights = np.exp(-0.5 * (at / SSIM_WIDTH) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        windows = np.lib.stride_tricks.sliding_window_view(picture, SSIM_WINDOW, axis=axis)
        picture = windows @ weights
    return picture
