"""Linear interpolation between voxels."""

from __future__ import annotations

import numpy as np

from ..scene.further_volumes import CORNERS


def interpolate(voxels: np.ndarray, places) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate linearly between the eight voxels around each place.

    Parameters
    ----------
    voxels : (nz, ny, nx) ndarray
    places : sequence of three ndarrays of float
        Voxel indices x, y and z of the places, of one shape.

    Returns
    -------
    values : (m,) ndarray of float64
        Of the places inside, in the order of ``inside``.
    inside : ndarray of bool
        Of the shape of the places: which lie in the volume. Places up to half a voxel beyond the outermost centers
        count as these.
    """
    counts = voxels.shape[::-1]
    inside = np.logical_and.reduce([(p >= -0.5) & (p <= n - 0.5) for p, n in zip(places, counts)])
    places = [np.clip(p[inside], 0.0, n - 1.0) for p, n in zip(places, counts)]
    first = [np.minimum(p.astype(np.int64), max(n - 2, 0)) for p, n in zip(places, counts)]
    value = np.zeros(len(places[0]))
    for corner in CORNERS.astype(np.int64):
        share = np.prod([p - i if far else 1.0 - (p - i) for p, i, far in zip(places, first, corner)], axis=0)
        if not share.any():
            continue  # as for half of the corners of an axis-parallel plane through voxels
        ix, iy, iz = (np.minimum(i + far, n - 1) for i, far, n in zip(first, corner, counts))
        # A share of zero takes nothing, not even of a NaN.
        value += np.multiply(share, voxels[iz, iy, ix], out=np.zeros(len(share)), where=share > 0.0)
    return value, inside
