"""The light of post-classified pictures (docs/explanation/light.md) by brute force, in float64.

A voxel has a vector m, the unit normal that points to where extinction falls times the trust in it, the share T of each
lamp that arrives at a point x' beside it and that meshes leave at the voxel, and O of the ambient light.  They are
interpolated trilinearly.  The color of a point with the transfer function's color c is then

    c * L + H,  L = w S + (1 - w) C,  H = w sum over lamps of specular ramp(n.l) highlight I T,
    S = (ambient + diffuse world(n)) O + sum over lamps of diffuse I ((1 - q) wrap(n.l) T + q spread(n.l) U),
    C = (ambient + diffuse world mean) O + sum over lamps of diffuse I ((1 - q) T + q U),

with w = smoothstep(0, TRUSTED, |m|) and n = m / |m|.  S is the light of a surface, C that of a cloud, which has no
normal.  q is 3/7 of the amount of indirect light, the weight of the further two of three octaves, and U the share of
these that arrives at x'.
"""

from itertools import pairwise

import numpy as np

from ..scene import Scene
from .lamps import ReferenceLamps, unit
from .light_normals import LEAST, NormalField, automatic_sigma, smoothstep
from .light_transport import Tracer
from .medium import ScalarField, corner_indices, cubics, polynomial
from .transfer import mean_extinction, opacity_unit_distance

TRUSTED = 0.3  # length of m from which a normal is wholly trusted
ROUNDING = np.sin(np.radians(5.0))  # of the maximum of n.l and 0, in cosines
INDIRECT = (1 / 2 + 1 / 4) / (1 + 1 / 2 + 1 / 4)  # weight of the further two of three octaves
SPREAD = 0.4  # optical depth of indirect light over that of direct light, on average
RAMP = 0.2  # n.l from which a highlight is whole: it must not end in an edge where the diffuse light ends
TURNED = 0.4  # cosine between a two-sided surface's normal and the eye from which it is wholly turned to the eye
FARTHEST = 3.0  # of x', in widths of a voxel along the normal, before
FURTHER = 9.0 / 8.0
FACING = 0.25  # m.l, up and down, over which the point beside a voxel goes over to the lamp's side
FACE = 1.0, 2.0  # widths of a voxel from a face at which its normal begins to fade and is gone
SIDE = 0.5  # balance of the distances to both transparent sides from which m wholly points to the nearer one
ALMOST_NONE = 1e-6  # |m| below which there is no direction


def wrap(cosine) -> np.ndarray:
    """The maximum of n.l and 0, averaged over n.l +- ROUNDING, so that it has no kink at the terminator."""
    c = np.asarray(cosine, dtype=np.float64)
    between = (np.clip(c, -ROUNDING, ROUNDING) + ROUNDING) ** 2 / (4.0 * ROUNDING)
    return between + np.maximum(c - ROUNDING, 0.0)


def spread(cosine) -> np.ndarray:
    """What indirect light counts by the cosine to the lamp: see docs/explanation/light.md."""
    lit, away = wrap(cosine), np.clip(-np.asarray(cosine, dtype=np.float64), 0.0, None)
    return lit * (1.0 + SPREAD) / (lit + SPREAD) + away * away


def voxel_width(normal, matrix) -> np.ndarray:
    """(N,) extent of a cell of voxels along unit normals (N, 3); ``matrix`` (4, 4): voxel index to world."""
    return np.abs(np.einsum("ni,ij->nj", normal, matrix[:3, :3])).sum(axis=1)


def _distances(intervals, values) -> tuple[np.ndarray, np.ndarray]:
    """Distances (N,) of values down and up to intervals without their ends; infinite where there is none."""
    down, up = np.full(values.shape, np.inf), np.full(values.shape, np.inf)
    for low, high in intervals:
        down = np.where(values > low, np.minimum(down, np.maximum(values - high, 0.0)), down)
        up = np.where(values < high, np.minimum(up, np.maximum(low - values, 0.0)), up)
    return down, up


def _balance(near, far) -> np.ndarray:
    """(far - near) / (far + near); 1 where ``far`` is infinite or both are 0, -1 where only ``near`` is infinite."""
    with np.errstate(invalid="ignore"):
        found = (far - near) / (far + near)
    return np.where(np.isinf(far) | (far + near == 0.0), 1.0, np.where(np.isinf(near), -1.0, found))


