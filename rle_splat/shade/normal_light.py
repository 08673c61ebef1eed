"""Parallel light on voxels, computed from coded normals where a run of voxels is read.

Light that follows the view (a headlight, highlights) would have to be computed again for every voxel in every frame
(``voxel_light``). Where it depends on the normal and the direction to the eye alone, it is computed while a sheet is
splatted, for the voxels that the sheet reads. Shear-warp renderers look it up in a table of all coded normals instead
(Lacroute and Levoy 1994); the normals are then as coarse as the table is small.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..runtime.buffer_pool import empty
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from .lighting import BACK, PHONG, Lighting
from .shading import components
from .voxel_light import light_bounds

ONE = np.float32(32767.0)  # code of a component of 1
PART_BITS = 8  # binary places of a shininess
SHARPEST = 1024.0  # shininess up to which a coded normal is exact enough: its direction errs by up to 2^-15
# Cosines are bounded from below, such that their power is 2^-FAINT_BITS at least: its square, the smallest number that
# occurs, is then no denormal number, which would be slow.
FAINT_BITS = 60.0
# Columns of ``Lamps.rays``.
TOWARDS, HALFWAY, MATT, GLOSS, RAY = 0, 3, 6, 9, 12
# Entries of ``Lamps.surface``: RGB of the light from all directions, 1 for two-sided surfaces, the least cosine.
EVERYWHERE, TWO_SIDED, FAINT = 0, 3, 4


class Lamps(NamedTuple):
    """Coded normals and parallel light, as kernels take them.

    Attributes
    ----------
    normals : (3, m) int16
        Unit normals, world space, times ONE; zero for a voxel without normal.
    rays : (n, RAY) float32
        Of each light: unit vector to it; unit vector half-way to an eye at infinity; RGB of its diffuse light and of
        its highlight.
    surface : (5,) float32
        See EVERYWHERE.
    whole, parts : int
        The shininess, and PART_BITS of its fraction.
    is_near : bool
        Whether the eye is not at infinity.
    from_line : (3, 4) float64
        (voxel of a scanline, scanline, slice, 1) to the vector from there to the eye, world units.
    """

    normals: np.ndarray
    rays: np.ndarray
    surface: np.ndarray
    whole: int
    parts: int
    is_near: bool
    from_line: np.ndarray


NO_LAMPS = Lamps(
    read_only(np.empty((3, 0), np.int16)), read_only(np.empty((0, RAY), np.float32)),
    read_only(np.zeros(5, np.float32)), 0, 0, False, read_only(np.zeros((3, 4))),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class NormalLight:
    """Light on voxels, still to be made of their normals.

    Attributes
    ----------
    falling : Lighting
    channels : int
        Of light, and of highlight if there is any, 1 or 3 each.
    most_light, most_highlight : float
        See VoxelLight.
    """

    falling: Lighting
    channels: int
    most_light: float
    most_highlight: float

    @property
    def no_codes(self) -> np.ndarray:
        """(0, channels): codes of light of no voxel."""
        return np.empty((0, self.channels), np.uint16)

    def lamps(self, normals: np.ndarray, axis: int) -> Lamps:
        """For kernels: ``normals``, (3, m) codes in the order of the tables of principal axis ``axis``."""
        falling = self.falling
        (i, j, k), (*eye, near) = AXES[axis], falling.eye.tolist()
        rows = zip(falling.matrix[:3].tolist(), eye)
        from_line = np.array([(-near * row[i], -near * row[j], -near * row[k], at - near * row[3]) for row, at in rows])
        is_near = near != 0.0
        return Lamps(read_only(normals), *self._of_all_axes, is_near, read_only(from_line))

    @cached_property
    def _of_all_axes(self) -> tuple:
        """``rays``, ``surface``, ``whole`` and ``parts`` of Lamps, whatever the principal axis."""
        material = self.falling.material.tolist()
        _, diffuse, specular, shininess, *everywhere = material[:7]
        rays = [
            (*towards, *halfway, *(diffuse * part for part in color), *(specular * part for part in color))
            for towards, halfway, color in self.falling.beams()
        ]
        rays = np.array(rays, np.float32).reshape(-1, RAY)
        places = round(shininess * 2**PART_BITS)
        faintest = 2.0 ** -(FAINT_BITS / max(shininess, 0.5))
        surface = np.array((*everywhere, material[BACK], faintest), np.float32)
        return read_only(rays), read_only(surface), places >> PART_BITS, places % 2**PART_BITS


def normal_light(falling: Lighting, shape_xyz) -> NormalLight | None:
    """The light of a Lighting as a NormalLight.

    Parameters
    ----------
    falling : Lighting
    shape_xyz : (nx, ny, nz)
        Of the volume.

    Returns
    -------
    NormalLight or None
        None if it depends on more than normals and the direction to the eye: where lights are not parallel or shadows
        fall, for Phong highlights, and for highlights sharper than SHARPEST.

    Raises
    ------
    RleSplatError
        If the light is above BRIGHTEST.
    """
    material = falling.material
    is_parallel = falling.shadows is None and falling.is_parallel
    if falling.sky.size or not is_parallel or (material[2] > 0.0 and (material[PHONG] > 0.0 or material[3] > SHARPEST)):
        return None
    bounds = light_bounds(falling, shape_xyz)
    return NormalLight(falling, bounds.channels, bounds.most_light, bounds.most_highlight)


def code_normals(normals: np.ndarray, *, threads: int = 0) -> np.ndarray:
    """Code unit normals.

    Parameters
    ----------
    normals : (m, 3) ndarray of float32
        As of ``shading.normals``.
    threads : int
        0 for one per core.

    Returns
    -------
    (3, m) ndarray of int16
        See ``Lamps``.
    """
    codes = empty((3, len(normals)), np.int16)
    if compiled():
        with parallel_call(threads):
            _code(components(normals), codes)
    else:
        codes[:] = np.rint(normals.T * ONE)
    return codes


@kernel
def _code(normals, codes):
    """Kernel of ``code_normals``; ``normals``: (3, m)."""
    share_out(_code_part, codes.shape[1], (normals, codes))


@kernel(inner=True)
def _code_part(begin, end, normals, codes):
    """``_code`` for voxels [begin, end)."""
    for component in range(3):
        these, coded = normals[component, begin:end], codes[component, begin:end]
        for i in range(these.size):
            coded[i] = np.int16(np.rint(these[i] * ONE))
