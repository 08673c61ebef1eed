"""Lights with a size as several without: how many it takes, and where they are.  The same every time.

A shadow's edge under k samples is a stair of k steps, none higher than 1 / k of the light, each as wide as the penumbra
over k.  Footprints are two voxels wide, so steps that wide are slopes; so many samples are taken, up to MOST_SAMPLES.
"""

from __future__ import annotations

import math

import numpy as np

STEP = 2.0  # voxels of penumbra that one sample is enough for
MOST_SAMPLES = 8  # sixteen look the same on a head under a sun 23 degrees wide
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
PLASTIC = np.array((0.7548776662466927, 0.5698402909980532))  # steps that fill a square evenly (the plastic number)
# Directions to the fourteen points of Lebedev's rule of degree five, and their weights: the six axes, eight corners.
_CORNERS = np.stack(np.meshgrid((-1, 1), (-1, 1), (-1, 1)), axis=-1).reshape(-1, 3) / math.sqrt(3.0)
SKY_DIRECTIONS = np.concatenate((np.eye(3), -np.eye(3), _CORNERS))
SKY_WEIGHTS = np.array((1 / 15,) * 6 + (3 / 40,) * 8)


def light_samples(light, box: np.ndarray, voxel: float) -> np.ndarray:
    """(k, 3) world: directions that a sun shines along, or places that another light shines from.

    ``box``: (8, 3) corners of the volume, world.  ``voxel``: world length of one.
    """
    matrix = light.matrix_world
    centre = box.mean(axis=0)
    if light.type == "SUN":
        along = -_unit(matrix[:3, 2])
        radius = math.tan(0.5 * min(light.angle, math.pi / 2))
        width = 2.0 * radius * np.linalg.norm(box - centre, axis=1).max() * 2.0 / voxel
        across, up = _perpendicular(along)
        places = _on_disc(_count(width)) * radius
        return along + places[:, :1] * across + places[:, 1:] * up
    place = matrix[:3, 3]
    if light.type == "AREA":
        across, up = matrix[:3, 0] * light.size, matrix[:3, 1] * light.size
        if light.shape in ("RECTANGLE", "ELLIPSE"):
            up = matrix[:3, 1] * light.size_y
        size = float(np.hypot(np.linalg.norm(across), np.linalg.norm(up)))
        count = _count(_penumbra(size, place, box, voxel))
        spread = 0.5 * _on_disc(count) if light.shape in ("DISK", "ELLIPSE") else _on_square(count)
    else:
        across, up = _perpendicular(_unit(centre - place))
        size = 2.0 * light.radius
        spread = 0.5 * size * _on_disc(_count(_penumbra(size, place, box, voxel)))
    return place + spread[:, :1] * across + spread[:, 1:] * up


def _penumbra(size: float, place, box, voxel: float) -> float:
    """Voxels that the widest penumbra in the box has: of what is nearest the light, on what is furthest."""
    centre, radius = box.mean(axis=0), np.linalg.norm(box - box.mean(axis=0), axis=1).max()
    away = np.linalg.norm(place - centre)
    nearest = max(away - radius, voxel)
    return size / voxel * (away + radius - nearest) / nearest


def _count(width: float) -> int:
    """Samples for a penumbra of ``width`` voxels at its widest: one where it is narrower than a voxel."""
    return 1 if width <= 1.0 else int(min(math.ceil(width / STEP) + 1, MOST_SAMPLES))


def _on_disc(count: int) -> np.ndarray:
    """(count, 2) points spread evenly over the unit disc, about its middle: Vogel's spiral."""
    if count == 1:
        return np.zeros((1, 2))
    n = np.arange(count)
    radius, angle = np.sqrt((n + 0.5) / count), n * GOLDEN_ANGLE
    places = np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)
    return places - places.mean(axis=0)


def _on_square(count: int) -> np.ndarray:
    """(count, 2) points spread evenly over the square [-1/2, 1/2]^2, about its middle."""
    if count == 1:
        return np.zeros((1, 2))
    places = np.mod(0.5 + np.arange(count)[:, None] * PLASTIC, 1.0)
    return places - places.mean(axis=0)


def _unit(vector) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _perpendicular(along) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across ``along`` and each other; any of them where that is no direction."""
    along = along if np.isfinite(along).all() else np.array((0.0, 0.0, 1.0))
    across = _unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    return across, np.cross(along, across)
