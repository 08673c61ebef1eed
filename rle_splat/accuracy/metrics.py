"""Differences of two pictures: in levels, 1/255 of scene-linear premultiplied values, and SSIM on display-encoded
color."""

from dataclasses import dataclass

import numpy as np

LEVEL = 1.0 / 255.0
# Field of Difference -> title of the error, in levels.
ERRORS = {"rmse": "RMSE", "largest": "largest error", "p999": "99.9th percentile of the error"}
# SSIM as in Wang, Bovik, Sheikh and Simoncelli 2004: a Gaussian window of 11 x 11 pixels with a standard deviation of
# 1.5, and the constants against division by zero in flat parts, for values from 0 to 1.
SSIM_WINDOW, SSIM_WIDTH, SSIM_C1, SSIM_C2 = 11, 1.5, 0.01**2, 0.03**2


@dataclass(frozen=True)
class Difference:
    """The difference of two arrays, over all values.

    Attributes
    ----------
    largest, rmse, p999, bias : float
        Levels: the largest absolute difference, the root mean square, the 99.9th percentile of the absolute
        difference, the mean signed difference.
    psnr : float
        dB, for a peak of 1; infinite for equal arrays.
    count : int
        Values compared.
    """

    largest: float
    rmse: float
    p999: float
    bias: float
    psnr: float
    count: int


def difference(image, reference) -> Difference:
    """Compare two arrays of the same shape; transparent pixels count too.  Raises ValueError for unequal shapes."""
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
    """Encode premultiplied scene-linear RGBA (H, W, 4) over a scene-linear background as sRGB (H, W, 3), 0 to 1."""
    rgba = np.asarray(rgba, dtype=np.float64)
    linear = np.clip(rgba[..., :3] + (1.0 - rgba[..., 3:]) * np.asarray(background), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def ssim(image, reference) -> float:
    """Mean structural similarity of two premultiplied scene-linear pictures (H, W, 4), as shown over black."""
    return float(ssim_map(display_encoded(image), display_encoded(reference)).mean())


def ssim_map(image, reference) -> np.ndarray:
    """Structural similarity (H - 10, W - 10, C) of two (H, W, C) pictures of values 0 to 1, where the window fits."""
    if min(np.shape(image)[:2]) < SSIM_WINDOW or np.shape(image) != np.shape(reference):
        raise ValueError(f"SSIM needs two pictures of one size, {SSIM_WINDOW} pixels a side or more")
    mean_i, mean_r = _smooth(image), _smooth(reference)
    # Both are centered first: subtracting two means of like size would cancel the small variance of flat pictures.
    center = reference.mean(axis=(0, 1))
    i, r = image - center, reference - center
    off_i, off_r = mean_i - center, mean_r - center
    variance_i, variance_r = _smooth(i * i) - off_i**2, _smooth(r * r) - off_r**2
    covariance = _smooth(i * r) - off_i * off_r
    similar = (2.0 * mean_i * mean_r + SSIM_C1) * (2.0 * covariance + SSIM_C2)
    return similar / ((mean_i**2 + mean_r**2 + SSIM_C1) * (variance_i + variance_r + SSIM_C2))


def _smooth(picture: np.ndarray) -> np.ndarray:
    """Gaussian means over the window of SSIM, along both axes in turn."""
    at = np.arange(SSIM_WINDOW) - SSIM_WINDOW // 2
    weights = np.exp(-0.5 * (at / SSIM_WIDTH) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        windows = np.lib.stride_tricks.sliding_window_view(picture, SSIM_WINDOW, axis=axis)
        picture = windows @ weights
    return picture
