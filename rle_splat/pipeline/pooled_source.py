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
from .scan_source import ScanSource, classified_sheets
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

    scan: ScanSource

    @property
    def level(self) -> int:
        return self.scene.volume.level

    @property
    def node_size(self) -> int:
        return 2**self.level

    def medium_steps(self, work: Work):
        job, clock, quality = work.job, work.clock, self.quality
        lit = yield from self.scan.lit_steps(work)
        write = clock.timing("shade", lit.write_records("extinction"))
        key = (lit.key, self.level)

        def node_steps():
            return pooled_steps(lit.classified.voxels, write, self.level, lit.classified, threads=self.threads)

        def tables(axis: int, nodes, colors):
            yield 1.0
            return encode(nodes, colors, axis, record=quality.record, threads=self.threads)

        def encode_steps(axis: int):
            nodes = yield from timed(job.steps("nodes", key, node_steps, _bytes_of), clock, "encode")
            steps = job.steps("node records", (key, quality.record, axis), lambda: tables(axis, *nodes))
            return (yield from timed(steps, clock, "encode"))

        found = lit.classified
        counts = found.visible_voxels, found.nan_voxels, lit.estimate
        return classified_sheets(encode_steps, 1.0, quality, self.scene.mist, *counts)


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
    return PooledSource(replace(scan.scene, volume=PooledGrid(scan.scene.volume, level)), scan.quality, scan)


def _bytes_of(made) -> int:
    """Of nodes and their colors, as ``pooled_steps`` makes them."""
    nodes, colors = made
    return nodes.voxels.nbytes + nodes.properties.nbytes + colors.nbytes
