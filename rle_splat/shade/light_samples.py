"""Samples of lights that have a size. They are the same every time.

With k samples, the edge of a shadow is a stair of k steps, each at most 1 / k of the light and as wide as the penumbra
over k. Footprints are two voxels wide, so steps of that width look like a slope. So many samples are taken, and those
of the model of light where more than FEW would be: in a hollow, the steps of fewer show as polygons.
"""

from __future__ import annotations

import math

import numpy as np

STEP = 2.0  # voxels of penumbra per sample
FEW, FIXED = 8, 16
GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
PLASTIC = np.array((0.7548776662466927, 0.5698402909980532))  # steps that fill a square evenly (the plastic number)
HALF_SKY = 12  # directions of the sky above a plane


def light_samples(light, box: np.ndarray, voxel: float, sharp: bool = False) -> np.ndarray:
    """Sample a light.

    Parameters
    ----------
    light : Light
    box : (8, 3) ndarray of float64
        Corners of the volume, world.
    voxel : float
        World length of a voxel.
    sharp : bool
        Whether a light with a size is one sample, its middle.

    Returns
    -------
    (k, 3) ndarray of float64
        World. For a SUN the directions in which it shines; for other lights the positions from which they shine.
    """
    count = 1 if sharp else _count(light, box, voxel)
    if count > FEW:
        return fixed_samples(light, box)
    matrix = light.matrix_world
    center = box.mean(axis=0)
    if light.type == "SUN":
        along = -_unit(matrix[:3, 2])
        across, up = _perpendicular(along)
        points = _on_disc(count) * math.tan(0.5 * min(light.angle, math.pi / 2))
        return along + points[:, :1] * across + points[:, 1:] * up
    position = matrix[:3, 3]
    if light.type == "AREA":
        across, up = _sides(light)
        spread = 0.5 * _on_disc(count) if light.shape in ("DISK", "ELLIPSE") else _on_square(count)
    else:
        towards = center - position
        across, up = _perpendicular(_unit(towards) if towards.any() else np.array((0.0, 0.0, 1.0)))
        spread = light.radius * _on_disc(count)
    return position + spread[:, :1] * across + spread[:, 1:] * up


def fixed_samples(light, box: np.ndarray) -> np.ndarray:
    """The FIXED points of a light with a size that the model of light has (docs/explanation/light.md).

    Parameters and return value as of ``light_samples``.
    """
    matrix, center = light.matrix_world, box.mean(axis=0)
    if light.type == "AREA":
        across, up = _sides(light)
        if light.shape in ("DISK", "ELLIPSE"):
            spread = 0.5 * _spiral(FIXED)
        else:
            spread = (np.indices((4, 4)).reshape(2, FIXED).T + 0.5) / 4.0 - 0.5
        return matrix[:3, 3] + spread[:, :1] * across + spread[:, 1:] * up
    is_sun = light.type == "SUN"
    towards = matrix[:3, 2] if is_sun else center - matrix[:3, 3]
    towards = _unit(towards) if towards.any() else np.array((0.0, 0.0, 1.0))
    radius = math.tan(0.5 * min(light.angle, math.pi / 2)) if is_sun else light.radius
    across, up = _perpendicular(towards)
    spread = radius * _spiral(FIXED) if radius > 0.0 else np.zeros((1, 2))
    points = spread[:, :1] * across + spread[:, 1:] * up
    return -(towards + points) if is_sun else matrix[:3, 3] + points


def sky_directions() -> np.ndarray:
    """Sample the sky evenly, for ambient occlusion.

    Returns
    -------
    (2 HALF_SKY, 3) ndarray of float64
        World, unit vectors: a spiral over half the sphere, and their opposites, so that any plane hides half of them.
        The map from the disc to the half sphere is Lambert's, which keeps areas.
    """
    disc = _spiral(HALF_SKY)
    squared = (disc**2).sum(axis=1, keepdims=True)
    half = np.concatenate((disc * np.sqrt(2.0 - squared), 1.0 - squared), axis=1)
    return np.concatenate((half, -half))


def _sides(light) -> tuple[np.ndarray, np.ndarray]:
    """The sides of an area light, world."""
    tall = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    return light.matrix_world[:3, 0] * light.size, light.matrix_world[:3, 1] * tall


def _count(light, box: np.ndarray, voxel: float) -> int:
    """Samples for the widest penumbra in the box; one if it is narrower than a voxel."""
    center, radius = box.mean(axis=0), np.linalg.norm(box - box.mean(axis=0), axis=1).max()
    if light.type == "SUN":
        width = 4.0 * math.tan(0.5 * min(light.angle, math.pi / 2)) * radius / voxel
    else:  # that of the nearest point on the furthest
        size = np.linalg.norm(_sides(light)) if light.type == "AREA" else 2.0 * light.radius
        away = np.linalg.norm(light.matrix_world[:3, 3] - center)
        nearest = max(away - radius, voxel)
        width = size / voxel * (away + radius - nearest) / nearest
    return 1 if width <= 1.0 else math.ceil(min(width / STEP, FIXED)) + 1


def _on_disc(count: int) -> np.ndarray:
    """(count, 2) points spread evenly over the unit disc, with mean zero: Vogel's spiral."""
    if count == 1:
        return np.zeros((1, 2))
    points = _spiral(count)
    return points - points.mean(axis=0)


def _spiral(count: int) -> np.ndarray:
    """(count, 2) points of Vogel's spiral in the unit disc."""
    n = np.arange(count)
    radius, angle = np.sqrt((n + 0.5) / count), n * GOLDEN_ANGLE
    return np.stack((radius * np.cos(angle), radius * np.sin(angle)), axis=1)


def _on_square(count: int) -> np.ndarray:
    """(count, 2) points spread evenly over the square [-1/2, 1/2]^2, with mean zero."""
    if count == 1:
        return np.zeros((1, 2))
    points = np.mod(0.5 + np.arange(count)[:, None] * PLASTIC, 1.0)
    return points - points.mean(axis=0)


def _unit(vector) -> np.ndarray:
    """``vector`` scaled to length one."""
    return vector / np.linalg.norm(vector)


def _perpendicular(along) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors perpendicular to a unit vector and to each other."""
    across = _unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    return across, np.cross(along, across)
