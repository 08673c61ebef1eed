"""FLIP, how different two pictures look when one is flicked over the other (Andersson and others 2020), by NVIDIA's
own package flip-evaluator: never part of the extension, and used where somebody installed it."""

from __future__ import annotations

import numpy as np

from ..accuracy.metrics import display_encoded

try:
    import flip_evaluator
except ImportError:
    flip_evaluator = None

PIXELS_PER_DEGREE = 67.0  # FLIP's own: a display 0.7 m wide of 3840 pixels, seen from 0.7 m


def mean_flip(image, reference, background=(0.0, 0.0, 0.0)) -> float | None:
    """Mean FLIP of premultiplied scene-linear pictures (H, W, 4) as a display shows them: 0 when they are equal, 1 at
    most; None where the package is not installed."""
    if flip_evaluator is None:
        return None
    shown, wanted = (np.ascontiguousarray(display_encoded(p, background), np.float32) for p in (image, reference))
    return float(flip_evaluator.evaluate(wanted, shown, "LDR", True, False, True, {"ppd": PIXELS_PER_DEGREE})[1])
