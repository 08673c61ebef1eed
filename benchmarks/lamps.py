"""The lamps under which light is measured."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rle_splat.scene import Light, Scene
from rle_splat.view.look_at import look_at


def shining(along) -> np.ndarray:
    """(4, 4) matrix of a light that shines along a direction."""
    return look_at((0.0, 0.0, 0.0), along)


def _sun(along, energy: float, color=(1.0, 1.0, 1.0)) -> Light:
    return Light("SUN", color=color, energy=energy, matrix_world=shining(along))


# Seen by a turntable's camera at an azimuth of 30 degrees: from the left, above.
SUN = (_sun((-0.501, 0.602, -0.622), 3.0),)
# A key, a fill and a rim.
THREE = (
    _sun((-0.609, 0.609, -0.508), 2.4),
    _sun((0.843, 0.527, -0.105), 0.8, (0.6, 0.75, 1.0)),
    _sun((0.199, -0.896, -0.398), 1.2, (1.0, 0.85, 0.7)),
)


def area_lamp(scene: Scene) -> Light:
    """A square lamp half as long a side as the volume, from where SUN comes, as bright as it: wide penumbrae."""
    ends = [[0.0, count - 1.0] for count in scene.volume.shape_xyz]
    corners = scene.index_to_world @ np.vstack((np.stack(np.meshgrid(*ends)).reshape(3, 8), np.ones(8)))
    middle, reach = corners[:3].mean(axis=1), np.ptp(corners[:3], axis=1).max()
    matrix = SUN[0].matrix_world.copy()
    matrix[:3, 3] = middle + 1.5 * reach * matrix[:3, 2]
    energy = SUN[0].energy * math.pi * (1.5 * reach) ** 2
    return Light("AREA", energy=energy, matrix_world=matrix, size=0.5 * reach)


# Name -> fields of a Scene; lamps whose place depends on it are made by a function.
LIGHTS = {
    "headlight": dict(lights=(), headlight=True),
    "sun": dict(lights=SUN, headlight=False, volume_shadows=True),
    "three lamps": dict(lights=THREE, headlight=False, volume_shadows=True),
    "sun, occlusion": dict(lights=SUN, headlight=False, volume_shadows=True, ambient_occlusion=0.7),
    "sun, octaves": dict(lights=SUN, headlight=False, volume_shadows=True, indirect_light=0.6),
    "area lamp": dict(lights=area_lamp, headlight=False, volume_shadows=True),
}


def under(scene: Scene, name: str) -> Scene:
    """The scene under lamps of LIGHTS in place of its own."""
    fields = dict(LIGHTS[name])
    if callable(fields["lights"]):
        fields["lights"] = (fields["lights"](scene),)
    return replace(scene, **fields)
