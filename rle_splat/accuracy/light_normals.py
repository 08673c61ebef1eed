"""Normals at a scale for the reference of light: gradients of a smoothed field, in float64, and how far to trust them.

Arrays over voxels are (nz, ny, nx); vectors are (x, y, z).  Lengths are millimeters, or whatever unit the affine has.

Each voxel has the vector m = N / sqrt(R^2 + (NOISE E)^2), in which N is its gradient, R the root mean square of the
gradients' lengths over the 27 voxels around it, and E the one that errors of stored values give.  m is interpolated
between voxels.  Its direction is the normal, and its length says how far to trust it: it is about 1 at a surface, far
below where there is nothing but noise, and passes smoothly through 0 where normals turn over, as in the middle of a
plate.  So one vector does for both.
"""

from functools import lru_cache

import numpy as np

REACH = 3.0  # sigmas at which the Gaussian is cut
LARGEST_SIGMA = 2.0  # mm: slices 5 mm apart must not erase vessels
# The error of a stored value is uniform over one step of this size: rounding of integers, and for floats as many
# machine epsilons of float32, so that what a renderer's smoothing in float32 adds is not seen.
WHOLE_STEP = 1.0
FLOAT_STEPS = 256.0
# Gradients that are E long have the trust .02, gradients from 13 E on the trust 1 (16-bit scans: .6 stored values per
# voxel after smoothing by one voxel).
NOISE = 40.0
LEAST = 0.04  # of R: what |N| lacks of it is added along x, so that the middle of a wall differs from what is flat
BRICK = 16  # voxels along a side of what is computed at once
MOST_BRICKS = 1024  # are kept, of 131 KB each


def spacing_of(affine) -> np.ndarray:
    """(3,) distance of neighboring voxels along x, y, z."""
    return np.sqrt((np.asarray(affine, dtype=np.float64)[:3, :3] ** 2).sum(axis=0))


def automatic_sigma(affine) -> float:
    """The largest slice distance, at most LARGEST_SIGMA: half of it leaves rings of thick slices, 1.5 round bones."""
    return float(min(spacing_of(affine).max(), LARGEST_SIGMA))


def gaussian(sigma: float, spacing: float) -> np.ndarray:
    """(2 r + 1,) weights at whole voxels of a Gaussian cut at REACH sigmas; they add up to 1."""
    radius = int(np.floor(REACH * sigma / spacing + 1e-9))
    if radius == 0:
        return np.ones(1)
    weights = np.exp(-0.5 * (np.arange(-radius, radius + 1) * spacing / sigma) ** 2)
    return weights / weights.sum()


