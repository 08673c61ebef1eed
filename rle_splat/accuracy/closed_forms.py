"""Pictures known on paper (algorithm.md 2.3): optical depths and colours of simple bodies along world rays."""

from __future__ import annotations

import numpy as np

from .rays import Rays


def composed(tau, color) -> np.ndarray:
    """G4: (N,) optical depths of matter of one colour -> (N, 4) premultiplied; the order inside never matters."""
    alpha = -np.expm1(-np.asarray(tau, dtype=np.float64))[:, None]
    return np.concatenate((alpha * np.asarray(color, dtype=np.float64), alpha), axis=1)


def over(front, back) -> np.ndarray:
    """G7: (N, 4) premultiplied bodies, one wholly before the other: a1 c1 + (1 - a1) a2 c2."""
    return front + (1.0 - front[:, 3:]) * back


def box_length(rays: Rays, index_to_world, low, high) -> np.ndarray:
    """G1: (N,) world length inside an index-space box of each ray's whole line."""
    inverse = np.linalg.inv(index_to_world)
    start = rays.origin @ inverse[:3, :3].T + inverse[:3, 3]
    step = rays.step @ inverse[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (np.asarray(low) - start) / step, (np.asarray(high) - start) / step
    inside = (start >= low) & (start <= high)
    enters = np.where(step == 0.0, np.where(inside, -np.inf, np.inf), np.minimum(a, b)).max(axis=1)
    leaves = np.where(step == 0.0, np.where(inside, np.inf, -np.inf), np.maximum(a, b)).min(axis=1)
    return np.maximum(leaves - enters, 0.0) * rays.length_per_depth


def distance_to_axis(rays: Rays, centre) -> np.ndarray:
    """b: (N,) world distance between a point and the line of each ray."""
    to_centre = np.asarray(centre, dtype=np.float64) - rays.origin
    along = (to_centre * rays.direction).sum(axis=1)
    return np.sqrt(np.maximum((to_centre**2).sum(axis=1) - along**2, 0.0))


def sphere_length(rays: Rays, centre, radius: float) -> np.ndarray:
    """G2: (N,) world length of each ray inside a sphere, 2 sqrt(R^2 - b^2)."""
    return 2.0 * np.sqrt(np.maximum(radius**2 - distance_to_axis(rays, centre) ** 2, 0.0))


def gaussian_tau(rays: Rays, centre, peak: float, width: float) -> np.ndarray:
    """G3: (N,) optical depth of peak * exp(-r^2 / 2 width^2), in world lengths: peak width sqrt(2 pi) exp(-b^2/..)."""
    b = distance_to_axis(rays, centre)
    return peak * width * np.sqrt(2.0 * np.pi) * np.exp(-0.5 * (b / width) ** 2)


def linear_source(sigma: float, length, start: float, slope: float) -> np.ndarray:
    """G5: radiance of a slab of constant extinction whose colour is start + slope * depth."""
    seen = np.exp(-sigma * np.asarray(length, dtype=np.float64))
    return start * (1.0 - seen) + slope / sigma * (1.0 - seen * (1.0 + sigma * np.asarray(length)))


def tent(u) -> np.ndarray:
    """The linear interpolation kernel, support [-1, 1]."""
    return np.maximum(1.0 - np.abs(u), 0.0)


def impulse_tau(u, v, sigma: float, slice_distance: float) -> np.ndarray:
    """G8: optical depth of one voxel seen along an axis, at index offsets u, v from its centre."""
    return sigma * slice_distance * tent(u) * tent(v)
