"""Pre-shading of the non-transparent voxels: Blinn-Phong, two-sided (paper 2.1; algorithm.md 4.2).

Split in two: the normals do not depend on the view and may be kept between frames; the colours may change with it.
"""

from __future__ import annotations

import numpy as np

from ..jit import compiled, kernel, parallel_call, prange, read_only
from ..volume.gradient import CHUNK, unit_normals
from .lights import AREA, AXIS, CONE, EDGE, KIND, NEAREST, POSITION, RGB, SPOT, SUN, light_rows

SHARPEST = 1e9  # a larger shininess is a highlight of no width; the whole part must also fit an integer


def is_shaded(shading, lights, headlight_direction=None) -> bool:
    """Whether normals are needed at all: the transfer function shades and something shines."""
    return bool(shading) and (len(lights) > 0 or headlight_direction is not None)


def follows_view(shading, lights, headlight_direction=None) -> bool:
    """Whether the shaded colours change when the camera moves: a highlight or a headlight."""
    if not is_shaded(shading, lights, headlight_direction):
        return False
    return shading.specular > 0.0 or headlight_direction is not None


def normals(classified, volume, index_to_world, *, backend: str = "auto", threads: int = 0) -> np.ndarray:
    """(m, 3) float32 unit world normals of the visible voxels, (0, 0, 0) where the gradient is below the noise."""
    return unit_normals(
        volume, classified.row_start, classified.column, index_to_world, backend=backend, threads=threads
    )


def shade(
    classified, normals, index_to_world, shading, lights=(), *,
    headlight_direction=None, eye=None, backend: str = "auto", threads: int = 0,
) -> np.ndarray:
    """(m, 3) float32 shaded, unassociated, scene-linear colours of the visible voxels.

    c * (ambient + sum diffuse |n.l| I) + sum specular |n.h|^shininess I over the lights, I an RGB scale (see
    ``lights.py``); c itself where there is no normal, and everywhere when nothing shades or nothing shines.

    ``normals``: (m, 3) of ``normals()``, None when ``is_shaded`` is False.  ``shading``: a Shade, or None.
    ``lights``: scene.Light objects.  ``headlight_direction``: (3,) the way the camera looks, world, or None.
    ``eye``: (4,) homogeneous world eye; its last component is 0 for parallel rays and the rest then points from
    the scene to the eye, else it is above 0.  Only highlights need it.
    """
    if not is_shaded(shading, lights, headlight_direction):
        return classified.color
    matrix = np.ascontiguousarray(index_to_world, dtype=np.float64)
    eye = np.zeros(4) if eye is None else np.asarray(eye, dtype=np.float64) * (-1.0 if eye[3] < 0.0 else 1.0)
    rows = light_rows(lights, headlight_direction, matrix)
    shininess = min(shading.shininess, SHARPEST)
    material = np.array([shading.ambient, shading.diffuse, shading.specular, shininess], dtype=np.float64)
    shaded = np.empty((len(classified.column), 3), dtype=np.float32)
    n_y = classified.shape_xyz[1]
    voxels = (read_only(a) for a in (classified.row_start, classified.column, classified.color, normals))
    arrays = (*voxels, read_only(matrix), material, rows, eye, shaded)
    if compiled(backend):
        with parallel_call(threads):
            _shade_rows(n_y, *arrays)
    else:
        _shade_numpy(n_y, *arrays)
    return read_only(shaded)


@kernel(inline="always")
def _scale_of(x, y, z):
    """One over the length of a vector, 0 for the zero vector."""
    length = np.sqrt(x * x + y * y + z * z)
    return 1.0 / length if length > 0.0 else 0.0


@kernel(inline="always")
def _power(base, whole, rest):
    """``base`` (0 or more) to the power ``whole + rest``; the whole part, mostly all there is, by squarings."""
    result = 1.0 if rest == 0.0 else base**rest
    while whole > 0:
        if whole & 1:
            result *= base
        base *= base
        whole >>= 1
    return result


@kernel
def _towards(light, px, py, pz):
    """Unit vector from a world point to a light (a row of ``light_rows``), and its falloff there."""
    if light[KIND] == SUN:
        return -light[AXIS], -light[AXIS + 1], -light[AXIS + 2], 1.0
    lx, ly, lz = light[POSITION] - px, light[POSITION + 1] - py, light[POSITION + 2] - pz
    falloff = 1.0 / max(lx * lx + ly * ly + lz * lz, light[NEAREST])
    scale = _scale_of(lx, ly, lz)
    lx, ly, lz = lx * scale, ly * scale, lz * scale
    off_axis = -(lx * light[AXIS] + ly * light[AXIS + 1] + lz * light[AXIS + 2])
    if light[KIND] == AREA:
        falloff *= max(off_axis, 0.0)
    elif light[KIND] == SPOT:
        t = min(max((off_axis - light[CONE]) / light[EDGE], 0.0), 1.0)
        falloff *= t * t * (3.0 - 2.0 * t)
    return lx, ly, lz, falloff


