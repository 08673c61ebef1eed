"""Lamps, headlight and world of a scene for the truths, in float64, written independently of ``shade``."""

import numpy as np

from ..scene import Scene
from .rays import rigid

# Radiance of a white Lambert surface that faces a light of energy 1 at distance 1, as in Cycles.
RADIANCE = {"SUN": 1.0 / np.pi, "POINT": 0.25 / np.pi**2, "SPOT": 0.25 / np.pi**2, "AREA": 1.0 / np.pi**2}
HARDEST_EDGE = 1e-4  # of a spot's cone, in cosines


class ReferenceLamps:
    """What shines in a scene, before anything blocks it."""

    def __init__(self, scene: Scene):
        self._scene = scene
        camera = rigid(scene.camera.matrix_world)
        self._towards_camera = camera[:3, 2]
        self._eye = camera[:3, 3] if scene.camera.type == "PERSP" else None
        self._half_voxel = 0.5 * np.cbrt(abs(np.linalg.det(scene.index_to_world[:3, :3])))

    def to_eye(self, at) -> np.ndarray:
        """Unit vectors from world points (N, 3) to the eye, (N, 3) or one (3,) for all."""
        return self._towards_camera if self._eye is None else unit(self._eye - at)

    def world(self, outward):
        """(N, 3) radiance of a white Lambert surface under the world, not below 0, for (N, 3) normals.

        Of an environment from the harmonics as such, to which those of order 0, 1, 2 of its light are pi, 2 pi / 3 and
        pi / 4 times those of its radiance (Ramamoorthi and Hanrahan 2001, equation 8), over pi.  Shorter normals see
        less of how the world differs by direction.
        """
        mean = np.zeros(3) if self._scene.world is None else np.array(self._scene.world)
        if self._scene.environment is None:
            return np.broadcast_to(mean, outward.shape)
        first, second = self._scene.environment.first, self._scene.environment.second
        x, y, z = outward.T
        c1, c2, c3, c4 = np.sqrt(np.array((3.0, 15.0, 5.0, 15.0)) / np.pi) / (2.0, 2.0, 4.0, 4.0)
        # Harmonics of a direction, and coefficients of the radiance: 4 pi times the mean of radiance times harmonic.
        harmonics = np.stack((
            c1 * y, c1 * z, c1 * x, c2 * x * y, c2 * y * z, c3 * (2 * z * z - x * x - y * y), c2 * x * z,
            c4 * (x * x - y * y),
        ))  # fmt: skip
        xx, yy, zz = second[0, 0], second[1, 1], second[2, 2]
        coefficients = 4.0 * np.pi * np.stack((
            c1 * first[1], c1 * first[2], c1 * first[0], c2 * second[0, 1], c2 * second[1, 2], c3 * 3.0 * zz,
            c2 * second[0, 2], c4 * (xx - yy),
        ))  # fmt: skip
        weights = np.array([2.0 / 3.0] * 3 + [0.25] * 5)
        return np.maximum(mean + np.einsum("hn,h,hc->nc", harmonics, weights, coefficients), 0.0)

    def lights(self, at):
        """For each light: unit vectors towards it and its strength I, both (N, 3) or broadcasting to it."""
        for light in self._scene.lights:
            axis = -unit(light.matrix_world[:3, 2])
            strength = RADIANCE[light.type] * light.energy * np.array(light.color)
            if light.type == "SUN":
                yield -axis, strength
                continue
            away = light.matrix_world[:3, 3] - at
            towards = unit(away)
            nearest = max(_nearest(light), self._half_voxel**2)
            strength = strength / np.maximum((away**2).sum(axis=1, keepdims=True), nearest)
            on_axis = -(towards * axis).sum(axis=1, keepdims=True)
            if light.type == "AREA":
                strength = strength * np.maximum(on_axis, 0.0)
            elif light.type == "SPOT":
                cone = np.cos(0.5 * min(light.spot_size, np.pi))
                inside = np.clip((on_axis - cone) / max((1.0 - cone) * light.spot_blend, HARDEST_EDGE), 0.0, 1.0)
                strength = strength * inside**2 * (3.0 - 2.0 * inside)
            yield towards, strength
        if self._scene.headlight:
            yield self._towards_camera, np.ones(3)


def _nearest(light) -> float:
    """The squared distance within which a light grows no stronger, because it fills the surface's hemisphere."""
    if light.type != "AREA":
        return light.radius**2
    width, height = np.linalg.norm(light.matrix_world[:3, :2], axis=0)
    tall = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    area = width * light.size * height * tall * (np.pi / 4.0 if light.shape in ("DISK", "ELLIPSE") else 1.0)
    return area / np.pi


def unit(vector) -> np.ndarray:
    """Vectors (..., 3) scaled to length one; zero vectors are kept."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0.0, length, 1.0)
