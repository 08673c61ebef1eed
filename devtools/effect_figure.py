"""how-to-effects.jpg: pairs of pictures without and with an effect, for the guide on light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import rle_splat as rs

STYLE = rs.FigureStyle(
    width_cm=20.0, dpi=150.0, columns=4, background="black", caption="", scale_bar="off", sides="off", color_bar=False,
    font_size=9.0,
)  # fmt: skip
DIM, NIGHT = (0.15, 0.15, 0.18), (0.03, 0.03, 0.04)
CLEAR, ASIDE = 4.0, (1.0, 1.0, 0.3)  # mm of tissue for an opacity; the direction of a sun
APERTURE, FOCUS = 9.0, 85.0  # mm: radius of the lens, and how far before the skull's middle it is sharp


def make(brain: Path, skull: Path, bone: Path) -> rs.MadeFigure:
    """The figure, of two scans, and the transfer function of the skull."""
    folds = _scene(brain, azimuth=40, elevation=18, fit=1.0)
    lit = replace(folds, lights=(_sun(folds, (1.0, -0.4, 1.4), 3.2),), world=DIM)
    white = replace(folds, world=(1.0, 1.0, 1.0))
    shade = replace(folds.transfer_function.shade, ambient=0.02)
    clear = replace(folds.transfer_function, opacity_unit_distance=CLEAR, shade=shade)
    aside = replace(folds, transfer_function=clear, lights=(_sun(folds, ASIDE, 6.0),), world=NIGHT, volume_shadows=True)
    bones = _scene(skull, bone, azimuth=28, elevation=22, fit=1.0, perspective=True, fov=52)
    bones = replace(
        bones, labels=rs.body_labels(bones.volume, bones.transfer_function), world=(0.2, 0.2, 0.22),
        lights=(_sun(bones, (0.2, -1.0, 1.2), 3.0),), volume_shadows=True, ambient_occlusion=0.8,
    )  # fmt: skip
    distance = np.linalg.norm(bones.camera.matrix_world[:3, 3] - rs.turntable_aim(bones.volume, bones.volume_matrix))
    lens = replace(bones.camera, aperture_radius=APERTURE, focus_distance=float(distance) - FOCUS)
    panels = {
        "Shadows off": lit, "Shadows on": replace(lit, volume_shadows=True), "Ambient Occlusion 0": white,
        "Ambient Occlusion 1": replace(white, ambient_occlusion=1.0), "Scattering 0": aside,
        "Scattering 0.9": replace(aside, indirect_light=0.9), "Depth of Field off": bones,
        "Depth of Field on": replace(bones, camera=lens),
    }  # fmt: skip
    return rs.make_figure(panels.values(), panels, STYLE, rs.Quality.preset("fine"), frame=False)


def _scene(scan, function=None, **view) -> rs.Scene:
    """A scan without lights, in a view of the turntable, by its own transfer function or that of a file."""
    volume = rs.read_volume(scan)
    camera, matrix = rs.turntable(volume, **view)
    chosen = rs.default_transfer_function(volume)[0] if function is None else rs.TransferFunction.from_json(function)
    return rs.Scene(volume, chosen, camera, volume_matrix=matrix, headlight=False)


def _sun(scene: rs.Scene, direction, energy: float) -> rs.Light:
    middle = rs.turntable_aim(scene.volume, scene.volume_matrix)
    return rs.Light(matrix_world=rs.look_at(middle + direction, middle), energy=energy)
