"""The relevant voxels of a scene and their light, which are encoded along an axis, drawn in sheets and traced."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..classify.lookup_table import LookupTable, extinction_steps
from ..classify.relevant import Reach
from ..classify.visible import VisibleVoxels
from ..effects.ray_values import ValueMap, find_shown_values
from ..encode.scalars import ScalarVolume, center_of, in_scanlines, is_shared, scalar_table_steps, scalars_of
from ..raycast.rays import ChannelVoxels, RowVoxels, bricks_of
from ..raycast.trace import trace as trace_rays
from ..runtime.jit import read_only
from ..runtime.steps import drain, map_steps
from ..shade.lighting import Lighting
from ..shade.sample_light import SampleLight
from ..splat.scalar_splat import LabelLook
from .memory_estimate import MemoryEstimate
from .scalar_channels import ScalarChannel, center_ends, join_values
from .scalar_labels import ScalarLabels
from .scalar_light import IN_ROWS
from .source import Work

if TYPE_CHECKING:
    from ..volume.volume import Volume
    from .scalar_source import ScalarSource


@dataclass(frozen=True, eq=False)
class LitScalars:
    """The relevant voxels of a scene and their light, before a principal axis is chosen.

    Attributes
    ----------
    work : Work
        That its tables are part of.
    volume : Volume
        Whose values count: where labels hide, these are taken away from.
    key : tuple
        All that the voxels depend on.
    ends : tuple of float
        Smallest and largest stored value that is splatted.
    infinite : tuple of float
        Stored values that stand for minus and plus infinity; empty where nothing is infinite.
    length : float
        World length of a unit of the volume.
    transfer : LookupTable or ValueMap
        The lookup table of the transfer function; in a mode that shows values, how these are counted.
    estimate : MemoryEstimate
        What all of it and its tables take.
    falling : Lighting or None
        None where nothing shines.
    light : SampleLight or None
        Once it is shaded; None where nothing shines.
    codes : (m, channels) ndarray of int16 or None
        As ``encode.scalars.ScalarVolume`` has them, in rows, once it is shaded; None where nothing shines or thins.
    codes_key : tuple
        All that they depend on.
    thinned : bool
        Whether their last channel is a factor of extinction.
    channels : tuple of ScalarChannel
        Further ones.
    labels : ScalarLabels or None
        Whose functions classify in place of ``transfer``.
    """

    source: ScalarSource
    work: Work
    volume: Volume
    voxels: VisibleVoxels
    key: tuple
    ends: tuple
    infinite: tuple
    length: float
    transfer: LookupTable | ValueMap
    estimate: MemoryEstimate
    falling: Lighting | None
    light: SampleLight | None = None
    codes: np.ndarray | None = None
    codes_key: tuple = ()
    thinned: bool = False
    channels: tuple[ScalarChannel, ...] = ()
    labels: ScalarLabels | None = None

    @property
    def visible_voxels(self) -> int:
        return len(self.voxels)

    @property
    def nan_voxels(self) -> int:
        return self.voxels.nan_voxels

    @property
    def center(self) -> float:
        """What is taken from stored values before they are splatted."""
        return center_of(self.volume.voxels.dtype, self.ends)

    def extinction(self) -> np.ndarray:
        """(m,) float32 of the voxels by transfer functions alone, 1 / world length."""
        return drain(self.extinction_steps())

    def extinction_steps(self):
        """Generator of fractions done: as ``extinction``."""
        kind = self.volume.voxels.dtype
        if self.labels is not None:
            found = self.labels.extinction(self.voxels, kind, self.infinite)
        else:
            found = yield from extinction_steps(self.transfer, self.voxels.stored, kind, self.infinite)
        for channel in self.channels:
            found += yield from map_steps(channel.extinction_steps(), lambda _: 1.0)
        return found

    @property
    def parts(self) -> tuple[ScalarChannel, ...]:
        """All channels: the volume itself first."""
        volume, function = self.volume, self.source.scene.transfer_function
        own = ScalarChannel(
            volume, function, self.voxels, Reach.of(volume, function), self.ends, self.infinite, self.transfer
        )
        return (own, *self.channels)

    @property
    def functions_key(self) -> tuple:
        """The keys of all transfer functions, as far as they classify."""
        functions = (self.source.scene.transfer_function, *(channel.function for channel in self.channels))
        labels = () if self.labels is None else self.labels.key
        return (*(function.classification_key for function in functions), *labels)

    @property
    def centers(self) -> tuple[float, ...]:
        """``center`` of each further channel."""
        return tuple(channel.center for channel in self.channels)

    @property
    def further_tables(self) -> tuple[LookupTable, ...]:
        """The lookup table of each further channel."""
        return tuple(channel.transfer for channel in self.channels)

    @property
    def values_key(self) -> tuple:
        """All that the values of further channels depend on."""
        return (self.key, *(channel.values_key for channel in self.channels))

    def encode_steps(self, axis: int):
        """Generator of fractions done: the ScalarVolume of one principal axis."""
        voxels, job, clock, threads = self.voxels, self.work.job, self.work.clock, self.source.threads
        kind = self.source.scene.volume.voxels.dtype
        with clock.stage("encode"):
            make_steps = partial(scalar_table_steps, voxels, axis, threads=threads)
            tables = yield from job.steps("runs", (self.key, axis), make_steps)
        order = IN_ROWS if is_shared(axis) else axis

        def place_steps(words):
            return in_scanlines(tables, voxels, words, threads=threads)

        def scalars():
            self.work.claim(self.estimate.one_axis())
            return place_steps(scalars_of(voxels, kind, self.infinite, self.center))

        steps = job.steps("scalars", (self.key, self.infinite, self.center, order), scalars)
        with clock.stage("encode"):
            placed = yield from steps
        values = codes = None
        if self.channels:
            steps = job.steps("values", (self.values_key, order), lambda: place_steps(join_values(self.channels)))
            with clock.stage("mixing"):
                values = yield from steps
        if self.codes is not None:
            steps = job.steps("codes", (self.codes_key, order), lambda: place_steps(self.codes.view(np.uint16)))
            # As with classified voxels, whose records are lit already.
            with clock.stage("shade"):
                codes = (yield from steps).view(np.int16)
        return ScalarVolume(tables, placed, self.center, codes, self.light, self.thinned, values, self.centers)

    def trace(self, rays, slabs: int):
        """Color, half depths and work of single rays through the voxels."""
        scene, voxels, job = self.source.scene, self.voxels, self.work.job
        shape, ends = scene.volume.shape_xyz, (self.infinite, self.center)
        bricks = job.get("bricks", self.key, lambda: bricks_of(voxels.bits, shape))
        key = (self.key, *ends, IN_ROWS)
        scalars = job.get("scalars", key, lambda: scalars_of(voxels, scene.volume.voxels.dtype, *ends))
        codes = None if self.codes is None else read_only(self.codes)
        # Of the function as it is: what is kept may be more.
        reach = Reach.of_values(scene.volume, find_shown_values(scene.transfer_function, scene.mode))
        shown = center_ends(reach, self.center)
        look = None
        if self.labels is not None:
            shown = np.concatenate((shown, center_ends(self.labels.functions.reach(scene.volume), self.center)))
            look = LabelLook(self.labels.cells, self.labels.tables)
        rows = RowVoxels(
            voxels.bits, voxels.row_start, bricks, read_only(scalars), codes, shown, shape[::-1], self._channel_rows()
        )
        return trace_rays(
            rows, self.center, self.transfer, rays, slabs, self.source.quality, self.light, self.further_tables,
            self.centers, look,
        )  # fmt: skip

    def _channel_rows(self) -> ChannelVoxels | None:
        """Further channels for single rays; None without any."""
        if not self.channels:
            return None
        key = (self.values_key, IN_ROWS)
        values = self.work.job.get("values", key, lambda: join_values(self.channels))
        shown = [center_ends(channel.reach, channel.center) for channel in self.channels]
        begins = np.cumsum([0, *map(len, shown)], dtype=np.int64)
        return ChannelVoxels(*map(read_only, (values, np.concatenate(shown), begins)))
