"""Transmittance to lamps and openness to the sky for the truth of light, by exact rays.

The medium is the extinction of the voxels, interpolated trilinearly, within the box of voxel centers.  Along a ray it
is a cubic in each cell, which Gauss-Legendre quadrature of two nodes integrates exactly.  What clip objects remove is
empty, and meshes block all light.

Positions are voxel indices (x, y, z).
"""

import numpy as np

from ..scene import Light, Scene
from .clips import Clipping
from .integrate import span
from .lamps import unit
from .rays import WorldRays
from .transfer import Segments, extinction, world_opacity_distance

POINTS = 16  # on a lamp that is not a point
WIDEST_SUN = 0.5 * np.pi  # angle
OPAQUE = 10.0  # optical depth from which a ray is not followed further: at most 5e-5 of the light arrives
SCATTERED = 1, 2  # octaves of indirect light: 2^-n of the light, through 2^-n of the optical depth
SHIFT = 2
BLOCK = 1 << SHIFT  # cells along a side of what is passed over at once where it is empty
FURTHEST = 8  # blocks
RAYS_AT_ONCE = 16384
RAYS_NEAR_MESHES = 256
NUDGE = 1e-9  # voxels ahead, where the cell of a position on a face is looked up
NODES = 0.5 + np.sqrt(1.0 / 12.0) * np.array((-1.0, 1.0))
# Directions of the sky: a spiral over the upper half sphere, at heights of equal areas, and their opposites.
_TURNS = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(12)
_HEIGHTS = 1.0 - (np.arange(12) + 0.5) / 12.0
_AROUND = np.sqrt(1.0 - _HEIGHTS**2)
_UPPER = np.stack((_AROUND * np.cos(_TURNS), _AROUND * np.sin(_TURNS), _HEIGHTS), axis=1)
SKY = np.concatenate((_UPPER, -_UPPER))


