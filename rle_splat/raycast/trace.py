"""Follow single rays through the tables of a scalar volume."""

from __future__ import annotations

import numpy as np

from ..classify.lookup_table import LookupTable
from ..runtime.jit import compiled, parallel_call
from ..scene import Quality
from ..splat.scalar_splat import kernel_light_planes, kernel_lookup
from ..splat.splat import OPAQUE
from . import reference
from .scalar_rays import POWERS, RayList, RowVoxels, trace_rays


def trace(
    voxels: RowVoxels, center: float, table: LookupTable, rays: RayList, slabs: int, quality: Quality, work=None
) -> tuple[np.ndarray, np.ndarray]:
    """Premultiplied rgba (n, 4) float32 of single rays, each voxel's depth cut into ``slabs`` at least, and where along
    them half is absorbed (n,) float64, inf where less is.

    ``center``: what was taken from the stored values.  ``work``: filled as ``trace_rays`` does, (n, 2) int32, or None.
    No extinction is thinned.
    """
    lookup, (matt, gloss) = kernel_lookup(table, center), kernel_light_planes(voxels.lights, False)
    least = max(quality.termination, OPAQUE)
    out, half = np.zeros((len(rays.enter), 4), np.float32), np.full(len(rays.enter), np.inf)
    results = out, half, np.empty((len(out), 2), np.int32) if work is None else work
    arguments = (voxels, rays, lookup, matt, gloss, slabs, least)
    if not compiled():
        reference.trace_rays(*arguments, results)
        return out, half
    cubics = np.empty((len(out), POWERS * (len(matt) + len(gloss))))
    with parallel_call(quality.threads):
        trace_rays(*arguments, cubics, results)
    return out, half
