"""Source of pooled sheets: voxels averaged before they are splatted, where many share a pixel (minification "pool").

The voxels are classified and lit as ever; what is encoded are nodes of 2^level voxels a side.  Neither the tables nor a
frame's time depends on how much finer the volume is than the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..encode.encode import encode
from ..encode.pooling import node_to_voxel, nodes_shape, pooled_steps
from ..runtime.steps import timed
from ..view.base_plane import BasePlane
from .medium import ClassifiedVoxels
from .scan_source import LitVolume, ScanSource
from .source import Source, Work


@dataclass(frozen=True, eq=False)
class PooledGrid:
    """A volume in nodes of 2^``level`` voxels a side of ``source``: where they lie, not what is in them."""

    source: object
    level: int

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        return nodes_shape(self.source.shape_xyz, self.level)[::-1]

    @property
    def affine(self) -> np.ndarray:
        """(4, 4) float64, node index to the volume's own space."""
        return self.source.affine @ node_to_voxel(self.level)

    @property
    def remarks(self) -> tuple:
        return self.source.remarks


@dataclass(frozen=True, eq=False)
class PooledSource(Source):
    """Nodes of a scan's classified voxels.  ``scan``: the source of the voxels."""

    scan: ScanSource | None = None

    @property
    def level(self) -> int:
        return self.scene.volume.level

    @property
    def node_size(self) -> int:
        return 2**self.level

    def classify_steps(self, work: Work):
        return self.scan.classify_steps(work)

    def shade_steps(self, voxels, work: Work):
        lit = (yield from self.scan.shade_steps(voxels, work)).voxels
        return ClassifiedVoxels(PooledVoxels(self, lit), self.quality, self.scene.mist, 1.0)


@dataclass(frozen=True, eq=False)
class PooledVoxels:
    """The nodes of a lit volume, before they are encoded."""

    source: PooledSource
    lit: LitVolume

    @property
    def visible_voxels(self) -> int:
        return self.lit.visible_voxels

    @property
    def nan_voxels(self) -> int:
        return self.lit.nan_voxels

    @property
    def estimate(self):
        return self.lit.estimate

    def encode_steps(self, axis: int):
        lit, source = self.lit, self.source
        job, clock, record, machine = lit.work.job, lit.work.clock, source.quality.record, source.machine
        write = clock.timing("shade", lit.write_records("extinction"))
        key = (lit.key, source.level)

        def node_steps():
            return pooled_steps(lit.classified.voxels, write, source.level, lit.classified, **machine)

        def tables(nodes, colors):
            yield 1.0
            return encode(nodes, colors, axis, record=record, **machine)

        nodes = yield from timed(job.steps("nodes", key, node_steps, _bytes_of), clock, "encode")
        steps = job.steps("node records", (key, record, axis), lambda: tables(*nodes))
        return (yield from timed(steps, clock, "encode"))


def pooled(scan: ScanSource, planes: list[BasePlane]) -> Source:
    """The source with nodes as large as fit into a sheet pixel, on all of its whole base planes.

    Nodes are doubled voxels, and where one covers less than a sheet pixel, its footprint is widened.
    """
    shape_xyz = scan.scene.volume.shape_xyz
    pixels_a_voxel = max((float(plane.scale.max()) for plane in planes), default=1.0)
    level = math.floor(-math.log2(pixels_a_voxel)) if pixels_a_voxel < 1.0 else 0
    level = min(level, (max(shape_xyz) - 1).bit_length())
    if level == 0:
        return scan
    scene = replace(scan.scene, volume=PooledGrid(scan.scene.volume, level))
    return PooledSource(scene, scan.quality, scan.effects, scan.notes, scan.plan, scan)


def _bytes_of(made) -> int:
    """Of nodes and their colors, as ``pooled_steps`` makes them."""
    nodes, colors = made
    return nodes.voxels.nbytes + nodes.properties.nbytes + colors.nbytes