@kernel(parallel=True)
def _shade_rows(n_y, row_start, column, color, normals, matrix, material, lights, eye, shaded):
    """``matrix`` (4, 4) index to world; ``material`` ambient, diffuse, specular, shininess; ``lights`` (n, COLUMNS);
    ``color``, ``normals``, ``shaded`` (m, 3) float32."""
    ambient, diffuse, specular, shininess = material
    whole = np.int64(shininess)
    rest = shininess - whole
    for row in prange(row_start.size - 1):
        z, y = row // n_y, row % n_y
        for i in range(row_start[row], row_start[row + 1]):
            nx, ny, nz = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
            if nx == 0.0 and ny == 0.0 and nz == 0.0:
                for channel in range(3):
                    shaded[i, channel] = color[i, channel]
                continue
            x = np.float64(column[i])
            px = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]
            py = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]
            pz = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
            vx, vy, vz = eye[0] - eye[3] * px, eye[1] - eye[3] * py, eye[2] - eye[3] * pz
            scale = _scale_of(vx, vy, vz)
            vx, vy, vz = vx * scale, vy * scale, vz * scale
            dr = dg = db = ambient
            sr = sg = sb = 0.0
            for k in range(lights.shape[0]):
                lx, ly, lz, falloff = _towards(lights[k], px, py, pz)
                matt = diffuse * abs(nx * lx + ny * ly + nz * lz) * falloff
                dr += matt * lights[k, RGB]
                dg += matt * lights[k, RGB + 1]
                db += matt * lights[k, RGB + 2]
                if specular > 0.0:
                    hx, hy, hz = lx + vx, ly + vy, lz + vz
                    cosine = abs(nx * hx + ny * hy + nz * hz) * _scale_of(hx, hy, hz)
                    gloss = specular * _power(cosine, whole, rest) * falloff
                    sr += gloss * lights[k, RGB]
                    sg += gloss * lights[k, RGB + 1]
                    sb += gloss * lights[k, RGB + 2]
            shaded[i, 0] = color[i, 0] * dr + sr
            shaded[i, 1] = color[i, 1] * dg + sg
            shaded[i, 2] = color[i, 2] * db + sb


def _shade_numpy(n_y, row_start, column, color, normals, matrix, material, lights, eye, shaded):
    """Twin of ``_shade_rows``, in chunks of voxels."""
    ambient, diffuse, specular, shininess = material
    for first in range(0, len(column), CHUNK):
        part = slice(first, min(first + CHUNK, len(column)))
        row = np.searchsorted(row_start, np.arange(part.start, part.stop), side="right") - 1
        index = np.stack((column[part].astype(np.float64), row % n_y, row // n_y), axis=1)
        points = index @ matrix[:3, :3].T + matrix[:3, 3]
        n = normals[part].astype(np.float64)
        view = _unit_numpy(eye[:3] - eye[3] * points)
        matt = np.full((len(points), 3), ambient)
        gloss = np.zeros((len(points), 3))
        for light in lights:
            towards, falloff = _towards_numpy(light, points)
            strength = falloff[:, None] * light[RGB:NEAREST]
            matt += diffuse * np.abs((n * towards).sum(axis=1))[:, None] * strength
            if specular > 0.0:
                half = _unit_numpy(towards + view)
                gloss += specular * np.abs((n * half).sum(axis=1))[:, None] ** shininess * strength
        lit = color[part] * matt + gloss
        shaded[part] = np.where(n.any(axis=1)[:, None], lit, color[part])


def _unit_numpy(vectors) -> np.ndarray:
    lengths = np.sqrt((vectors**2).sum(axis=1))[:, None]
    return vectors * np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)


def _towards_numpy(light, points):
    """Twin of ``_towards`` for (m, 3) points: (m, 3) unit vectors and (m,) falloff."""
    if light[KIND] == SUN:
        return np.broadcast_to(-light[AXIS:RGB], points.shape), np.ones(len(points))
    way = light[POSITION:AXIS] - points
    falloff = 1.0 / np.maximum((way**2).sum(axis=1), light[NEAREST])
    towards = _unit_numpy(way)
    off_axis = -(towards @ light[AXIS:RGB])
    if light[KIND] == AREA:
        falloff *= np.maximum(off_axis, 0.0)
    elif light[KIND] == SPOT:
        t = np.clip((off_axis - light[CONE]) / light[EDGE], 0.0, 1.0)
        falloff *= t * t * (3.0 - 2.0 * t)
    return towards, falloff
