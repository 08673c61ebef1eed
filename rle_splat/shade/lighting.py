"""What falls on the voxels of a volume: lights, light from everywhere, a headlight, and what shadows leave of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..classify.limits import STRONGEST_LIGHT
from ..runtime.jit import read_only
from .lights import AXIS, KIND, NEAREST, RGB, SUN, light_rows

BACK, PHONG = 7, 8  # of a Lighting's material
SHARPEST = 1e9  # a larger shininess is a highlight of no width; the whole part must also fit an integer
FULL_CODE = 65535  # of a Shadows' codes: all of the light


@dataclass(frozen=True, eq=False)
class Shadows:
    """What of the lights and of the ambient light reaches each voxel.

    ``codes``: (k, m) uint16, FULL_CODE times the share that arrives.  ``row_of``: (n + 1,) int64, the row of ``codes``
    for each of n lights and for the ambient light; -1 for what is in no shadow.
    """

    codes: np.ndarray
    row_of: np.ndarray

    def share(self, which: int, part: slice) -> np.ndarray | float:
        """(k,) float64 of light number ``which``, -1 the ambient light, that reaches the voxels ``part``."""
        row = self.row_of[which]
        return 1.0 if row < 0 else self.codes[row, part] / FULL_CODE


@dataclass(frozen=True, eq=False)
class Lighting:
    """What falls on the voxels of a volume.

    ``matrix``: (4, 4) index to world.  ``material``: (9,) ambient, diffuse, specular, shininess; RGB of the light that
    comes from everywhere, ambient and the world's together; 1 where surfaces have two sides, else 0; 1 for highlights
    by Phong, 0 by Blinn and Phong.  ``rows``: the lights, see ``light_rows``.  ``eye``: (4,)
    homogeneous world eye, its last component 0 for parallel rays.  ``shadows``: of the same voxels, None without any.
    """

    matrix: np.ndarray
    material: np.ndarray
    rows: np.ndarray
    eye: np.ndarray
    shadows: Shadows | None = None

    @property
    def is_far(self) -> bool:
        """Whether it does not matter where a voxel is, nor which it is: parallel light without shadows, and parallel
        rays where highlights are seen, which are Blinn's."""
        if self.shadows is not None or self.material[PHONG] > 0.0:
            return False
        sees_highlights = self.material[2] > 0.0 and self.eye[3] != 0.0
        return not (sees_highlights or (self.rows[:, KIND] != SUN).any())

    @property
    def near(self) -> tuple | None:
        """What ``add_near`` takes of it; None where ``rays`` will do."""
        if self.is_far:
            return None
        shadows = None if self.shadows is None else (read_only(self.shadows.codes), read_only(self.shadows.row_of))
        return self.matrix, self.rows, self.eye, shadows

    def rays(self) -> np.ndarray:
        """(n, 9) float32 of lights that are far: unit vectors to the light, and half-way to the eye; RGB."""
        towards = -self.rows[:, AXIS:RGB]
        halfway = unit_vectors(towards + unit_vectors(self.eye[None, :3]))
        return np.ascontiguousarray(np.hstack((towards, halfway, self.rows[:, RGB:NEAREST])), dtype=np.float32)


def is_shaded(shading, lights, headlight_direction=None, world=None) -> bool:
    """Whether normals are needed at all: the transfer function shades and something shines."""
    return bool(shading) and (len(lights) > 0 or headlight_direction is not None or world is not None)


def lighting(index_to_world, shading, lights=(), *, headlight_direction=None, eye=None, world=None) -> Lighting | None:
    """The Lighting of a Shade and scene.Light objects, or None when nothing shades or nothing shines.

    ``headlight_direction``: (3,) the way the camera looks, world, or None.  ``eye``: (4,) homogeneous world eye; its
    last component is 0 for parallel rays and the rest then points from the scene to the eye.  Only highlights need it.
    ``world``: (3,) radiance that shines from everywhere, or None.
    """
    if not is_shaded(shading, lights, headlight_direction, world):
        return None
    matrix = np.ascontiguousarray(index_to_world, dtype=np.float64)
    eye = np.zeros(4) if eye is None else np.asarray(eye, dtype=np.float64) * (-1.0 if eye[3] < 0.0 else 1.0)
    shininess = min(shading.shininess, SHARPEST)
    # A matt surface under a sky of radiance W has the radiance W times its colour, whichever way it faces.
    everywhere = np.full(3, shading.ambient, np.float64)
    if world is not None:
        everywhere += shading.diffuse * np.minimum(np.asarray(world, np.float64), STRONGEST_LIGHT)
    kinds = float(shading.two_sided), float(shading.highlight == "phong" and shading.specular > 0.0)
    numbers = shading.ambient, shading.diffuse, shading.specular, shininess
    material = np.array([*numbers, *everywhere, *kinds], np.float64)
    rows = light_rows(lights, headlight_direction, matrix)
    return Lighting(*(read_only(array) for array in (matrix, material, rows, eye)))


def unit_vectors(vectors) -> np.ndarray:
    """(k, 3) vectors of length one; those of length zero stay."""
    lengths = np.sqrt((vectors**2).sum(axis=1))[:, None]
    return vectors * np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
