"""The stage of the normals, which takes over those that are kept of voxels seen before: a transfer function that shows
a few voxels more costs the gradients of those few."""

from __future__ import annotations

import numpy as np

from .classify.shading import normals
from .classify.visible import VisibleVoxels
from .kept import Job
from .volume.gradient import KnownNormals


def kept_normals(
    job: Job, key: tuple, voxels: VisibleVoxels, volume, index_to_world, *, backend: str = "auto", threads: int = 0
) -> np.ndarray:
    """(m, 3) float32 ``shading.normals`` of ``voxels``, which are voxels of ``volume``.

    ``key``: ((what the volume holds and who computes, which of its voxels), how it lies in the world).  Normals with
    the same first and last of these three are the same for the same voxel.
    """
    (volume_key, _), lie = key

    def serves(other, held) -> bool:
        return isinstance(held, KnownNormals) and other[0][0] == volume_key and other[1] == lie

    def make() -> KnownNormals:
        latest = job.latest("normals", serves)
        known = None if latest is None else job.get("normals", latest, None)
        found = normals(voxels, volume, index_to_world, known=known, backend=backend, threads=threads)
        return KnownNormals(voxels.row_start, voxels.column, found)

    # The lists of voxels are counted where they are kept themselves.
    return job.get("normals", key, make, lambda made: made.normals.nbytes).normals
