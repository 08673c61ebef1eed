"""The first half of the road: a scene's volume -> the tables that the splatter walks, each stage kept.

What depends on what, so that a change redoes no more than it must:

    blocks    the voxels
    visible   blocks, and which values the transfer function shows
    looks     visible, and the transfer function's points
    normals   visible, and how the volume lies in the world
    runs      visible, and the principal axis
    shadows   looks, where a light is, meshes: one for each light that casts them
    records   runs, looks, normals, lights, shadows; the view too if a highlight or a headlight follows it
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from ..classify.classification import ClassifiedVolume, classified, opacity_distance, unit_length
from ..classify.mixture import Mixture
from ..classify.refined import RefinedVolume, value_block_steps
from ..classify.transfer_function import TransferFunction
from ..classify.visible import Visibility, count_steps, fill_steps
from ..effects.shadows import Matter
from ..encode.encode import brightest_steps, record_steps, reorder_steps, run_tables
from ..encode.records import decoding_of
from ..encode.store import StoredVolume
from ..runtime.memory import bytes_text
from ..runtime.steps import Clock, Progress, drain, portion, timed
from ..scene import Quality, RleSplatError, Scene
from ..shade.lighting import Lighting, lighting
from ..shade.refined_light import LitVoxels, RefinedLight, lit_voxels
from ..shade.shading import DENSITY, color_bound, light_records, normals, shaded_colors
from ..splat.splat import splat_steps
from ..view.projection import world_to_camera
from ..volume.axes import AXES, AXIS_NAMES
from .memory_estimate import MemoryEstimate, estimate_of, refuse_too_much
from .shadows import shadow_count, shadow_steps
from .stage_cache import Job, StageCache

IN_ORDER = 2  # the principal axis whose records are in the voxels' own order


@dataclass(frozen=True, eq=False)
class Medium:
    """What the splatter needs to know of a volume, however it came to be encoded.

    ``encode_steps(axis)``: generator of fractions done, returns the tables of a principal axis.
    ``splat_steps(encoded, plane, limits)``: generator that splats such tables, see ``splat.splat_steps``.
    ``most_color(encodings)``: the largest channel of any unassociated colour in some tables.
    ``visible_voxels``: how many the tables hold.  ``estimate``: None for a `.rle` file.
    ``picture(rgba, depth)``: of what was warped, where that is not the picture yet.  ``trace(rays, slabs)``: colour and
    half depths of single rays, see ``raycast.scalar_rays``; None where there is no way to.
    """

    shape_xyz: tuple[int, int, int]
    encode_steps: Callable
    splat_steps: Callable
    most_color: Callable
    visible_voxels: int
    nan_voxels: int = 0
    estimate: MemoryEstimate | None = None
    picture: Callable | None = None
    trace: Callable | None = None


@dataclass(frozen=True, eq=False)
class Look:
    """A volume classified, and what falls on its voxels; ``key`` names all their records depend on.

    ``normals``: (m, 3) float32, or the LitVoxels of a refined volume; None without ``falling``.  ``estimate``: what
    all of it and its tables take.  ``refinement``: how much finer than the scan the classified volume is.
    """

    classified: ClassifiedVolume
    normals: np.ndarray | LitVoxels | None
    falling: Lighting | None
    visible_key: tuple
    key: tuple
    estimate: MemoryEstimate
    refinement: int = 1

    def write_records(self, model: str, backend: str, threads: int) -> Callable:
        """For ``encode.record_steps``: a function that writes the records of some planes' voxels."""
        if isinstance(self.normals, LitVoxels):
            light = RefinedLight(self.normals, self.falling, self.refinement, backend, threads)
            return partial(light.records, self.classified, model)

        def write(places, records):
            return light_records(
                self.classified, self.normals, self.falling, model, places, records, backend=backend, threads=threads
            )

        return write


def classified_scene(scene: Scene, quality: Quality) -> Scene:
    """The scene with its volume on the grid that it is classified on."""
    if quality.classification != "refined":
        return scene
    if isinstance(scene.volume, StoredVolume):
        raise RleSplatError(
            "A .rle file holds voxels that are classified already; render the volume itself with the classification "
            "refined, or the file with the classification pre."
        )
    if scene.transfer_function.gradient_opacity is not None:
        raise RleSplatError(
            "The classification refined knows no gradients between voxels, which the transfer function's "
            "gradient_opacity asks for; choose post or pre."
        )
    return replace(scene, volume=RefinedVolume(scene.volume, scene.transfer_function, quality.refinement))


def medium_steps(scene: Scene, quality: Quality, job: Job, clock: Clock, axes: int = 1, picture: int = 0):
    """Generator of Progress: the Medium of a scene, its tables still to be made; see ``look_steps``."""
    if isinstance(scene.volume, StoredVolume):
        return _stored_medium(scene, quality)
    look = yield from look_steps(scene, quality, job, clock, axes, picture)
    found = look.classified

    def encode_steps(axis: int):
        # Where all three are wanted, the one that the others take their records from comes first.
        return axes_steps(look, quality, (IN_ORDER, axis) if axes == len(AXES) else (axis,), job, clock)

    length = found.opacity_distance if quality.model == "opacity" else 1.0
    return pre_classified(
        found.shape_xyz, encode_steps, length, quality, scene.mist, found.visible_voxels, found.nan_voxels,
        look.estimate,
    )


