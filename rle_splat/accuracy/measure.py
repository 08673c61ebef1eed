"""How wrong a picture of a scene is, at probe pixels: what a report says after a render (algorithm.md 2.4, step 5)."""

from __future__ import annotations

import numpy as np

from ..scene import Scene
from .probes import PROBES, choose_probes, judge, probe_errors
from .truths import truth

TOLERANCE = 1e-7  # of the truth itself: far below a level, 1/255


def measure(scene: Scene, rgba, truth_name: str, tolerance: float, count: int = PROBES, seed: int = 0,
            far=np.inf, **shading) -> dict:  # fmt: skip
    """What ``probes.judge`` says of a picture of the scene, and which ``truth`` its errors are against; JSON-ready.

    ``rgba``: (H, W, 4) premultiplied picture of the scene, of its crop where it has one.  ``tolerance``: levels.
    ``count``: of probes, three quarters of them random.  ``far``: planar depth at which rays end, a number or
    (H, W).  ``shading``: ``colors``, or ``light`` and ``highlight``, as ``truths.truth`` takes them.
    """
    probes = choose_probes(rgba, count, seed)
    left, top = scene.crop[:2] if scene.crop is not None else (0, 0)
    columns, rows = probes.centres
    ends = np.broadcast_to(far, np.shape(rgba)[:2])[probes.rows, probes.columns]
    true, _ = truth(scene, truth_name, pixels=(columns + left, rows + top), far=ends, tolerance=TOLERANCE, **shading)
    return {"truth": truth_name, **judge(probe_errors(probes.of(rgba), true), probes.random, tolerance)}
