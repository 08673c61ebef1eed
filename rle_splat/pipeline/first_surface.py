"""The first visible surface along a ray: what lies under the mouse."""

import math
from dataclasses import dataclass

import numpy as np

from ..classify.classification import opacity_distance, optical_depth, unit_length
from ..effects.clips import half_spaces
from ..scene import Scene
from ..volume.sample import labels_at, values_at

SAMPLES = 4  # per voxel of the ray's way
FINER = 16  # samples for each step near the surface
HALF = math.log(2.0)  # optical depth at which half of the light is absorbed
LEAST = 1.0 / 255.0  # opacity of a whole ray below which nothing is seen
VALUE_SHOWN = {"mip": np.nanargmax, "minip": np.nanargmin}  # of a ray, in modes that show one of its values


@dataclass(frozen=True, eq=False)
class Surface:
    """A point of a volume that is seen along a ray.

    Attributes
    ----------
    index : (3,) ndarray of float64
        Voxel index (x, y, z).
    position : (3,) ndarray of float64
        In the volume's own space and unit of length.
    world : (3,) ndarray of float64
    distance : float
        World length from the ray's origin.
    value : float
        Physical value, interpolated trilinearly.
    opacity : float
        Of the ray up to the point.
    label : int or None
        Of the nearest voxel; None in a scene without labels.
    """

    index: np.ndarray
    position: np.ndarray
    world: np.ndarray
    distance: float
    value: float
    opacity: float
    label: int | None


class _Ray:
    """A ray through the medium of a scene: at world length ``t`` from its origin it is at ``first + t * step``."""

    def __init__(self, scene: Scene, origin, direction):
        self._scene = scene
        to_index = np.linalg.inv(scene.index_to_world)
        self.origin = np.asarray(origin, np.float64)
        self.direction = np.asarray(direction, np.float64) / np.linalg.norm(direction)
        self.first = to_index[:3, :3] @ self.origin + to_index[:3, 3]
        self.step = to_index[:3, :3] @ self.direction
        self._clips = [(half_spaces(one, scene.index_to_world), one) for one in scene.clips]

    def indices(self, t) -> np.ndarray:
        """(n, 3) voxel indices at ``t`` (n,)."""
        return self.first + np.asarray(t)[:, None] * self.step

    def way(self, nearest: float, furthest: float) -> tuple[float, float]:
        """Where the ray enters and leaves the box of the voxel centers; enter >= leave if it misses it."""
        last = np.array(self._scene.volume.shape_xyz) - 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            both = np.sort((-self.first / self.step, (last - self.first) / self.step), axis=0)
        along = self.step == 0.0
        if (along & ((self.first < 0.0) | (self.first > last))).any():
            return 0.0, 0.0
        enter, leave = both[0][~along].max(initial=nearest), both[1][~along].min(initial=furthest)
        return float(enter), float(leave)

    def extinction(self, indices) -> np.ndarray:
        """(n,) float64 at voxel indices, 1/world length; 0 where clip objects cut the volume away."""
        scene = self._scene
        length = unit_length(scene.volume, scene.index_to_world)
        found = self._of(scene.volume, scene.transfer_function, indices, length)
        if scene.labels is not None:
            labels = labels_at(scene.labels.volume, indices)
            for label, function in scene.labels.functions.items():
                mine = labels == label
                if mine.any():
                    own = scene.volume, function, indices[mine], length
                    found[mine] = 0.0 if function is None else self._of(*own)
        for channel in scene.channels:
            found += self._of(channel.volume, channel.transfer_function, indices, length)
        return np.where(self.is_kept(indices), found, 0.0)

    @staticmethod
    def _of(volume, function, indices, length: float) -> np.ndarray:
        depth = optical_depth(function.alpha_at(values_at(volume, indices)))
        if function.gradient_opacity is not None:
            depth *= function.gradient_opacity.factor(_gradients(volume, indices))
        return depth / opacity_distance(volume, function, length)

    def is_kept(self, indices) -> np.ndarray:
        """(n,) bool: whether clip objects keep voxel indices."""
        kept = np.ones(len(indices), bool)
        for sides, clip in self._clips:
            inside = (indices @ sides[:, :3].T + sides[:, 3] <= 0.0).all(axis=1)
            kept &= ~inside if clip.kind == "box" and clip.keep == "outside" else inside
        return kept

    def is_shown(self, indices) -> np.ndarray:
        """(n,) bool: whether clip objects keep voxel indices, and no label hides them."""
        labels = self._scene.labels
        if labels is None:
            return self.is_kept(indices)
        hidden = [label for label, function in labels.functions.items() if function is None]
        return self.is_kept(indices) & ~np.isin(labels_at(labels.volume, indices), hidden)


