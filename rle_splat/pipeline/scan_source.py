"""Sources of classified sheets: a scan's voxels are classified and lit first, as in the paper.

What each stage result depends on, so that a change redoes no more than it must:

    blocks      the voxels
    visible     blocks, and which values the transfer function shows
    properties  visible, the transfer function, how long a unit of the volume is in the world
    normals     visible, and how the volume lies in the world
    shadows     properties, where a light is, meshes: one for each light that casts them
    runs        visible, and the principal axis
    records     properties, normals, lights and shadows, the model, and the principal axis
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..classify.classification import ClassifiedVolume, classify_voxels, unit_length
from ..classify.mixture import Mixture
from ..classify.relevant import count_kept, gather_steps
from ..classify.visible import Visibility, mark_steps
from ..effects.shadows import Occluders
from ..encode.encode import brightest_steps, record_steps, reorder_steps, table_steps
from ..encode.records import decoding_of
from ..runtime.memory import bytes_text
from ..runtime.steps import Clock, Progress, announce, drain, map_steps
from ..scene import Quality, Scene
from ..shade.lighting import Lighting
from ..shade.shading import DENSITY, color_bound, light_records, shaded_colors
from ..volume.axes import AXES
from ..volume.blocks import block_steps
from ..volume.gradient import normal_steps
from .lighting import lighting_key, scene_lighting, shadow_lighting_steps
from .medium import ClassifiedVoxels
from .memory_estimate import MemoryEstimate, PlannedTables, VoxelCount, estimate_tables
from .shadows import shadow_count
from .source import Source, Work, array_key
from .stage_cache import StageCache

IN_ORDER = 2  # the principal axis whose records are in the voxels' own order


@dataclass(frozen=True, eq=False)
class LitVolume:
    """A volume classified, and the light that falls on its voxels.

    Attributes
    ----------
    falling : Lighting or None
        None where nothing shines.
    visible_key, key : tuple
        All that the visible voxels, and all that their records, depend on.
    estimate : MemoryEstimate
        What all of it and its tables take.
    work : Work
        That its tables are part of.
    normals : (m, 3) float32 ndarray or None
        Of the visible voxels, world space; None without ``falling``, and before they are shaded.
    """

    source: ScanSource
    classified: ClassifiedVolume
    falling: Lighting | None
    visible_key: tuple = ()
    key: tuple = ()
    estimate: MemoryEstimate | None = None
    work: Work | None = None
    normals: np.ndarray | None = None

    @property
    def visible_voxels(self) -> int:
        return self.classified.visible_voxels

    @property
    def nan_voxels(self) -> int:
        return self.classified.nan_voxels

    @property
    def color_bound(self) -> float | None:
        """A bound of every channel of the lit colors; None where there is none but by looking at all of them."""
        return color_bound(self.classified, self.falling)

    def write_records(self, model: str):
        """For ``encode.record_steps``: a function that writes the records of some planes' voxels."""

        def write(positions, records):
            lit = self.classified, self.normals, self.falling
            return light_records(*lit, model, positions, records, threads=self.source.threads)

        return write

    def encode_steps(self, axis: int):
        """Generator of fractions done: the RunLengthVolume of one principal axis.

        Where all three are wanted, the one that the others take their records from comes first.
        """
        axes = tuple(dict.fromkeys((IN_ORDER, axis))) if self.work.axes == len(AXES) else (axis,)
        for n, one in enumerate(axes):
            tables = yield from map_steps(self._axis_steps(one), lambda done, n=n: (n + done) / len(axes))
        return tables

    def _axis_steps(self, axis: int):
        """``encode_steps`` of this axis alone.

        Where the records of principal z, which are in the voxels' own order, are at hand, nothing is shaded again.
        """
        work, quality, voxels = self.work, self.source.quality, self.classified.voxels
        job, clock, threads = work.job, work.clock, self.source.threads
        with clock.stage("encode"):
            make_steps = partial(table_steps, voxels, axis, threads=threads)
            tables = yield from job.steps("runs", (self.visible_key, axis), make_steps)
        write = clock.timing("shade", self.write_records(quality.model))

        def key_of(axis):
            return (self.key, quality.model, quality.record, axis)

        def records():
            work.claim(self.estimate.one_axis())
            if job.has("records", key_of(IN_ORDER)):
                in_order = job.get("records", key_of(IN_ORDER), None)
                return (yield from reorder_steps(tables, voxels, in_order, threads=threads))
            decoding = None
            if quality.record != 16:
                brightest = self.color_bound
                if brightest is None:
                    brightest = yield from brightest_steps(voxels, write)
                density = self.classified.properties[:, DENSITY[quality.model]].max(initial=0.0)
                decoding = decoding_of(quality.record, float(density), brightest)
            steps = record_steps(tables, voxels, write, quality.model, quality.record, decoding, threads=threads)
            return (yield from steps)

        steps = job.steps("records", key_of(axis), records, lambda encoded: encoded.voxel_data.nbytes)
        with clock.stage("encode"):
            return (yield from steps)


