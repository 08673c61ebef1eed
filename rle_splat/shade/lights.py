"""Lights as rows of numbers, for one kernel that handles all types.

The irradiance scale I is chosen such that a white Lambertian surface facing the light has the radiance that Cycles
gives it: E / pi under a sun of E W/m^2, P / (4 pi^2 d^2) under a point or spot of P W at distance d, and
P cos / (pi^2 d^2) under an area light, where cos is that of the angle to its axis. Near the light, d^2 is kept above
three bounds: the value at which the light would fill the surface's sky (radius^2; area / pi), half a voxel squared, and
the value at which I would leave the range of float32.
"""

from __future__ import annotations

import numpy as np

from ..classify.limits import STRONGEST_LIGHT
from ..volume.triples import unit

SUN, POINT, SPOT, AREA = range(4)
KINDS = {"SUN": SUN, "POINT": POINT, "SPOT": SPOT, "AREA": AREA}
# Columns of a row: kind; position (world); unit direction in which it shines; RGB times I at distance 1 (for a sun at
# any distance); smallest squared distance; cosine of half the spot's angle; width of the spot's soft edge in cosines.
KIND, POSITION, AXIS, RGB, NEAREST, CONE, EDGE, COLUMNS = 0, 1, 4, 7, 10, 11, 12, 13
STRONGEST_AT_1, NEAREST_SQUARED = 1e30, 1e-36  # kernels keep RGB and one over the squared distance as float32
HARD_EDGE = 1e-4  # least width of a spot's edge, which is divided by


def light_rows(lights, headlight_direction, index_to_world) -> np.ndarray:
    """Make the rows of lights.

    Parameters
    ----------
    lights : sequence of Light
    headlight_direction : (3,) array_like or None
        World direction of a headlight, which is added as one white parallel light with I = 1.
    index_to_world : (4, 4) array_like

    Returns
    -------
    (n, COLUMNS) ndarray of float64
    """
    rows = []
    if lights:
        half_voxel = 0.5 * np.cbrt(abs(np.linalg.det(np.asarray(index_to_world)[:3, :3])))
        rows = [_light_row(light, half_voxel) for light in lights]
    if headlight_direction is not None:
        rows.append((SUN, *(0.0,) * 3, *unit(map(float, headlight_direction)), *(1.0,) * 3, *(0.0,) * 3))
    return np.array(rows, dtype=np.float64).reshape(-1, COLUMNS)


def _light_row(light, half_voxel: float) -> np.ndarray:
    """Row of a light; ``half_voxel``: half the world length of a voxel."""
    matrix = light.matrix_world
    kind = KINDS[light.type]
    power = {
        SUN: 1.0 / np.pi,
        POINT: 1.0 / (4.0 * np.pi**2),
        SPOT: 1.0 / (4.0 * np.pi**2),
        AREA: 1.0 / np.pi**2,
    }[kind] * light.energy
    row = np.zeros(COLUMNS)
    row[KIND], row[POSITION:AXIS], row[AXIS:RGB] = kind, matrix[:3, 3], unit((-matrix[:3, 2]).tolist())
    with np.errstate(over="ignore"):
        row[RGB:NEAREST] = np.minimum(power * np.array(light.color), STRONGEST_AT_1)
    nearest = light.radius**2
    if kind == AREA:
        width, height = np.linalg.norm(matrix[:3, :2], axis=0) * light.size
        if light.shape in ("RECTANGLE", "ELLIPSE"):
            height = np.linalg.norm(matrix[:3, 1]) * light.size_y
        round_part = np.pi / 4.0 if light.shape in ("DISK", "ELLIPSE") else 1.0
        nearest = round_part * width * height / np.pi
    if kind == SUN:
        row[RGB:NEAREST] = np.minimum(row[RGB:NEAREST], STRONGEST_LIGHT)
    row[NEAREST] = max(nearest, half_voxel**2, row[RGB:NEAREST].max() / STRONGEST_LIGHT, NEAREST_SQUARED)
    row[CONE] = np.cos(0.5 * min(light.spot_size, np.pi))
    row[EDGE] = max((1.0 - row[CONE]) * light.spot_blend, HARD_EDGE)
    return row
