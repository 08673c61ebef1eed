"""The error of a picture of a scene, measured at probe pixels (algorithm.md 2.4, step 5)."""

from __future__ import annotations

from rle_splat.accuracy.probes import PROBES, choose_probes, error_summary, probe_errors, truth_tolerance
from rle_splat.accuracy.truths import truth
from rle_splat.scene import Scene


def measure(
    scene: Scene, rgba, truth_name: str, tolerance: float, count: int = PROBES, seed: int = 0, **shading
) -> dict:
    """Measure the error of a premultiplied scene-linear picture at probe pixels.

    ``tolerance`` is in levels, 1/255; three quarters of the probes are random; ``shading`` is as ``truths.truth`` takes
    it.  JSON-ready: ``probes.error_summary`` and the name of the ``truth``.
    """
    probes = choose_probes(rgba, count, seed)
    true, _ = truth(scene, truth_name, pixels=probes.centers, tolerance=truth_tolerance(shading), **shading)
    return {"truth": truth_name, **error_summary(probe_errors(probes.of(rgba), true), probes.random, tolerance)}
