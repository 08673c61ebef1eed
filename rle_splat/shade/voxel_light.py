"""Light on each voxel, apart from its color; post-classified sheets interpolate it beside the scalar.

The paper shades voxels before they are splatted. So does this module, but the color is applied later, from the lookup
table (algorithm.md 1.14):

    color of a sample  =  classified color * light + highlight

Light and highlight have one channel if all light is white, else three. They are stored as the 16-bit floats of
``encode.records``, relative to a power of two, so that the 1 of unshaded voxels is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..classify.visible import VisibleVoxels
from ..encode.records import UNBIAS, code_of
from ..encode.reference import code
from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference
from .chunk_light import DR, LANES, SCRATCH, SHARE, SR, add_near, add_rays, clear_light
from .lighting import Lighting
from .lights import AXIS, KIND, NEAREST, POSITION, RGB, SUN
from .shading import components, refuse_too_bright

_ZERO = np.float32(0.0)


@dataclass(frozen=True, eq=False)
class VoxelLight:
    """Coded light of each voxel.

    Attributes
    ----------
    codes : (m, channels) ndarray of uint16
        Light, then highlight, of 1 or 3 channels each; no highlight if nothing is specular.
    unit : float
        A code, as shifted float32 bits, times this is its value.
    most_light, most_highlight : float
        Upper bounds of any voxel, from the lights alone, so that they do not depend on which voxels are kept.
    """

    codes: np.ndarray
    unit: float
    most_light: float
    most_highlight: float

    @property
    def nbytes(self) -> int:
        """Bytes of the codes."""
        return self.codes.nbytes


def light_planes(channels: int) -> tuple[tuple, tuple]:
    """Sheet planes, counted from the scalar, of light and of highlight, for so many ``channels`` together."""
    return {1: ((1,), ()), 2: ((1,), (2,)), 3: ((1, 2, 3), ()), 6: ((1, 2, 3), (4, 5, 6))}[channels]


def with_factor(light: VoxelLight | None, factor: np.ndarray) -> VoxelLight:
    """Copy with one more channel, the last: ``factor`` (m,) in [0, 1], which multiplies each voxel's extinction."""
    unit = float(UNBIAS) if light is None else light.unit
    codes = code(factor * (float(UNBIAS) / unit)).astype(np.uint16)[:, None]
    if light is None:
        return VoxelLight(codes, unit, 1.0, 0.0)
    return replace(light, codes=np.concatenate((light.codes, codes), axis=1))


def voxel_light(voxels: VisibleVoxels, normals, falling: Lighting, *, threads: int = 0) -> VoxelLight:
    """Light on voxels.

    Parameters
    ----------
    voxels : VisibleVoxels
    normals : (m, 3) ndarray of float32
        A voxel without normal has light 1, or what shadows leave of it, and highlight 0.
    falling : Lighting
    threads : int
        0 for one per core.

    Returns
    -------
    VoxelLight

    Raises
    ------
    RleSplatError
        If the light is above BRIGHTEST.
    """
    bounds = light_bounds(falling, voxels.shape_xyz)
    each, brightest = bounds.each, max(bounds.most_light, bounds.most_highlight)
    scale = 2.0 ** math.ceil(math.log2(brightest))
    codes = empty((len(voxels), bounds.channels), np.uint16)
    _, ny, nz = voxels.shape_xyz
    if compiled():
        near = falling.near
        light = (components(normals), falling.material, None if near else falling.rays(), near)
        rows = (ny, read_only(voxels.row_start), read_only(voxels.column))
        with parallel_call(threads):
            _code_light(rows, nz, *light, each, 1.0 / scale, codes)
    else:
        reference.code_light(voxels, normals, falling, each, scale, codes)
    return VoxelLight(codes, float(UNBIAS) * scale, bounds.most_light, bounds.most_highlight)


