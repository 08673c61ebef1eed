"""The first half of the road for post-classified sheets: a scene's volume -> tables of scalars, each stage kept.

What depends on what, so that a change redoes no more than it must:

    blocks    the voxels
    relevant  blocks, and the range of values that the transfer function shows, or, where each sheet stands for itself,
              a wider one that is kept; there short gaps are closed, too
    normals   relevant, and how the volume lies in the world
    gradients relevant, where opacity depends on them; thinned, from gradients and light
    shadows   relevant, the transfer function, where a light is, meshes: one for each light that casts them
    light     normals, lights and shadows; the view too if a highlight or a headlight follows it
    runs      relevant, and the principal axis
    scalars   relevant, and the principal axis
    table     the transfer function: nothing else depends on it
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..classify.classification import opacity_distance, unit_length
from ..classify.gaps import close_gaps
from ..classify.points import LARGEST
from ..classify.relevant import Reach, kept_counts, kept_voxels, relevant_steps
from ..classify.value_table import extinction_of, value_table
from ..classify.visible import VisibleVoxels
from ..effects.ray_values import VALUE_MODES, shown_values, value_look
from ..effects.shadows import Matter
from ..encode.scalars import OWN_TYPES, ScalarVolume, in_scanlines, is_shared, scalar_tables, scalars_of
from ..raycast.scalar_rays import RowVoxels, bricks_of
from ..raycast.trace import trace as trace_rays
from ..runtime.jit import read_only
from ..runtime.memory import bytes_text
from ..runtime.steps import Clock, Progress, portion, timed
from ..scene import Quality, Scene, preintegrated_of
from ..shade.lighting import Lighting
from ..shade.shading import normals, refuse_too_bright
from ..shade.voxel_light import VoxelLight, voxel_light, with_factor
from ..splat.scalar_splat import scalar_splat_steps, value_splat_steps
from ..volume.blocks import Blocks, block_steps
from ..volume.gradient_size import gradient_sizes
from .medium import Medium, array_key, lighting_key, scene_lighting
from .memory_estimate import MemoryEstimate, refuse_too_much, scalar_estimate
from .shadows import shadow_count, shadow_steps
from .stage_cache import Job

# A wider range that is kept is used as it is while it reaches at most so many times as many blocks of voxels.
WORTH_KEEPING = 2.0
IN_ROWS = "rows"  # the voxels' own order


@dataclass(frozen=True, eq=False)
class RelevantVoxels:
    """The ``voxels`` that matter to a range of values, ``reach``; ``closed``: and those in short gaps between them."""

    reach: Reach
    voxels: VisibleVoxels
    closed: bool

    @property
    def key(self) -> tuple:
        return (*self.reach.key, self.closed)

    @property
    def nbytes(self) -> int:
        return self.voxels.nbytes


@dataclass(frozen=True, eq=False)
class _Lit:
    """What is known of a scene before a principal axis is chosen; keys name all that results depend on."""

    voxels: VisibleVoxels
    key: tuple
    light: VoxelLight | None
    light_key: tuple
    thinned: bool
    estimate: MemoryEstimate


def scalar_medium_steps(scene: Scene, quality: Quality, job: Job, clock: Clock, axes: int = 1, picture: int = 0):
    """Generator of Progress: the Medium of a scene for post-classified sheets, its tables still to be made.

    The arguments are those of ``medium.medium_steps``.
    """
    volume, tf = scene.volume, scene.transfer_function
    machine = dict(backend=quality.backend, threads=quality.threads)
    length = unit_length(volume, scene.index_to_world)
    voxels_key = (volume.key if job.cache.keeps else "", quality.backend)
    steps = job.steps("blocks", voxels_key, lambda: block_steps(volume, **machine))
    blocks = yield from portion(timed(steps, clock, "classify"), 0.0, 0.02, "Looking through the voxels")
    falling = scene_lighting(scene, scene.index_to_world)
    relevant, needs = yield from _relevant_steps(scene, quality, job, clock, blocks, voxels_key, falling, axes, picture)
    table = values = None
    with clock.stage("classify"):
        ends, infinite = _value_ends(volume, tf, blocks)
        if scene.mode in VALUE_MODES:
            values = value_look(volume, tf, scene.mode, ends)
        else:
            table = job.get(
                "table", (voxels_key, tf.classification_key, length),
                lambda: value_table(volume, tf, ends, opacity_distance(volume, tf, length)),
            )
    key = (voxels_key, relevant.key)
    factor = None
    if tf.gradient_opacity is not None and values is None:
        with clock.stage("gradients"):
            factor = _factor(volume, tf, relevant.voxels, key, job, machine)
    shadows_key = ()
    if falling is not None and shadow_count(scene):
        voxels = relevant.voxels

        def tables_of(axis):
            return job.get("runs", (key, axis), lambda: scalar_tables(voxels, axis, **machine))

        def extinction():
            found = extinction_of(table, voxels.stored, volume.voxels.dtype, infinite)
            return found if factor is None else found * factor

        look = (key, tf.classification_key, length)
        around = scene.index_to_world, scene.triangles, scene.clips
        matter = Matter(voxels, extinction, tables_of, *around, look, boxed=True, **machine)
        steps = shadow_steps(scene, matter, job, clock)
        shadows, shadows_key = yield from portion(steps, 0.08, 0.1, "Casting shadows")
        falling = replace(falling, shadows=shadows)
    if falling is not None:
        yield Progress(0.1, "Shading")
    with clock.stage("shade"):
        light, light_key = _light(scene, relevant.voxels, key, falling, shadows_key, job, machine)
    if factor is not None:
        light_key = (light_key, key, tf.gradient_opacity)
        light = job.get("thinned", light_key, lambda: with_factor(light, factor))
    lit = _Lit(relevant.voxels, key, light, light_key, factor is not None, needs)
    centre = 0.0 if volume.voxels.dtype.name in OWN_TYPES else 0.5 * (ends[0] + ends[1])

    def encode_steps(axis: int):
        return _axis_steps(volume, lit, axis, infinite, centre, quality, job, clock)

    def splat(encoded, plane, limits):
        if values is not None:
            return value_splat_steps(encoded, values, plane, quality, limits)
        return scalar_splat_steps(encoded, table, plane, quality, limits, scene.mode == "xray", scene.mist)

    def trace(rays, slabs):
        shape, ends = volume.shape_xyz, (infinite, centre)
        bricks = job.get("bricks", key, lambda: bricks_of(voxels.bits, shape))
        scalars = job.get(
            "scalars", (key, *ends, IN_ROWS), lambda: scalars_of(voxels, volume.voxels.dtype, *ends)
        )
        lights = (None, np.float32(1.0)) if light is None else (read_only(light.codes), np.float32(light.unit))
        # Of the function as it is: what is kept may be more.
        reach = Reach.of_values(volume, shown_values(scene.transfer_function, scene.mode))
        with np.errstate(over="ignore"):
            shown = np.clip(reach.ends.astype(np.float64) - centre, -LARGEST, LARGEST)
        records = read_only(scalars), *lights
        rows = RowVoxels(voxels.bits, voxels.row_start, bricks, *records, shown, shape[::-1])
        return trace_rays(rows, centre, table, rays, slabs, quality)

    voxels = relevant.voxels
    counts = (len(voxels), voxels.nan_voxels, needs)
    if values is not None:
        return Medium(
            voxels.shape_xyz, encode_steps, splat, lambda encodings: values.most, *counts, picture=values.picture
        )
    # A volume of a single value has no normal anywhere, and shows the colors as they are.
    is_lit = light is not None and ends[0] < ends[1]
    shine = (light.most_light, light.most_highlight) if is_lit else (1.0, 0.0)
    most_color = refuse_too_bright(table.most_color * shine[0] + shine[1]) if scene.mode == "composite" else 1.0
    return Medium(voxels.shape_xyz, encode_steps, splat, lambda encodings: most_color, *counts, trace=trace)


def _relevant_steps(scene, quality, job: Job, clock: Clock, blocks: Blocks, voxels_key, falling, axes, picture):
    """Generator of Progress: the RelevantVoxels of a scene, and the MemoryEstimate of all that is to come."""
    volume = scene.volume
    machine = dict(backend=quality.backend, threads=quality.threads)
    reach = Reach.of_values(volume, shown_values(scene.transfer_function, scene.mode))
    near = int(np.count_nonzero(reach.of_blocks(blocks)))

    def wanted(counted) -> MemoryEstimate:
        needs = scalar_estimate(volume, counted, axes=axes, lit=falling is not None, picture=picture)
        return needs.with_shadows(shadow_count(scene) if falling is not None else 0)

    # Between sheets both ends of a slab count, so that voxels which need not be kept would change what is seen where
    # the other end is not kept: pictures must not depend on what was shown before.  Nor may a ray's value.
    between = preintegrated_of(quality.depth_rule) is not None or scene.mode in VALUE_MODES
    closed = not between and blocks.nan_voxels == 0  # what is no number is never kept

    def serves(key, held: RelevantVoxels) -> bool:
        if between or key[0] != voxels_key or not held.reach.covers(reach):
            return False
        return np.count_nonzero(held.reach.of_blocks(blocks)) <= WORTH_KEEPING * near

    key = (voxels_key, (*reach.key, closed))
    found = None if job.has("relevant", key) else job.latest("relevant", serves)
    if found is not None:
        key = found
    if job.has("relevant", key):
        relevant = job.get("relevant", key, None)
        return relevant, wanted((np.diff(relevant.voxels.row_start), relevant.voxels.row_pieces))
    steps = timed(relevant_steps(volume, reach, blocks, **machine), clock, "classify")
    bits = yield from portion(steps, 0.02, 0.08, "Finding the voxels that matter")
    with clock.stage("classify"):
        if closed:
            close_gaps(bits, volume.shape_xyz, **machine)
        counted = kept_counts(bits, **machine)
    needs = wanted(counted)
    job.cache.make_room(needs.needed)
    refuse_too_much(needs)
    yield Progress(0.08, f"Keeping {needs.visible_voxels} voxels, about {bytes_text(needs.needed)} in all")
    with clock.stage("classify"):
        voxels = kept_voxels(volume, bits, counted, blocks, **machine)
        relevant = job.get("relevant", key, lambda: RelevantVoxels(reach, voxels, closed))
    return relevant, needs


def _light(scene: Scene, voxels: VisibleVoxels, key, falling: Lighting | None, shadows_key, job: Job, machine):
    """The VoxelLight of the voxels, and its key; None where nothing shines.  ``shadows_key``: of falling's shadows."""
    if falling is None:
        return None, ()
    matrix = scene.index_to_world
    normals_key = (key, array_key(matrix[:3, :3]))
    directions = job.get("normals", normals_key, lambda: normals(voxels, scene.volume, matrix, **machine))
    light_key = (key, *lighting_key(scene, matrix, falling), shadows_key)
    return job.get("light", light_key, lambda: voxel_light(voxels, directions, falling, **machine)), light_key


