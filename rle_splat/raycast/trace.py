"""Follow single rays through the tables of a scalar volume."""

from __future__ import annotations

import numpy as np

from ..classify.lookup_table import LookupTable
from ..runtime.jit import compiled, parallel_call, read_only
from ..scene import Quality
from ..shade.sample_light import SampleLight
from ..splat.label_fields import NO_CELLS, cell_field
from ..splat.scalar_splat import LabelLook, channel_lookups, kernel_lookup, no_numbers
from ..splat.splat import OPAQUE
from ..volume.stored_scalars import StoredScalars
from . import reference
from .ray_light import ray_light
from .rays import ChannelVoxels, RayList, RowVoxels
from .scalar_rays import POWERS, trace_rays


def trace(
    voxels: RowVoxels, center: float, table: LookupTable, rays: RayList, slabs: int, quality: Quality,
    light: SampleLight | None = None, further: tuple[LookupTable, ...] = (), centers: tuple[float, ...] = (),
    labels: LabelLook | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Premultiplied rgba (n, 4) float32 of single rays, each voxel's depth cut into ``slabs`` at least; where along
    them half is absorbed (n,) float64, inf where less is; and their work (n, 2) int32, as ``trace_rays`` counts it.

    ``center``: what was taken from the stored values.  ``light``: that of which the voxels have codes; None where
    nothing shines.  ``further``, ``centers``: tables of further channels, and what was taken from their values.
    ``labels``: whose tables classify in place of ``table``.  No extinction is thinned.
    """
    lookup, least = kernel_lookup(table, center), max(quality.termination, OPAQUE)
    voxels = voxels._replace(codes=None) if light is None else voxels
    channels = channel_lookups(lookup, further, centers, voxels.codes, labels, center)
    field = None if labels is None else cell_field(labels.cells)
    count = len(rays.length)
    results = np.zeros((count, 4), np.float32), np.full(count, np.inf), np.zeros((count, 2), np.int32)
    pieces = [rays._replace(enter=enter, leave=leave) for enter, leave in zip(rays.enter, rays.leave, strict=True)]
    if not compiled():
        for piece in pieces:
            reference.trace_rays(voxels, piece, lookup, channels, field, light, slabs, least, results)
        return results
    if channels is not None:  # one kernel is for channels, labels and both
        field = field or NO_CELLS
        voxels = voxels._replace(further=voxels.further or _no_channels(len(voxels.scalars)))
    planes = len(further) + (0 if light is None else voxels.codes.shape[1])
    scratch = np.empty((count, POWERS + 1, planes))
    falling = None if light is None else ray_light(light, rays)
    with parallel_call(quality.threads):
        voxels = voxels._replace(scalars=StoredScalars.of(voxels.scalars))
        for piece in pieces:
            trace_rays(voxels, piece, lookup, channels, field, falling, slabs, least, scratch, results)
    return results


def _no_channels(count: int) -> ChannelVoxels:
    """What stands for further channels of ``count`` voxels that have none."""
    return ChannelVoxels(no_numbers(count, np.float32), read_only(np.empty((0, 2))), read_only(np.zeros(1, np.int64)))
