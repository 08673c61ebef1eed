"""Single rays: pixels of a picture that are integrated one by one, where sheets and warp err most.

Single rays go through the same voxels, lookup table and light as the sheets, and the same box, clip distances, clip
objects and meshes end them.  They leave out the resampling of sheets and the warp.
"""

from __future__ import annotations

from dataclasses import MISSING, fields, replace
from functools import partial

import numpy as np

from ..effects.clips import cuts_of
from ..effects.mixing import is_sampled
from ..effects.ray_effects import RayEffects
from ..raycast.rays import rays_through
from ..runtime.figures import percent_text
from ..runtime.steps import Clock, Progress
from ..runtime.work_sizes import RAYS_AT_ONCE
from ..scene import NO_DEPTH, Scene, midpoints_of
from ..view.base_plane import base_plane
from ..view.eye import IndexView
from ..view.principal_axis import candidate_pyramids, dominant_axis
from ..warp.reference import AROUND
from ..warp.steep import TILE, most_in_tile, steep_pixels
from .medium import Medium
from .source import Source

NO_PIXELS = {"pixels": 0, "share": 0.0, "slabs": 0}  # of a report, where there are no single rays
LEAST_SLABS = 4
# Fields of a scene that single rays take into account; every other field must have its default.
KNOWN = {
    "volume", "transfer_function", "camera", "width", "height", "volume_matrix", "scene_scale", "lights", "headlight",
    "triangles", "ray_ends", "panes", "pane_shares", "crop", "effects", "motion", "clips", "volume_shadows", "world",
    "environment", "ambient_occlusion", "indirect_light", "channels", "labels", "reasons_off", "antialias",
}  # fmt: skip


def can_trace(source: Source) -> bool:
    """Whether pixels can be integrated by single rays: of post-classified values, and without mist."""
    scene = source.scene
    if not source.traces_rays or min(scene.volume.shape_xyz) < 2:
        return False
    if scene.transfer_function.gradient_opacity is not None:
        return False
    if scene.labels is not None and not is_sampled(scene):
        return False
    return all(field.name in KNOWN or not _is_given(scene, field) for field in fields(Scene))


def _is_given(scene: Scene, field) -> bool:
    """Whether a field of the scene differs from its default; an empty array counts as the default."""
    value, usual = getattr(scene, field.name), field.default
    usual = field.default_factory() if usual is MISSING else usual
    if isinstance(value, np.ndarray):
        return value.size > 0 and not np.array_equal(value, usual)
    return value is not usual and value != usual


def traces_steep_pixels(source: Source) -> bool:
    """Whether the steep pixels of a picture are integrated by single rays."""
    return source.quality.rays > 0.0 and can_trace(source)


