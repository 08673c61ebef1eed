"""Light on voxels for the truths: the shading formula in float64, written independently of ``shade``.

Each voxel is lit by its own normal.  The light is interpolated between voxels, not the normal; both truths are defined
so (algorithm.md 1.14).  The normals are those of the volume.  Only voxels next to rays are lit.

The truths have no shadows and no ambient occlusion, which would take a ray from each voxel to each light.  So pictures
with shadows have no tolerance and no measured error; shadows have truths of their own (tests/truths/test_shadows.py).
"""

from __future__ import annotations

import numpy as np

from ..scene import RleSplatError, Scene
from .normals import normals_at
from .rays import rigid
from .transfer import extinction_and_color

# Radiance of a white Lambert surface that faces a light of energy 1 at distance 1, as in Cycles.
RADIANCE = {"SUN": 1.0 / np.pi, "POINT": 0.25 / np.pi**2, "SPOT": 0.25 / np.pi**2, "AREA": 1.0 / np.pi**2}
HARDEST_EDGE = 1e-4  # of a spot's cone, in cosines


def shading_of(scene: Scene, truth_name: str) -> dict:
    """Make the shading arguments of ``truths.truth`` for a scene.

    Returns
    -------
    dict
        ``colors`` for T1; ``light`` and, where there are highlights, ``highlight`` for T2.  Empty where the transfer
        function does not shade or the scene has no light.

    Raises
    ------
    RleSplatError
        For a scene with shadows or ambient occlusion, which the truths do not have.
    """
    if scene.transfer_function.shade is None or not (scene.lights or scene.headlight or scene.world):
        return {}
    if scene.ambient_occlusion or (scene.volume_shadows and any(light.casts_shadow for light in scene.lights)):
        raise RleSplatError("The truths have no shadows: turn off shadows and ambient occlusion to measure an error.")
    lit = ReferenceLight(scene)
    if truth_name == "T1":
        return {"colors": _ByIndex(lit.color)}
    shading = {"light": _ByIndex(lambda indices: lit.light(indices)[0])}
    if scene.transfer_function.shade.specular > 0.0:
        shading["highlight"] = _ByIndex(lambda indices: lit.light(indices)[1])
    return shading


class _ByIndex:
    """A function of index arrays, with the subscript of an array."""

    def __init__(self, function):
        self._function = function

    def __getitem__(self, indices):
        return self._function(indices)


