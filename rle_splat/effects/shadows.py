"""Shadows of the volume and of meshes, and ambient occlusion: the share of each light that reaches each voxel.

Each is one number per voxel, which does not depend on the view: FULL (light_sweep.py) times the share that arrives,
at the voxel itself, or at a point beside it, where a surface does not shade itself.
The extinction that casts shadows is that of the voxels, interpolated, whatever the classification.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..classify.visible import VisibleVoxels
from ..encode.encode import fetch_chunks
from ..encode.scalars import in_scanlines
from ..encode.tables import RunTables
from ..runtime.steps import drain, map_steps
from ..shade.light_beside import light_beside_steps
from ..shade.light_samples import SKY_DIRECTIONS, SKY_WEIGHTS, light_samples
from ..shade.light_sheets import Sweep, point_sweeps, sun_sweeps
from ..shade.light_sweep import FULL, sweep_light
from ..shade.sample_light import OCTAVES
from .clip_cover import cover
from .mesh_depth import sheet_depth

# Slices behind a mesh that are still lit: light is interpolated between voxels, and the surface itself is to be lit.
BEHIND_MESHES = 0.5
AT_ONCE = 1 << 19  # voxels whose powers are looked up between two chances to cancel
# Slices next to a voxel that do not occlude it: they belong to the same surface, whose steps between voxels would show.
NEAR_SKY = 2


@dataclass(frozen=True, eq=False)
class Occluders:
    """What blocks light: voxels and meshes.

    Attributes
    ----------
    voxels : VisibleVoxels
    find_extinction : callable
        ``find_extinction()``: (m,) float32 extinction of the voxels, 1 / world length, in their own order; called once.
    tables_of : callable
        ``tables_of(axis)``: RunTables of the voxels.
    matrix : (4, 4) ndarray of float64
        Voxel index (x, y, z) to world.
    triangles : (n, 3, 3) ndarray or None
        World coordinates of the meshes.
    clips : tuple of Clip
        What they cut away casts no shadow.
    medium_key : tuple
        Identifies everything that the voxels and their extinction depend on.
    boxed : bool
        Whether the medium ends at the box of the voxel centers.
    threads : int
        0 for one per core.
    """

    voxels: VisibleVoxels
    find_extinction: Callable[[], np.ndarray]
    tables_of: Callable[[int], RunTables]
    matrix: np.ndarray
    triangles: np.ndarray | None
    clips: tuple
    medium_key: tuple
    boxed: bool
    threads: int = 0

    @cached_property
    def key(self) -> tuple:
        """Identifies everything that shadows depend on, except the light."""
        triangles = () if self.triangles is None else hashlib.blake2b(self.triangles.tobytes()).digest()
        clips = tuple((clip.kind, clip.keep, clip.matrix_world.tobytes()) for clip in self.clips)
        return self.medium_key, self.matrix.tobytes(), triangles, clips, self.boxed

    @property
    def corners(self) -> np.ndarray:
        """(8, 3) world corners of the box of voxel centers."""
        index = np.indices((2, 2, 2)).reshape(3, 8).T * (np.array(self.voxels.shape_xyz) - 1.0)
        return index @ self.matrix[:3, :3].T + self.matrix[:3, 3]

    @property
    def voxel(self) -> float:
        """World length of the side of a cube of the same size as a voxel."""
        return float(np.cbrt(abs(np.linalg.det(self.matrix[:3, :3]))))

    @cached_property
    def extinction(self) -> np.ndarray:
        """(m,) float32 extinction that clip objects keep of each voxel, 1 / world length, in the voxels' own order."""
        whole = self.find_extinction()
        return whole * cover(self.clips, self.voxels, self.matrix) if self.clips else whole

    @cached_property
    def extinction_across(self) -> np.ndarray:
        """The same in the order of the scanlines of principal axis x."""
        return drain(in_scanlines(self.tables_of(0), self.voxels, self.extinction, threads=self.threads))


