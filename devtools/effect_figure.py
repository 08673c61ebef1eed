"""Pairs of pictures without and with an effect, for how-to-effects.jpg of the guide on light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import rle_splat as rs
from benchmarks.scenes import smoke
from rle_splat.scene.display import to_bytes

SIDE, FINER = 300, 2  # pixels, and pixels rendered along each side of one
DIM, NIGHT, WHITE = (0.12, 0.12, 0.14), (0.02, 0.02, 0.02), (1.0, 1.0, 1.0)  # worlds
OPENED = (0.0, 8.0, 30.0)  # mm: from the skull's middle to a plane that cuts off its top
LOW, ASIDE = (-0.8, -0.3, 1.1), (-1.0, 0.2, 0.5)  # directions of suns
PLUME, DENSE = (112, 120, 176), 0.35  # voxels of smoke, and of them for an opacity
APERTURE, FOCUS = 5.0, 55.0  # mm: radius of the lens, and how far before the brain's middle it is sharp
PALE, MATTE = ((0.0, 0.9, 0.9, 0.92), (1.0, 0.95, 0.95, 0.95)), rs.Shade(ambient=0.0, diffuse=1.0, specular=0.0)
LEFT = (-0.9, 0.9, 0.5)  # of a camera: from its left and above


def make(brain: Path, skull: Path, bone: Path) -> dict[str, Image.Image]:
    """The pictures by their captions, of two scans, and the transfer function of the skull."""
    folds = _scene(brain, azimuth=40, elevation=18, fit=0.95)
    white = replace(folds, world=WHITE)
    plume = _scene_of(smoke(PLUME), rs.preset("smoke"), azimuth=20, elevation=8, fit=1.0)
    function = replace(plume.transfer_function, opacity_unit_distance=DENSE, color=PALE, shade=MATTE)
    plume = replace(
        plume, transfer_function=function, lights=(_sun(plume, ASIDE, 5.0),), world=NIGHT, volume_shadows=True
    )
    bones = _scene(skull, bone, azimuth=25, elevation=42, fit=0.9)
    lower = replace(bones.camera, shift_y=-0.06)
    bones = replace(bones, camera=lower, labels=rs.body_labels(bones.volume, bones.transfer_function))
    middle = rs.turntable_aim(bones.volume, bones.volume_matrix)
    top = rs.Clip(kind="plane", matrix_world=rs.look_at(middle + OPENED, middle))
    opened = replace(bones, clips=(top,), lights=(_sun(bones, LOW, 3.5),), world=DIM, ambient_occlusion=0.7)
    camera, _ = rs.turntable(folds.volume, azimuth=25, elevation=35, fit=1.1, perspective=True, fov=60)
    near = replace(
        folds, camera=camera, world=(0.2, 0.2, 0.22), lights=(_sun(folds, camera.matrix_world[:3, :3] @ LEFT, 4.0),),
        volume_shadows=True, ambient_occlusion=0.8,
    )  # fmt: skip
    distance = np.linalg.norm(camera.matrix_world[:3, 3] - rs.turntable_aim(folds.volume, folds.volume_matrix))
    lens = replace(camera, aperture_radius=APERTURE, focus_distance=float(distance) - FOCUS)
    scenes = {
        "Shadows off": opened, "Shadows on": replace(opened, volume_shadows=True), "Ambient Occlusion 0": white,
        "Ambient Occlusion 1": replace(white, ambient_occlusion=1.0), "Scattering 0": plume,
        "Scattering 0.9": replace(plume, indirect_light=0.9), "Depth of Field off": near,
        "Depth of Field on": replace(near, camera=lens),
    }  # fmt: skip
    return {caption: _picture(scene) for caption, scene in scenes.items()}


def _scene(scan, function=None, **view) -> rs.Scene:
    """A scan without lights, in a view of the turntable, by its own transfer function or that of a file."""
    volume = rs.read_volume(scan)
    chosen = rs.default_transfer_function(volume)[0] if function is None else rs.TransferFunction.from_json(function)
    return _scene_of(volume, chosen, **view)


def _scene_of(volume: rs.Volume, chosen: rs.TransferFunction, **view) -> rs.Scene:
    camera, matrix = rs.turntable(volume, **view)
    return rs.Scene(volume, chosen, camera, FINER * SIDE, FINER * SIDE, volume_matrix=matrix, headlight=False)


def _sun(scene: rs.Scene, direction, energy: float) -> rs.Light:
    middle = rs.turntable_aim(scene.volume, scene.volume_matrix)
    return rs.Light(matrix_world=rs.look_at(middle + direction, middle), energy=energy)


def _picture(scene: rs.Scene) -> Image.Image:
    rgba = rs.render(scene, rs.Quality.preset("fine")).rgba.reshape(SIDE, FINER, SIDE, FINER, 4).mean(axis=(1, 3))
    return Image.fromarray(to_bytes(rgba), "RGBA")