class Tracer:
    """Casts rays through the medium and the meshes of a scene.

    Parameters
    ----------
    world_distance : float
        World length of the opacity unit distance.
    """

    def __init__(self, scene: Scene, world_distance: float):
        volume = scene.volume
        self._voxels, self._matrix, self._clips = volume.voxels, scene.index_to_world, scene.clips
        self._to_index = np.linalg.inv(self._matrix[:3, :3])
        self._high = np.array(volume.voxels.shape[::-1]) - 1.0
        self._center = self._matrix[:3, :3] @ (0.5 * self._high) + self._matrix[:3, 3]
        lookups = [_extinction_lookup(volume, scene.transfer_function, world_distance)]
        self._empty = _empty_blocks(volume, Segments(scene.transfer_function))
        for channel in scene.channels:
            own, function = channel.volume, channel.transfer_function
            lookups.append(_extinction_lookup(own, function, world_opacity_distance(scene, function)))
            self._empty = np.minimum(self._empty, _empty_blocks(own, Segments(function)))
        self._extinction = lookups[0] if len(lookups) == 1 else lambda number: sum(one(number) for one in lookups)
        self._meshes = None if scene.triangles is None or len(scene.triangles) == 0 else Meshes(scene.triangles)

    def towards(self, light: Light, index: np.ndarray, own=None) -> np.ndarray:
        """(N,) share of a light that arrives at (N, 3) positions.

        Meshes block it from ``own`` (N, 3) on; by default from the positions themselves.

        A light that is not a point is the mean over POINTS of its disk: a sun's angle, a lamp's sphere as seen from
        the middle of the volume, or the points of an area.  The renderer has the same for large lights and where it
        traces light, else up to 8 (``shade.light_samples``).
        """
        return np.exp(-self._depths_towards(light, index, own, OPAQUE)).mean(axis=0)

    def scattered(self, light: Light, index: np.ndarray, own=None) -> np.ndarray:
        """(N,) share of a light that arrives scattered at (N, 3) positions: the mean of the octaves SCATTERED by their
        weights (Wrenninge et al. 2013).  ``own`` as of ``towards``."""
        depths = self._depths_towards(light, index, own, OPAQUE * 2.0 ** max(SCATTERED))
        weights = [2.0**-n for n in SCATTERED]
        return sum(weight * np.exp(-weight * depths).mean(axis=0) for weight in weights) / sum(weights)

    def _depths_towards(self, light: Light, index, own, opaque: float) -> np.ndarray:
        """(M, N) optical depth from (N, 3) positions to each of M points of a light; infinite behind meshes."""
        targets, parallel = _targets(light, self._center), light.type == "SUN"

        def rays(start):
            directions = [np.broadcast_to(target, start.shape) if parallel else target - start for target in targets]
            lengths = [np.full(len(start), np.inf) if parallel else np.linalg.norm(way, axis=1) for way in directions]
            return start, [unit(way) for way in directions], lengths

        begins = self._world(index)
        depths = self._depths(*rays(begins), opaque)
        self._block(depths, *rays(begins if own is None else self._world(own)))
        return depths

    def openness(self, index: np.ndarray) -> np.ndarray:
        """O: (N,) mean transmittance from (N, 3) positions over the directions of SKY."""
        start = self._world(index)
        directions = [np.broadcast_to(towards, start.shape) for towards in SKY]
        rays = start, directions, [np.full(len(start), np.inf)] * len(SKY)
        depths = self._depths(*rays, OPAQUE)
        self._block(depths, *rays)
        return np.exp(-depths).mean(axis=0)

    def _world(self, index):
        return np.einsum("ni,ji->nj", index, self._matrix[:3, :3]) + self._matrix[:3, 3]

    def _depths(self, start, directions, lengths, opaque: float) -> np.ndarray:
        """(K, N) optical depth, not followed beyond ``opaque``, from world points (N, 3) along rays of K directions.

        ``directions``, ``lengths``: for each, unit vectors (N, 3) and world lengths (N,).
        """
        count = len(directions) * len(start)
        rays = WorldRays(np.tile(start, (len(directions), 1)), np.concatenate(directions), np.ones(count))
        length = np.concatenate(lengths)
        depth = np.empty(count)
        for first in range(0, count, RAYS_AT_ONCE):  # of all directions, as short arrays take longer
            part = slice(first, first + RAYS_AT_ONCE)
            depth[part] = self._depth(rays[part], length[part], opaque)
        return depth.reshape(len(directions), -1)

    def _block(self, depths, start, directions, lengths) -> None:
        """Make ``depths`` (K, N) infinite behind meshes; rays as of ``_depths``."""
        if self._meshes is not None:
            for one, *ray in zip(depths, directions, lengths):
                one[self._meshes.block(start, *ray)] = np.inf

    def _depth(self, rays: WorldRays, length, opaque: float) -> np.ndarray:
        """(N,) optical depth of rays over a world length (N,); all rays go on by one cell at a time."""
        # No products of matrices, for the reason given in ``integrate``.
        origin = np.einsum("ni,ji->nj", rays.origin - self._matrix[:3, 3], self._to_index)
        step = np.einsum("ni,ji->nj", rays.direction, self._to_index)
        depth = np.zeros(len(origin))
        if not self._high.all():  # a medium without thickness
            return depth
        begin, end = span(origin, step, np.zeros(3), self._high, 0.0, length)
        clipping = Clipping(self._clips, rays) if self._clips else None
        crossings = None if clipping is None else clipping.crossings()
        on = np.flatnonzero(end > begin)
        o, d = np.ascontiguousarray(origin[on].T), np.ascontiguousarray(step[on].T)  # (3, N): several times as quick
        begin, end, tau = begin[on], end[on], depth[on]
        last = (self._high - 1.0)[:, None]
        while len(on):
            cell = np.clip(np.floor(o + d * begin + NUDGE * np.sign(d)), 0.0, last).astype(np.int64)
            block = cell >> SHIFT
            around = self._empty[block[2], block[1], block[0]]  # blocks
            shown = around == 0
            # The faces ahead of the cell, or of the empty blocks around.
            near = np.where(shown, cell, block * BLOCK)
            face = near + np.where(d > 0.0, np.maximum(around * BLOCK, 1), np.minimum((1 - around) * BLOCK, 0))
            with np.errstate(divide="ignore", invalid="ignore"):
                out = np.where(d != 0.0, (face - o) / d, np.inf)
            until = np.minimum(np.minimum(out[0], out[1]), np.minimum(out[2], end))
            if crossings is not None:
                until = np.minimum(until, np.where(crossings[on] > begin[:, None], crossings[on], np.inf).min(axis=1))
                shown &= clipping.keeps(on, 0.5 * (begin + until))
            until = np.maximum(until, np.nextafter(begin, np.inf))
            here = np.flatnonzero(shown)
            tau[here] += self._cell_depth(*(part.take(here, axis=-1) for part in (o, d, begin, until, cell)))
            begin = until
            depth[on] = tau
            going = np.flatnonzero((until < end) & (tau < opaque))
            if len(going) < len(on):
                on, begin, end, tau = (part.take(going) for part in (on, begin, end, tau))
                o, d = o.take(going, axis=1), d.take(going, axis=1)
        return depth

    def _cell_depth(self, origin, step, begin, until, cell):
        """(N,) optical depth of pieces of rays within their cells (3, N), from world length ``begin`` to ``until``."""
        nx, ny = self._voxels.shape[2], self._voxels.shape[1]
        first = (cell[2] * ny + cell[1]) * nx + cell[0]
        # (2, 4, N): by z, by y and x
        apart = np.array((0, nx * ny))[:, None, None] + np.array((0, 1, nx, nx + 1))[:, None]
        corners = self._extinction(first + apart)
        total = 0.0
        for node in NODES:
            x, y, z = origin + step * (begin + node * (until - begin)) - cell
            along = corners[:, 0::2] + x * (corners[:, 1::2] - corners[:, 0::2])
            across = along[:, 0] + y * (along[:, 1] - along[:, 0])
            total = total + across[0] + z * (across[1] - across[0])
        return 0.5 * total * (until - begin)


