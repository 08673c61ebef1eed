"""Voxels averaged before they are splatted, where many share a pixel: the minification "pool".

The voxels are classified and shaded as ever; what is encoded are nodes of 2^level voxels a side.  Neither the tables
nor a frame's time depends on how much finer the volume is than the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..encode.encode import encode
from ..encode.pooling import node_to_voxel, nodes_shape, pooled_steps
from ..encode.store import StoredVolume
from ..runtime.steps import Clock, timed
from ..scene import Quality, RleSplatError, Scene
from ..view.base_plane import BasePlane
from .medium import look_steps, pre_classified
from .stage_cache import Job


@dataclass(frozen=True, eq=False)
class PooledVolume:
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


def pooled_scene(scene: Scene, planes: list[BasePlane]) -> Scene:
    """The scene with its volume in nodes as large as fit into a sheet pixel, on all of its whole base planes.

    Nodes are doubled voxels, and where one covers less than a sheet pixel, its footprint is widened.
    """
    if isinstance(scene.volume, StoredVolume):
        raise RleSplatError(
            "A .rle file holds voxels that are encoded already, of which no averages are made; choose the minification "
            "widen or off."
        )
    pixels_a_voxel = max((float(plane.scale.max()) for plane in planes), default=1.0)
    level = math.floor(-math.log2(pixels_a_voxel)) if pixels_a_voxel < 1.0 else 0
    level = min(level, (max(scene.volume.shape_xyz) - 1).bit_length())
    return replace(scene, volume=PooledVolume(scene.volume, level)) if level else scene


def _bytes_of(made) -> int:
    """Of nodes and their colours, as ``pooled_steps`` makes them."""
    nodes, colors = made
    return nodes.voxels.nbytes + nodes.looks.nbytes + colors.nbytes


def pooled_medium_steps(scene: Scene, quality: Quality, job: Job, clock: Clock, axes: int = 1, picture: int = 0):
    """Generator of Progress: the Medium of a scene of a PooledVolume; as ``medium.medium_steps``."""
    pooled: PooledVolume = scene.volume
    look = yield from look_steps(replace(scene, volume=pooled.source), quality, job, clock, axes, picture)
    machine = dict(backend=quality.backend, threads=quality.threads)
    write = look.write_records("extinction", **machine)
    key = (look.key, pooled.level)

    def timed_write(*arguments):
        with clock.stage("shade"):
            return write(*arguments)

    def node_steps():
        voxels = look.classified.voxels
        return pooled_steps(voxels, timed_write, pooled.level, look.classified, **machine)

    def tables(axis: int, nodes, colors):
        yield 1.0
        return encode(nodes, colors, axis, record=quality.record, **machine)

    def encode_steps(axis: int):
        shaded_before = clock.stages["shade"]
        nodes = yield from timed(job.steps("nodes", key, node_steps, _bytes_of), clock, "encode")
        clock.stages["encode"] -= clock.stages["shade"] - shaded_before
        steps = job.steps("node records", (key, quality.record, axis), lambda: tables(axis, *nodes))
        return (yield from timed(steps, clock, "encode"))

    found = look.classified
    return pre_classified(
        found.shape_xyz, encode_steps, 1.0, quality, scene.mist, found.visible_voxels, found.nan_voxels, look.estimate
    )
