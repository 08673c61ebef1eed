"""Light on the voxels of a volume: lights, ambient light, headlight, and shadows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..classify.limits import STRONGEST_LIGHT
from ..runtime.jit import read_only
from ..volume.triples import unit
from .environment import SKY, most_by_normal, terms_of
from .lights import AXIS, KIND, NEAREST, RGB, SUN, light_rows

BACK = 7  # entry of Lighting.material
SHARPEST = 1e9  # shininess is clamped to it: the highlight has no width, and the integer part must fit an integer
FULL_CODE = 65535  # code of full light in Shadows.codes


@dataclass(frozen=True, eq=False)
class Shadows:
    """Shadows on the voxels: the share of each light, and of the ambient light, that reaches each voxel.

    Attributes
    ----------
    codes : (k, m) ndarray of uint16
        FULL_CODE times the share.
    row_of : (n + 1,) ndarray of int64
        Row of ``codes`` for each of n lights and, last, for the ambient light; -1 for no shadow.
    """

    codes: np.ndarray
    row_of: np.ndarray

    def share(self, which: int, part: slice) -> np.ndarray | float:
        """(k,) float64 share of light number ``which`` (-1: the ambient light) that reaches the voxels ``part``."""
        row = self.row_of[which]
        return 1.0 if row < 0 else self.codes[row, part] / FULL_CODE


@dataclass(frozen=True, eq=False)
class Lighting:
    """The light on the voxels of a volume and the material that reflects it.

    Attributes
    ----------
    matrix : (4, 4) ndarray of float64
        Voxel index to world.
    material : (8,) or (35,) ndarray of float64
        Ambient, diffuse, specular, shininess; RGB of the light from all directions (ambient and the world's mean); 1
        for two-sided surfaces, else 0. Where the world differs by direction, from SKY on what each channel's light
        changes by with the normal: diffuse times ``environment.terms_of``.
    rows : (n, COLUMNS) ndarray of float64
        The lights; see ``lights.light_rows``.
    eye : (4,) ndarray of float64
        Homogeneous eye in the world; its last component is 0 for parallel rays.
    shadows : Shadows or None
        Of the same voxels.
    """

    matrix: np.ndarray
    material: np.ndarray
    rows: np.ndarray
    eye: np.ndarray
    shadows: Shadows | None = None

    @property
    def sky(self) -> np.ndarray:
        """(3, TERMS) float64 of ``environment.terms_of``, times diffuse; (3, 0) without an environment."""
        return self.material[SKY:].reshape(3, -1)

    @cached_property
    def is_parallel(self) -> bool:
        """Whether all lights are parallel."""
        return bool((self.rows[:, KIND] == SUN).all())

    @property
    def has_highlights(self) -> bool:
        """Whether any light makes highlights; the light from all directions makes none."""
        return bool(self.material[2] > 0.0 and len(self.rows))

    @property
    def most_everywhere(self) -> np.ndarray:
        """(3,) float64 upper bounds of the light from all directions on any normal."""
        return self.material[4:7] + most_by_normal(self.sky) if self.sky.size else self.material[4:7]

    @property
    def is_far(self) -> bool:
        """Whether light does not depend on a voxel's position or number.

        True for parallel light without shadows, if highlights are seen along parallel rays, or there are none.
        """
        if self.shadows is not None:
            return False
        sees_highlights = self.material[2] > 0.0 and self.eye[3] != 0.0
        return self.is_parallel and not sees_highlights

    @property
    def near(self) -> tuple | None:
        """Arguments of the kernel ``add_near``; None if ``rays`` suffices."""
        if self.is_far:
            return None
        shadows = None if self.shadows is None else (read_only(self.shadows.codes), read_only(self.shadows.row_of))
        return self.matrix, self.rows, self.eye, shadows

    def beams(self) -> list[tuple]:
        """For each parallel light three triples: unit vectors to the light, and half-way to the eye; RGB."""
        eye, found = unit(self.eye[:3].tolist()), []
        for row in self.rows.tolist():
            towards = [-part for part in row[AXIS:RGB]]
            found.append((towards, unit([one + two for one, two in zip(towards, eye)]), row[RGB:NEAREST]))
        return found

    def rays(self) -> np.ndarray:
        """(n, 9) float32: ``beams``."""
        return np.array(self.beams(), np.float32).reshape(-1, 9)


def is_shaded(shading, lights, headlight_direction=None, world=None) -> bool:
    """Whether normals are needed: the transfer function is shaded and there is any light."""
    return bool(shading) and (len(lights) > 0 or headlight_direction is not None or world is not None)


def lighting(
    index_to_world, shading, lights=(), *, headlight_direction=None, eye=None, world=None, environment=None
) -> Lighting | None:
    """Make the Lighting of a scene.

    Parameters
    ----------
    index_to_world : (4, 4) array_like
    shading : Shade or None
    lights : sequence of Light
    headlight_direction : (3,) array_like or None
        World direction in which the camera looks.
    eye : (4,) array_like or None
        Homogeneous eye in the world, needed for highlights only. Its last component is 0 for parallel rays; the rest
        then points from the scene to the eye.
    world : (3,) array_like or None
        Scene-linear RGB radiance that arrives from all directions, or its mean.
    environment : Environment or None
        How it differs by direction.

    Returns
    -------
    Lighting or None
        None if the transfer function is unshaded or there is no light.
    """
    if not is_shaded(shading, lights, headlight_direction, world):
        return None
    matrix = np.ascontiguousarray(index_to_world, dtype=np.float64)
    eye = np.zeros(4) if eye is None else np.asarray(eye, dtype=np.float64) * (-1.0 if eye[3] < 0.0 else 1.0)
    shininess = min(shading.shininess, SHARPEST)
    # A diffuse surface under a sky of uniform radiance W has the radiance W times its color, whatever its normal.
    everywhere, sky = (shading.ambient,) * 3, ()
    if world is not None:
        mean = np.asarray(world, np.float64)
        everywhere = shading.ambient + shading.diffuse * np.minimum(mean, STRONGEST_LIGHT)
        held = np.divide(STRONGEST_LIGHT, mean, out=np.ones(3), where=mean > STRONGEST_LIGHT)
        sky = (shading.diffuse * held[:, None] * terms_of(environment)).ravel()
    numbers = shading.ambient, shading.diffuse, shading.specular, shininess
    material = np.array([*numbers, *everywhere, float(shading.two_sided), *sky], np.float64)
    rows = light_rows(lights, headlight_direction, matrix)
    return Lighting(*(read_only(array) for array in (matrix, material, rows, eye)))


def unit_vectors(vectors) -> np.ndarray:
    """(k, 3) vectors scaled to length one; zero vectors are kept."""
    lengths = np.sqrt((vectors**2).sum(axis=1))[:, None]
    return vectors * np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
