"""FLIP, the visible difference when two pictures alternate (Andersson et al. 2020), by NVIDIA's package
flip-evaluator, which is optional."""

from __future__ import annotations

import numpy as np

from rle_splat.accuracy.metrics import display_encoded

try:
    import flip_evaluator
except ImportError:
    flip_evaluator = None

PIXELS_PER_DEGREE = 67.0  # FLIP's default: a display 0.7 m wide with 3840 pixels, seen from 0.7 m


def mean_flip(image, reference, background=(0.0, 0.0, 0.0)) -> float | None:
    """Mean FLIP of two premultiplied scene-linear pictures (height, width, 4) over a background.

    From 0 (equal) to 1; None if flip-evaluator is not installed.
    """
    if flip_evaluator is None:
        return None
    shown, wanted = (np.ascontiguousarray(display_encoded(p, background), np.float32) for p in (image, reference))
    return float(flip_evaluator.evaluate(wanted, shown, "LDR", True, False, True, {"ppd": PIXELS_PER_DEGREE})[1])
