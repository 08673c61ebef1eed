"""The light on a chunk of voxels: sums of diffuse light and of highlights over all lights.

Kernels take LANES voxels at a time, with the scratch of one chunk in one array ``s``: each step of the formula of
``shading.shade`` is a loop over the chunk, so that it becomes wide SIMD.
"""

from __future__ import annotations

import numpy as np

from ..runtime.jit import inner_loop, kernel
from .environment import SKY, TERMS
from .lighting import BACK, FULL_CODE
from .lights import AREA, AXIS, CONE, EDGE, KIND, NEAREST, POSITION, RGB, SPOT, SUN

# Voxels shaded together: the scratch arrays stay in the L1 cache, and loops are long enough for SIMD.
LANES = 256
# Planes of the float32 scratch: unit vectors to the light and to the eye; cosine, its power and the light's falloff;
# sums of diffuse light and of highlights; light that arrives, and all light without shadows.
LX, LY, LZ, VX, VY, VZ, COS, POWER, FALLOFF, DR, DG, DB, SR, SG, SB, SHARE, ALL = (LANES * p for p in range(17))
SCRATCH = 17 * LANES
PX, PY, PZ = (LANES * plane for plane in range(3))  # planes of the float64 scratch: world position
POSITIONS = 3 * LANES
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_PER_CODE = np.float32(1.0 / FULL_CODE)
_FAINT = np.float32(1e-18)  # the product of two such numbers is not denormal


@kernel(inline="always")
def clear_light(material, normals, count, s):
    """Set the sums of a chunk to the light from all directions, and the highlights to zero."""
    for channel in range(3):
        everywhere = np.float32(material[4 + channel])
        for i in range(LANES):
            s[DR + channel * LANES + i] = everywhere
    if material.size > SKY:
        _add_sky(material, normals, count, s)
    for i in range(LANES):
        s[SHARE + i] = _ONE
    for i in range(3 * LANES):
        s[SR + i] = _ZERO


@kernel(inner=True)
def _add_sky(material, normals, count, s):
    """Add what the world's light changes by with the normal, see ``environment.py``; the sum is at least ambient."""
    least = np.float32(material[0])
    for channel in range(3):
        at = SKY + channel * TERMS
        x1, y1, z1 = np.float32(material[at]), np.float32(material[at + 1]), np.float32(material[at + 2])
        xx, yy, zz = np.float32(material[at + 3]), np.float32(material[at + 4]), np.float32(material[at + 5])
        xy, yz, zx = np.float32(material[at + 6]), np.float32(material[at + 7]), np.float32(material[at + 8])
        for i in range(count):
            x, y, z = normals[0, i], normals[1, i], normals[2, i]
            change = x * (x1 + xx * x + xy * y) + y * (y1 + yy * y + yz * z) + z * (z1 + zz * z + zx * x)
            s[DR + channel * LANES + i] = max(s[DR + channel * LANES + i] + change, least)


@kernel(inline="always")
def _raise_to(shininess, count, s):
    """POWER = COS ** shininess, for COS >= 0; the integer part by repeated squaring.

    Values too faint to see become 0 at once, because denormal numbers are a hundred times slower.
    """
    whole = np.int64(shininess)
    rest = np.float32(shininess - whole)
    for i in range(count):
        s[POWER + i] = _ONE
    if rest != _ZERO:
        for i in range(count):
            s[POWER + i] = s[COS + i] ** rest
    while whole > 0:
        if whole & 1:
            for i in range(count):
                power = s[POWER + i] * s[COS + i]
                s[POWER + i] = power if power > _FAINT else _ZERO
        whole >>= 1
        if whole > 0:
            for i in range(count):
                square = s[COS + i] * s[COS + i]
                s[COS + i] = square if square > _FAINT else _ZERO


