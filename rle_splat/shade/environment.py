"""Light from all directions that depends on the normal: a world's radiance, and what a surface receives of it.

With means over all directions d of the radiance L,

    m = <L>,    v = <L d>,    S = <L d d'> - m / 3 (its trace is 0),

a Lambert surface of color 1 with outward normal n has the radiance

    B(n) = m + 2 v.n + 15/8 n' S n

up to order 2. It follows from equation 13 of Ramamoorthi and Hanrahan (2001) by the addition theorem: the sums over the
harmonics of an order are 3 / (4 pi) n.d and 5 / (8 pi) (3 (n.d)^2 - 1), and a surface weights them by 2/3 and 1/4.

The outward side is that of the lower values, away from the gradient, for two-sided surfaces too: with both sides lit a
sphere under a bright sky would be as bright from below.
"""

from __future__ import annotations

import numpy as np

from ..scene import Environment

SKY, TERMS = 8, 9  # first of the terms in ``Lighting.material``, and how many there are for a channel
# Components of the normal that a term multiplies; see ``terms_of``.
LINEAR = ((0,), (1,), (2,))
PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


def terms_of(environment: Environment | None) -> np.ndarray:
    """Coefficients of B(n) - m.

    Returns
    -------
    (3, TERMS) ndarray of float64
        For each channel, of x, y, z, xx, yy, zz, xy, yz, zx of the unit gradient, which points inwards. (3, 0) without
        an environment.
    """
    if environment is None:
        return np.empty((3, 0))
    linear = [-2.0 * environment.first[axis] for (axis,) in LINEAR]
    products = [15.0 / 8.0 * (1.0 if i == j else 2.0) * environment.second[i, j] for i, j in PRODUCTS]
    return np.array([*linear, *products]).T


def light_by_normal(normals: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """B(n) - m for normals: the reference implementation of what kernels do with ``terms_of``.

    Parameters
    ----------
    normals : (k, 3) ndarray
        Unit gradients.
    terms : (3, TERMS) or (3, 0) ndarray

    Returns
    -------
    (k, 3) ndarray of float64
        RGB; zeros without terms.
    """
    normals = np.asarray(normals, np.float64)
    if not terms.shape[1]:
        return np.zeros((len(normals), 3))
    columns = [normals[:, axes].prod(axis=1) for axes in (*LINEAR, *PRODUCTS)]
    return np.column_stack(columns) @ terms.T


def most_by_normal(terms: np.ndarray) -> np.ndarray:
    """(3,) upper bounds of B(n) - m over all unit normals, for each channel."""
    if not terms.shape[1]:
        return np.zeros(3)
    forms = np.moveaxis(_matrices(terms.T[3:]), -1, 0)
    return np.linalg.norm(terms[:, :3], axis=1) + np.linalg.eigvalsh(forms)[:, -1]


def _matrices(products: np.ndarray) -> np.ndarray:
    """(3, 3, 3) symmetric matrices, the channel last, of the coefficients (6, 3) of PRODUCTS."""
    found = np.zeros((3, 3, 3))
    for (i, j), number in zip(PRODUCTS, products):
        found[i, j] += 0.5 * number
        found[j, i] += 0.5 * number
    return found


def panorama_moments(pixels: np.ndarray, to_world: np.ndarray) -> tuple[tuple, Environment]:
    """The mean and the environment of an equirectangular picture.

    Each pixel counts by its solid angle and at its center. Along a row the five sums of a Fourier series are enough.

    Parameters
    ----------
    pixels : (H, W, 3) ndarray of float32
        Radiance, scene-linear; row 0 looks up along +Z. Column 0 begins at -X, the middle is +X and a quarter of the
        width is +Y, as in Blender.
    to_world : (3, 3) ndarray of float64
        Rotation from the directions of the picture to the world's.

    Returns
    -------
    mean : tuple of float
        Scene-linear RGB.
    environment : Environment
    """
    height, width = pixels.shape[:2]
    longitude = np.pi - 2.0 * np.pi * (np.arange(width) + 0.5) / width
    around = np.stack(
        (np.ones(width), np.cos(longitude), np.sin(longitude), np.cos(2.0 * longitude), np.sin(2.0 * longitude))
    )
    one, cos, sin, cos2, sin2 = (np.tensordot(pixels, wave / width, axes=(1, 0)).astype(np.float64) for wave in around)
    edges = np.sin(0.5 * np.pi - np.pi * np.arange(height + 1) / height)
    share = 0.5 * (edges[:-1] - edges[1:])  # of the sphere
    latitude = 0.5 * np.pi - np.pi * (np.arange(height) + 0.5) / height
    up, flat = np.sin(latitude), np.cos(latitude)

    def mean(by_row, waves):
        return (share * by_row) @ waves

    first = np.stack((mean(flat, cos), mean(flat, sin), mean(up, one)))
    second = np.empty((3, 3, 3))
    second[0, 0], second[1, 1] = mean(flat**2, 0.5 * (one + cos2)), mean(flat**2, 0.5 * (one - cos2))
    second[2, 2], second[0, 1] = mean(up**2, one), mean(flat**2, 0.5 * sin2)
    second[0, 2], second[1, 2] = mean(up * flat, cos), mean(up * flat, sin)
    second[1, 0], second[2, 0], second[2, 1] = second[0, 1], second[0, 2], second[1, 2]
    whole = mean(np.ones(height), one)
    second -= np.multiply.outer(np.eye(3), np.trace(second) / 3.0)
    turned = np.einsum("ia,jb,abc->ijc", to_world, to_world, second)
    return tuple(np.maximum(whole, 0.0).tolist()), Environment(to_world @ first, turned)


def sphere_moments(directions: np.ndarray, radiance: np.ndarray, weights: np.ndarray) -> tuple[tuple, Environment]:
    """The mean and the environment behind the radiances of a white Lambert surface.

    Parameters
    ----------
    directions : (n, 3) ndarray of float64
        Outward normals.
    radiance : (n, 3) ndarray of float64
        B of each, scene-linear RGB.
    weights : (n,) ndarray of float64
        Solid angle of each.

    Returns
    -------
    mean : tuple of float
    environment : Environment
        The inverse of B(n) as of the module, fitted by least squares.
    """
    columns = [directions[:, axes].prod(axis=1) for axes in (*LINEAR, *PRODUCTS)]  # xx + yy + zz is the constant
    root = np.sqrt(weights)[:, None]
    found = np.linalg.lstsq(np.column_stack(columns) * root, radiance * root, rcond=None)[0]
    form = _matrices(found[3:])
    mean = np.trace(form) / 3.0
    second = 8.0 / 15.0 * (form - np.multiply.outer(np.eye(3), mean))
    return tuple(np.maximum(mean, 0.0).tolist()), Environment(0.5 * found[:3], second)
