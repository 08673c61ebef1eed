"""How far two pictures are apart, in levels: 1/255 of full scale in scene-linear premultiplied values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEVEL = 1.0 / 255.0


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