def _extinction_lookup(volume, transfer_function, world_distance: float):
    """A function from flat numbers of voxels to their extinction, 1 / world length."""
    stored = volume.voxels.reshape(-1)
    if stored.dtype.kind == "f" or stored.dtype.itemsize > 2:
        return lambda number: extinction(transfer_function, volume.physical(stored[number]), world_distance)
    limits = np.iinfo(stored.dtype)
    every = np.arange(limits.min, limits.max + 1)
    table = extinction(transfer_function, volume.physical(every.astype(stored.dtype)), world_distance)
    return lambda number: table[stored[number].astype(np.int64) - limits.min]


def _empty_blocks(volume, segments: Segments) -> np.ndarray:
    """(bz, by, bx) distance of each block to the nearest that shows anything at a corner of its cells: 0 for that block
    itself, 1 for those beside it, at most FURTHEST; as many blocks less one are empty on all sides."""
    found = []
    for combine in (np.fmin, np.fmax):  # which leave out NaN
        ends = volume.voxels
        for axis, count in enumerate(volume.voxels.shape):
            starts = np.arange(0, max(count - 1, 1), BLOCK)
            following = np.take(ends, np.minimum(starts + BLOCK, count - 1), axis)  # at corners of this block, too
            ends = combine(combine.reduceat(ends, starts, axis=axis), following)
        found.append(volume.physical(ends))
    shows = segments.show_between(*np.sort(np.stack(found), axis=0))
    distance = np.where(shows, 0, FURTHEST)
    for number in range(1, FURTHEST):
        for axis in range(3):  # a cube further on all sides
            wide = np.pad(shows, [(1, 1) if other == axis else (0, 0) for other in range(3)])
            wide = np.moveaxis(wide, axis, 0)
            shows = np.moveaxis(wide[:-2] | wide[1:-1] | wide[2:], 0, axis)
        distance = np.where(shows, np.minimum(distance, number), distance)
    return distance


