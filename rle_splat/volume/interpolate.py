"""Linear interpolation between voxels."""

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
    shares = [(1.0 - (p - i), p - i) for p, i in zip(places, first)]  # of the voxels before and after a place
    steps = [step if n > 1 else 0 for n, step in zip(counts, (1, counts[0], counts[0] * counts[1]))]
    stored = voxels.reshape(-1)
    base = first[0] + counts[0] * (first[1] + counts[1] * first[2])
    value = np.zeros(len(base))
    for corner in CORNERS.astype(np.int64):
        share = shares[0][corner[0]] * shares[1][corner[1]] * shares[2][corner[2]]
        if not share.any():
            continue  # as for half of the corners of an axis-parallel plane through voxels
        found = stored[base + corner @ steps]
        if found.dtype.kind == "f":
            found = np.where(share > 0.0, found, 0.0)  # a share of zero takes nothing, not even of a NaN
        value += share * found
    return value, inside
