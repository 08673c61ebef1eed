"""Scenes and the quality of their pictures, for hypothesis to draw: what a search of edits begins with.

Most edits of such a scene can be seen: a few voxels fill the picture, none of them too thin, under lights about as
bright as the sun.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from hypothesis import strategies as st

from rle_splat.classify.transfer_function import GradientOpacity, Shade, TransferFunction
from rle_splat.scene import LIGHT_TYPES, Light, Quality, Scene
from rle_splat.volume.volume import Volume
from tests.stability.effect_strategies import reach_of
from tests.stability.strategies import FIELDS, SEEDS, affines, cameras, field_of, rotation, stored, value_range

WIDTH, HEIGHT, MOST_VOXELS = 24, 20, 12
# Integers have a table of values, floats have none, and doubles are kept as singles. Each stored type of scalar needs
# its own variants of the sheet loop compiled. So int16, which has the stages of uint8, is left to the other searches.
DTYPES = ("uint8", "float32", "float64")
# Evenly spread, where hypothesis' own floats are mostly ends: of black nothing is to be seen.
UNIT = st.sampled_from([number / 10 for number in range(11)])
COLORS = st.tuples(*[st.sampled_from((0.2, 0.4, 0.6, 0.8, 1.0))] * 3)


@dataclass(frozen=True, eq=False)
class Shot:
    """A scene and the quality of its picture."""

    scene: Scene
    quality: Quality

    def with_scene(self, **changes) -> Shot:
        return replace(self, scene=replace(self.scene, **changes))

    def with_quality(self, **changes) -> Shot:
        return replace(self, quality=replace(self.quality, **changes))

    def with_function(self, **changes) -> Shot:
        return self.with_scene(transfer_function=replace(self.scene.transfer_function, **changes))

    def with_camera(self, **changes) -> Shot:
        return self.with_scene(camera=replace(self.scene.camera, **changes))


def drawn_volume(draw, shape, affine) -> Volume:
    """Any field in one of DTYPES; NaN and infinities among floats at times."""
    random = np.random.default_rng(draw(SEEDS))
    voxels = stored(field_of(draw(st.sampled_from(FIELDS)), shape, random), draw(st.sampled_from(DTYPES)))
    if voxels.dtype.kind == "f" and draw(st.integers(0, 3)) == 0:
        voxels[random.random(shape) < 0.05] = draw(st.sampled_from((np.nan, np.inf, -np.inf)))
    slope, intercept = draw(st.sampled_from(((1.0, 0.0), (-2.5, 0.125), (0.37, -11.0))))
    return Volume(voxels, affine, slope=slope, intercept=intercept)


def drawn_function(draw, volume: Volume) -> TransferFunction:
    """Opacities and colors over the values that there are, thick enough to be seen; shaded more often than not."""
    low, high = value_range(volume)

    def at(share):
        return low + share * (high - low)

    most, first = draw(st.sampled_from((0.2, 0.6, 1.0))), 0.6 * draw(UNIT)
    opacity = draw(st.sampled_from((
        ((at(first), 0.0), (at(1.0), most)),
        ((at(first), 0.0), (at(first), most)),
        ((at(first - 0.1), 0.0), (at(first), most), (at(first + 0.2), 0.0), (at(1.0), 0.5 * most)),
    )))  # fmt: skip
    shade = draw(st.sampled_from((Shade(), Shade(0.2, 0.8, 0.0), Shade(0.1, 0.6, 0.5, 5.0), None)))
    colors = (at(0.0), *draw(COLORS)), (at(1.0), *draw(COLORS))
    gradients = drawn_gradients(draw, volume) if draw(st.booleans()) else None
    return TransferFunction("drawn", None, opacity, colors, drawn_distance(draw, volume), shade, gradients)


def drawn_distance(draw, volume: Volume) -> float | None:
    """A length that opacities may refer to: of a few voxels; None for what the volume's spacing makes of it."""
    return None if draw(st.integers(0, 3)) == 0 else (1.0 + 2.0 * draw(UNIT)) * float(volume.spacing.min())


def drawn_gradients(draw, volume: Volume) -> GradientOpacity:
    low, high = value_range(volume)
    steepest = 0.5 * (high - low) / float(volume.spacing.min())
    return GradientOpacity(*sorted((0.3 * steepest * draw(UNIT), steepest * draw(UNIT))))


def drawn_light(draw, scene: Scene) -> Light:
    """About as bright on the volume as it is white, from beside it."""
    random = np.random.default_rng(draw(SEEDS))
    middle, reach = reach_of(scene)
    kind, away = draw(st.sampled_from(LIGHT_TYPES)), 1.5 * reach
    pose = np.eye(4)
    pose[:3, :3] = rotation(random)
    pose[:3, 3] = middle + away * pose[:3, 2]  # it shines along its -Z
    energy = math.pi if kind == "SUN" else 4.0 * math.pi**2 * away**2
    return Light(
        kind, draw(COLORS), energy, pose, radius=0.1 * reach, angle=0.1, size=0.5 * reach, size_y=0.3 * reach,
        casts_shadow=draw(st.integers(0, 3)) > 0,
    )  # fmt: skip


@st.composite
def shots(draw, kind: str) -> Shot:
    """A scene with lights at times, seen by any camera.  ``kind``: a classification."""
    shape = draw(st.tuples(*[st.integers(4, MOST_VOXELS)] * 3))
    volume = drawn_volume(draw, shape, draw(affines(2.0, 0.3)))
    tf = drawn_function(draw, volume)
    camera = drawn_camera(draw, volume.affine, volume.shape_xyz)
    scene = Scene(volume, tf, camera, WIDTH, HEIGHT, headlight=draw(st.booleans()))
    lights = tuple(drawn_light(draw, scene) for _ in range(draw(st.sampled_from((0, 1, 1, 2)))))
    hidden = draw(st.sampled_from((0.0, 0.0, 0.7)))
    scene = replace(scene, lights=lights, volume_shadows=draw(st.booleans()), ambient_occlusion=hidden)
    name = draw(st.sampled_from(("draft", "standard", "fine")))
    return Shot(scene, Quality.preset(name, kind, threads=1))


def drawn_camera(draw, index_to_world, shape_xyz):
    clipped = st.sampled_from((None, None, None, "start", "end"))
    return draw(cameras(index_to_world, shape_xyz, widest=100.0, shift=0.2, framed=True, clipped=clipped))


def further_off(shot: Shot, times: float) -> Shot:
    """The volume so many times smaller in the picture."""
    camera = shot.scene.camera
    return shot.with_camera(lens=camera.lens / times, ortho_scale=camera.ortho_scale * times)