class Meshes:
    """Triangles that block light.

    Parameters
    ----------
    triangles : (n, 3, 3)
        World.
    """

    def __init__(self, triangles):
        triangles = np.asarray(triangles, dtype=np.float64)
        self._corner = triangles[:, 0]
        self._sides = triangles[:, 1] - self._corner, triangles[:, 2] - self._corner
        self._middle = triangles.mean(axis=1)
        self._radius = np.linalg.norm(triangles - self._middle[:, None], axis=2).max(axis=1)

    def block(self, start, direction, length) -> np.ndarray:
        """(N,) bool: whether any triangle meets world rays from (N, 3) along unit vectors over a length (N,)."""
        blocked = np.zeros(len(start), bool)
        for first in range(0, len(start), RAYS_NEAR_MESHES):
            part = slice(first, first + RAYS_NEAR_MESHES)
            near = self._near(start[part], direction[part], length[part])
            blocked[part] = self._met(near, start[part], direction[part], length[part])
        return blocked

    def _near(self, start, direction, length):
        """Numbers of the triangles whose bounding spheres meet the hull of rays that are parallel or end in a point."""
        center = start.mean(axis=0)
        radius = np.linalg.norm(start - center, axis=1).max()
        ahead = direction[0] if np.isinf(length[0]) else start[0] + direction[0] * length[0] - center
        along = np.einsum("ni,i->n", self._middle - center, ahead) / (ahead**2).sum()
        along = np.clip(along, 0.0, np.inf if np.isinf(length[0]) else 1.0)
        away = np.linalg.norm(self._middle - center - along[:, None] * ahead, axis=1)
        return np.flatnonzero(away <= self._radius + radius)

    def _met(self, numbers, start, direction, length):
        """(N,) bool; each triangle with all rays (Moeller and Trumbore 1997)."""
        met = np.zeros(len(start), bool)
        for number in numbers:
            one, two, corner = self._sides[0][number], self._sides[1][number], self._corner[number]
            across, away = np.cross(direction, two), start - corner
            turned = np.cross(away, one)
            with np.errstate(divide="ignore", invalid="ignore"):
                over = 1.0 / np.einsum("ni,i->n", across, one)
                u = over * np.einsum("ni,ni->n", across, away)
                v = over * np.einsum("ni,ni->n", turned, direction)
                at = over * np.einsum("ni,i->n", turned, two)
                met |= (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (at > 0.0) & (at < length)
        return met


def _disk(count: int) -> np.ndarray:
    """(count, 2) points that fill the unit disk evenly: a spiral by the golden angle (Vogel 1979)."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt((np.arange(count) + 0.5) / count)
    return np.stack((radius * np.cos(turn), radius * np.sin(turn)), axis=-1)


def _targets(light: Light, center) -> np.ndarray:
    """Points of a lamp, or unit vectors towards points of a sun, (M, 3); ``center`` (3,): of the volume."""
    x, y, back, place = (light.matrix_world[:3, column] for column in range(4))
    if light.type == "AREA":
        tall = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
        if light.shape in ("DISK", "ELLIPSE"):
            across = 0.5 * _disk(POINTS)
        else:
            middles = (np.arange(4) + 0.5) / 4 - 0.5
            across = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        return place + across[:, :1] * light.size * x + across[:, 1:] * tall * y
    is_sun = light.type == "SUN"
    facing = unit(back if is_sun else center - place)
    radius = np.tan(0.5 * min(light.angle, WIDEST_SUN)) if is_sun else light.radius
    middle = facing if is_sun else place
    if radius == 0.0:
        return middle[None]
    x = unit(np.cross(facing, np.eye(3)[np.argmin(np.abs(facing))]))
    disk = radius * _disk(POINTS)
    found = middle + disk[:, :1] * x + disk[:, 1:] * np.cross(facing, x)
    return unit(found) if is_sun else found
