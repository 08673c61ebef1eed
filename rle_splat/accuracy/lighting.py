"""Light on voxels for the truth T1: the paper's shading formula in float64, written independently of ``shade``.

Each voxel is lit by its own normal, and its color is interpolated (algorithm.md 1.14).  The normals are those of the
volume.  Only voxels next to rays are lit.  T1 has no shadows and no ambient occlusion; the light of T2, which has them,
is in ``light_model``.
"""

import numpy as np

from ..scene import RleSplatError, Scene
from .lamps import ReferenceLamps, unit
from .light_model import PostLight
from .normals import normals_at
from .transfer import extinction_and_color, world_opacity_distance


def shading_of(scene: Scene, truth_name: str) -> dict:
    """Make the shading arguments of ``truths.truth`` for a scene.

    Returns
    -------
    dict
        ``colors`` for T1, ``light`` for T2.  Empty where the transfer function does not shade or the scene has no
        light, and in an X-ray.

    Raises
    ------
    RleSplatError
        For T1 of a scene with shadows or ambient occlusion, which it does not have.
    """
    unlit = scene.transfer_function.shade is None or scene.mode == "xray"
    if unlit or not scene.shines:
        return {}
    if truth_name == "T2":
        return {"light": PostLight(scene, world_opacity_distance(scene))}
    if scene.ambient_occlusion or (scene.volume_shadows and any(light.casts_shadow for light in scene.lights)):
        raise RleSplatError(
            "The reference of the classification pre has no shadows: turn off shadows and ambient occlusion, or choose "
            "the classification post, to measure an error."
        )
    return {"colors": _ByIndex(ReferenceLight(scene).color)}


class _ByIndex:
    """A function of index arrays, with the subscript of an array."""

    def __init__(self, function):
        self._function = function

    def __getitem__(self, indices):
        return self._function(indices)


class ReferenceLight:
    """The light on the voxels of a scene: shaded color = c * light + highlight.

    Arguments called ``indices`` are index arrays (z, y, x) that broadcast to any shape.

    light = ambient + diffuse world + sum diffuse |n.l| I and highlight = sum specular |n.h|^shininess I over the
    lights; 1 and 0 where there is no normal.  With one-sided shading a light counts where the surface faces it; the
    scalar falls towards the outside of a surface.  The world counts on that side alone.
    """

    def __init__(self, scene: Scene):
        self._scene, self._matrix, self._lamps = scene, scene.index_to_world, ReferenceLamps(scene)

    def light(self, indices) -> tuple[np.ndarray, np.ndarray]:
        """(..., 3) light and (..., 3) highlight; each voxel is lit once."""
        indices = np.broadcast_arrays(*indices)
        shape = self._scene.volume.voxels.shape
        one, back = np.unique(np.ravel_multi_index(indices, shape), return_inverse=True)
        light, highlight = self._shine(*np.unravel_index(one, shape))
        back = back.reshape(indices[0].shape)
        return light[back], highlight[back]

    def color(self, indices) -> np.ndarray:
        """(..., 3) shaded colors of the transfer function."""
        volume = self._scene.volume
        own = extinction_and_color(self._scene.transfer_function, volume.physical(volume.voxels[indices]), 1.0)[1]
        light, highlight = self.light(indices)
        return own * light + highlight

    def _shine(self, z, y, x):
        """(N, 3) light and highlight of voxels in the order of the volume."""
        scene, shade = self._scene, self._scene.transfer_function.shade
        normal = normals_at(scene.volume, (z, y, x), self._matrix)
        # No products of matrices here, for the reason given in ``integrate``.
        at = np.einsum("in,ji->nj", (x, y, z), self._matrix[:3, :3]) + self._matrix[:3, 3]
        to_eye = self._lamps.to_eye(at)
        light, highlight = shade.ambient + shade.diffuse * self._lamps.world(-normal), np.zeros((len(x), 3))
        for towards, strength in self._lamps.lights(at):
            outward = -(normal * towards).sum(axis=1, keepdims=True)
            if not shade.two_sided:
                strength = np.where(outward > 0.0, strength, 0.0)
            light += shade.diffuse * np.abs(outward) * strength
            facing = np.abs((normal * unit(towards + to_eye)).sum(axis=1, keepdims=True))
            highlight += shade.specular * facing**shade.shininess * strength
        flat = ~normal.any(axis=1)
        light[flat], highlight[flat] = 1.0, 0.0
        return light, highlight