def _factor(volume, tf, voxels: VisibleVoxels, key, job: Job, machine) -> np.ndarray:
    """(m,) float32: what the transfer function multiplies the voxels' extinction by, by the size of their gradient."""
    place = (key, array_key(volume.affine[:3, :3]))
    sizes = job.get("gradients", place, lambda: gradient_sizes(volume, voxels.row_start, voxels.column, **machine))
    return tf.gradient_opacity.factor(sizes)


def _value_ends(volume, tf, blocks: Blocks) -> tuple[tuple, tuple]:
    """Smallest and largest stored value that is splatted, and what stands for minus and plus infinity in doing so:
    the transfer function's ends, beyond which nothing changes; no numbers where nothing is infinite."""
    seen = blocks.low <= blocks.high  # others hold no number
    low, high = blocks.low[seen], blocks.high[seen]
    finite = [ends[np.isfinite(ends)].astype(np.float64) for ends in (low, high)]
    least, most = float(finite[0].min(initial=np.inf)), float(finite[1].max(initial=-np.inf))
    infinite = ()
    if volume.voxels.dtype.kind == "f" and (np.isinf(low).any() or np.isinf(high).any()):
        points = [(value - volume.intercept) / volume.slope for value, *_ in (*tf.opacity, *tf.color)]
        infinite = min(points), max(points)
        # Blocks that hold infinite values do not tell their finite ones.
        finite = sorted((value - volume.intercept) / volume.slope for value in volume.value_range)
        least, most = min(finite[0], infinite[0]), max(finite[1], infinite[1])
    return (least, most) if least <= most else (0.0, 0.0), infinite


