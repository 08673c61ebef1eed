"""FLIP, how different two pictures look when one is flicked over the other (Andersson and others 2020), by NVIDIA's
own package flip-evaluator, which the benchmarks' environment alone holds."""

from __future__ import annotations

import numpy as np

from rle_splat.accuracy.metrics import display_encoded

try:
    import flip_evaluator

    FLIP_PROBLEM = ""
except ImportError as problem:
    flip_evaluator = None
    FLIP_PROBLEM = str(problem)

PIXELS_PER_DEGREE = 67.0  # FLIP's own: a display 0.7 m wide of 3840 pixels, seen from 0.7 m


def mean_flip(image, reference, background=(0.0, 0.0, 0.0)) -> float | None:
    """Mean FLIP of premultiplied scene-linear pictures (H, W, 4) as a display shows them: 0 when they are equal, 1 at
    most; None where the package is not installed."""
    if flip_evaluator is None:
        return None
    shown, wanted = (np.ascontiguousarray(display_encoded(p, background), np.float32) for p in (image, reference))
    return float(flip_evaluator.evaluate(wanted, shown, "LDR", True, False, True, {"ppd": PIXELS_PER_DEGREE})[1])
