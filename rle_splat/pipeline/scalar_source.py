"""Source of scalar sheets: values are interpolated first, and classified in every pixel of a sheet.

What each stage result depends on, so that a change redoes no more than it must:

    blocks    the voxels
    relevant  blocks, and the range of values that the transfer function shows, or, where each sheet stands for itself,
              a wider one that is kept; there short gaps are closed, too
    revealed  the voxels, and where labels hide; in a mode of values, and what stands for hidden ones
    labels    the label map, and which labels look alike
    factor    relevant, where labels hide, and the transfer function
    gradients relevant, where opacity depends on them; thinned, from gradients and codes
    values    relevant, of further channels, and the principal axis
    extinction  relevant, factor, and the transfer function: for shadows
    codes     relevant, and what ``scalar_light`` says; the light itself is made where a sheet reads them
    runs      relevant, and the principal axis
    scalars   relevant, and the principal axis
    table     the transfer function: nothing else depends on it

Of several channels, voxels are kept that matter to any of them.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ..classify.classification import unit_length
from ..classify.gaps import close_gaps
from ..classify.limits import LEAST_DISTANCE
from ..classify.lookup_table import LookupTable
from ..classify.mixture import Mixture
from ..classify.relevant import Reach, count_kept, gather_steps, relevant_steps
from ..classify.visible import VisibleVoxels
from ..effects.mixing import is_masked, is_sampled
from ..effects.ray_mode import OF_VALUES
from ..effects.ray_values import ValueMap, find_shown_values, find_value_hidden, value_map
from ..effects.shadows import Occluders
from ..encode.scalars import scalar_table_steps
from ..runtime.memory import bytes_text
from ..runtime.steps import Progress, announce
from ..scene import preintegrated_of
from ..shade.shading import refuse_too_bright
from ..splat.scalar_splat import LabelLook
from ..view.depth_rules import value_rule
from ..volume.blocks import Blocks, block_steps
from ..volume.gradient_size import gradient_sizes
from .lighting import scene_lighting
from .lit_scalars import LitScalars
from .medium import Medium, ScalarVoxels, mist_color
from .memory_estimate import MemoryEstimate, PlannedTables, VoxelCount, estimate_tables
from .scalar_channels import ScalarChannel, find_value_ends, make_channel_table
from .scalar_labels import LabelFunctions, ScalarLabels
from .scalar_light import code_steps, light_of, with_factor
from .shadows import node_side, shadow_count
from .source import Source, Work, array_key

ONE_VOXEL_THICK = (
    "The volume is one voxel thick, so nothing is shown: the classification post fills the space between voxel "
    "centers; choose the classification pre (Interpolate: Colors)."
)
# A wider range that is kept is used as it is while it reaches at most so many times as many blocks of voxels.
WORTH_KEEPING = 2.0
HIDING, BOUNDING = "Hiding labels", "Finding the boundaries of labels"
FINDING = "Finding the voxels that matter"


@dataclass(frozen=True, eq=False)
class RelevantVoxels:
    """The ``voxels`` that matter to a range of values, ``reach``; ``closed``: and those in short gaps between them.

    ``found``: how many they are, for estimates of memory.  ``further``: of each further channel what it shows, and its
    values of the same voxels.
    """

    reach: Reach
    voxels: VisibleVoxels
    closed: bool
    found: VoxelCount
    further: tuple[tuple[Reach, VisibleVoxels], ...] = ()

    @property
    def key(self) -> tuple:
        return _relevant_key(self.reach, [reach for reach, _ in self.further], self.closed)

    @property
    def nbytes(self) -> int:
        return self.voxels.nbytes + sum(voxels.stored.nbytes for _, voxels in self.further)


def _relevant_key(reach: Reach, further, closed: bool) -> tuple:
    """``further``: the Reach of each further channel."""
    return (*reach.key, *(each.key for each in further), closed)


@dataclass(frozen=True, eq=False)
class ScalarSource(Source):
    """A scan whose values are interpolated inside each sheet and then classified."""

    scalar_sheets, traces_rays = True, True

    @property
    def depth_rule(self) -> str:
        rule = self.quality.depth_rule
        return value_rule(rule) if self.shows_values else rule

    @property
    def _mixture(self) -> Mixture:
        return Mixture(self.scene.volume, self.scene.transfer_function, self.scene.labels)

    @cached_property
    def _labels(self) -> LabelFunctions | None:
        """The functions of labels where each sample looks its own up."""
        if not is_sampled(self.scene):
            return None
        return LabelFunctions.of(self.scene.labels, self.scene.transfer_function)

    @property
    def shows_values(self) -> bool:
        """Whether a pixel shows a value of its ray in place of emission and absorption."""
        return self.scene.mode in OF_VALUES

    def remarks_on(self, medium: Medium) -> tuple[str, ...]:
        if min(self.scene.volume.shape_xyz) == 1:
            return (ONE_VOXEL_THICK,)
        return super().remarks_on(medium)

    # --- the stages -----------------------------------------------------------------------------------------------

    def classify_steps(self, work: Work):
        """Generator of Progress: the LitScalars of the scene, without their light."""
        scene, job, clock = self.scene, work.job, work.clock
        volume = scene.volume
        length = unit_length(volume, scene.index_to_world)
        voxels_key = volume.key if job.cache.keeps else ""
        if scene.channels and job.cache.keeps:
            voxels_key = (voxels_key, *(channel.volume.key for channel in scene.channels))
        if scene.labels is not None and (self._labels is None or self._labels.hides):
            voxels_key = (voxels_key, self._mixture.key)
            hide_steps = partial(self._mixture.reveal_steps, threads=self.threads)
            if is_masked(scene):
                stored = find_value_hidden(volume, scene.transfer_function, scene.mode)
                voxels_key = (*voxels_key, float(stored))
                hide_steps = partial(self._mixture.mask_steps, stored)
            steps = job.steps("revealed", voxels_key, hide_steps, _bytes_of)
            with clock.stage("mixing"):
                volume = yield from announce(steps, 0.0, 0.0, HIDING)
        steps = job.steps("blocks", voxels_key, partial(block_steps, volume, threads=self.threads))
        with clock.stage("classify"):
            blocks = yield from announce(steps, 0.0, 0.02, "Looking through the voxels")
        further = yield from self._channel_blocks(work)
        falling = scene_lighting(scene, scene.index_to_world)
        cells = None
        if self._labels is not None:
            with clock.stage("mixing"):
                steps = job.steps("labels", self._labels.key, self._labels.cell_steps)
                cells = yield from announce(steps, 0.02, 0.02, BOUNDING)
        relevant, needed = yield from self._relevant_steps(
            work, volume, blocks, further, cells, voxels_key, falling is not None
        )  # fmt: skip
        with clock.stage("classify"):
            ends, infinite = find_value_ends(volume, scene.transfer_function, blocks)
            transfer = self._transfer(work, voxels_key, ends, length)
            channels = self._channels(work, relevant, further, length)
            labels = None if cells is None else ScalarLabels.of(self._labels, cells, transfer, volume, ends, length)
        key = voxels_key, relevant.key
        if labels is not None:
            key = (*key, labels.key)
        return LitScalars(
            self, work, volume, relevant.voxels, key, ends, infinite, length, transfer, needed, falling,
            channels=channels, labels=labels,
        )  # fmt: skip

    def _channel_blocks(self, work: Work):
        """Generator of Progress: the Blocks of each further channel."""
        found = []
        for number, channel in enumerate(self.scene.channels):
            key = channel.volume.key if work.job.cache.keeps else number
            steps = work.job.steps("blocks", key, partial(block_steps, channel.volume, threads=self.threads))
            with work.clock.stage("mixing"):
                found.append((yield from announce(steps, 0.02, 0.02, "Looking through the channels")))
        return found

    def _channels(self, work: Work, relevant: RelevantVoxels, blocks, length: float) -> tuple[ScalarChannel, ...]:
        """The further channels, of which ``blocks`` are known."""
        found = []
        for number, (channel, own, (reach, voxels)) in enumerate(zip(self.scene.channels, blocks, relevant.further)):
            volume, function = channel.volume, channel.transfer_function
            ends, infinite = find_value_ends(volume, function, own)
            key = (volume.key if work.job.cache.keeps else number, function.classification_key, length, "further")
            given = self.scene.volume, volume, function, ends, length
            table = work.job.get("table", key, partial(make_channel_table, *given))
            found.append(ScalarChannel(volume, function, voxels, reach, ends, infinite, table))
        return tuple(found)

    def shade_steps(self, voxels: LitScalars, work: Work):
        """Generator of Progress: the ScalarVoxels of the scene."""
        scene, job, clock, unlit = self.scene, work.job, work.clock, voxels
        tf, key, length = scene.transfer_function, unlit.key, unlit.length
        factor = hidden_key = None
        if scene.labels is not None and unlit.labels is None and not is_masked(scene):
            step = max(length * float(unlit.volume.spacing.min()), LEAST_DISTANCE)
            hidden_key = key, tf.classification_key, length
            factor = yield from self._hide_steps(work, unlit.voxels, hidden_key, lambda: unlit.extinction() * step)
        if tf.gradient_opacity is not None and not self.shows_values:
            with clock.stage("gradients"):
                by_gradient = self._factor(work, unlit.voxels, key)
                factor = by_gradient if factor is None else factor * by_gradient

        def table_steps(axis):
            return job.steps("runs", (key, axis), partial(scalar_table_steps, unlit.voxels, axis, threads=self.threads))

        blocking_key = key, *unlit.functions_key, length

        def make_extinction_steps():
            found = yield from unlit.extinction_steps()
            return found if factor is None else found * factor

        def extinction_steps():
            return job.steps("extinction", blocking_key, make_extinction_steps)

        around = scene.index_to_world, scene.triangles, scene.clips
        occluders = Occluders(
            unlit.voxels, extinction_steps, table_steps, *around, blocking_key, boxed=True, threads=self.threads
        )
        codes, codes_key = None, ()
        if unlit.falling is not None:
            yield Progress(0.1, "Shading")
            side = node_side(self.quality)
            codes, codes_key = yield from code_steps(scene, unlit, occluders, side, work, self.threads)
        if factor is not None:
            codes_key = (codes_key, hidden_key, key, tf.gradient_opacity)
            codes = job.get("thinned", codes_key, lambda: with_factor(codes, factor))
        light = light_of(scene, unlit.falling)
        lit = replace(unlit, light=light, codes=codes, codes_key=codes_key, thinned=factor is not None)
        return ScalarVoxels(
            lit, self.quality, scene.mist, lit.transfer, self._most_color(lit), absorbs=scene.mode == "xray",
            further=lit.further_tables,
            labels=None if lit.labels is None else LabelLook(lit.labels.cells, lit.labels.tables),
        )  # fmt: skip

    def _relevant_steps(self, work: Work, volume, blocks: Blocks, further_blocks, cells, voxels_key, lit: bool):
        """Generator of Progress: the RelevantVoxels of the scene, and the MemoryEstimate of all that is to come.

        ``further_blocks``: the Blocks of each further channel.  ``cells``: LabelCells, or None.
        """
        job, clock = work.job, work.clock
        reach = Reach.of_values(volume, find_shown_values(self.scene.transfer_function, self.scene.mode))

        channels = self.scene.channels
        further = [Reach.of(channel.volume, channel.transfer_function) for channel in channels]
        labeled, shadows = self.scene.labels is not None, shadow_count(self.scene) if lit else 0
        thinned = self.scene.transfer_function.gradient_opacity is not None
        if cells is not None:
            by_labels = self._labels.reach(volume)
        exact = bool(self.quality.exact_light)
        tables = PlannedTables(0, work.axes, lit, shadows, labeled, thinned, len(channels), cells is not None, exact)

        def estimate_for(found: VoxelCount) -> MemoryEstimate:
            return estimate_tables(found, tables, work.picture)

        # Between sheets both ends of a slab count, so that voxels which need not be kept would change what is seen
        # where the other end is not kept: pictures must not depend on what was shown before.  Nor may a ray's value.
        between = preintegrated_of(self.quality.depth_rule) is not None or self.shows_values
        # What is no number is never kept.  With several channels what is kept is what any of them shows now.
        exact = between or bool(channels) or cells is not None
        closed = not exact and blocks.nan_voxels == 0

        own_key = (voxels_key, _relevant_key(reach, further, closed))

        def serves(key, held: RelevantVoxels) -> bool:
            if exact or len(key) != len(own_key) or key[0] != voxels_key or not held.reach.covers(reach):
                return False
            held_blocks, blocks_shown = (np.count_nonzero(one.of_blocks(blocks)) for one in (held.reach, reach))
            return held_blocks <= WORTH_KEEPING * blocks_shown

        key = own_key if cells is None else (*own_key, self._labels.key, by_labels.key)
        found = None if job.has("relevant", key) else job.latest("relevant", serves)
        if found is not None:
            key = found
        if job.has("relevant", key):
            relevant = job.get("relevant", key, None)
            return relevant, estimate_for(relevant.found)
        with clock.stage("classify"):
            steps = relevant_steps(volume, reach, blocks, threads=self.threads)
            bits = yield from announce(steps, 0.02, 0.08, FINDING)
        for channel, own, shown in zip(channels, further_blocks, further, strict=True):
            with clock.stage("mixing"):
                steps = relevant_steps(channel.volume, shown, own, threads=self.threads)
                bits |= yield from announce(steps, 0.08, 0.08, FINDING)
        if cells is not None:
            with clock.stage("mixing"):
                steps = relevant_steps(volume, by_labels, blocks, threads=self.threads)
                shown = yield from announce(steps, 0.08, 0.08, FINDING)
                bits |= yield from announce(self._labels.mask_steps(cells, shown), 0.08, 0.08, FINDING)
        with clock.stage("classify"):
            if closed:
                close_gaps(bits, volume.shape_xyz, threads=self.threads)
                yield Progress(0.08, FINDING)
            counted = count_kept(bits, threads=self.threads)
        counts = VoxelCount.in_rows(volume, counted)
        needed = estimate_for(counts)
        work.claim(needed)
        keeping = f"Keeping {needed.visible_voxels} voxels, about {bytes_text(needed.needed)} in all"
        yield Progress(0.08, keeping)

        def gather():
            lists = []
            for part, own in zip((volume, *(channel.volume for channel in channels)), (blocks, *further_blocks)):
                lists.append((yield from gather_steps(part, bits, counted, own, threads=self.threads)))
            voxels = lists[0]
            others = tuple((shown, replace(voxels, stored=own.stored)) for shown, own in zip(further, lists[1:]))
            return RelevantVoxels(reach, voxels, closed, counts, others)

        with clock.stage("classify"):
            relevant = yield from announce(job.steps("relevant", key, gather), 0.08, 0.08, keeping)
        return relevant, needed

    def _transfer(self, work: Work, voxels_key, ends, length: float) -> LookupTable | ValueMap:
        volume, tf = self.scene.volume, self.scene.transfer_function
        if self.shows_values:
            return value_map(volume, tf, self.scene.mode, ends, is_masked(self.scene))
        key = (voxels_key, tf.classification_key, length)
        return work.job.get("table", key, lambda: make_channel_table(volume, volume, tf, ends, length))

    def _hide_steps(self, work: Work, voxels: VisibleVoxels, key, depth):
        """Generator of Progress: what the labels leave of extinction, (m,) float32; ``depth()``: see Mixture."""
        steps = work.job.steps("factor", key, lambda: self._mixture.factor_steps(voxels, depth(), threads=self.threads))
        with work.clock.stage("mixing"):
            return (yield from announce(steps, 0.1, 0.1, HIDING))

    def _factor(self, work: Work, voxels: VisibleVoxels, key) -> np.ndarray:
        """(m,) float32: what the transfer function multiplies extinction by, by the size of each voxel's gradient."""
        volume = self.scene.volume
        placed_key = (key, array_key(volume.affine[:3, :3]))
        rows = voxels.row_start, voxels.column
        sizes = work.job.get("gradients", placed_key, lambda: gradient_sizes(volume, *rows, threads=self.threads))
        return self.scene.transfer_function.gradient_opacity.factor(sizes)

    def _most_color(self, lit: LitScalars) -> float:
        scene, light = self.scene, lit.light
        if self.shows_values:
            return lit.transfer.most
        if scene.mode != "composite":
            return 1.0
        shine = (1.0, 0.0) if light is None else (light.most_light, light.most_highlight)
        own = (lit.transfer,) if lit.labels is None else lit.labels.tables
        most_color = max(table.most_color for table in (*own, *lit.further_tables))
        brightest = refuse_too_bright(most_color * shine[0] + shine[1])
        return max(brightest, *mist_color(scene.mist))


def _bytes_of(volume) -> int:
    """Of a volume whose voxels are a copy."""
    return volume.voxels.nbytes
