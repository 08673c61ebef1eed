"""Light on samples along single rays, by the formula of ``shade.sample_light``."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..runtime.jit import inner_loop, read_only
from ..shade.environment import SKY, TERMS
from ..shade.lighting import BACK, unit_vectors
from ..shade.lights import AREA, AXIS, CONE, EDGE, KIND, NEAREST, POSITION, RGB, SPOT, SUN
from ..shade.sample_light import ALMOST_NONE, NORMAL, RAMP, ROUNDING, SPREAD, TRUSTED, TURNED, SampleLight
from ..shade.surface_points import smoothstep

AMBIENT, DIFFUSE, SPECULAR, SHININESS, EVERYWHERE = range(5)  # entries of Lighting.material
NO_PLANE = -1


class RayLight(NamedTuple):
    """A SampleLight and the rays that meet it, as kernels take them.

    Attributes
    ----------
    lamps : (n, COLUMNS) ndarray of float64
        See ``lights.light_rows``.
    shares : (n,) ndarray of int64
        Which plane is T of each lamp; NO_PLANE for one that casts no shadows.
    scattered : (n,) ndarray of int64
        The same of U.
    indirect : float
        See SampleLight.
    open_plane : int
        Which plane is O, or NO_PLANE.
    material : ndarray of float64
        See Lighting.
    start, step : (rays, 3) ndarray of float64
        A ray is at ``start + s * step``, world, at ``s`` voxels along it.
    to_eye : (rays, 3) ndarray of float64
        Unit vectors, world.
    """

    lamps: np.ndarray
    shares: np.ndarray
    scattered: np.ndarray
    indirect: float
    open_plane: int
    material: np.ndarray
    start: np.ndarray
    step: np.ndarray
    to_eye: np.ndarray


def ray_light(light: SampleLight, rays) -> RayLight:
    """The light on the samples of rays, a RayList."""
    falling = light.falling
    shares, scattered = map(read_only, light.rows_of(NORMAL, NO_PLANE))
    # Element by element: the bits of a matrix product depend on its size.
    (first, step), matrix = (rays.first.T, rays.step.T), falling.matrix[:3]
    start = np.stack([row[0] * first[0] + row[1] * first[1] + row[2] * first[2] + row[3] for row in matrix], axis=1)
    step = np.stack([row[0] * step[0] + row[1] * step[1] + row[2] * step[2] for row in matrix], axis=1)
    arrays = (read_only(array) for array in (falling.material, start, step, unit_vectors(-step)))
    open_plane = light.planes - 1 if light.opened else NO_PLANE
    return RayLight(read_only(falling.rows), shares, scattered, light.indirect, open_plane, *arrays)


@inner_loop
def light_at(light, planes, ray, s):
    """Light and highlight, RGB each, at ``s`` voxels along a ray, of its ``planes`` there: m, T, U and O."""
    lamps, shares, scattered, indirect, open_plane, material, start, step, to_eye = light
    ex, ey, ez = to_eye[ray, 0], to_eye[ray, 1], to_eye[ray, 2]
    px, py, pz = start[ray, 0] + s * step[ray, 0], start[ray, 1] + s * step[ray, 1], start[ray, 2] + s * step[ray, 2]
    size = math.sqrt(planes[0] * planes[0] + planes[1] * planes[1] + planes[2] * planes[2])
    surface, scale = smoothstep(size / TRUSTED), 1.0 / max(size, ALMOST_NONE)
    nx, ny, nz = planes[0] * scale, planes[1] * scale, planes[2] * scale
    if material[BACK] > 0.0:
        away = max(-(nx * ex + ny * ey + nz * ez), 0.0)
        turned = smoothstep(away / TURNED)
        kept, added = 1.0 - 2.0 * turned, away * (1.0 - turned)
        nx, ny, nz = kept * nx + added * ex, kept * ny + added * ey, kept * nz + added * ez
    red, green, blue = material[EVERYWHERE], material[EVERYWHERE + 1], material[EVERYWHERE + 2]
    if material.size > SKY:
        red += surface * (max(red + _change(material, 0, nx, ny, nz), material[AMBIENT]) - red)
        green += surface * (max(green + _change(material, 1, nx, ny, nz), material[AMBIENT]) - green)
        blue += surface * (max(blue + _change(material, 2, nx, ny, nz), material[AMBIENT]) - blue)
    if open_plane >= 0:
        red, green, blue = red * planes[open_plane], green * planes[open_plane], blue * planes[open_plane]
    red_shine = green_shine = blue_shine = 0.0
    for lamp in range(lamps.shape[0]):
        lx, ly, lz, whole = _towards(lamps, lamp, px, py, pz)
        arrives = whole
        if shares[lamp] >= 0:
            arrives = whole * planes[shares[lamp]]
        facing = nx * lx + ny * ly + nz * lz
        rounded = min(max(facing + ROUNDING, 0.0), 2.0 * ROUNDING)
        wrap = rounded * rounded * (0.25 / ROUNDING) + max(facing - ROUNDING, 0.0)
        matt = material[DIFFUSE] * (1.0 + surface * (wrap - 1.0)) * arrives
        if scattered[lamp] >= 0:
            spread = (1.0 + SPREAD) * wrap / (wrap + SPREAD) + max(-facing, 0.0) * max(-facing, 0.0)
            around = material[DIFFUSE] * (1.0 + surface * (spread - 1.0)) * whole * planes[scattered[lamp]]
            matt += indirect * (around - matt)
        red += matt * lamps[lamp, RGB]
        green += matt * lamps[lamp, RGB + 1]
        blue += matt * lamps[lamp, RGB + 2]
        if material[SPECULAR] > 0.0 and facing > 0.0:
            hx, hy, hz = lx + ex, ly + ey, lz + ez
            squared = hx * hx + hy * hy + hz * hz
            cosine = (nx * hx + ny * hy + nz * hz) / math.sqrt(squared) if squared > 0.0 else 0.0
            ramp = smoothstep(facing / RAMP)
            gloss = material[SPECULAR] * surface * ramp * max(cosine, 0.0) ** material[SHININESS] * arrives
            red_shine += gloss * lamps[lamp, RGB]
            green_shine += gloss * lamps[lamp, RGB + 1]
            blue_shine += gloss * lamps[lamp, RGB + 2]
    return red, green, blue, red_shine, green_shine, blue_shine


@inner_loop
def _change(material, channel, nx, ny, nz):
    """What the world's light changes by with the normal, see ``environment``; its terms are of the gradient, -n."""
    at = SKY + channel * TERMS
    around = nx * (material[at + 3] * nx + material[at + 6] * ny) + ny * (material[at + 4] * ny + material[at + 7] * nz)
    around += nz * (material[at + 5] * nz + material[at + 8] * nx)
    return around - (material[at] * nx + material[at + 1] * ny + material[at + 2] * nz)


@inner_loop
def _towards(lamps, lamp, px, py, pz):
    """Unit vector from a world point to a lamp, and its falloff there, as ``shade.reference.find_light``."""
    ax, ay, az = lamps[lamp, AXIS], lamps[lamp, AXIS + 1], lamps[lamp, AXIS + 2]
    if lamps[lamp, KIND] == SUN:
        return -ax, -ay, -az, 1.0
    x, y, z = lamps[lamp, POSITION] - px, lamps[lamp, POSITION + 1] - py, lamps[lamp, POSITION + 2] - pz
    squared = x * x + y * y + z * z
    scale = 1.0 / math.sqrt(squared) if squared > 0.0 else 0.0
    x, y, z = x * scale, y * scale, z * scale
    falloff = 1.0 / max(squared, lamps[lamp, NEAREST])
    off_axis = -(x * ax + y * ay + z * az)
    if lamps[lamp, KIND] == AREA:
        falloff *= max(off_axis, 0.0)
    elif lamps[lamp, KIND] == SPOT:
        falloff *= smoothstep((off_axis - lamps[lamp, CONE]) / lamps[lamp, EDGE])
    return x, y, z, falloff
