"""Proves that a lens blurs by the closed form of its circle of confusion, to one percent of the circle's size.

A point of the aperture at ``a``, in world units from the middle, sees a medium at depth z moved by a k (1/f - 1/z) in
perspective (k pixels to a unit at depth 1) and by a k (z/f - 1) orthographically (k pixels to a unit), f being the
depth in focus: thin lens and similar triangles.  The mean picture's second moments are those of the sharp one and those
of the aperture times that factor: for a disk of radius R, R^2/4 along any axis; for a regular polygon with n corners,
R^2 (2 + cos(2 pi / n)) / 12.  Moments ask for no shape of the medium, and hardly for its size: a blot is enough.
"""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.pipeline.render import render
from rle_splat.scene import Camera, Quality
from tests.truths.conftest import OPACITY_IS_VALUE

SIZE, FOCUS, RADIUS = 160, 4.0, 0.25
SPACING, SIDE, SIGMA = 0.02, 13, 1.4  # of the blot: in world units, in voxels
PIXELS = {"PERSP": SIZE * 50.0 / 36.0, "ORTHO": SIZE / 2.5}  # to a world unit, at depth 1 in perspective


def blot(stage, depth, kind, **lens):
    """A thin blot of a medium in the middle of the picture, ``depth`` before a camera with a lens."""
    position = np.arange(SIDE) - 0.5 * (SIDE - 1)
    square = position**2 + (position**2)[:, None] + (position**2)[:, None, None]
    volume = stage.volume(np.exp(-0.5 * square / SIGMA**2), np.diag((SPACING, SPACING, SPACING, 1.0)))
    at = np.eye(4)
    at[:3, 3] = np.array((0.0, 0.0, -depth)) - 0.5 * SPACING * (SIDE - 1)
    camera = Camera(type=kind, ortho_scale=2.5, clip_start=0.01, focus_distance=FOCUS, aperture_radius=RADIUS, **lens)
    thin = replace(OPACITY_IS_VALUE, opacity=((0.0, 0.0), (1.0, 0.05)))
    return stage.before(volume, camera, (SIZE, SIZE), volume_matrix=at, transfer_function=thin)


def moments(scene):
    """Of the picture's alpha, in pixels: its total, its middle (2,), and its second moments about it (2,)."""
    alpha = render(scene, Quality(classification="post")).rgba[..., 3].astype(np.float64)
    positions = np.mgrid[:SIZE, :SIZE][::-1] + 0.5
    total = alpha.sum()
    middle = (positions * alpha).sum(axis=(1, 2)) / total
    return total, middle, ((positions - middle[:, None, None]) ** 2 * alpha).sum(axis=(1, 2)) / total


@pytest.mark.parametrize(
    ("kind", "depth", "blades", "moment"),
    [
        (kind, depth, *((0, 0.25), (3, 0.125), (6, 5.0 / 24.0))[(k + d) % 3])
        for k, kind in enumerate(PIXELS)
        for d, depth in enumerate((2.5, 3.0, 6.0))
    ],
)
def test_a_lens_blurs_to_the_circle_of_confusion(stage, kind, depth, blades, moment):
    scene = blot(stage, depth, kind, aperture_blades=blades)
    total, middle, blurred = moments(scene)
    sharp_total, sharp_middle, sharp = moments(replace(scene, camera=replace(scene.camera, aperture_radius=0.0)))
    # The blot's own thickness: each depth has its factor.
    position = SPACING * (np.arange(SIDE) - 0.5 * (SIDE - 1))
    weight = np.exp(-0.5 * (position / (SPACING * SIGMA)) ** 2)
    z = depth + position
    factor = 1.0 / FOCUS - 1.0 / z if kind == "PERSP" else z / FOCUS - 1.0
    expected = moment * (RADIUS * PIXELS[kind]) ** 2 * np.average(factor**2, weights=weight)
    found = np.sqrt((blurred - sharp) / expected)
    assert found == pytest.approx(1.0, abs=0.01)
    assert middle == pytest.approx(sharp_middle, abs=0.05)
    assert total == pytest.approx(sharp_total, rel=0.02), "a lens takes no light away"