def _convolve(values: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Convolve along an axis; nothing lies outside the array."""
    found, radius, count = np.zeros_like(values), len(weights) // 2, values.shape[axis]
    values, result = np.moveaxis(values, axis, 0), np.moveaxis(found, axis, 0)
    most = min(radius, count - 1)
    for offset in range(-most, most + 1):
        to = slice(max(-offset, 0), count - max(offset, 0))
        result[to] += weights[radius + offset] * values[max(offset, 0) : count + min(offset, 0)]
    return found


def smooth(values: np.ndarray, sigma: float, spacing) -> np.ndarray:
    """The mean of the finite values around each voxel with Gaussian weights; NaN where there are none.

    Weights of voxels outside the volume and of values that are not finite are left out, and the rest is divided by
    their sum.  So a constant stays constant beside a face and beside NaN (normalized convolution, Knutsson and Westin
    1993).
    """
    finite = np.isfinite(values)
    total, weight = np.where(finite, values, 0.0), finite.astype(np.float64)
    for axis in range(3):
        weights = gaussian(sigma, spacing[2 - axis])
        total, weight = _convolve(total, weights, axis), _convolve(weight, weights, axis)
    return np.divide(total, weight, out=np.full(values.shape, np.nan), where=weight > 0.0)


def differences(values: np.ndarray, spacing) -> np.ndarray:
    """(nz, ny, nx, 3) central differences per mm, one-sided at the faces; 0 along an axis of one voxel.

    A neighbor that is not finite counts as equal to the voxel itself, a voxel that is not finite has none.
    """
    found = np.zeros((*values.shape, 3))
    for axis in range(3):
        own, last = np.moveaxis(values, axis, 0), values.shape[axis] - 1
        if last == 0:
            continue
        index = np.arange(last + 1)
        after, before = own[np.minimum(index + 1, last)], own[np.maximum(index - 1, 0)]
        steps = (np.minimum(index + 1, last) - np.maximum(index - 1, 0)).reshape(-1, 1, 1)
        after, before = (np.where(np.isfinite(other), other, own) for other in (after, before))
        slope = np.where(np.isfinite(own), after - before, 0.0) / (steps * spacing[2 - axis])
        found[..., 2 - axis] = np.moveaxis(np.nan_to_num(slope, nan=0.0), 0, axis)
    return found


def noise_of_gradient(sigma: float, spacing) -> float:
    """Root mean square length, per mm, of the gradient that independent errors of one step give.

    Errors uniform over one step have the variance 1/12.  The gradient along an axis is a convolution with the
    difference of two shifted Gaussians along it and with Gaussians across it, so its variance is 1/12 times the
    product of the sums of their squares.  For sigma 0 and a spacing of 1 this is sqrt(1/8) = 0.35 steps.
    """
    kernels = [gaussian(sigma, distance) for distance in spacing]
    squares = [float((kernel**2).sum()) for kernel in kernels]
    total = 0.0
    for axis in range(3):
        slope = np.convolve(kernels[axis], (0.5, 0.0, -0.5)) / spacing[axis]
        across = np.prod([square for other, square in enumerate(squares) if other != axis])
        total += float((slope**2).sum()) * across / 12.0
    return float(np.sqrt(total))


def box_mean(values: np.ndarray) -> np.ndarray:
    """The mean over the 27 voxels around each one; at faces over those that exist."""
    total, count = values, np.ones(values.shape)
    for axis in range(3):
        total, count = _convolve(total, np.ones(3), axis), _convolve(count, np.ones(3), axis)
    return total / count


def normals_of(voxels: np.ndarray, affine, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Vectors m and lengths of gradients of all voxels of an array.

    A gradient is a covector.  The differences along the voxel axes are transformed by the inverse transpose of the
    affine's directions.

    Parameters
    ----------
    voxels : (nz, ny, nx)
        Stored values.
    affine : (4, 4)
        Voxel index (x, y, z) to mm.
    sigma : float
        Of the Gaussian, in mm; 0 for none.

    Returns
    -------
    vector : (nz, ny, nx, 3) float64
        m, along the axes of the volume's own space.
    slope : (nz, ny, nx) float64
        |N|, stored values per mm.
    """
    spacing = spacing_of(affine)
    values = voxels.astype(np.float64)
    directions = np.asarray(affine, dtype=np.float64)[:3, :3] / spacing
    smoothed = smooth(values, sigma, spacing)
    slopes = differences(smoothed, spacing)
    gradient = np.einsum("...i,ij->...j", slopes, np.linalg.inv(directions))
    step = WHOLE_STEP
    if voxels.dtype.kind == "f":
        step = FLOAT_STEPS * float(np.finfo(np.float32).eps) * np.abs(np.nan_to_num(smoothed))
    squared = (gradient**2).sum(axis=-1)
    mean = box_mean(squared)
    gradient[..., 0] += np.maximum(LEAST * np.sqrt(mean) - np.sqrt(squared), 0.0)
    scale = np.sqrt(mean + (NOISE * noise_of_gradient(sigma, spacing) * step) ** 2)[..., None]
    vector = np.divide(gradient, scale, out=np.zeros_like(gradient), where=scale > 0.0)
    vector /= np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1.0)
    return np.where(np.isfinite(values)[..., None], vector, 0.0), np.sqrt(squared)


class NormalField:
    """``normals_of`` a volume, computed in bricks when first needed; arguments as there."""

    def __init__(self, voxels: np.ndarray, affine, sigma: float):
        self._voxels, self._affine, self._sigma = voxels, affine, sigma
        # Beyond the Gaussian's reach, one voxel for differences and one for the mean of squares.
        self._beyond = [int(REACH * sigma / distance + 1e-9) + 2 for distance in spacing_of(affine)[::-1]]
        self._brick = lru_cache(MOST_BRICKS)(self._compute)

    def at(self, z, y, x) -> np.ndarray:
        """(N, 4) vector and slope of voxels, for index arrays (N,)."""
        index = np.stack((z, y, x), axis=-1)
        bricks, back = np.unique(index // BRICK, axis=0, return_inverse=True)
        back, found = back.ravel(), np.empty((len(index), 4))
        order = np.argsort(back, kind="stable")
        for brick, mine in zip(bricks.tolist(), np.split(order, np.cumsum(np.bincount(back))[:-1])):
            found[mine] = self._brick(*brick)[tuple((index[mine] % BRICK).T)]
        return found

    def _compute(self, *brick) -> np.ndarray:
        """(BRICK, BRICK, BRICK, 4) of a brick's voxels, fewer at the far faces."""
        corner = np.array(brick) * BRICK
        begin = np.maximum(corner - self._beyond, 0)
        part = tuple(slice(b, c + BRICK + beyond) for b, c, beyond in zip(begin, corner, self._beyond))
        vector, slope = normals_of(self._voxels[part], self._affine, self._sigma)
        own = tuple(slice(c - b, c - b + BRICK) for b, c in zip(begin, corner))
        return np.concatenate((vector[own], slope[own][..., None]), axis=-1)


def smoothstep(low: float, high: float, x) -> np.ndarray:
    """0 up to ``low``, 1 from ``high`` on, 3 t^2 - 2 t^3 between: no kink at either end."""
    t = np.clip((np.asarray(x, dtype=np.float64) - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
