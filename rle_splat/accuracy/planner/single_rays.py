"""Pixels of a finished picture by single rays, where its sheets and warp would break the tolerance."""

from dataclasses import replace

import numpy as np

from ...effects.analyze import analyze_effects
from ...effects.ray_effects import RayEffects
from ...pipeline.scalar_source import ScalarSource
from ...pipeline.single_rays import trace_steps
from ...pipeline.source import Work
from ...pipeline.stage_cache import StageCache
from ...raycast.scalar_rays import COMPOSITED
from ...runtime.steps import Clock, map_steps, step_within
from ...scene import Quality, Scene
from ...view.eye import index_view
from .error_estimate import ErrorEstimate
from .features import LEVELS
from .ray_cost import FEW_SLABS, RayCost, measured_us

# RayCost is measured with rays at the pixels of the largest estimate and at random ones, each traced with FEW_SLABS
# slabs to a voxel's depth and with twice as many.
LARGEST_RAYS, RANDOM_RAYS = 256, 2048
# More random rays that are timed: beside other work the fewer ones wait longer for the second thread than they work, at
# each principal axis (measured for three axes: 43 to 67 ms, where 12 were counted).
TIMED_RAYS = 8192
COST_TERMINATION = 1 / 16384


def single_ray_steps(scene: Scene, quality: Quality, columns, rows, slabs: int, cache: StageCache):
    """Trace single rays through pixels of a picture.  Generator of fractions done.

    Parameters
    ----------
    scene : Scene
        Without the effects that are off.
    columns, rows : (n,) int
        Pixels of the picture.
    slabs : int
        The least number of slabs that a voxel's depth is cut into.
    cache : StageCache
        The one that the picture was made with; its tables are used again.

    Returns
    -------
    rgba : (n, 4) float32
        Premultiplied, scene-linear.
    work : (n, 2) int32
        See ``raycast.scalar_rays.trace_rays``.
    spent : float
        Milliseconds that the rays took, without their tables.
    """
    view, job, clock = index_view(scene.camera, scene.index_to_world, scene.width, scene.height), cache.job(), Clock()
    medium = yield from map_steps(ScalarSource(scene, quality).medium_steps(Work(job, Clock())), lambda step: 0.0)
    ray_effects = RayEffects(scene, view, quality, analyze_effects(scene, quality)[0], Clock())
    yield from map_steps(ray_effects.leave_out_idle_steps([]), lambda step: 0.0)
    steps = trace_steps(scene, view, medium, ray_effects, columns, rows, slabs)
    rgba, work = yield from step_within(steps, lambda: clock.stage("rays"))
    job.keep()
    return rgba, work, clock.stages["rays"]


def with_rays(stages_ms: dict, spent: float) -> dict:
    """Add the ``spent`` milliseconds of single rays to a report's ``stages_ms``."""
    return {**stages_ms, "rays": stages_ms["rays"] + spent, "total": stages_ms["total"] + spent}


def ray_cost_steps(scene: Scene, quality: Quality, estimate: ErrorEstimate, cell_us: float, slab_us: float, cache):
    """Measure the RayCost of a scene at some of its pixels.  Generator of fractions done; returns the RayCost.

    ``cell_us``, ``slab_us``: of the MachineProfile.
    """
    quality = replace(quality, termination=COST_TERMINATION)
    largest, anywhere = estimate.largest(LARGEST_RAYS), estimate.anywhere(RANDOM_RAYS)
    found, timed_rays = [], []
    for pixels in (largest, anywhere):
        for slabs in (FEW_SLABS, 2 * FEW_SLABS):
            rgba, work, took = yield from single_ray_steps(scene, quality, *pixels, slabs, cache)
            found.append(rgba)
            timed_rays.append((took, work, slabs))
    differs = max(float(np.abs(few - many).max(initial=0.0)) for few, many in (found[:2], found[2:4]))
    more = estimate.anywhere(TIMED_RAYS)
    _, more_work, took = yield from single_ray_steps(scene, quality, *more, slabs, cache)
    timed_rays.append((took, more_work, slabs))
    # The first of all may have to load the kernel, so those at the largest estimate do not count.
    ratios = [took / max(_counted_ms(*given, cell_us, slab_us), 1e-9) for took, *given in timed_rays[2:]]
    rays = max(len(work), 1)
    counted = cell_us * float(work.sum()) / rays, slab_us * float(work[:, COMPOSITED].sum()) / rays
    return RayCost(LEVELS * differs, counted, measured_us(ratios, counted))


def _counted_ms(work: np.ndarray, slabs: int, cell_us: float, slab_us: float) -> float:
    """Milliseconds of rays by their ``work`` (n, 2)."""
    return 1e-3 * (cell_us * float(work.sum()) + slabs * slab_us * float(work[:, COMPOSITED].sum()))