@kernel(inline="always")
def add_rays(rays, normals, material, count, s):
    """Add parallel lights, seen along parallel rays, to the sums of a chunk; ``rays``: see ``Lighting.rays``."""
    diffuse, specular, back = np.float32(material[1]), np.float32(material[2]), np.float32(material[BACK])
    for k in range(rays.shape[0]):
        lx, ly, lz = rays[k, 0], rays[k, 1], rays[k, 2]
        hx, hy, hz = rays[k, 3], rays[k, 4], rays[k, 5]
        red, green, blue = rays[k, 6], rays[k, 7], rays[k, 8]
        for i in range(count):
            facing = normals[0, i] * lx + normals[1, i] * ly + normals[2, i] * lz
            matt = diffuse * max(-facing, back * facing)
            s[DR + i] += matt * red
            s[DG + i] += matt * green
            s[DB + i] += matt * blue
        if specular > _ZERO:
            for i in range(count):
                s[COS + i] = abs(normals[0, i] * hx + normals[1, i] * hy + normals[2, i] * hz)
            if back == _ZERO:
                for i in range(count):
                    facing = normals[0, i] * lx + normals[1, i] * ly + normals[2, i] * lz
                    s[COS + i] = s[COS + i] if facing < _ZERO else _ZERO
            _raise_to(material[3], count, s)
            for i in range(count):
                gloss = specular * s[POWER + i]
                s[SR + i] += gloss * red
                s[SG + i] += gloss * green
                s[SB + i] += gloss * blue


@kernel(inner=True)
def add_near(near, normals, material, n_y, row, row_start, column, begin, count, s):
    """As ``add_rays``, for lights and eyes near the voxels; ``row``: row of the chunk's first voxel."""
    matrix, lights, eye, shadows = near
    positions = np.empty(POSITIONS, np.float64)
    _voxel_positions(n_y, row, row_start, column, matrix, begin, count, positions)
    if material[2] > 0.0:
        _view_voxels(eye, count, positions, s)
    _shade_ambient(shadows, material, begin, count, s)
    for k in range(lights.shape[0]):
        _towards(lights[k], count, positions, s)
        _shade_light(shadows, k, lights[k], material, begin, count, s)
        _add_light(lights[k], normals, material, count, s)
    _divide_shares(shadows, count, s)


@kernel(inner=True)
def _shade_ambient(shadows, material, begin, count, s):
    """Apply shadows to the light from all directions, and begin the sums SHARE (after shadows) and ALL (before).

    ``shadows``: (codes, row_of) of a Shadows; None does nothing, here and in the next two functions.
    """
    if shadows is not None:
        codes, row_of = shadows
        everywhere = np.float32(material[4] + material[5] + material[6])
        for i in range(count):
            s[SHARE + i] = everywhere
            s[ALL + i] = everywhere
        row = row_of[row_of.size - 1]
        if row >= 0:
            left = codes[row, begin : begin + count]
            for i in range(count):
                share = np.float32(left[i]) * _PER_CODE
                s[DR + i] *= share
                s[DG + i] *= share
                s[DB + i] *= share
                s[SHARE + i] *= share


@kernel(inner=True)
def _shade_light(shadows, k, light, material, begin, count, s):
    """Apply shadows to FALLOFF of light number ``k``, and add it to SHARE and ALL."""
    if shadows is not None:
        codes, row_of = shadows
        strength = np.float32(material[1] * (light[RGB] + light[RGB + 1] + light[RGB + 2]))
        for i in range(count):
            s[ALL + i] += strength * s[FALLOFF + i]
        if row_of[k] >= 0:
            left = codes[row_of[k], begin : begin + count]
            for i in range(count):
                s[FALLOFF + i] *= np.float32(left[i]) * _PER_CODE
        for i in range(count):
            s[SHARE + i] += strength * s[FALLOFF + i]


@kernel(inner=True)
def _divide_shares(shadows, count, s):
    """Divide SHARE by ALL: the share of all light that arrives, or 1 if there is no light."""
    if shadows is not None:
        for i in range(count):
            s[SHARE + i] = s[SHARE + i] / s[ALL + i] if s[ALL + i] > _ZERO else _ONE


@inner_loop(exact=True)
def _divide_exactly(part, length):
    """``part / length``: the processors' estimates of one over a root differ between makers."""
    return part / length


@kernel(inline="always")
def _scale_of(x, y, z):
    """One over the length of a vector; 0 for the zero vector."""
    length = np.sqrt(x * x + y * y + z * z)
    return 1.0 / length if length > 0.0 else 0.0


