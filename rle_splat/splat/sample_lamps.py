"""A SampleLight, and where the samples of a base plane lie, as the kernels of ``sample_block`` take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..runtime.jit import read_only
from ..shade.environment import LINEAR
from ..shade.lighting import BACK
from ..shade.lights import AXIS, COLUMNS, EDGE, NEAREST, POSITION, RGB
from ..shade.sample_light import NORMAL, SampleLight
from ..view.base_plane import BasePlane
from ..volume.axes import AXES
from .pixel_block import BLOCK

LEAST = 4.0  # transmittances at which a pixel is opaque: the weight of samples that share their light
DRAFT, LEAST_OF_DRAFTS = 2e-3, 1.0 / 16.0  # such a transmittance from which on that weight is at least so much
NO_PLANE = 0  # of T, U or O: that plane is the scalar's
MATT, GLOSS, LAMP = COLUMNS, COLUMNS + 3, COLUMNS + 6  # columns of ``SampleLamps.lamps``, behind those of light_rows
HELD = 7  # planes of ``scratch.Rows.light``
AMBIENT, EVERYWHERE, SHININESS, SURFACE = 0, 1, 4, 5  # entries of ``SampleLamps.surface``, and how many there are


class SampleLamps(NamedTuple):
    """Lamps and material, and the geometry of a base plane.

    Attributes
    ----------
    lamps : (n * LAMP,) float32
        Of each lamp, as ``lights.light_rows``, its position relative to the middle of the volume and one over the width
        of its spot's edge; then RGB of its diffuse light and of its highlight.
    shares : (n,) int64
        Plane of a sheet that holds T of each lamp, or NO_PLANE.
    scattered : (n,) int64
        That of U, or NO_PLANE.
    indirect : float32
        See SampleLight.
    open_plane : int
        That of O, or NO_PLANE.
    surface : (SURFACE,) float32
        Ambient light, RGB of the light from all directions, shininess.
    sky : (27,) or (0,) float32
        ``environment.terms_of`` of the outward normal, times diffuse, channel by channel.
    is_glossy, turns : bool
        Whether there are highlights, and whether surfaces are two-sided.
    slope_u, slope_v : (W + BLOCK,), (H,) float32
        Voxels that the rays of a column move along scanlines per slice along the axis; those of a row, across them.
    base_u, base_v : (W + BLOCK,), (H,) float32
        Where they are in the plane across the axis through the middle of the volume, voxels from there.
    to_world : (9,) float32
        World vectors of a voxel along scanlines, across them, and along the axis.
    ahead : (9,) float32
        The same, towards the eye, in multiples of the last one's length.
    sign, middle : float
        ``sign * s - middle`` is the distance along the axis from the middle of the volume, of a sample ``s`` voxels
        along the viewing direction.
    opaque : float32
        Transmittance below which a pixel is opaque.
    least : float32
        Weight of a pixel's samples from which on their light is evaluated anew.
    """

    lamps: np.ndarray
    shares: np.ndarray
    scattered: np.ndarray
    indirect: np.float32
    open_plane: int
    surface: np.ndarray
    sky: np.ndarray
    is_glossy: bool
    turns: bool
    slope_u: np.ndarray
    slope_v: np.ndarray
    base_u: np.ndarray
    base_v: np.ndarray
    to_world: np.ndarray
    ahead: np.ndarray
    sign: float
    middle: float
    opaque: np.float32
    least: np.float32


def sample_lamps(light: SampleLight, plane: BasePlane, shape_xyz, termination: float) -> SampleLamps:
    """For kernels, of a base plane of a volume; ``termination``: transmittance at which a pixel is opaque."""
    falling = light.falling
    material, (i, j, k) = falling.material, AXES[plane.axis]
    middle = 0.5 * (np.array(shape_xyz) - 1.0)
    directions = falling.matrix[:3, (i, j, k)].T
    lamps = np.zeros((len(falling.rows), LAMP))
    lamps[:, :COLUMNS] = falling.rows
    lamps[:, POSITION:AXIS] -= falling.matrix[:3, :3] @ middle + falling.matrix[:3, 3]
    lamps[:, EDGE] = 1.0 / np.where(lamps[:, EDGE] > 0.0, lamps[:, EDGE], 1.0)
    lamps[:, MATT:GLOSS] = material[1] * falling.rows[:, RGB:NEAREST]
    lamps[:, GLOSS:LAMP] = material[2] * falling.rows[:, RGB:NEAREST]
    shares, scattered = map(read_only, light.rows_of(1 + NORMAL, NO_PLANE))
    sky = falling.sky.copy()
    sky[:, : len(LINEAR)] *= -1.0  # terms are of the gradient, which points inwards
    slopes = [np.asarray(each, np.float64) for each in plane.ray_slopes]
    away = middle[k] - plane.reference
    bases = [x + away * slope - middle[axis] for x, slope, axis in zip(plane.points, slopes, (i, j))]
    ahead = directions * (-plane.sign / np.linalg.norm(directions[2]))
    return SampleLamps(
        _single(lamps), shares, scattered, np.float32(light.indirect), light.planes if light.opened else NO_PLANE,
        _single(material[[0, 4, 5, 6, 3]]), _single(sky), falling.has_highlights, bool(material[BACK] > 0.0),
        _single(_padded(slopes[0])), _single(slopes[1]), _single(_padded(bases[0])),
        _single(bases[1]), _single(directions), _single(ahead), float(plane.sign), float(middle[k]),
        np.float32(termination), np.float32(max(LEAST * termination, LEAST_OF_DRAFTS if termination >= DRAFT else 0.0)),
    )  # fmt: skip


def _single(array) -> np.ndarray:
    """Flat, float32."""
    return read_only(np.array(array, np.float32).ravel())


def _padded(columns: np.ndarray) -> np.ndarray:
    """One more block of columns."""
    return np.concatenate((columns, np.repeat(columns[-1:], BLOCK)))