def add_neighbors(source: Source) -> Source:
    """The source with its crop enlarged to whole tiles (see ``warp.steep``) whose pixels have all their neighbors.

    The source as it is where no steep pixels are traced.
    """
    scene = source.scene
    if scene.crop is None or not traces_steep_pixels(source):
        return source
    first = (max(side // TILE * TILE - AROUND, 0) for side in scene.crop[:2])
    ends = zip(scene.crop[2:], (scene.width, scene.height), strict=True)
    crop = (*first, *(min(-(-side // TILE) * TILE + AROUND, most) for side, most in ends))
    return replace(source, scene=replace(scene, crop=crop))


def trace_steps(scene: Scene, view: IndexView, medium: Medium, ray_effects: RayEffects, columns, rows, slabs: int):
    """Generator of fractions done: integrate pixels of the picture; returns premultiplied rgba (n, 4) float32, and the
    work that each took (n, 2) int32 (see ``raycast.scalar_rays.trace_rays``).

    ``columns``, ``rows``: (n,) ints.  ``slabs``: at least as many per voxel of depth.
    """
    rgba, work = np.empty((len(columns), 4), np.float32), np.empty((len(columns), 2), np.int32)
    trace = partial(_trace, scene, view, medium, {}, slabs)
    for first in range(0, len(columns), RAYS_AT_ONCE):
        yield first / len(columns)
        part = slice(first, first + RAYS_AT_ONCE)
        rgba[part], _, work[part] = ray_effects.trace(trace, columns[part], rows[part])
    return rgba, work


def _trace(scene: Scene, view: IndexView, medium: Medium, planes: dict, slabs: int, columns, rows, ends=np.inf):
    """Premultiplied rgba (n, 4) and depths (n,), float32, of pixels of the picture, NO_DEPTH where there is none; and
    the work that each took (n, 2) int32.

    ``planes``: base planes by axis and sign, filled as they are needed.  ``ends``: planar depth at which a mesh ends
    each ray, a number or (n,).
    """
    left, top = scene.region[:2]
    columns, rows = columns + (left + 0.5), rows + (top + 0.5)
    axes, signs = dominant_axis(view.ray_directions(columns, rows))
    rgba, depth = np.zeros((len(columns), 4), np.float32), np.full(len(columns), NO_DEPTH, np.float32)
    work = np.zeros((len(columns), 2), np.int32)
    shape, cuts = scene.volume.shape_xyz, cuts_of(scene, medium.quality)
    ends = np.broadcast_to(np.minimum(ends, scene.camera.clip_end), columns.shape)
    for axis, sign in candidate_pyramids(view):
        mine = np.flatnonzero((axes == axis) & (signs == sign))
        if not len(mine):
            continue
        if (axis, sign) not in planes:
            planes[axis, sign] = base_plane(view, shape, axis, sign, "slice", 1.0, boxed=True)
        if planes[axis, sign] is not None:
            clip = scene.camera.clip_start, ends[mine]
            rays = rays_through(planes[axis, sign], view, shape, columns[mine], rows[mine], clip, cuts)
            rgba[mine], half, work[mine] = medium.trace(rays, slabs)
            found = np.isfinite(half)
            depth[mine[found]] = (rays.depth[:, 0] + np.where(found, half, 0.0) * rays.depth[:, 1])[found]
    return rgba, depth, work


def retrace_steps(
    source: Source, wanted, view: IndexView, medium: Medium, ray_effects: RayEffects, rgba, depth, clock: Clock
):
    """Generator of Progress: integrate the steep pixels of a picture by single rays, where its plan asks for it.

    Parameters
    ----------
    source : Source
        Of the picture.
    ray_effects : RayEffects
        Those of its sheets.
    wanted : (left, top, right, bottom)
        The pixels of the whole frame that are returned.
    rgba, depth : (H, W, 4) and (H, W) float32
        The picture by sheets.

    Returns
    -------
    rgba, depth : (h, w, 4) and (h, w) float32
    dict
        The report's ``rays``: pixels, their share, and slabs per voxel.
    """
    if not traces_steep_pixels(source):
        return rgba, depth, NO_PIXELS
    scene, quality = source.scene, source.quality
    left, top = scene.region[:2]
    inner = slice(wanted[1] - top, wanted[3] - top), slice(wanted[0] - left, wanted[2] - left)
    with clock.stage("rays"):
        most = most_in_tile(scene.width, scene.height, quality.rays)
        steep = steep_pixels(rgba, quality.rays, most, (left, top), quality.threads)[inner]
        rgba, depth = (np.ascontiguousarray(values[inner]) for values in (rgba, depth))
        # Slabs per voxel of depth along a quality's own rays: twice its sheets, and enough to err less than these
        where, slabs = np.flatnonzero(steep), max(LEAST_SLABS, 2 * (midpoints_of(quality.depth_rule) or 1))
        trace = partial(_trace, scene, view, medium, {}, slabs)
        for first in range(0, len(where), RAYS_AT_ONCE):
            yield Progress(0.95 + 0.04 * first / len(where), "Computing exact pixels")
            rows, columns = np.divmod(where[first : first + RAYS_AT_ONCE], steep.shape[1])
            pixels = columns + inner[1].start, rows + inner[0].start
            rgba[rows, columns], depth[rows, columns], _ = ray_effects.trace(trace, *pixels)
    return rgba, depth, {"pixels": len(where), "share": len(where) / max(steep.size, 1), "slabs": slabs}


def describe_rays(rays: dict | None) -> list[str]:
    """A report's ``rays`` as lines for people."""
    if not rays or not rays["pixels"]:
        return []
    return [f"{rays['pixels']:,} pixels ({percent_text(rays['share'])}) were computed by ray casting."]