def _gradients(volume, indices) -> np.ndarray:
    """(n,) magnitudes of the gradient by central differences, physical values per unit of the volume."""
    shifts = np.eye(3)
    per_voxel = [0.5 * (values_at(volume, indices + one) - values_at(volume, indices - one)) for one in shifts]
    return np.linalg.norm(np.stack(per_voxel, axis=1) @ np.linalg.inv(volume.affine[:3, :3]), axis=1)


def find_surface(scene: Scene, origin, direction, nearest: float = 0.0, furthest: float = math.inf) -> Surface | None:
    """Find the first visible surface of a scene's volume along a ray.

    The extinction is that of the classified interpolated values, whatever the quality; edges of labels are not
    smoothed. The optical depth is a sum of trapezoids, four to a voxel, and sixteen times as many where it reaches
    ln 2.

    Parameters
    ----------
    scene : Scene
        Its camera and size are not used; its meshes do not end the ray.
    origin, direction : (3,) array_like of float
        The ray in world space.
    nearest, furthest : float
        World lengths from the origin between which the ray is followed.

    Returns
    -------
    Surface or None
        Where the opacity of the ray passes one half, or else its most opaque sample; in the modes mip and minip, the
        value that is shown. None if nothing is visible.
    """
    if not scene.volume.holds_values:
        return None
    ray = _Ray(scene, origin, direction)
    enter, leave = ray.way(nearest, furthest)
    if not enter < leave:
        return None
    count = max(math.ceil((leave - enter) * np.linalg.norm(ray.step) * SAMPLES), 1) + 1
    t = np.linspace(enter, leave, count)
    if scene.mode in VALUE_SHOWN:
        values = np.where(ray.is_shown(ray.indices(t)), values_at(scene.volume, ray.indices(t)), np.nan)
        if np.isnan(values).all():
            return None
        best = int(VALUE_SHOWN[scene.mode](values))
        is_seen = float(scene.transfer_function.alpha_at(values[best])) > 0.0
        return _surface(scene, ray, t[best], 1.0) if is_seen else None
    sigma = ray.extinction(ray.indices(t))
    depth = _depths(t, sigma)
    if not sigma.any() or -math.expm1(-depth[-1]) < LEAST:
        return None
    if depth[-1] < HALF:
        return _surface(scene, ray, t[int(sigma.argmax())], -math.expm1(-depth[-1]))
    after = int(np.searchsorted(depth, HALF))
    fine = np.linspace(t[after - 1], t[min(after + 1, count - 1)], 2 * FINER + 1)  # a fine sum may be smaller
    sigma = ray.extinction(ray.indices(fine))
    depth = depth[after - 1] + _depths(fine, sigma)
    seen = np.flatnonzero((depth >= min(HALF, depth[-1])) & (sigma > 0.0))
    best = int(seen[0]) if len(seen) else int(sigma.argmax())
    return _surface(scene, ray, fine[best], -math.expm1(-depth[best]))


def point_along(scene: Scene, origin, direction, distance: float) -> Surface | None:
    """Find the point of a ray that is so many world units from its origin, such as on a slice.

    Returns
    -------
    Surface or None
        Whether it is visible or not; None outside the box of the voxel centers.
    """
    ray = _Ray(scene, origin, direction)
    enter, leave = ray.way(-math.inf, math.inf)
    inside = scene.volume.holds_values and enter <= distance <= leave
    return _surface(scene, ray, distance, 1.0) if inside else None


def _depths(t, sigma) -> np.ndarray:
    """(n,) optical depth from the first of the samples at ``t`` (n,) to each of them."""
    return np.concatenate(((0.0,), np.cumsum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(t))))


def _surface(scene: Scene, ray: _Ray, t: float, opacity: float) -> Surface:
    index = ray.indices((t,))
    affine = scene.volume.affine
    return Surface(
        index=index[0], position=affine[:3, :3] @ index[0] + affine[:3, 3], world=ray.origin + t * ray.direction,
        distance=float(t), value=float(values_at(scene.volume, index)[0]), opacity=float(opacity),
        label=None if scene.labels is None else int(labels_at(scene.labels.volume, index)[0]),
    )  # fmt: skip
