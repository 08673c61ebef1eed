"""Rays of the tests: the turntable's in its own words, and where rays meet a plane."""

from __future__ import annotations

import numpy as np

from rle_splat.accuracy.rays import WorldRays, pixel_centers


def depth_to_plane(rays: WorldRays, point, normal) -> np.ndarray:
    """(N,) planar depth at which each ray meets a plane; inf where it is parallel or behind."""
    normal = np.asarray(normal, dtype=np.float64)
    ahead = rays.step @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = ((np.asarray(point, dtype=np.float64) - rays.origin) @ normal) / ahead
    return np.where((ahead != 0.0) & (depth > 0.0), depth, np.inf)


def turntable_rays(shape_xyz, spacing, azimuth, elevation, fit, perspective, fov, width, height):
    """The turntable in its own words: (WorldRays, index_to_world) with voxel (i, j, k) at (i sx, j sy, k sz).

    Angles in degrees.  An orthographic ray starts on the plane through the aim, so depth 0 lies inside the
    volume and ``near`` must be minus infinity; a perspective ray starts at the eye.
    """
    shape, spacing = np.asarray(shape_xyz, np.float64), np.asarray(spacing, np.float64)
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    right = np.array((np.cos(a), np.sin(a), 0.0))
    forward = np.array((-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)))
    up = np.cross(right, forward)
    aim = 0.5 * (shape - 1.0) * spacing
    view_height = fit * (shape * spacing).max()
    columns, rows = pixel_centers(width, height)
    across = ((columns / width) - 0.5) * view_height * width / height
    above = (0.5 - rows / height) * view_height
    on_plane = aim + across[:, None] * right + above[:, None] * up
    if perspective:
        distance = 0.5 * view_height / np.tan(0.5 * np.deg2rad(fov))
        start = np.broadcast_to(aim - distance * forward, on_plane.shape)
        step = (on_plane - start) / distance
    else:
        start, step = on_plane, np.broadcast_to(forward, on_plane.shape)
    length = np.sqrt((step**2).sum(axis=1))
    return WorldRays(start, step / length[:, None], length), np.diag((*spacing, 1.0))
