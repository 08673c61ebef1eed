"""Pixels of a picture that has been made, by rays of their own, where a tolerance is not kept without them; and what
such rays err and take."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ...pipeline.scalar_source import ScalarSource
from ...pipeline.single_rays import trace_steps
from ...pipeline.source import Work
from ...pipeline.stage_cache import StageCache
from ...runtime.jit import compiled
from ...runtime.steps import Clock
from ...scene import Quality, Scene
from ...view.eye import index_view
from .error_estimate import Doubt, RayCost
from .features import LEVELS

# Single rays that tell what rays err, and what they take; and slabs that a voxel's depth is cut into for both.
DOUBTFUL_RAYS, TIMED_RAYS, FEW_SLABS = 256, 1024, 4
TRIED_TERMINATION = 1 / 16384


def retrace_steps(scene: Scene, quality: Quality, columns, rows, slabs: int, cache: StageCache):
    """Generator of fractions done; returns premultiplied rgba (n, 4) float32 of pixels of the picture, and the
    milliseconds that their rays took.

    ``columns``, ``rows``: (n,) ints.  ``slabs``: that a voxel's depth is cut into, at least.  ``cache``: what made the
    scene's picture, whose tables are used.
    """
    quality = replace(quality, backend="numba" if compiled(quality.backend) else "numpy")
    view, job = index_view(scene.camera, scene.index_to_world, scene.width, scene.height), cache.job()
    medium = yield from _quietly(ScalarSource(scene, quality).medium_steps(Work(job, Clock())))
    steps, spent = trace_steps(scene, view, medium, columns, rows, slabs), 0.0
    while True:
        began = time.perf_counter()
        try:
            done = next(steps)
        except StopIteration as finished:
            spent += 1e3 * (time.perf_counter() - began)
            job.keep()
            return finished.value, spent
        spent += 1e3 * (time.perf_counter() - began)
        yield done


def with_rays(stages_ms: dict, spent: float) -> dict:
    """A report's ``stages_ms`` of a picture of which pixels were then traced, in ``spent`` milliseconds."""
    return {**stages_ms, "rays": stages_ms["rays"] + spent, "total": stages_ms["total"] + spent}


def ray_cost_steps(scene: Scene, quality: Quality, doubt: Doubt, cache: StageCache):
    """Generator of fractions done; returns the RayCost of a scene's picture, from a few of its pixels."""
    quality = replace(quality, termination=TRIED_TERMINATION)
    doubtful, anywhere = doubt.most_doubtful(DOUBTFUL_RAYS), doubt.anywhere(TIMED_RAYS)
    apart, spent = [], []
    for places in (doubtful, anywhere):  # the first of them may have to load the kernel
        for slabs in (FEW_SLABS, 2 * FEW_SLABS):
            values, took = yield from retrace_steps(scene, quality, *places, slabs, cache)
            apart.append(values)
            spent.append(took)
    differs = max(float(np.abs(few - many).max(initial=0.0)) for few, many in (apart[:2], apart[2:]))
    return RayCost.of(FEW_SLABS, LEVELS * differs, spent[2:], len(anywhere[0]))


def _quietly(steps):
    """Generator: the same steps, told as nothing done."""
    while True:
        try:
            next(steps)
        except StopIteration as finished:
            return finished.value
        yield 0.0