@dataclass(frozen=True, eq=False)
class ScanSource(Source):
    """A scan whose voxels are classified by one transfer function."""

    stage, mixed = "classify", False  # of the clock, the work of classifying; whether labels or channels take part

    # --- what differs between kinds of scans ----------------------------------------------------------------------

    @property
    def shown(self) -> Visibility:
        """Which voxels are visible."""
        return Visibility(self.scene.volume, self.scene.transfer_function)

    def mark_steps(self, shown, blocks):
        return mark_steps(shown, blocks, threads=self.threads)

    def classify(self, shown, voxels, length: float) -> ClassifiedVolume:
        return classify_voxels(shown, voxels, length, threads=self.threads)

    @property
    def record_type(self):
        """Type of the voxels for the estimate of memory: float32 where each has its own optical properties."""
        return np.float32 if self.scene.transfer_function.gradient_opacity is not None else None

    def normal_steps(self, voxels):
        """Generator of fractions: (m, 3) float32 unit normals of visible voxels, world."""
        rows = voxels.row_start, voxels.column
        return normal_steps(self.scene.volume, *rows, self.scene.index_to_world, threads=self.threads)

    # --- the stages -----------------------------------------------------------------------------------------------

    def classify_steps(self, work: Work):
        """Generator of Progress: the LitVolume of the scene, without its light."""
        scene, job, clock = self.scene, work.job, work.clock
        length = unit_length(scene.volume, scene.index_to_world)
        # A cache without room needs no content key, and large volumes no second reading for it.
        voxels_key = scene.volume.key if job.cache.keeps else ""
        shown = self.shown
        visible_key = (voxels_key, shown.key)
        falling = scene_lighting(scene, scene.index_to_world)
        voxels, needed = yield from self._visible_steps(work, shown, voxels_key, visible_key, falling is not None)
        with clock.stage(self.stage):
            key = (visible_key, scene.transfer_function.classification_key, length)
            found = job.get(
                "properties", key, lambda: self.classify(shown, voxels, length), lambda c: c.properties.nbytes
            )
        return LitVolume(self, found, falling, visible_key, key, needed, work)

    def shade_steps(self, voxels: LitVolume, work: Work):
        """Generator of Progress: the ClassifiedVoxels of the scene."""
        scene, quality, found = self.scene, self.quality, voxels.classified
        if voxels.falling is None:
            lit = replace(voxels, key=(voxels.key, "unshaded"))
        else:
            lit = yield from self._light_steps(voxels, work)
        length = found.opacity_distance if quality.model == "opacity" else 1.0
        return ClassifiedVoxels(lit, quality, scene.mist, length)

    def _light_steps(self, unlit: LitVolume, work: Work):
        """Generator of Progress: the LitVolume with its normals and its shadows."""
        scene, job, voxels = self.scene, work.job, unlit.classified.voxels
        matrix, visible_key = scene.index_to_world, unlit.visible_key
        with work.clock.stage("shade"):
            normals_key = (visible_key, array_key(matrix[:3, :3]))
            steps = job.steps("normals", normals_key, lambda: self.normal_steps(voxels))
            directions = yield from announce(steps, 0.1, 0.1, "Shading")

        def runs_steps(axis):
            return job.steps("runs", (visible_key, axis), partial(table_steps, voxels, axis, threads=self.threads))

        def extinction_steps():
            yield 0.0
            return unlit.classified.extinction

        around = matrix, scene.triangles, scene.clips
        occluders = Occluders(
            voxels, extinction_steps, runs_steps, *around, unlit.key, boxed=False, threads=self.threads,
        )  # fmt: skip
        falling, shadows_key = yield from shadow_lighting_steps(scene, unlit.falling, work, occluders)
        key = (unlit.key, *lighting_key(scene, matrix, unlit.falling), shadows_key)
        return replace(unlit, falling=falling, key=key, normals=directions)

    def _visible_steps(self, work: Work, shown, voxels_key, visible_key, shaded: bool):
        """Generator of Progress: the visible voxels, and the MemoryEstimate of all that is to come."""
        scene, job, clock = self.scene, work.job, work.clock

        shadows = shadow_count(scene) if shaded else 0
        tables = PlannedTables(self.quality.record, work.axes, shaded, shadows, self.mixed)

        def estimate_for(counted) -> MemoryEstimate:
            voxels = VoxelCount.in_rows(scene.volume, counted, self.record_type)
            return estimate_tables(voxels, tables, work.picture)

        if job.has("visible", visible_key):
            voxels = job.get("visible", visible_key, None)
            return voxels, estimate_for((np.diff(voxels.row_start), voxels.row_pieces))
        blocks_of = partial(block_steps, scene.volume, threads=self.threads)
        with clock.stage("classify"):
            steps = job.steps("blocks", voxels_key, blocks_of)
            blocks = yield from announce(steps, 0.0, 0.02, "Looking through the voxels")
        with clock.stage(self.stage):
            bits = yield from announce(self.mark_steps(shown, blocks), 0.02, 0.06, "Counting")
        counted = count_kept(bits, threads=self.threads)
        needed = estimate_for(counted)
        work.claim(needed)
        message = f"Classifying {needed.visible_voxels} voxels, about {bytes_text(needed.needed)} in all"
        yield Progress(0.06, message)
        gather = partial(gather_steps, scene.volume, bits, counted, blocks, threads=self.threads)
        with clock.stage(self.stage):
            return (yield from announce(job.steps("visible", visible_key, gather), 0.06, 0.1, message)), needed


