"""Scenes whose pixels are single rays through single columns of voxels, so that bounds on numbers can be stated; and
noise of any stored type, seen from aside."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import CLASSIFICATIONS, Camera, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from rle_splat.warp.warp import warp_steps

# Where what is interpolated is the scalar.
FINER = tuple(name for name in CLASSIFICATIONS if name != "pre")
# One sheet per slice, one sheet pixel per voxel, nothing mixed: a pixel is its own column of voxels.
EXACT = Quality(
    classification="pre", depth_rule="slice", sheet_density=0.0, warp_filter="bilinear", termination=0.0, name="exact"
)
WHITE = ((0.0, 1.0, 1.0, 1.0),)
STEPPED = TransferFunction(
    opacity=((10, 0.0), (50, 0.2), (50, 0.6), (80, 0.0), (100, 0.0), (120, 1.0)),
    color=((0, 0.0, 0.5, 1.0), (60, 1.0, 0.5, 0.25), (60, 2.0, 0.0, 0.0), (200, 0.0, 0.0, 4.0)),
)


def from_above(voxels, transfer_function, scale: float = 1.0, **more) -> Scene:
    """Parallel rays down through ``voxels`` (nz, ny, nx), one pixel a column, 1 x 1 x 1 * ``scale`` in the world."""
    voxels = np.asarray(voxels)
    nz, ny, nx = voxels.shape
    place = np.eye(4)
    place[:3, 3] = scale * 0.5 * (nx - 1), scale * 0.5 * (ny - 1), scale * (nz + 10.0)
    camera = Camera(
        place, "ORTHO", ortho_scale=scale * max(nx, ny), clip_start=scale * 0.1, clip_end=scale * (nz + 100.0)
    )
    grown = np.diag((scale, scale, scale, 1.0))
    return Scene(Volume(voxels, np.eye(4)), transfer_function, camera, nx, ny, grown, headlight=False, **more)


def columns(scene: Scene, quality: Quality = EXACT, **knobs) -> np.ndarray:
    """(ny, nx, 4) float32: the pixel of each column of a scene ``from_above``, premultiplied color and alpha."""
    return render(scene, replace(quality, **knobs)).rgba[::-1]


def warped_by(draw) -> list:
    """The intermediate images that ``draw()`` warps."""
    caught = []

    def catching(images, *rest):
        caught.extend(images)
        return warp_steps(images, *rest)

    with patch("rle_splat.pipeline.render.warp_steps", catching):
        draw()
    return caught


def sheets(scene: Scene, quality: Quality = EXACT, **knobs) -> np.ndarray:
    """As ``columns``, before the warp has rounded alpha: premultiplied color and transmittance."""
    (image,) = warped_by(lambda: render(scene, replace(quality, **knobs)))
    (u, v), (nx, ny, _) = image.base_plane.origin, scene.volume.shape_xyz
    assert tuple(image.base_plane.density) == (1.0, 1.0) and image.base_plane.axis == 2
    return image.pixels[-v : ny - v, -u : nx - u]


def drawn(scene: Scene, classification: str, **knobs) -> np.ndarray:
    """A picture at standard quality."""
    return render(scene, Quality.preset("standard", classification=classification, **knobs)).rgba


def transfer(opacity, color=WHITE, distance=1.0, shade=None, **more) -> TransferFunction:
    return TransferFunction(opacity=opacity, color=color, opacity_unit_distance=distance, shade=shade, **more)


def unlike(one, two) -> int:
    """How many numbers of two arrays differ; NaN is unlike everything."""
    one, two = np.asarray(one), np.asarray(two)
    return int((one != two).sum()) if one.shape == two.shape else max(one.size, two.size, 1)


def turned(volume, transfer_function, size=40, **more) -> Scene:
    camera, matrix = turntable(volume, 35.0, 25.0)
    return Scene(volume, transfer_function, camera, size, size, matrix, **more)


def noise(dtype="float32", shape=(7, 8, 9), seed=3) -> np.ndarray:
    """Values from -20 (0 where there is no sign) to 124."""
    kind = np.dtype(dtype).kind
    values = np.random.default_rng(seed).integers(-20 if kind != "u" else 0, 125, shape)
    return (values + (0.25 if kind == "f" else 0)).astype(dtype)
