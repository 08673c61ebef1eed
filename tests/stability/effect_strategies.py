"""Hypothesis strategies for the effects of a scene: any number of them at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from rle_splat.classify.transfer_function import GradientOpacity
from rle_splat.scene import CLIP_KINDS, LIGHT_TYPES, MIST_FALLOFFS, MODES, Channel, Clip, Labels, Light, Mist, Pose
from rle_splat.scene.checks import LARGEST_SHARE
from rle_splat.scene.clip import CLIP_SIDES
from rle_splat.volume.volume import Volume
from tests.stability.strategies import (
    FIELDS,
    SEEDS,
    UNIT,
    field_of,
    rotation,
    scenes,
    stored,
    transfer_functions,
    value_range,
)

# Effects that render several pictures and take their mean.
BLURS = ("depth of field", "motion blur")


def reach_of(scene) -> tuple[np.ndarray, float]:
    """The middle of the volume in the world, and how far its corners are from it."""
    counts = np.array(scene.volume.shape_xyz, np.float64)
    corners = np.array([counts * c - 0.5 for c in np.ndindex(2, 2, 2)])
    corners = corners @ scene.index_to_world[:3, :3].T + scene.index_to_world[:3, 3]
    middle = corners.mean(axis=0)
    return middle, float(np.linalg.norm(corners - middle, axis=1).max())


def pose_near(scene, random, size: float = 1.0) -> np.ndarray:
    """(4, 4): turned anyhow, somewhere about the volume, ``size`` of its reach as the unit."""
    middle, reach = reach_of(scene)
    pose = np.eye(4)
    pose[:3, :3] = rotation(random) * size * reach
    pose[:3, 3] = middle + random.uniform(-1.0, 1.0, 3) * reach
    return pose


def color(draw) -> tuple:
    return tuple(draw(UNIT) for _ in range(3))


def with_mode(draw, scene, random):
    return replace(scene, mode=draw(st.sampled_from([mode for mode in MODES if mode != "composite"])))


def with_gradient_opacity(draw, scene, random):
    low, high = value_range(scene.volume)
    steepest = (high - low) / float(scene.volume.spacing.min())
    ends = sorted((steepest * draw(UNIT), steepest * draw(UNIT)))
    function = replace(scene.transfer_function, gradient_opacity=GradientOpacity(*ends))
    return replace(scene, transfer_function=function)


def with_lights(draw, scene, random):
    _, reach = reach_of(scene)
    lights = tuple(
        Light(
            kind, color(draw), draw(st.sampled_from((0.1, 3.0, 1e4))), pose_near(scene, random), radius=0.1 * reach,
            angle=0.1, size=reach, size_y=0.5 * reach, casts_shadow=draw(st.booleans()),
        )
        for kind in draw(st.lists(st.sampled_from(LIGHT_TYPES), min_size=1, max_size=2))
    )  # fmt: skip
    return replace(scene, lights=lights)


def with_shadows(draw, scene, random):
    return replace(with_lights(draw, scene, random), volume_shadows=True)


def with_world(draw, scene, random):
    return replace(scene, world=color(draw))


def with_occlusion(draw, scene, random):
    return replace(with_world(draw, scene, random), ambient_occlusion=draw(st.sampled_from((0.5, 1.0))))


def with_indirect_light(draw, scene, random):
    return replace(with_shadows(draw, scene, random), indirect_light=draw(st.sampled_from((0.5, 1.0))))


def with_meshes(draw, scene, random):
    middle, reach = reach_of(scene)
    corners = middle + reach * random.uniform(-1.5, 1.5, (draw(st.integers(1, 3)), 3, 3))
    return replace(scene, triangles=corners)


def with_clips(draw, scene, random):
    clips = tuple(
        Clip(kind, pose_near(scene, random, draw(st.floats(0.2, 1.0))), draw(st.sampled_from(CLIP_SIDES)))
        for kind in draw(st.lists(st.sampled_from(CLIP_KINDS), min_size=1, max_size=3))
    )
    return replace(scene, clips=clips)


def with_mist(draw, scene, random):
    _, reach = reach_of(scene)
    falloff = draw(st.sampled_from(MIST_FALLOFFS))
    return replace(scene, mist=Mist(reach * draw(UNIT), reach * (0.01 + draw(UNIT)), falloff, color(draw)))


def with_labels(draw, scene, random):
    shape = scene.volume.voxels.shape
    labels = Volume(random.integers(0, 3, shape).astype(np.uint8), scene.volume.affine)
    tf = draw(transfer_functions(*value_range(scene.volume), float(scene.volume.spacing.min())))
    return replace(scene, labels=Labels(labels, {1: tf, 2: None}))


def with_channels(draw, scene, random):
    field = field_of(draw(st.sampled_from(FIELDS)), scene.volume.voxels.shape, random)
    volume = Volume(stored(field, "uint8"), scene.volume.affine)
    tf = draw(transfer_functions(*value_range(volume), float(volume.spacing.min())))
    return replace(scene, channels=(Channel(volume, tf),))


def with_lens(draw, scene, random):
    _, reach = reach_of(scene)
    camera = replace(
        scene.camera, aperture_radius=min(0.05 * reach, LARGEST_SHARE), focus_distance=reach * (0.1 + draw(UNIT)),
        aperture_blades=draw(st.sampled_from((0, 5))),
    )  # fmt: skip
    return replace(scene, camera=camera)


def with_motion(draw, scene, random):
    _, reach = reach_of(scene)
    poses = []
    for time in (0.0, 1.0):
        moved = scene.volume_matrix.copy()
        moved[:3, 3] += time * 0.2 * reach * random.standard_normal(3)
        poses.append(Pose(scene.camera.matrix_world, moved))
    return replace(scene, motion=tuple(poses))


# Effects by the names that people know them by; what an effect rests on comes with it.
GIVEN = {
    "mode": with_mode, "gradient opacity": with_gradient_opacity, "lights": with_lights, "shadows": with_shadows,
    "world light": with_world, "ambient occlusion": with_occlusion, "indirect light": with_indirect_light,
    "mesh occlusion": with_meshes,
    "clip objects": with_clips, "mist": with_mist, "labels": with_labels, "channels": with_channels,
    "depth of field": with_lens, "motion blur": with_motion,
}  # fmt: skip
RESTS_ON = {"shadows": ("lights",), "indirect light": ("shadows", "lights"), "ambient occlusion": ("world light",)}


@st.composite
def scenes_with_effects(draw):
    """(scene, the same without its effects, their names): one to five of them, in any order."""
    names = draw(st.lists(st.sampled_from(sorted(GIVEN)), min_size=1, max_size=5, unique=True))
    most_pixels = 8 if set(names) & set(BLURS) else 20
    plain = replace(draw(scenes(most_pixels)), lights=())
    random, scene = np.random.default_rng(draw(SEEDS)), plain
    for name in names:
        scene = GIVEN[name](draw, scene, random)
    return scene, plain, tuple(dict.fromkeys(each for name in names for each in (name, *RESTS_ON.get(name, ()))))