@dataclass(frozen=True, eq=False)
class MixedSource(ScanSource):
    """A scan with labels or channels, which several transfer functions classify."""

    stage, mixed = "mixing", True

    @property
    def shown(self) -> Mixture:
        scene = self.scene
        return Mixture(scene.volume, scene.transfer_function, scene.labels, scene.channels)

    def mark_steps(self, shown, blocks):
        return shown.mark_steps(threads=self.threads)

    def classify(self, shown, voxels, length: float) -> ClassifiedVolume:
        return shown.classify(voxels, length, threads=self.threads)

    @property
    def record_type(self):
        return np.float32


def make_scan_source(scene: Scene, quality: Quality, *more) -> ScanSource:
    """The source of a scene's own voxels, classified before they are splatted; ``more``: see Source."""
    kind = MixedSource if scene.labels is not None or scene.channels else ScanSource
    return kind(scene, quality, *more)


def classify_and_shade(scene: Scene, quality: Quality, clock: Clock):
    """Classify and shade a scene's voxels, nothing kept.

    Returns
    -------
    ClassifiedVolume
    (m, 3) float32
        The lit colors of its visible voxels, scene-linear.
    """
    source = make_scan_source(scene, quality)
    lit = drain(source.medium_steps(Work(StageCache(0).job(), clock))).voxels
    with clock.stage("shade"):
        colors = shaded_colors(lit.classified, lit.normals, lit.falling, threads=source.threads)
    return lit.classified, colors