def pre_classified(shape_xyz, encode_steps, length_unit: float, quality: Quality, mist, *counts) -> Medium:
    """The Medium of voxels that are classified before they are splatted; ``length_unit``: in which rays are counted."""

    def splat(encoded, plane, limits):
        return splat_steps(encoded, plane, quality, length_unit, limits, mist)

    def most_color(encodings):
        return max((encoded.most_color for encoded in encodings), default=0.0)

    return Medium(shape_xyz, encode_steps, splat, most_color, *counts)


def look_steps(scene: Scene, quality: Quality, job: Job, clock: Clock, axes: int = 1, picture: int = 0):
    """Generator of Progress: the Look of a scene's volume.

    ``axes``: how many principal axes will be encoded; ``picture``: bytes that its pixels will take.  Says what memory
    is about to be taken, and raises RleSplatError with what would fit when there is not enough.
    """
    volume, tf, matrix = scene.volume, scene.transfer_function, scene.index_to_world
    refinement = volume.refinement if isinstance(volume, RefinedVolume) else 1
    machine = dict(backend=quality.backend, threads=quality.threads)
    length = unit_length(volume, matrix)
    mixed = bool(scene.labels or scene.channels)
    shown = Mixture(volume, tf, scene.labels, scene.channels) if mixed else Visibility(volume, tf)
    stage = "mixing" if mixed else "classify"
    # A store without room needs no content key, and large volumes no second reading for it.
    voxels_key = (volume.key if job.cache.keeps else "", quality.backend)
    visible_key = (voxels_key, shown.key)
    looks_key = (visible_key, tf.classification_key, length)
    lit_matrix = matrix @ np.diag((refinement, refinement, refinement, 1.0))  # light falls on the scan's own voxels
    falling = scene_lighting(scene, lit_matrix)
    shaded = falling is not None

    def wanted(counted):
        # As of volumes with too many values for a table of looks: each voxel has its own.
        each = np.float32 if mixed or tf.gradient_opacity is not None else None
        needs = estimate_of(volume, counted, quality, axes=axes, shaded=shaded, picture=picture, dtype=each)
        return needs.with_shadows(shadow_count(scene) if shaded else 0)

    if not job.has("visible", visible_key):
        steps = job.steps("blocks", voxels_key, lambda: value_block_steps(volume, **machine))
        blocks = yield from portion(timed(steps, clock, "classify"), 0.0, 0.02, "Looking through the voxels")
        steps = timed(shown.count_steps(**machine) if mixed else count_steps(shown, blocks, **machine), clock, stage)
        counted = yield from portion(steps, 0.02, 0.06, "Counting")
        needs = wanted(counted)
        job.cache.make_room(needs.needed)
        refuse_too_much(needs)
        told = f"Classifying {needs.visible_voxels} voxels, about {bytes_text(needs.needed)} in all"
        yield Progress(0.06, told)
        fill = partial(shown.fill_steps, **machine) if mixed else partial(fill_steps, shown, **machine)
        steps = job.steps("visible", visible_key, lambda: fill(blocks, counted))
        voxels = yield from portion(timed(steps, clock, stage), 0.06, 0.1, told)
    else:
        voxels = job.get("visible", visible_key, None)
        needs = wanted((np.diff(voxels.row_start), voxels.row_pieces))
    with clock.stage(stage):
        look_at = partial(shown.classified, **machine) if mixed else partial(classified, shown, **machine)
        found = job.get("looks", looks_key, lambda: look_at(voxels, length), lambda c: c.looks.nbytes)
    with clock.stage("shade"):
        if not shaded:
            return Look(found, None, None, visible_key, (looks_key, "unshaded"), needs)
        normals_key = (visible_key, array_key(lit_matrix[:3, :3]))
        point = lit_voxels if refinement > 1 else normals
        directions = job.get("normals", normals_key, lambda: point(voxels, volume, lit_matrix, **machine))
        key = (looks_key, *lighting_key(scene, lit_matrix, falling))
    if shadow_count(scene):
        if refinement > 1:
            raise RleSplatError(
                "The classification refined has no shadows and no ambient occlusion; choose post or pre, or leave them "
                "out."
            )

        def tables_of(axis):
            return job.get("runs", (visible_key, axis), lambda: run_tables(voxels, axis, **machine))

        matter = Matter(
            voxels, lambda: found.extinction, tables_of, matrix, scene.triangles, scene.clips, looks_key, boxed=False,
            **machine,
        )
        steps = shadow_steps(scene, matter, job, clock)
        shadows, shadows_key = yield from portion(steps, 0.1, 0.1, "Casting shadows")
        falling, key = replace(falling, shadows=shadows), (key, shadows_key)
    return Look(found, directions, falling, visible_key, key, needs, refinement)