class ReferenceLight:
    """The light on the voxels of a scene: shaded color = c * light + highlight.

    Arguments called ``indices`` are index arrays (z, y, x) that broadcast to any shape.

    Notes
    -----
    light = ambient + diffuse world + sum diffuse |n.l| I and highlight = sum specular |n.h|^shininess I over the
    lights; 1 and 0 where there is no normal.  For Phong's highlight, |n.h| is replaced by the cosine between the eye
    and the direction of the light mirrored at the surface.  With one-sided shading a light counts where the surface
    faces it; the scalar falls towards the outside of a surface.  The world counts on that side alone.
    """

    def __init__(self, scene: Scene):
        self._scene, self._matrix = scene, scene.index_to_world
        camera = rigid(scene.camera.matrix_world)
        self._towards_camera = camera[:3, 2]
        self._eye = camera[:3, 3] if scene.camera.type == "PERSP" else None
        self._half_voxel = 0.5 * np.cbrt(abs(np.linalg.det(self._matrix[:3, :3])))
        self._last = (None, None)

    def light(self, indices) -> tuple[np.ndarray, np.ndarray]:
        """(..., 3) light and (..., 3) highlight."""
        if self._last[0] is not indices:  # light and highlight of the same voxels are looked up one after the other
            self._last = (indices, self._lit(indices))
        return self._last[1]

    def color(self, indices) -> np.ndarray:
        """(..., 3) shaded colors of the transfer function."""
        volume = self._scene.volume
        own = extinction_and_color(self._scene.transfer_function, volume.physical(volume.voxels[indices]), 1.0)[1]
        light, highlight = self.light(indices)
        return own * light + highlight

    def _lit(self, indices):
        """(..., 3) light and highlight; each voxel is lit once."""
        indices = np.broadcast_arrays(*indices)
        shape = self._scene.volume.voxels.shape
        one, back = np.unique(np.ravel_multi_index(indices, shape), return_inverse=True)
        light, highlight = self._shine(*np.unravel_index(one, shape))
        back = back.reshape(indices[0].shape)
        return light[back], highlight[back]

    def _shine(self, z, y, x):
        """(N, 3) light and highlight of voxels in the order of the volume."""
        scene, shade = self._scene, self._scene.transfer_function.shade
        normal = normals_at(scene.volume, (z, y, x), self._matrix)
        # No products of matrices here, for the reason given in ``integrate``.
        at = np.einsum("in,ji->nj", (x, y, z), self._matrix[:3, :3]) + self._matrix[:3, 3]
        to_eye = self._towards_camera if self._eye is None else _unit(self._eye - at)
        light, highlight = shade.ambient + shade.diffuse * self._world(-normal), np.zeros((len(x), 3))
        for towards, strength in self._lights(at):
            outward = -(normal * towards).sum(axis=1, keepdims=True)
            if not shade.two_sided:
                strength = np.where(outward > 0.0, strength, 0.0)
            light += shade.diffuse * np.abs(outward) * strength
            if shade.highlight == "phong":
                mirrored = (-2.0 * outward) * normal - towards  # twice the part along the normal, less the whole
                facing = np.clip((mirrored * to_eye).sum(axis=1, keepdims=True), 0.0, None)
            else:
                facing = np.abs((normal * _unit(towards + to_eye)).sum(axis=1, keepdims=True))
            highlight += shade.specular * facing**shade.shininess * strength
        flat = ~normal.any(axis=1)
        light[flat], highlight[flat] = 1.0, 0.0
        return light, highlight

    def _world(self, outward):
        """(N, 3) radiance of a white Lambert surface under the world, not below 0, for (N, 3) unit normals.

        Of an environment from the harmonics as such, to which those of order 0, 1, 2 of its light are pi, 2 pi / 3 and
        pi / 4 times those of its radiance (Ramamoorthi and Hanrahan 2001, equation 8), over pi.
        """
        mean = np.zeros(3) if self._scene.world is None else np.array(self._scene.world)
        if self._scene.environment is None:
            return np.broadcast_to(mean, outward.shape)
        first, second = self._scene.environment.first, self._scene.environment.second
        x, y, z = outward.T
        c1, c2, c3, c4 = np.sqrt(np.array((3.0, 15.0, 5.0, 15.0)) / np.pi) / (2.0, 2.0, 4.0, 4.0)
        # Harmonics of a direction, and coefficients of the radiance: 4 pi times the mean of radiance times harmonic.
        harmonics = np.stack(
            (c1 * y, c1 * z, c1 * x, c2 * x * y, c2 * y * z, c3 * (3 * z * z - 1), c2 * x * z, c4 * (x * x - y * y))
        )
        squares = second[0, 0], second[1, 1], second[2, 2]
        coefficients = (
            4.0
            * np.pi
            * np.stack(
                (
                    c1 * first[1],
                    c1 * first[2],
                    c1 * first[0],
                    c2 * second[0, 1],
                    c2 * second[1, 2],
                    c3 * 3.0 * squares[2],
                    c2 * second[0, 2],
                    c4 * (squares[0] - squares[1]),
                )
            )
        )
        weights = np.array([2.0 / 3.0] * 3 + [0.25] * 5)
        return np.maximum(mean + np.einsum("hn,h,hc->nc", harmonics, weights, coefficients), 0.0)

    def _lights(self, at):
        """For each light: unit vectors towards it and its strength I, both (N, 3) or broadcasting to it."""
        for light in self._scene.lights:
            axis = -_unit(light.matrix_world[:3, 2])
            strength = RADIANCE[light.type] * light.energy * np.array(light.color)
            if light.type == "SUN":
                yield -axis, strength
                continue
            away = light.matrix_world[:3, 3] - at
            towards = _unit(away)
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


def _unit(vector) -> np.ndarray:
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(length > 0.0, length, 1.0)