def find_sides(opacity, values) -> tuple[np.ndarray, np.ndarray]:
    """Where extinction falls, and how far away nothing is shown, in values.

    Parameters
    ----------
    opacity : sequence of (value, alpha)
        Points of a transfer function; beyond its ends the last alpha holds.
    values : (N,)
        Physical.

    Returns
    -------
    side : (N,)
        1 where extinction falls towards lower values, -1 where towards higher ones; between these, m is shorter.
    distance : (N,)
        To the nearest transparent value on that side; 0 where there is none, and for values that are transparent.
    """
    points = sorted(opacity, key=lambda point: point[0])
    points = [(-np.inf, points[0][1]), *points, (np.inf, points[-1][1])]
    pairs = list(pairwise(points))
    shown = [(low[0], high[0]) for low, high in pairs if low[1] > 0.0 or high[1] > 0.0]
    clear = [(low[0], high[0]) for low, high in pairs if low[1] <= 0.0 and high[1] <= 0.0]
    # Single values, too, at which the opacity touches 0: intervals with ends that are next to them.
    clear += [
        (np.nextafter(value, -np.inf), np.nextafter(value, np.inf)) for value, alpha in points[1:-1] if alpha <= 0.0
    ]
    down, up = _distances(clear, values)
    shown_down, shown_up = _distances(shown, values)
    is_clear = (down == 0.0) & (up == 0.0)
    balance = np.where(is_clear, _balance(shown_up, shown_down), _balance(down, up))
    side = 2.0 * smoothstep(-SIDE, SIDE, balance) - 1.0
    distance = np.where(side >= 0.0, down, up)
    return side, np.where(np.isfinite(distance), distance, 0.0)