def scene_lighting(scene: Scene, matrix) -> Lighting | None:
    """What falls on voxels; ``matrix``: their indices to the world.  None where nothing shades or nothing shines."""
    to_camera = world_to_camera(scene.camera)
    eye = np.append(to_camera[2, :3], 0.0)
    if scene.camera.type == "PERSP":
        eye = np.append(np.linalg.inv(to_camera)[:3, 3], 1.0)
    headlight = -to_camera[2, :3] if scene.headlight else None
    shade = scene.transfer_function.shade
    return lighting(matrix, shade, scene.lights, headlight_direction=headlight, eye=eye, world=scene.world)


def lighting_key(scene: Scene, matrix, falling: Lighting) -> tuple:
    """Names all that the light on each voxel depends on beside its normal: the eye only where there are highlights."""
    seen_from = array_key(falling.eye) if falling.material[2] > 0.0 else None
    shade = tuple(asdict(scene.transfer_function.shade).values())
    return (array_key(matrix), shade, array_key(falling.rows, falling.material), seen_from)


def axes_steps(look: Look, quality: Quality, axes, job: Job, clock: Clock):
    """Generator of fractions done: as ``axis_steps`` for some principal axes, one after the other; returns the last."""
    for n, axis in enumerate(axes):
        steps = axis_steps(look, quality, axis, job, clock)
        while True:
            try:
                yield (n + next(steps)) / len(axes)
            except StopIteration as finished:
                made = finished.value
                break
    return made


def axis_steps(look: Look, quality: Quality, axis: int, job: Job, clock: Clock):
    """Generator of fractions done: the RunLengthVolume of one principal axis.

    Where the records of principal z, which are in the voxels' own order, are at hand, nothing is shaded again.
    """
    machine = dict(backend=quality.backend, threads=quality.threads)
    voxels = look.classified.voxels
    with clock.stage("encode"):
        tables = job.get("runs", (look.visible_key, axis), lambda: run_tables(voxels, axis, **machine))

    write = look.write_records(quality.model, **machine)

    def timed_write(*arguments):
        with clock.stage("shade"):
            return write(*arguments)

    def records():
        needs = look.estimate.one_axis()
        job.cache.make_room(needs.needed)
        refuse_too_much(needs)
        if job.has("records", key_of(IN_ORDER)):
            in_order = job.get("records", key_of(IN_ORDER), None)
            return (yield from reorder_steps(tables, voxels, in_order, **machine))
        decoding = None
        if quality.record != 16:
            brightest = color_bound(look.classified, look.falling)
            if brightest is None:
                brightest = yield from brightest_steps(voxels, timed_write)
            density = look.classified.looks[:, DENSITY[quality.model]].max(initial=0.0)
            decoding = decoding_of(quality.record, float(density), brightest)
        return (
            yield from record_steps(tables, voxels, timed_write, quality.model, quality.record, decoding, **machine)
        )

    def key_of(axis):
        return (look.key, quality.model, quality.record, axis)

    shaded_before = clock.stages["shade"]
    made = yield from timed(job.steps("records", key_of(axis), records, lambda e: e.voxel_data.nbytes), clock, "encode")
    clock.stages["encode"] -= clock.stages["shade"] - shaded_before
    return made


def classify_and_shade(scene: Scene, quality: Quality, clock: Clock):
    """(ClassifiedVolume, (m, 3) float32 shaded colours) of a scene, nothing kept."""
    look = drain(look_steps(scene, quality, StageCache(0).job(), clock))
    with clock.stage("shade"):
        machine = dict(backend=quality.backend, threads=quality.threads)
        colors = shaded_colors(look.classified, look.normals, look.falling, **machine)
    return look.classified, colors


def array_key(*arrays) -> tuple:
    return tuple(np.ascontiguousarray(array).tobytes() for array in arrays)


def _stored_medium(scene: Scene, quality: Quality) -> Medium:
    """The medium of a `.rle` file, whose classification, colours and model are what they are."""
    stored: StoredVolume = scene.volume
    if quality.model != stored.model:
        raise RleSplatError(
            f"This .rle file holds the {stored.model} model; render it with --model {stored.model}, or encode it again."
        )

    def encode_steps(axis: int):
        if axis not in stored.axes:
            raise RleSplatError(
                f"This view needs principal axis {AXIS_NAMES[axis]}, which the .rle file does not hold; "
                "encode the volume again with all three axes."
            )
        yield 1.0
        return stored.axes[axis]

    length = unit_length(stored, scene.index_to_world)
    if stored.model == "opacity":
        length = opacity_distance(stored, TransferFunction.from_json(stored.transfer_function), length)
    else:
        length /= stored.unit_length
    visible = next(iter(stored.axes.values())).visible_voxels
    return pre_classified(stored.shape_xyz, encode_steps, length, quality, scene.mist, visible)
