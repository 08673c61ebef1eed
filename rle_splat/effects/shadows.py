"""Shadows of the volume and of meshes, and ambient occlusion: the share of each light that arrives.

It does not depend on the view.  It is FULL (light_sweep.py) times the share that arrives at each voxel itself, or at
each node of a grid, from which it is read beside voxels, where a surface does not shade itself.  What meshes leave of
lamps is then looked up apart, at the voxels, so that what touches a surface shades it.
The extinction that casts shadows is that of the voxels, interpolated, whatever the classification; for a coarser grid,
means of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ..classify.visible import VisibleVoxels
from ..encode.encode import fetch_chunks
from ..encode.pooling import pool_steps
from ..encode.scalars import in_scanlines, scalar_table_steps
from ..runtime.array_hash import hash_array
from ..runtime.buffer_pool import empty
from ..runtime.steps import map_steps
from ..scene import Clip
from ..shade.light_nodes import lit_nodes_steps, shade_nodes_steps
from ..shade.light_rays import Bricks, Cuts, trace_steps
from ..shade.light_samples import fixed_samples, light_samples, sky_directions
from ..shade.light_sheets import Sweep, point_sweeps, sun_sweeps
from ..shade.light_sweep import FULL, sweep_light
from ..shade.mesh_light import block_steps
from ..shade.sample_light import OCTAVES, ONE
from ..shade.surface_points import Points, faces_of
from .clip_cover import cover_steps
from .mesh_depth import sheet_depth

# Slices behind a mesh that are still lit: light is interpolated between voxels, and the surface itself is to be lit.
BEHIND_MESHES = 0.5
LISTED_AT_ONCE = 1 << 21  # nodes that are listed between two chances to cancel, 10 ms
CODED_AT_ONCE = 1 << 20  # voxels whose light becomes codes between two chances to cancel, 10 ms
# Slices next to a voxel that do not occlude it: they belong to the same surface, whose steps between voxels would show.
NEAR_SKY = 2


@dataclass(frozen=True, eq=False)
class Occluders:
    """What blocks light: voxels and meshes.

    Attributes
    ----------
    find_extinction : callable
        ``find_extinction()``: generator of fractions done that returns the extinction of the voxels, (m,) float32,
        1 / world length, in their own order.
    table_steps : callable
        ``table_steps(axis)``: generator of fractions done that returns the RunTables of the voxels.
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
    find_extinction: Callable[[], Iterator]
    table_steps: Callable[[int], Iterator]
    matrix: np.ndarray
    triangles: np.ndarray | None
    clips: Sequence[Clip]
    medium_key: tuple
    boxed: bool
    threads: int = 0
    _blocking: dict = field(default_factory=dict, repr=False)  # results of ``extinction_steps`` and ``blocking_steps``

    @cached_property
    def key(self) -> tuple:
        """Identifies everything that shadows depend on, except the light."""
        triangles = () if self.triangles is None else hash_array(self.triangles)
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

    @property
    def has_meshes(self) -> bool:
        return self.triangles is not None and len(self.triangles) > 0

    @property
    def without_meshes(self) -> Occluders:
        return replace(self, triangles=None)

    def extinction_steps(self):
        """Generator of fractions done: (m,) float32 extinction that clip objects keep of each voxel, 1 / world length,
        in the voxels' own order."""
        if "clipped" not in self._blocking:
            found = yield from map_steps(self.find_extinction(), lambda fraction: 0.5 * fraction)
            if self.clips:
                steps = cover_steps(self.clips, self.voxels, self.matrix)
                kept = yield from map_steps(steps, lambda fraction: 0.5 + 0.5 * fraction)
                found = np.multiply(found, kept, out=kept)
            self._blocking["clipped"] = found
        return self._blocking["clipped"]

    def blocking_steps(self, axis: int):
        """Generator of fractions done: RunTables of a principal axis, where their scanlines begin, (n_slices,
        n_scanlines), and the extinction of their voxels."""
        if axis not in self._blocking:
            extinction = yield from map_steps(self.extinction_steps(), lambda fraction: 0.5 * fraction)
            tables = yield from map_steps(self.table_steps(axis), lambda _: 0.5)
            _, ny, nz = self.voxels.shape_xyz
            rows = self.voxels.row_start[:-1].reshape(nz, ny)
            if axis == 0:
                rows = tables.scanline_data_pointers
                moved = in_scanlines(tables, self.voxels, extinction, threads=self.threads)
                extinction = yield from map_steps(moved, lambda fraction: 0.5 + 0.5 * fraction)
            elif axis == 1:
                rows = np.ascontiguousarray(rows.T)
            self._blocking[axis] = tables, rows, extinction
        return self._blocking[axis]