class PostLight:
    """Light at points of a scene.

    Voxels are looked at when first needed, and kept: T and O take most of the time.

    Parameters
    ----------
    scene : Scene
        With a transfer function that shades.
    world_distance : float
        World length of the opacity unit distance.
    """

    def __init__(self, scene: Scene, world_distance: float):
        volume = scene.volume
        self._scene, self._shade = scene, scene.transfer_function.shade
        self._matrix, self._shape = scene.index_to_world, volume.voxels.shape
        self._from_world = np.linalg.inv(self._matrix[:3, :3])
        # From the volume's own space to the world.  Its scale turns mm into world lengths.
        own_to_world = self._matrix[:3, :3] @ np.linalg.inv(volume.affine[:3, :3])
        self._covector = np.linalg.inv(own_to_world)
        self._world_per_mm = float(np.cbrt(abs(np.linalg.det(own_to_world))))
        sigma = automatic_sigma(volume.affine) if self._shade.smoothness is None else self._shade.smoothness
        self._channels = [
            (one.volume, one.transfer_function, NormalField(one.volume.voxels, one.volume.affine, sigma))
            for one in (scene, *scene.channels)
        ]
        self._lamps, self._faces = ReferenceLamps(scene), CutFaces(scene)
        self._casting = [n for n, light in enumerate(scene.lights) if scene.volume_shadows and light.casts_shadow]
        self._opened = scene.ambient_occlusion > 0.0
        self._indirect = scene.indirect_light * INDIRECT if self._casting else 0.0
        self._tracer = Tracer(scene, world_distance) if self._casting or self._opened else None
        self._known = np.empty(0, np.int64)  # flat numbers of voxels, ascending, whose planes are in ``_kept``
        shares = len(self._casting) * (2 if self._indirect else 1) + self._opened
        self._kept = np.empty((0, 3 + shares))

    def planes(self, z, y, x) -> np.ndarray:
        """(N, K) m, T of each lamp that casts shadows, U of each with indirect light, and O with ambient occlusion, of
        voxels (N,)."""
        numbers, back = np.unique(np.ravel_multi_index((z, y, x), self._shape), return_inverse=True)
        new = np.setdiff1d(numbers, self._known, assume_unique=True)
        if len(new):
            at = np.searchsorted(self._known, new)
            self._kept = np.insert(self._kept, at, self._find_planes(*np.unravel_index(new, self._shape)), axis=0)
            self._known = np.insert(self._known, at, new)
        return self._kept[np.searchsorted(self._known, numbers)][back.ravel()]

    def _find_planes(self, z, y, x):
        m, beside = self.surfaces(z, y, x)
        casting = [self._scene.lights[number] for number in self._casting]
        index = np.stack((x, y, z), axis=1).astype(np.float64)
        near = self._near(beside)
        from_sides = ((one, self._near(self._lamp_side(one, index, m, beside))) for one in casting)
        found = [*m.T, *(self._tracer.towards(one, side, index) for one, side in from_sides)]
        if self._indirect:
            found += [self._tracer.scattered(light, near, index) for light in casting]
        if self._opened:
            found.append(1.0 - self._scene.ambient_occlusion * (1.0 - self._tracer.openness(near)))
        return np.stack(found, axis=1)

    def _near(self, index) -> np.ndarray:
        """(N, 3) positions, moved along the axes to at most a voxel beyond the volume."""
        return np.clip(index, -1.0, self._shape[::-1])

    def surfaces(self, z, y, x) -> tuple[np.ndarray, np.ndarray]:
        """m (N, 3), world, and x' (N, 3), voxel indices x, y, z, of voxels (N,).

        Of several channels, the means weighted by what each shows around the voxel.
        """
        found = [self._surfaces_of(*channel, z, y, x) for channel in self._channels]
        if len(found) == 1:
            return found[0]
        weights = [self._shown_around(volume, function, z, y, x) for volume, function, _ in self._channels]
        total = sum(weights)
        shares = [np.divide(weight, total, out=np.zeros_like(total), where=total > 0.0) for weight in weights]
        shares[0] = np.where(total > 0.0, shares[0], 1.0)
        return tuple(sum(share[:, None] * each for share, each in zip(shares, both)) for both in zip(*found))

    def _lamp_side(self, light, index, m, beside) -> np.ndarray:
        """(N, 3) points of a lamp: ``beside`` where m faces it, else towards it."""
        world = np.einsum("ni,ji->nj", index, self._matrix[:3, :3]) + self._matrix[:3, 3]
        is_sun = light.type == "SUN"
        away = np.broadcast_to(light.matrix_world[:3, 2], m.shape) if is_sun else light.matrix_world[:3, 3] - world
        direction = unit(away)
        reach = FURTHER * FARTHEST * voxel_width(direction, self._matrix)
        reach = reach if is_sun else np.minimum(reach, np.linalg.norm(away, axis=1))
        towards = index + np.einsum("ni,ji->nj", reach[:, None] * direction, self._from_world)
        t = 1.0 - _dot(m, m) * smoothstep(-FACING, FACING, _dot(m, direction))
        t *= smoothstep(0.0, LEAST**2, _dot(m, m))  # flat values keep their own shade
        return (1.0 - t) * beside + t * towards

    def _shown_around(self, volume, function, z, y, x):
        """(N,) mean extinction over the values from the smallest to the largest of the 27 voxels around."""
        steps = np.indices((3, 3, 3)).reshape(3, 27) - 1
        at = (np.clip(own[:, None] + step, 0, n - 1) for own, step, n in zip((z, y, x), steps, self._shape))
        values = volume.physical(volume.voxels[tuple(at)])
        ends = sorted(point[0] for point in (*function.opacity, *function.color))
        values = np.where(np.isinf(values), np.clip(values, ends[0], ends[-1]), values)
        distance = opacity_unit_distance(function, self._scene.volume)
        return mean_extinction(function, np.fmin.reduce(values, axis=1), np.fmax.reduce(values, axis=1), distance)

    def _surfaces_of(self, volume, function, normals, z, y, x):
        """``surfaces`` of one channel."""
        field, index = normals.at(z, y, x), np.stack((x, y, z), axis=1).astype(np.float64)
        values = volume.physical(volume.voxels[z, y, x])
        side, distance = find_sides(function.opacity, values)
        vector, slope = field[:, :3], field[:, 3]
        falling = -np.sign(volume.slope) * unit(np.einsum("ni,ij->nj", vector, self._covector))
        m = (side * np.linalg.norm(vector, axis=1))[:, None] * falling
        world = np.einsum("ni,ji->nj", index, self._matrix[:3, :3]) + self._matrix[:3, 3]
        face, rest, inside = self._faces.at(world)
        m = rest[:, None] * m + face
        m = m / np.maximum(np.linalg.norm(m, axis=1, keepdims=True), 1.0)
        length, normal = np.linalg.norm(m, axis=1), unit(m)
        width = voxel_width(normal, self._matrix)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(distance > 0.0, distance * self._world_per_mm / (np.abs(volume.slope) * slope), 0.0)
        depth = rest * np.minimum(depth, FARTHEST * width) + (1.0 - rest) * inside
        b = FURTHER * smoothstep(0.0, TRUSTED, length) * np.minimum(depth + width, FARTHEST * width)
        return m, index + np.einsum("ni,ji->nj", b[:, None] * normal, self._from_world)

    def at(self, index, planes) -> tuple[np.ndarray, np.ndarray]:
        """(N, 3) light L and (N, 3) highlight H.

        Parameters
        ----------
        index : (N, 3)
            Voxel index x, y, z.
        planes : (N, K)
            Those of ``planes``, interpolated.
        """
        shade = self._shade
        world = np.einsum("ni,ji->nj", index, self._matrix[:3, :3]) + self._matrix[:3, 3]
        to_eye = np.broadcast_to(self._lamps.to_eye(world), world.shape)
        length = np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
        w, normal = smoothstep(0.0, TRUSTED, length), planes[:, :3] / np.maximum(length, ALMOST_NONE)
        if shade.two_sided:
            away = np.maximum(-_dot(normal, to_eye), 0.0)
            turned = smoothstep(0.0, TURNED, away)
            normal = (1.0 - 2.0 * turned) * normal + away * (1.0 - turned) * to_eye
        mean = np.zeros(3) if self._scene.world is None else np.array(self._scene.world, dtype=np.float64)
        surface = shade.ambient + shade.diffuse * self._lamps.world(normal)
        cloud = shade.ambient + shade.diffuse * mean
        opened = planes[:, -1:] if self._opened else 1.0
        light, highlight = (w * surface + (1.0 - w) * cloud) * opened, np.zeros_like(world)
        for number, (towards, strength) in enumerate(self._lamps.lights(world)):
            facing = _dot(normal, np.broadcast_to(towards, world.shape))
            q = self._indirect if number in self._casting else 0.0
            if q:
                arrives = planes[:, 3 + len(self._casting) + self._casting.index(number), None]
                light = light + q * shade.diffuse * (w * spread(facing) + (1.0 - w)) * strength * arrives
            if number in self._casting:
                strength = strength * planes[:, 3 + self._casting.index(number), None]
            light = light + (1.0 - q) * shade.diffuse * (w * wrap(facing) + (1.0 - w)) * strength
            if shade.specular == 0.0:
                continue
            peak = np.maximum(_dot(normal, unit(towards + to_eye)), 0.0) ** shade.shininess
            highlight = highlight + shade.specular * w * smoothstep(0.0, RAMP, facing) * peak * strength
        return light, highlight