class LightBounds(NamedTuple):
    """What is known of the light on voxels before it is made: channels of light, and of highlight if there is any,
    ``each``; all ``channels``; and see VoxelLight."""

    each: int
    channels: int
    most_light: float
    most_highlight: float


def light_bounds(falling: Lighting, shape_xyz) -> LightBounds:
    """Bounds of a Lighting on the voxels of a volume; RleSplatError if the light is above BRIGHTEST."""
    strengths, sky = falling.rows[:, RGB:NEAREST], falling.sky
    colors = (*strengths.tolist(), falling.material[4:7].tolist(), *sky.T.tolist())
    white = all([red == green == blue for red, green, blue in colors])
    each = 1 if white else 3
    ambient, (_, diffuse, specular) = max(falling.most_everywhere.tolist()), falling.material[:3].tolist()
    if not falling.is_parallel:
        strengths = strengths / _nearest(falling, shape_xyz)[:, None]
    strongest = max(map(sum, zip(*strengths.tolist())), default=0.0)
    most_light, most_highlight = max(1.0, ambient + diffuse * strongest), specular * strongest
    refuse_too_bright(max(most_light, most_highlight))
    return LightBounds(each, each * (2 if falling.has_highlights else 1), most_light, most_highlight)


def _nearest(falling: Lighting, shape_xyz) -> np.ndarray:
    """(n,) lower bound of the squared distance from each light to any voxel; 1 for a parallel light.

    Codes are relative to the strongest possible light, so the bound should be tight for lights outside the volume: it
    is the distance to the sphere around the volume.
    """
    matrix, rows = falling.matrix, falling.rows
    half = 0.5 * (np.array(shape_xyz) - 1.0)
    corners = (np.indices((2, 2, 2)).reshape(3, 8).T * 2.0 - 1.0) * half
    radius = np.linalg.norm(corners @ matrix[:3, :3].T, axis=1).max()
    center = matrix[:3, :3] @ half + matrix[:3, 3]
    away = np.maximum(np.linalg.norm(rows[:, POSITION:AXIS] - center, axis=1) * (1.0 - 1e-9) - radius, 0.0)
    return np.where(rows[:, KIND] == SUN, 1.0, np.maximum(rows[:, NEAREST], away**2))


@kernel
def _code_light(rows, n_planes, normals, material, rays, near, each, inverse, codes):
    """Kernel of ``voxel_light``.

    ``rows``: ny, row_start and column of the voxels. ``rays``, ``near``: see ``shading._write_records``. ``each``:
    channels of light, and of highlight. ``inverse``: one over their scale.
    """
    share_out(_code_planes, n_planes, (rows, normals, material, rays, near, each, inverse, codes))


@kernel(inner=True)
def _code_planes(begin, end, rows, normals, material, rays, near, each, inverse, codes):
    """``_code_light`` for planes [begin, end)."""
    n_y, row_start, column = rows
    s = np.empty(SCRATCH, np.float32)
    for plane in range(begin, end):
        row = plane * n_y
        at, last = row_start[row], row_start[row + n_y]
        while at < last:
            count = min(LANES, last - at)
            while row_start[row + 1] <= at:
                row += 1
            clear_light(material, normals[:, at : at + count], count, s)
            if rays is not None:
                add_rays(rays, normals[:, at : at + count], material, count, s)
            if near is not None:
                add_near(near, normals[:, at : at + count], material, n_y, row, row_start, column, at, count, s)
            for i in range(count):
                if normals[0, at + i] == _ZERO and normals[1, at + i] == _ZERO and normals[2, at + i] == _ZERO:
                    for channel in range(each):
                        s[DR + channel * LANES + i] = s[SHARE + i]
                        s[SR + channel * LANES + i] = _ZERO
            for part in range(codes.shape[1] // each):
                for channel in range(each):
                    light = s[(SR if part else DR) + channel * LANES :]
                    for i in range(count):
                        codes[at + i, part * each + channel] = np.uint16(code_of(light[i] * inverse))
            at += count
