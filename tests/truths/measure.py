"""The error of a picture of a scene, measured at probe pixels (algorithm.md 2.4, step 5)."""

from __future__ import annotations

import numpy as np

from rle_splat.accuracy.probes import PROBES, choose_probes, error_summary, probe_errors, truth_tolerance
from rle_splat.accuracy.truths import truth
from rle_splat.scene import Scene


def measure(scene: Scene, rgba, truth_name: str, tolerance: float, count: int = PROBES, seed: int = 0,
            far=np.inf, **shading) -> dict:  # fmt: skip
    """Measure the error of a premultiplied scene-linear picture (of its crop where it has one) at probe pixels.

    ``tolerance`` is in levels, 1/255; three quarters of the probes are random; ``far`` is the planar depth, one or
    (H, W), at which rays end; ``shading`` is as ``truths.truth`` takes it.  JSON-ready: ``probes.error_summary`` and
    the name of the ``truth``.
    """
    probes = choose_probes(rgba, count, seed)
    left, top = scene.crop[:2] if scene.crop is not None else (0, 0)
    columns, rows = probes.centers
    ends = np.broadcast_to(far, np.shape(rgba)[:2])[probes.rows, probes.columns]
    pixels = columns + left, rows + top
    true, _ = truth(scene, truth_name, pixels=pixels, far=ends, tolerance=truth_tolerance(shading), **shading)
    return {"truth": truth_name, **error_summary(probe_errors(probes.of(rgba), true), probes.random, tolerance)}