def light_steps(light, occluders: Occluders, offsets=None):
    """Find how much of a light arrives at each voxel, or at a point beside it.

    Parameters
    ----------
    light : Light
    occluders : Occluders
    offsets : (m, 3) ndarray of int16 or None
        From the voxels to their points, as of ``surface_points.place_steps``; None for the voxels themselves.

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    (m,) ndarray of uint16
        FULL times the share that arrives.
    """
    passes = _passes_of(light, occluders, offsets is not None)
    return mean_steps(passes, np.full(len(passes), 1.0 / len(passes)), occluders, offsets)


def _passes_of(light, occluders: Occluders, beside: bool) -> list[list[Sweep]]:
    """The sweeps of each sample of a light; ``beside``: to points beside voxels."""
    samples = light_samples(light, occluders.corners, occluders.voxel)
    grid = occluders.matrix, occluders.voxels.shape_xyz, occluders.boxed
    if light.type == "SUN":
        return [sun_sweeps(sample, *grid) for sample in samples]
    return [point_sweeps(sample, *grid, beside=beside) for sample in samples]


def scattered_steps(light, occluders: Occluders, offsets):
    """As ``light_steps`` of points beside the voxels, with the light that is scattered on its way.

    It passes several times as much: of a path that transmits t, t to the power of each of OCTAVES arrives.

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    (2, m) ndarray of uint16
        FULL times the share T that arrives, and the mean U, by their weights, of its further OCTAVES.

    Notes
    -----
    The least power is swept, by paths that are as much shorter, because a share of 16 bits loses all but one octave of
    what is nearly dark; its powers are looked up.  What meshes leave of the light is swept alone, as they scatter none.
    """
    passes = _passes_of(light, occluders, True)
    weights, powers = OCTAVES
    least, code = powers[-1], np.arange(FULL + 1.0) / FULL
    direct, *others = (FULL * code ** (power / least) for power in powers)
    further = np.average(others, axis=0, weights=weights[1:])
    arriving = np.stack((direct, further)).astype(np.float32) / np.float32(len(passes))
    count, meshless = len(occluders.voxels), replace(occluders, triangles=None)
    total, left = np.full((2, count), 0.5, np.float32), None
    for n, sweeps in enumerate(passes):
        paths = [replace(sweep, length=least**2 * sweep.length) for sweep in sweeps]
        found = yield from map_steps(_beside_steps(paths, meshless, offsets), lambda d, n=n: (n + d) / len(passes))
        if occluders.triangles is not None and len(occluders.triangles):
            cleared = _beside_steps([replace(sweep, length=np.zeros(6)) for sweep in sweeps], occluders, offsets)
            left = yield from map_steps(cleared, lambda _, n=n: (n + 1) / len(passes))
        for first in range(0, count, AT_ONCE):
            yield (n + 1) / len(passes)
            part = slice(first, first + AT_ONCE)
            share = np.float32(1.0) if left is None else left[part] / np.float32(FULL)
            for plane, of_code in zip(total, arriving):
                plane[part] += of_code[found[part]] * share
    return np.minimum(total, np.float32(FULL)).astype(np.uint16)


def sky_steps(occluders: Occluders, offsets=None):
    """As ``light_steps``, for light from all directions, sampled by fourteen; ambient occlusion.

    The NEAR_SKY slices next to a voxel do not occlude the voxel itself; a point beside it is occluded by all.

    Parameters
    ----------
    occluders : Occluders
    offsets : (m, 3) ndarray of int16 or None

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    (m,) ndarray of uint16
        FULL times the share that arrives.
    """
    grid = occluders.matrix, occluders.voxels.shape_xyz, occluders.boxed
    passes = [sun_sweeps(direction, *grid) for direction in SKY_DIRECTIONS]
    if offsets is None:
        passes = [[sweep.without_nearest(NEAR_SKY) for sweep in sweeps] for sweeps in passes]
    return mean_steps(passes, SKY_WEIGHTS, occluders, offsets)


