"""Single pixels of a scene by rays of their own, where the warp of a whole picture would err too much.

They go through the same tables, table of values and light as the sheets, and are cut off by the same box and clip
distances; what they leave out is the resampling of sheets and the warp.
"""

from __future__ import annotations

import time
from dataclasses import MISSING, fields, replace

import numpy as np

from .jit import compiled
from .kept import Kept
from .plan.doubt import Doubt, RayCost
from .plan.features import LEVELS
from .scalar_medium import scalar_medium_steps
from .scene import Quality, Scene
from .splat.scalar_rays import rays_through
from .steps import Clock
from .view.base_plane import base_plane
from .view.eye import index_view
from .view.principal_axis import candidate_pyramids, dominant_axis

# Single rays that tell what rays err, and what they take; and slabs that a voxel's depth is cut into for both.
DOUBTFUL_RAYS, TIMED_RAYS, FEW_SLABS = 256, 1024, 4
TRIED_TERMINATION = 1 / 16384
AT_ONCE = 2048  # rays between two looks at the user's Esc
# What of a scene single rays know of, light by the voxels that it falls on; anything else must be as it is by itself.
KNOWN = {
    "volume", "transfer_function", "camera", "width", "height", "volume_matrix", "scene_scale", "lights", "headlight",
    "background", "crop", "effects", "volume_shadows", "world", "ambient_occlusion",
}  # fmt: skip


def can_retrace(scene: Scene, quality: Quality) -> bool:
    """Whether single pixels of a scene can be had by rays of their own: of scalars, and without meshes.

    ``scene``: without the effects that are off (``effects.analyse``).
    """
    if quality.classification != "post" or min(scene.volume.shape_xyz) < 2:
        return False
    return all(field.name in KNOWN or not _given(scene, field) for field in fields(Scene))


def _given(scene: Scene, field) -> bool:
    """Whether a field of the scene is something else than what it is by itself; an empty array is nothing."""
    value, usual = getattr(scene, field.name), field.default
    usual = field.default_factory() if usual is MISSING else usual
    if isinstance(value, np.ndarray):
        return value.size > 0 and not np.array_equal(value, usual)
    return value is not usual and value != usual


def retrace_steps(scene: Scene, quality: Quality, columns, rows, slabs: int, kept: Kept):
    """Generator of fractions done; returns premultiplied rgba (n, 4) float32 of pixels of the picture, and the
    milliseconds that their rays took.

    ``columns``, ``rows``: (n,) ints.  ``slabs``: that a voxel's depth is cut into, at least.  ``kept``: what made the
    scene's picture, whose tables are used.
    """
    quality = replace(quality, backend="numba" if compiled(quality.backend) else "numpy")
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    columns, rows = (np.asarray(at, np.float64) + first + 0.5 for at, first in zip((columns, rows), scene.region))
    axes, signs = dominant_axis(view.ray_directions(columns, rows))
    spent, job, found = 0.0, kept.job(), np.zeros((len(columns), 4), np.float32)
    medium = yield from _quietly(scalar_medium_steps(scene, quality, job, Clock()))
    shape, clip = scene.volume.shape_xyz, (scene.camera.clip_start, scene.camera.clip_end)
    for axis, sign in candidate_pyramids(view):
        mine = np.flatnonzero((axes == axis) & (signs == sign))
        plane = base_plane(view, shape, axis, sign, "slice", 1.0, boxed=True) if len(mine) else None
        if plane is None:
            continue
        encoded = yield from _quietly(medium.encode_steps(axis))
        for first in range(0, len(mine), AT_ONCE):
            yield first / len(mine)
            part = mine[first : first + AT_ONCE]
            began = time.perf_counter()
            rays = rays_through(plane, view, shape, columns[part], rows[part], clip)
            found[part] = medium.trace(encoded, rays, sign, slabs)
            spent += 1e3 * (time.perf_counter() - began)
    job.keep()
    return found, spent


def ray_cost_steps(scene: Scene, quality: Quality, doubt: Doubt, kept: Kept):
    """Generator of fractions done; returns the RayCost of a scene's picture, from a few of its pixels."""
    quality = replace(quality, termination=TRIED_TERMINATION)
    doubtful, anywhere = doubt.most_doubtful(DOUBTFUL_RAYS), doubt.anywhere(TIMED_RAYS)
    apart, spent = [], []
    for places in (doubtful, anywhere):  # the first of them may have to load the kernel
        for slabs in (FEW_SLABS, 2 * FEW_SLABS):
            values, took = yield from retrace_steps(scene, quality, *places, slabs, kept)
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
