"""Proves that the picture does not pop where the principal axis changes: both axes give the same picture there."""

import numpy as np
import pytest

from rle_splat.accuracy.phantoms import FIELDS
from rle_splat.classify.classification import classify
from rle_splat.encode.encode import encode
from rle_splat.scene import Quality
from rle_splat.splat.splat import splat_steps
from rle_splat.view.base_plane import base_plane
from rle_splat.view.eye import index_view
from rle_splat.warp.warp import warp

LEVEL = 1.0 / 255.0
ANGLES = (43.0, 44.0, 44.9, 45.0, 45.1, 46.0, 47.0)


def by_axis(scene, axis, quality):
    """The picture of an orthographic scene with its principal axis forced."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    sign = -1 if view.eye[axis] > 0.0 else 1
    shape = scene.volume.shape_xyz
    plane = base_plane(view, shape, axis, sign, quality.depth_rule, quality.sheet_density)
    classified = classify(scene.volume, scene.transfer_function, scene.index_to_world)
    steps = splat_steps(encode(classified, classified.color, axis), plane, quality)
    while True:
        try:
            next(steps)
        except StopIteration as finished:
            return warp([finished.value], view, scene.region, quality, 1.0)[0]


@pytest.mark.parametrize("azimuth", ANGLES)
def test_either_axis_gives_the_same_picture_at_standard(stage, azimuth):
    """At most one level of difference anywhere within two degrees of the switch, on smooth data."""
    scene = stage.on_turntable(np.pad(FIELDS["smooth"](40), 1), azimuth, 20.0, size=(96, 96))
    pictures = [by_axis(scene, axis, Quality.preset("standard", classification="pre")) for axis in (0, 1)]
    assert pictures[0][..., 3].max() > 0.9
    assert np.abs(pictures[0] - pictures[1]).max() <= LEVEL


@pytest.mark.parametrize("azimuth", ANGLES)
def test_transmittance_does_not_depend_on_the_axis(stage, azimuth):
    """With the footprint integrated in depth the optical depth of a ray is the same sum from either side: what is
    left is rounding and the warp's resampling, a tenth of a level."""
    scene = stage.on_turntable(np.pad(FIELDS["smooth"](24), 1), azimuth, 20.0, size=(64, 64))
    exact = Quality(classification="pre", depth_rule="midpoint-16", sheet_density=6.0, termination=0.0)
    pictures = [by_axis(scene, axis, exact)[..., 3] for axis in (0, 1)]
    assert pictures[0].max() > 0.9
    assert np.abs(pictures[0] - pictures[1]).max() <= 0.1 * LEVEL