@kernel(inner=True)
def _voxel_positions(n_y, row, row_start, column, matrix, begin, count, positions):
    """World positions of ``count`` voxels from number ``begin`` on; ``row``: row of the first, or one before."""
    i = 0
    while i < count:
        z, y = row // n_y, row % n_y
        stop = min(row_start[row + 1] - begin, count)
        ox = matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]
        oy = matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]
        oz = matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
        for j in range(i, stop):
            x = np.float64(column[begin + j])
            positions[PX + j] = matrix[0, 0] * x + ox
            positions[PY + j] = matrix[1, 0] * x + oy
            positions[PZ + j] = matrix[2, 0] * x + oz
        i = max(i, stop)
        row += 1


@kernel(inner=True)
def _view_voxels(eye, count, positions, s):
    """Unit vectors to the eye, to VX, VY, VZ."""
    for i in range(count):
        x = eye[0] - eye[3] * positions[PX + i]
        y = eye[1] - eye[3] * positions[PY + i]
        z = eye[2] - eye[3] * positions[PZ + i]
        scale = _scale_of(x, y, z)
        s[VX + i] = x * scale
        s[VY + i] = y * scale
        s[VZ + i] = z * scale


@kernel(inner=True)
def _towards(light, count, positions, s):
    """Unit vectors to a light (a row of ``light_rows``), to LX, LY, LZ, and its FALLOFF."""
    ax, ay, az = light[AXIS], light[AXIS + 1], light[AXIS + 2]
    sx, sy, sz = np.float32(-ax), np.float32(-ay), np.float32(-az)
    for i in range(count):
        s[LX + i] = sx
        s[LY + i] = sy
        s[LZ + i] = sz
        s[FALLOFF + i] = _ONE
    kind = light[KIND]
    if kind == SUN:
        return
    for i in range(count):
        x, y = light[POSITION] - positions[PX + i], light[POSITION + 1] - positions[PY + i]
        z = light[POSITION + 2] - positions[PZ + i]
        falloff = 1.0 / max(x * x + y * y + z * z, light[NEAREST])
        scale = _scale_of(x, y, z)
        x, y, z = x * scale, y * scale, z * scale
        off_axis = -(x * ax + y * ay + z * az)
        if kind == AREA:
            falloff *= max(off_axis, 0.0)
        elif kind == SPOT:
            t = min(max((off_axis - light[CONE]) / light[EDGE], 0.0), 1.0)
            falloff *= t * t * (3.0 - 2.0 * t)
        s[LX + i] = x
        s[LY + i] = y
        s[LZ + i] = z
        s[FALLOFF + i] = falloff


@kernel(inner=True)
def _add_light(light, normals, material, count, s):
    """Add one light to the sums of a chunk."""
    diffuse, specular, back = np.float32(material[1]), np.float32(material[2]), np.float32(material[BACK])
    red, green, blue = np.float32(light[RGB]), np.float32(light[RGB + 1]), np.float32(light[RGB + 2])
    for i in range(count):
        facing = normals[0, i] * s[LX + i] + normals[1, i] * s[LY + i] + normals[2, i] * s[LZ + i]
        matt = diffuse * max(-facing, back * facing) * s[FALLOFF + i]
        s[DR + i] += matt * red
        s[DG + i] += matt * green
        s[DB + i] += matt * blue
    if specular == _ZERO:
        return
    for i in range(count):
        hx, hy, hz = s[LX + i] + s[VX + i], s[LY + i] + s[VY + i], s[LZ + i] + s[VZ + i]
        facing = normals[0, i] * hx + normals[1, i] * hy + normals[2, i] * hz
        length = np.sqrt(hx * hx + hy * hy + hz * hz)
        s[COS + i] = _divide_exactly(abs(facing), length) if length > _ZERO else _ZERO
    if back == _ZERO:
        for i in range(count):
            facing = normals[0, i] * s[LX + i] + normals[1, i] * s[LY + i] + normals[2, i] * s[LZ + i]
            s[COS + i] = s[COS + i] if facing < _ZERO else _ZERO
    _raise_to(material[3], count, s)
    for i in range(count):
        gloss = specular * s[POWER + i] * s[FALLOFF + i]
        s[SR + i] += gloss * red
        s[SG + i] += gloss * green
        s[SB + i] += gloss * blue
