"""Scenes and error measures shared by these tests: volumes whose scalar is their opacity, seen by any camera."""

import numpy as np
import pytest

from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.transfer import piecewise_linear
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import Camera, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

# The scalar is the opacity of one world unit; the color changes with it, so that order along a ray shows.
OPACITY_IS_VALUE = TransferFunction(
    name="opacity is the value",
    opacity=((0.0, 0.0), (1.0, 1.0)),
    color=((0.0, 0.9, 0.3, 0.1), (0.2, 0.2, 0.8, 0.3), (0.5, 0.1, 0.3, 1.0)),
    opacity_unit_distance=1.0,
    shade=None,
)


class Stage:
    """Builds scenes, renders them and holds them against the truth."""

    @staticmethod
    def color(opacity) -> np.ndarray:
        """The color of a medium of one opacity under OPACITY_IS_VALUE."""
        return piecewise_linear(OPACITY_IS_VALUE.color, opacity)

    @staticmethod
    def volume(field, affine=None, spacing=(1.0, 1.0, 1.0)) -> Volume:
        return Volume(np.asarray(field, np.float32), np.diag((*spacing, 1.0)) if affine is None else affine)

    def on_turntable(self, field, azimuth=35.0, elevation=25.0, perspective=False, size=(96, 96), fit=1.25, fov=40.0,
                     spacing=(1.0, 1.0, 1.0), **more) -> Scene:  # fmt: skip
        volume = self.volume(field, spacing=spacing)
        camera, matrix = turntable(volume, azimuth, elevation, fit, perspective, fov)
        return self.before(volume, camera, size, volume_matrix=matrix, **more)

    @staticmethod
    def before(volume, camera, size=(96, 96), transfer_function=OPACITY_IS_VALUE, headlight=False, **more) -> Scene:
        return Scene(volume, transfer_function, camera, *size, headlight=headlight, **more)

    @staticmethod
    def looking(eye, aim, up=(0.0, 0.0, 1.0), **fields) -> Camera:
        """A camera at ``eye`` looking at ``aim``, its other fields as given."""
        ahead = np.subtract(aim, eye) / np.linalg.norm(np.subtract(aim, eye))
        right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack((right, np.cross(right, ahead), -ahead), axis=1)
        matrix[:3, 3] = eye
        return Camera(matrix, **fields)

    @staticmethod
    def render(scene, **knobs):
        """By the paper's classification unless ``knobs`` say otherwise: the truth is T1."""
        usual = {"classification": "pre", "depth_rule": "simpson", "sheet_density": 1.5, "warp_filter": "cubic"}
        return render(scene, Quality(**usual | {"termination": 1 / 4096} | knobs))

    @staticmethod
    def truth(scene, name="T1", **how):
        """(rgba (H, W, 4), depth (H, W)) of T1 or T2, float64."""
        rgba, depth = truth(scene, name, tolerance=1e-7, **how)
        return rgba.reshape(scene.height, scene.width, 4), depth.reshape(scene.height, scene.width)

    def error(self, scene, true=None, **knobs):
        """The difference of a rendering from the truth, in levels."""
        true = self.truth(scene)[0] if true is None else true
        picture = self.render(scene, **knobs).rgba
        assert picture.dtype == np.float32 and picture.shape == true.shape and np.isfinite(picture).all()
        return difference(picture, true)


@pytest.fixture(scope="session")
def stage():
    return Stage()
