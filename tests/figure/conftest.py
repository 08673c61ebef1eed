"""Figures of small volumes: two balls at a known distance, in a patient's space or in none."""

from __future__ import annotations

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.figure.make import figure_steps
from rle_splat.figure.plan import Figure, FigureStyle, Panel, tile_size
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

SHAPE_XYZ = (20, 12, 14)
BALLS = ((4, 6, 7), (15, 6, 7))  # voxels (x, y, z) at the middles of two balls
RED = TransferFunction(
    name="Red", opacity=((0.0, 0.0), (100.0, 0.9)), color=((0.0, 0.0, 0.0, 1.0), (100.0, 1.0, 0.0, 0.0)), shade=None
)


def two_balls(**about) -> Volume:
    """A volume of two balls 11 voxels apart along x; ``about``: fields of Volume."""
    nx, ny, nz = SHAPE_XYZ
    z, y, x = np.mgrid[:nz, :ny, :nx]
    values = sum(np.clip(2.6 - np.sqrt((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2), 0.0, 1.0) for a, b, c in BALLS)
    given = {"affine": np.eye(4), **about}
    return Volume((100.0 * values).astype(np.float32), **given)


class Drawing:
    """Makes scenes and figures of one panel or several."""

    style = FigureStyle(width_cm=2.5, dpi=100.0, font_size=4.0, caption="")

    def scene(self, volume=None, style=None, count=1, function=RED, view=None, **more) -> Scene:
        volume = two_balls() if volume is None else volume
        width, height = tile_size(style or self.style, count)
        scale = more.pop("scene_scale", 1.0)
        camera, matrix = turntable(volume, scene_scale=scale, **(view or {}))
        return Scene(volume, function, camera, width, height, **{"volume_matrix": matrix, "scene_scale": scale, **more})

    def made(self, *scenes, style=None, titles=None):
        titles = titles or [""] * len(scenes)
        panels = tuple(Panel(scene, title) for scene, title in zip(scenes, titles))
        qualities = [Quality.preset("draft")] * len(panels)
        return drain(figure_steps(Figure(panels, style or self.style), qualities))


@pytest.fixture
def drawing() -> Drawing:
    return Drawing()


@pytest.fixture
def balls():
    """``balls(**fields of Volume)``."""
    return two_balls
