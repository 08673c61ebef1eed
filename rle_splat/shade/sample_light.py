"""Light on samples of a post-classified volume, of what is interpolated of the voxels around each.

A voxel has a vector m, the unit normal that points to where extinction falls times the trust in it, the share T of each
lamp that arrives beside it, and the openness O to the sky.  All three are interpolated between voxels, and a sample is
lit by what it finds:

    w  smoothstep(0, TRUSTED, |m|);  n = m / |m|;  e the unit vector to the eye
    n  of a two-sided surface that leans away, a = max(-n.e, 0), is turned to the eye softly, with s =
       smoothstep(0, TURNED, a): (1 - 2 s) n + a (1 - s) e, the tangent at the silhouette and -n from a = TURNED on
    S  = around(n) O + sum over lamps of diffuse I ((1 - q) wrap(n.l) T + q spread(n.l) U)
    C  = everywhere O + sum over lamps of diffuse I ((1 - q) T + q U)
    light = w S + (1 - w) C;  highlight = w sum over lamps of specular ramp(n.l) shine I T

S is the light of a surface, C that of a cloud, which has no normal.  ``everywhere`` is ambient light and the world's
mean, ``around(n)`` what the world sends on n (``environment``), I a lamp's strength (``lights``), wrap the maximum of
n.l and 0, rounded over the sine of 5 degrees, ramp(n.l) = smoothstep(0, RAMP, n.l) and shine Blinn's power.
q is INDIRECT times the amount of indirect light, 0 without it and of lamps that cast no shadows, U the share of it that
arrives (``effects.shadows``), and spread(n.l) = (1 + SPREAD) wrap / (wrap + SPREAD) + max(-n.l, 0)^2.
Every term is continuous.  A color is multiplied by the light; highlights are added in proportion to the extinction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .environment import light_by_normal
from .lighting import BACK, Lighting, unit_vectors
from .lights import KIND, NEAREST, POSITION, RGB, SUN
from .reference import find_light, smoothstep
from .shading import refuse_too_bright

ONE = np.float32(32767.0)  # code of 1 in planes of voxels: components of m, T, O, and factors of extinction
NORMAL = 3  # planes of m; those of T follow, in the order of ``SampleLight.casting``, then those of U, and that of O
TRUSTED = 0.3
ROUNDING = math.sin(math.radians(5.0))
RAMP = 0.2
TURNED = 0.4
# Weights of the powers of T that arrive, and these powers: a^n and b^n of Wrenninge et al. 2013.
OCTAVES = (1.0, 0.5, 0.25), (1.0, 0.5, 0.25)
INDIRECT = sum(OCTAVES[0][1:]) / sum(OCTAVES[0])
SPREAD = 0.4
SHARPEST = 1e9  # shininess
ALMOST_NONE = 1e-6  # |m| below which there is no direction
FAINTEST = 1e-30  # of bounds, which are divided by


@dataclass(frozen=True, eq=False)
class SampleLight:
    """Light to be evaluated at samples.

    Attributes
    ----------
    falling : Lighting
        Its ``shadows`` do not count.
    casting : tuple of int
        Rows of ``falling`` that have a plane of T.
    opened : bool
        Whether there is a plane of O.
    indirect : float
        q of the lamps that cast shadows, which have planes of U where it is above 0.
    most_light, most_highlight : float
        Upper bounds on any sample, from the lights alone.
    """

    falling: Lighting
    casting: tuple[int, ...]
    opened: bool
    indirect: float
    most_light: float
    most_highlight: float

    @property
    def planes(self) -> int:
        """Planes of a voxel: of m, T, U and O."""
        return NORMAL + len(self.casting) * (1 + (self.indirect > 0.0)) + self.opened

    def rows_of(self, first: int, without: int) -> tuple[np.ndarray, np.ndarray]:
        """Where T and U of each lamp are, (lamps,) int64, planes from ``first`` on; ``without``: of one without."""
        found = np.full((2, len(self.falling.rows)), without, np.int64)
        count = len(self.casting)
        for planes in found[: 1 + (self.indirect > 0.0)]:
            planes[list(self.casting)] = np.arange(first, first + count)
            first += count
        return found[0], found[1]


def sample_light(falling: Lighting, shape_xyz, casting=(), opened: bool = False, indirect: float = 0.0) -> SampleLight:
    """The light of a Lighting on the samples of a volume; RleSplatError if it is above BRIGHTEST.

    Parameters
    ----------
    shape_xyz : (nx, ny, nz)
        Of the volume.
    casting, opened
        See SampleLight.
    indirect : float
        Amount of indirect light, 0 to 1.
    """
    diffuse, specular = falling.material[1:3].tolist()
    strengths = falling.rows[:, RGB:NEAREST]
    if not falling.is_parallel:
        strengths = strengths / _nearest(falling, shape_xyz)[:, None]
    strongest = max(map(sum, zip(*strengths.tolist())), default=0.0)
    most_light = max(max(falling.most_everywhere.tolist()) + diffuse * strongest, FAINTEST)
    most_highlight = specular * strongest
    refuse_too_bright(max(most_light, most_highlight))
    given = falling, tuple(casting), bool(opened), INDIRECT * indirect if len(casting) else 0.0
    return SampleLight(*given, most_light, most_highlight)


def _nearest(falling: Lighting, shape_xyz) -> np.ndarray:
    """(n,) lower bound of the squared distance from each light to any voxel; 1 for a parallel light."""
    matrix, rows = falling.matrix, falling.rows
    half = 0.5 * (np.array(shape_xyz) - 1.0)
    corners = (np.indices((2, 2, 2)).reshape(3, 8).T * 2.0 - 1.0) * half
    radius = np.linalg.norm(corners @ matrix[:3, :3].T, axis=1).max()
    center = matrix[:3, :3] @ half + matrix[:3, 3]
    away = np.maximum(np.linalg.norm(rows[:, POSITION : POSITION + 3] - center, axis=1) * (1.0 - 1e-9) - radius, 0.0)
    return np.where(rows[:, KIND] == SUN, 1.0, np.maximum(rows[:, NEAREST], away**2))


def light_of_samples(light: SampleLight, planes, to_eye, points) -> tuple[np.ndarray, np.ndarray]:
    """Light and highlights of samples in numpy, as the kernels of ``splat.sample_block`` and ``raycast`` have them.

    Parameters
    ----------
    planes : (N, light.planes) ndarray
        m, T, U and O.
    to_eye : (N, 3) ndarray
        Unit vectors, world.
    points : (N, 3) ndarray or None
        World; None will do where all lamps are parallel.

    Returns
    -------
    light, highlight : (N, 3) ndarray of float64
    """
    falling = light.falling
    ambient, diffuse, specular, shininess = falling.material[:4]
    m = np.asarray(planes[:, :NORMAL], np.float64)
    size = np.sqrt((m**2).sum(axis=1, keepdims=True))
    w = smoothstep(size / TRUSTED)
    n = m / np.maximum(size, ALMOST_NONE)
    if falling.material[BACK] > 0.0:
        a = np.maximum(-(n * to_eye).sum(axis=1, keepdims=True), 0.0)
        s = smoothstep(a / TURNED)
        n = (1.0 - 2.0 * s) * n + a * (1.0 - s) * to_eye
    opened = planes[:, -1:].astype(np.float64) if light.opened else 1.0
    everywhere = falling.material[4:7]
    around = np.maximum(everywhere + light_by_normal(-n, falling.sky), ambient) if falling.sky.size else everywhere
    matt = (everywhere + w * (around - everywhere)) * opened
    gloss = np.zeros(n.shape)
    direct, scattered = light.rows_of(NORMAL, -1)
    for number, lamp in enumerate(falling.rows):
        towards, falloff = find_light(lamp, n if points is None else points)
        whole = arrives = falloff[:, None] * lamp[RGB:NEAREST]
        if direct[number] >= 0:
            arrives = whole * planes[:, direct[number], None].astype(np.float64)
        facing = (n * towards).sum(axis=1, keepdims=True)
        rounded = np.clip(facing + ROUNDING, 0.0, 2.0 * ROUNDING)
        wrap = rounded**2 * (0.25 / ROUNDING) + np.maximum(facing - ROUNDING, 0.0)
        lit = (1.0 + w * (wrap - 1.0)) * arrives
        if scattered[number] >= 0:
            spread = (1.0 + SPREAD) * wrap / (wrap + SPREAD) + np.maximum(-facing, 0.0) ** 2
            around = (1.0 + w * (spread - 1.0)) * whole * planes[:, scattered[number], None].astype(np.float64)
            lit = (1.0 - light.indirect) * lit + light.indirect * around
        matt = matt + diffuse * lit
        if specular > 0.0:
            cosine = (n * unit_vectors(towards + to_eye)).sum(axis=1, keepdims=True)
            shine = np.maximum(cosine, 0.0) ** min(shininess, SHARPEST)
            gloss = gloss + specular * w * smoothstep(facing / RAMP) * shine * arrives
    return np.broadcast_to(matt, n.shape), gloss
