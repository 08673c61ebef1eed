"""Light that is made of normals where it is read: the kernels of ``lamp_groups`` once more in numpy."""

from __future__ import annotations

import numpy as np

from ...shade.normal_light import EVERYWHERE, GLOSS, HALFWAY, MATT, PART_BITS, RAY, TOWARDS, TWO_SIDED, Lamps


def light_of_normals(lamps: Lamps, channels: int, normals: np.ndarray, place) -> np.ndarray:
    """Light of some voxels of a scanline, one after the other, by their normals: as ``lamp_groups``.

    Parameters
    ----------
    lamps : Lamps
    channels : int
        See NormalLight.
    normals : (3, k) ndarray of int16
    place : (int, int, int)
        Voxel of the first along its scanline, scanline, slice.

    Returns
    -------
    (k, channels) ndarray of float32
    """
    n = normals.T.astype(np.float64)  # rounding made them longer or shorter
    n /= np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1.0)
    everywhere, two_sided = lamps.surface[EVERYWHERE:TWO_SIDED].astype(np.float64), lamps.surface[TWO_SIDED] > 0.0
    matt, gloss = np.tile(everywhere, (len(n), 1)), np.zeros((len(n), 3))
    to_eye = np.zeros((len(n), 3))
    if lamps.is_near:
        x, scanline, k = place
        at = np.column_stack((x + np.arange(len(n)), *(np.full(len(n), one) for one in (scanline, k, 1.0))))
        to_eye = at @ lamps.from_line.T
        to_eye /= np.maximum(np.linalg.norm(to_eye, axis=1, keepdims=True), 1e-30)
    power = lamps.whole + lamps.parts / 2**PART_BITS
    for ray in lamps.rays.astype(np.float64):
        facing = n @ ray[TOWARDS:HALFWAY]
        matt += np.maximum(-facing, two_sided * facing)[:, None] * ray[MATT:GLOSS]
        halfway = ray[HALFWAY:MATT]
        if lamps.is_near:
            halfway = ray[TOWARDS:HALFWAY] + to_eye
            halfway /= np.maximum(np.linalg.norm(halfway, axis=1, keepdims=True), 1e-6)
        cosine = np.abs((n * halfway).sum(axis=1))
        cosine = np.where((facing < 0.0) | two_sided, cosine, 0.0)
        gloss += np.minimum(cosine, 1.0)[:, None] ** power * ray[GLOSS:RAY]
    some = normals.any(axis=0)[:, None]
    matt, gloss = np.where(some, matt, 1.0), np.where(some, gloss, 0.0)
    each = 1 if channels <= 2 else 3
    return np.concatenate((matt[:, :each], gloss[:, :each]), axis=1)[:, :channels].astype(np.float32)