def _axis_steps(volume, lit: _Lit, axis: int, infinite, centre: float, quality: Quality, job: Job, clock: Clock):
    """Generator of fractions done: the ScalarVolume of one principal axis.  ``infinite``: see ``_value_ends``."""
    machine = dict(backend=quality.backend, threads=quality.threads)
    kind, voxels = volume.voxels.dtype, lit.voxels
    with clock.stage("encode"):
        tables = job.get("runs", (lit.key, axis), lambda: scalar_tables(voxels, axis, **machine))
    needs = lit.estimate.one_axis()
    order = IN_ROWS if is_shared(axis) else axis

    def scalars():
        job.cache.make_room(needs.needed)
        refuse_too_much(needs)
        return in_scanlines(tables, voxels, scalars_of(voxels, kind, infinite, centre), **machine)

    steps = job.steps("scalars", (lit.key, infinite, centre, order), scalars)
    placed = yield from timed(steps, clock, "encode")
    if lit.light is None:
        return ScalarVolume(tables, placed, centre)
    lights = lit.light.codes
    steps = job.steps("lights", (lit.light_key, order), lambda: in_scanlines(tables, voxels, lights, **machine))
    codes = yield from timed(steps, clock, "shade")  # as with ``pre``, which writes lit records in scanlines
    return ScalarVolume(tables, placed, centre, codes, lit.light.unit, lit.thinned)
