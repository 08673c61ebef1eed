"""Scenes for the named systems: small volumes whose scalar is their opacity, and the truth T1 of them."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.truths import truth
from rle_splat.comparison.medium import scene_medium
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.truths.conftest import OPACITY_IS_VALUE

EXACT = Quality.preset("fine", classification="pre", termination=0.0)


class Stand:
    """Builds scenes and measures pictures of them."""

    quality = EXACT

    @staticmethod
    def scene(field, azimuth=35.0, elevation=25.0, perspective=False, size=(64, 60), fit=1.25, function=None,
              spacing=(1.0, 1.0, 1.0), **more) -> Scene:  # fmt: skip
        voxels = np.asarray(field)
        voxels = voxels.astype(np.float32) if voxels.dtype == np.float64 else voxels
        volume = Volume(voxels, np.diag((*spacing, 1.0)))
        camera, matrix = turntable(volume, azimuth, elevation, fit, perspective, 40.0)
        function = function or OPACITY_IS_VALUE
        return Scene(volume, function, camera, *size, volume_matrix=matrix, **({"headlight": False} | more))

    @staticmethod
    def truth(scene, **how):
        """(H, W, 4) float64 T1."""
        return truth(scene, tolerance=1e-7, **how)[0].reshape(scene.height, scene.width, 4)

    @staticmethod
    def medium(scene, quality=EXACT):
        return scene_medium(scene, quality)

    @staticmethod
    def draw(module, scene, quality=EXACT, **knobs):
        return module.prepare(scene_medium(scene, quality), quality, **knobs).draw()

    @staticmethod
    def error(picture, true):
        assert picture.rgba.dtype == np.float32 and np.isfinite(picture.rgba).all()
        return difference(picture.rgba, true)

    @staticmethod
    def clipped(scene, **ends):
        return replace(scene, camera=replace(scene.camera, **ends))


@pytest.fixture(scope="session")
def stand():
    return Stand()