def pool_occluders_steps(occluders: Occluders, side: int):
    """Generator of fractions done: average what blocks light over cubes of voxels.

    Parameters
    ----------
    side : int
        Voxels along a side of a cube.

    Returns
    -------
    Occluders
        Its voxels are the cubes, which lie where their middles are.  What clips cut away is cut away.
    """
    extinction = yield from map_steps(occluders.extinction_steps(), lambda fraction: 0.3 * fraction)
    steps = pool_steps(occluders.voxels, extinction, side, threads=occluders.threads)
    means = yield from map_steps(steps, lambda fraction: 0.3 + 0.4 * fraction)
    nx, found = means.shape[2], []
    at_once = max(LISTED_AT_ONCE // means[0].size, 1)
    for first in range(0, len(means), at_once):
        yield 0.7 + 0.3 * first / len(means)
        found.append(_list_nodes(means[first : first + at_once].reshape(-1, nx)))
    counts, pieces, columns, extinction, words = (np.concatenate(of_all) for of_all in zip(*found))
    row_start = np.concatenate(([0], np.cumsum(counts)))
    voxels = VisibleVoxels(means.shape[::-1], row_start, pieces, columns, extinction, 0, words)
    matrix = occluders.matrix.copy()
    matrix[:3, 3] += 0.5 * (side - 1) * matrix[:3, :3].sum(axis=1)
    matrix[:3, :3] *= side
    table_steps = partial(scalar_table_steps, voxels, threads=occluders.threads)
    return replace(
        occluders, voxels=voxels, find_extinction=lambda: _return(extinction), table_steps=table_steps, matrix=matrix,
        clips=(), medium_key=(occluders.key, side), _blocking={},
    )  # fmt: skip


def _list_nodes(rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of rows (n, nx) of nodes with their extinction: how many are above 0 and in how many pieces (n,), their columns
    and extinction (m,), and a bit for each node (n, words)."""
    kept, nx = rows > 0.0, rows.shape[1]
    pieces = np.count_nonzero(kept[:, 1:] & ~kept[:, :-1], axis=1) + kept[:, 0]
    columns = np.nonzero(kept)[1].astype(np.uint16 if nx <= 65536 else np.int32)
    words = np.packbits(np.pad(kept, ((0, 0), (0, -nx % 64))), axis=1, bitorder="little").view("<u8")
    return np.count_nonzero(kept, axis=1), pieces.astype(np.int32), columns, rows[kept], words.astype(np.uint64)


def _return(result):
    """Generator of nothing that returns ``result``."""
    return result
    yield


def light_passes(light, occluders: Occluders, *, nodes: bool, sharp: bool = False):
    """The sweeps of a light, and how much each sample of it weighs.

    Parameters
    ----------
    light : Light
    nodes : bool
        Whether nodes of a grid are lit, in place of voxels.
    sharp : bool
        As of ``light_samples``.

    Returns
    -------
    passes : list of list of Sweep
        The sweeps of each sample.
    weights : (samples,) ndarray of float64
    """
    samples = light_samples(light, occluders.corners, occluders.voxel, sharp)
    grid = occluders.matrix, occluders.voxels.shape_xyz, occluders.boxed
    if light.type == "SUN":
        passes = [sun_sweeps(sample, *grid) for sample in samples]
    else:
        passes = [point_sweeps(sample, *grid, beside=nodes) for sample in samples]
    return passes, np.full(len(passes), 1.0 / len(passes))


def sky_passes(occluders: Occluders, *, nodes: bool):
    """As ``light_passes``, for light from all directions: ambient occlusion.

    The NEAR_SKY slices next to a voxel do not occlude the voxel itself; a node is occluded by all.
    """
    grid = occluders.matrix, occluders.voxels.shape_xyz, occluders.boxed
    passes = [sun_sweeps(direction, *grid) for direction in sky_directions()]
    if not nodes:
        passes = [[sweep.without_nearest(NEAR_SKY) for sweep in sweeps] for sweeps in passes]
    return passes, np.full(len(passes), 1.0 / len(passes))


def voxel_light_steps(passes: list[list[Sweep]], weights, occluders: Occluders):
    """Generator of fractions done: find the weighted mean of the light of several samples at each voxel.

    Parameters
    ----------
    passes, weights
        As ``light_passes`` returns them.

    Returns
    -------
    (m,) ndarray of uint16
        FULL times the share that arrives.
    """
    total = np.zeros(len(occluders.voxels) if len(passes) > 1 else 0, np.float32)
    for n, (sweeps, weight) in enumerate(zip(passes, weights)):
        yield n / len(passes)
        codes = yield from map_steps(_sweep_steps(sweeps, occluders), lambda done, n=n: (n + done) / len(passes))
        if len(passes) == 1:
            return codes
        total += np.float32(weight) * codes
    return np.minimum(total + np.float32(0.5), np.float32(FULL)).astype(np.uint16)


def node_light_steps(passes: list[list[Sweep]], weights, occluders: Occluders):
    """As ``voxel_light_steps``, at the nodes of a grid, which are on the voxels of ``occluders``.

    Returns
    -------
    (nz + 2, ny + 2, nx + 2) ndarray of uint16
        FULL times the share that arrives, with a layer around the volume.
    """
    nodes = yield from map_steps(lit_nodes_steps(occluders.voxels.shape_xyz), lambda _: 0.0)
    sweeps = [(sweep, share) for of_sample, share in zip(passes, _shares(weights)) for sweep in of_sample]
    for done, (sweep, share) in enumerate(sweeps):
        blocking = yield from map_steps(occluders.blocking_steps(sweep.axis), lambda _, done=done: done / len(sweeps))
        meshes = _meshes_before(sweep, occluders)
        steps = shade_nodes_steps(sweep, *blocking, meshes, occluders.matrix, nodes, share, threads=occluders.threads)
        yield from map_steps(steps, lambda fraction, done=done: (done + fraction) / len(sweeps))
    return nodes


def scattered_light_steps(passes: list[list[Sweep]], weights, occluders: Occluders):
    """As ``node_light_steps``, with the light that is scattered on its way.

    It passes several times as much: of a path that transmits t, t to the power of each of OCTAVES arrives.

    The least power is swept, by paths that are as much shorter, because a share of 16 bits loses all but one octave of
    what is nearly dark; its powers are looked up.

    Returns
    -------
    (2, nz + 2, ny + 2, nx + 2) ndarray of uint16
        FULL times the share T that arrives, and the mean U, by their weights, of its further OCTAVES.
    """
    factors, powers = OCTAVES
    least, code = powers[-1], np.arange(FULL + 1.0) / FULL
    direct, *others = (code ** (power / least) for power in powers)
    arriving = np.stack((direct, np.average(others, axis=0, weights=factors[1:])))
    total = None
    for n, (sweeps, share) in enumerate(zip(passes, _shares(weights))):
        of_code = np.rint(share * arriving).astype(np.uint16)
        paths = [replace(sweep, length=least**2 * sweep.length) for sweep in sweeps]
        found = yield from map_steps(node_light_steps([paths], [1.0], occluders), lambda d, n=n: (n + d) / len(passes))
        if total is None:
            total = np.zeros((2, *found.shape), np.uint16)
        for layer, codes in enumerate(found):
            yield (n + 1) / len(passes)
            total[:, layer] += of_code[:, codes]
    return total


def unblocked_steps(passes: list[list[Sweep]], weights, occluders: Occluders, points: Points, beside: bool = False):
    """Generator of fractions done: what meshes leave of a light, looked up at voxels.

    Parameters
    ----------
    passes, weights
        As ``light_passes`` returns them, for a grid of any resolution.
    points : Points
        Beside the voxels of ``occluders``.
    beside : bool
        Whether light is looked up at these points, in place of the voxels.

    Returns
    -------
    (m,) ndarray of uint16
        FULL times the share that is left; of length 0 where that is all of it.
    """
    left = np.zeros(0, np.uint16)
    sweeps = [(sweep, share) for of_sample, share in zip(passes, _shares(weights)) for sweep in of_sample]
    for done, (sweep, share) in enumerate(sweeps):
        yield done / len(sweeps)
        meshes = _meshes_before(sweep, occluders)
        if meshes is None:
            continue
        if len(left) == 0:
            left = empty(len(occluders.voxels), np.uint16)
            left[:] = FULL
        given = sweep, meshes, occluders.voxels, points, occluders.matrix, share, beside, left
        steps = block_steps(*given, threads=occluders.threads)
        yield from map_steps(steps, lambda fraction, done=done: (done + fraction) / len(sweeps))
    return left


def traced_light_steps(light, occluders: Occluders, bricks: Bricks, points: Points, scattered: bool):
    """Generator of fractions done: what arrives of a light at points beside voxels, by rays to all its points.

    Parameters
    ----------
    light : Light or None
        None for light from all directions: ambient occlusion.
    bricks : Bricks
        Of the extinction of the voxels, of which clips cut nothing away.
    points : Points
        As ``light_rays.trace_steps`` takes them.
    scattered : bool
        Whether U of the light is asked for in place of its share.

    Returns
    -------
    (m,) ndarray of int16
        ONE times the share that arrives.
    """
    places = sky_directions() if light is None else fixed_samples(light, occluders.corners)
    is_sun = light is None or light.type == "SUN"
    grid = occluders.matrix, occluders.voxels.shape_xyz, occluders.boxed
    sums, cuts = np.zeros(len(occluders.voxels), np.float32), _cuts(occluders)
    for n, point in enumerate(places):

        def along(done, n=n):
            return (n + done) / len(places)

        sweeps = sun_sweeps(point, *grid) if is_sun else point_sweeps(point, *grid, beside=True)
        steps = unblocked_steps([sweeps], [1.0], occluders, points, beside=light is None)
        left = yield from map_steps(steps, lambda _: along(0.0))
        steps = trace_steps(
            occluders.voxels, points, bricks, occluders.matrix, point, is_sun, cuts, 1.0 / len(places), left, scattered,
            sums,
            threads=occluders.threads,
        )  # fmt: skip
        yield from map_steps(steps, along)
    codes = np.empty(len(sums), np.int16)
    for first in range(0, len(sums), CODED_AT_ONCE):
        yield 1.0
        part = slice(first, first + CODED_AT_ONCE)
        codes[part] = np.rint(np.minimum(sums[part], np.float32(1.0)) * ONE)
    return codes


def _cuts(occluders: Occluders) -> Cuts:
    """What the clips of occluders remove, in voxel indices."""
    faces = faces_of(occluders.clips, occluders.matrix)
    own = faces.normals @ occluders.matrix[:3]  # normals of index space, and what is to be taken from the offsets
    planes = np.concatenate((own[:, :3], faces.offsets[:, None] - own[:, 3:]), axis=1)
    boxes = (faces.removed[:, 0] @ occluders.matrix)[:, :3]
    return Cuts(np.ascontiguousarray(planes), np.ascontiguousarray(boxes))


def _shares(weights) -> list[int]:
    """What each sample of a light is of FULL; they add up to it."""
    return np.diff(np.rint(FULL * np.cumsum((0.0, *weights)) / np.sum(weights))).astype(int).tolist()


def _sweep_steps(sweeps: list[Sweep], occluders: Occluders):
    """Generator of fractions done: (m,) uint16 after all sweeps of a light without size, in the voxels' own order."""
    voxels, threads = occluders.voxels, occluders.threads
    codes = np.full(len(voxels), FULL, np.uint16)  # of voxels that no sweep is for: at the light itself
    # Along x voxels are in another order; all that come back from there replace what was there before.
    across = [sweep for sweep in sweeps if sweep.axis == 0]
    if across:
        found = codes.copy()
        for sweep in across:
            blocking = yield from map_steps(occluders.blocking_steps(0), lambda _: 0.0)
            sweep_light(sweep, *blocking, _meshes_before(sweep, occluders), found, threads=threads)
        fetched = fetch_chunks(blocking[0], voxels, codes[:, None], found[:, None], threads=threads)
        yield from map_steps(fetched, lambda _: 0.5)
    for sweep in sweeps:
        if sweep.axis != 0:
            blocking = yield from map_steps(occluders.blocking_steps(sweep.axis), lambda _: 0.5)
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