class CutFaces:
    """The faces of the box of voxel centers and of clip objects, whose normals replace the field's near them."""

    def __init__(self, scene: Scene):
        matrix, last = scene.index_to_world, np.array(scene.volume.voxels.shape[::-1]) - 1.0
        self._matrix, to_index = matrix, np.linalg.inv(matrix)
        # A row (normal, offset) for each face: the distance inside it is offset - normal . x.
        self._inside = [
            (sign * to_index[axis, :3], (last[axis] if sign > 0 else 0.0) - sign * to_index[axis, 3])
            for axis in range(3)
            for sign in (1.0, -1.0)
            if last[axis] > 0.0
        ]
        self._removed = []
        for clip in scene.clips:
            own = np.linalg.inv(clip.matrix_world)
            if clip.kind == "plane":
                sign = 1.0 if clip.keep == "inside" else -1.0
                self._inside.append((sign * own[2, :3], -sign * own[2, 3]))
            elif clip.keep == "inside":
                for axis in range(3):
                    self._inside += [(s * own[axis, :3], 1.0 - s * own[axis, 3]) for s in (1.0, -1.0)]
            else:
                self._removed.append(own)
        self._inside = [(row / np.linalg.norm(row), offset / np.linalg.norm(row)) for row, offset in self._inside]

    def at(self, world) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At world points (N, 3): the faces' part of m (N, 3), the share (N,) that is left of the field's own m, and
        the distance (N,) to the nearest face that counts."""
        total, rest, nearest = np.zeros_like(world), np.ones(len(world)), np.full(len(world), np.inf)
        for normal, offset in self._inside:
            width = voxel_width(normal[None], self._matrix)
            distance = np.abs(offset - np.einsum("ni,i->n", world, normal))
            near = 1.0 - smoothstep(*FACE, distance / width)
            total, rest = total + near[:, None] * normal, rest * (1.0 - near)
            nearest = np.where(near > 0.0, np.minimum(nearest, distance), nearest)
        for own in self._removed:
            # The faces of a box that is removed end at its edges: the nearest point of the box decides.
            at = np.einsum("ni,ji->nj", world, own[:3, :3]) + own[:3, 3]
            beyond = np.einsum("ni,ji->nj", at - np.clip(at, -1.0, 1.0), np.linalg.inv(own[:3, :3]))
            distance, away = np.linalg.norm(beyond, axis=1), unit(beyond)
            with np.errstate(divide="ignore", invalid="ignore"):
                near = 1.0 - smoothstep(*FACE, distance / voxel_width(away, self._matrix))
            near = np.where(distance > 0.0, near, 0.0)
            total, rest = total - near[:, None] * away, rest * (1.0 - near)
            nearest = np.where(near > 0.0, np.minimum(nearest, distance), nearest)
        return total, rest, np.where(rest < 1.0, nearest, 0.0)


class LitField(ScalarField):
    """T2 with light at every point: the scalar and what voxels have of light are interpolated, then evaluated.

    Parameters
    ----------
    values, transfer_function, world_distance, physical, further
        As ``ScalarField`` takes them.
    """

    is_lit = True

    def __init__(self, values, transfer_function, world_distance: float, physical, light: PostLight, further=()):
        super().__init__(values, transfer_function, world_distance, physical, further)
        self._light, self._count = light, 1 + len(further)

    def cells(self, cell: np.ndarray) -> np.ndarray:
        """(P, 3) integer low corners -> (P, 8, channels + 3) at the corners: the scalars, and x, y, z."""
        at = cell[:, None] + np.array(list(np.ndindex(2, 2, 2)))[:, ::-1]
        return np.concatenate((super().cells(cell), at), axis=-1)

    def light_up(self, table: np.ndarray) -> np.ndarray:
        """Cubics (P, channels + 3, 4) of cells -> (P, channels + 3 + K, 4) with those of ``PostLight.planes``."""
        start, travel = table[:, self._count :, 0], table[:, self._count :, 1]
        cell = np.clip(np.floor(start + 0.5 * travel), self.low, self.high - 1.0).astype(np.int64)
        index, _ = corner_indices(cell, self._shape)
        planes = self._light.planes(*(part.reshape(-1) for part in np.broadcast_arrays(*index)))
        return np.concatenate((table, cubics(planes.reshape(len(cell), 8, -1), start - cell, travel)), axis=1)

    def unlit(self, table: np.ndarray) -> np.ndarray:
        """The cubics that ``light_up`` was given."""
        return table[:, : self._count + 3]

    def fields(self, poly: np.ndarray, segment: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(P, 4, N) extinction * RGB and extinction, of cubics (P, C, 4) at ``t`` (P, N); lit after ``light_up``."""
        found, index = super().fields(poly, segment, t), poly[:, self._count :]
        if index.shape[1] > 3:
            at = np.moveaxis(polynomial(index[:, :, None, :], t[:, None, :]), 1, 2).reshape(-1, index.shape[1])
            light, highlight = (np.moveaxis(part.reshape(*t.shape, 3), 2, 1) for part in
                                self._light.at(at[:, :3], at[:, 3:]))  # fmt: skip
            found[:, :3] = found[:, :3] * light + found[:, 3:] * highlight
        return found


def _dot(one, two) -> np.ndarray:
    """(N, 1) products of vectors (N, 3)."""
    return np.einsum("ni,ni->n", one, two)[:, None]