def mean_steps(passes: list[list[Sweep]], weights, occluders: Occluders, offsets=None):
    """Find the weighted mean of the light of several point or parallel lights at each voxel, or beside it.

    Parameters
    ----------
    passes : list of list of Sweep
        The sweeps of each light.
    weights : (lights,) array_like
    occluders : Occluders
    offsets : (m, 3) ndarray of int16 or None
        As of ``light_steps``.

    Yields
    ------
    float
        Fraction done.

    Returns
    -------
    (m,) ndarray of uint16
        FULL times the share that arrives.
    """
    total = np.zeros(len(occluders.voxels) if len(passes) > 1 else 0, np.float32)
    for n, (sweeps, weight) in enumerate(zip(passes, weights)):
        yield n / len(passes)
        if offsets is None:
            codes = _sweep(sweeps, occluders)
        else:
            codes = yield from map_steps(
                _beside_steps(sweeps, occluders, offsets), lambda d, n=n: (n + d) / len(passes)
            )
        if len(passes) == 1:
            return codes
        total += np.float32(weight) * codes
    return np.minimum(total + np.float32(0.5), np.float32(FULL)).astype(np.uint16)


def _beside_steps(sweeps: list[Sweep], occluders: Occluders, offsets):
    """Generator of fractions: (m,) uint16 at points beside the voxels after all sweeps of a light without size."""
    voxels, codes = occluders.voxels, np.full(len(occluders.voxels), FULL, np.uint16)
    for done, sweep in enumerate(sweeps):
        tables, starts, extinction = _occluding(sweep.axis, occluders)
        steps = light_beside_steps(
            sweep, tables, starts, extinction, _meshes_before(sweep, occluders), voxels, offsets, occluders.matrix,
            codes, threads=occluders.threads,
        )  # fmt: skip
        yield from map_steps(steps, lambda fraction, done=done: (done + fraction) / len(sweeps))
    return codes


def _occluding(axis: int, occluders: Occluders):
    """RunTables of a principal axis, where their scanlines begin, (n_slices, n_scanlines), and their extinction."""
    tables = occluders.tables_of(axis)
    if axis == 0:
        return tables, tables.scanline_data_pointers, occluders.extinction_across
    _, ny, nz = occluders.voxels.shape_xyz
    rows = occluders.voxels.row_start[:-1].reshape(nz, ny)
    return tables, rows if axis == 2 else np.ascontiguousarray(rows.T), occluders.extinction


def _sweep(sweeps: list[Sweep], occluders: Occluders) -> np.ndarray:
    """(m,) uint16 after all sweeps of a light without size, in the voxels' own order."""
    voxels, threads = occluders.voxels, occluders.threads
    codes = np.full(len(voxels), FULL, np.uint16)  # of voxels that no sweep is for: at the light itself
    # Along x voxels are in another order; all that come back from there replace what was there before.
    across = [sweep for sweep in sweeps if sweep.axis == 0]
    if across:
        found = codes.copy()
        for sweep in across:
            blocking = _occluding(0, occluders)
            sweep_light(sweep, *blocking, _meshes_before(sweep, occluders), found, threads=threads)
        drain(fetch_chunks(occluders.tables_of(0), voxels, codes[:, None], found[:, None], threads=threads))
    for sweep in sweeps:
        if sweep.axis != 0:
            blocking = _occluding(sweep.axis, occluders)
            sweep_light(sweep, *blocking, _meshes_before(sweep, occluders), codes, threads=threads)
    return codes


def _meshes_before(sweep: Sweep, occluders: Occluders) -> np.ndarray | None:
    """(height, width, samples) float32 slices, ascending, from the sweep's first to the meshes on the light's rays,
    as ``sweep_light`` takes them; None when no mesh shades any of the voxels."""
    if occluders.triangles is None or len(occluders.triangles) == 0:
        return None
    corners = np.concatenate((occluders.triangles, np.ones((*occluders.triangles.shape[:2], 1))), axis=2)
    placed = corners @ sweep.to_sheet.T
    pixels, depths = placed[..., :3], placed[..., 3]
    pixels[..., :2] += 0.5 * pixels[..., 2:]  # the rays of a pixel lie all round the pixel's own
    clips = (-np.inf, float(len(sweep.slices)))
    found = sheet_depth(pixels, depths, clips, sweep.width, sweep.height, threads=occluders.threads)
    met = np.isfinite(found).any(axis=2)
    if not met.any():
        return None
    found[met] = np.sort(found[met], axis=1) + np.float32(BEHIND_MESHES)
    return found
