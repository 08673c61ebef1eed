"""Proves that the engine is its depth rule and nothing else: an independent program samples each pixel's ray at the
slices (and half way between them), composes slabs, and must meet the sheet-buffer picture at high sheet density.

What is left is the resampling; what the rule itself costs is measured in the ladder.  So a fault of the slice maps,
of path lengths, of the order of sheets or of the choice among pyramids shows here at a fraction of a level.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.accuracy.medium import ClassifiedField
from rle_splat.accuracy.metrics import difference
from rle_splat.accuracy.rays import camera_rays
from rle_splat.accuracy.transfer import extinction_and_color
from rle_splat.accuracy.truths import world_opacity_distance


def sampled_at_sheets(scene, depth_rule):
    """(H, W, 4): slabs of a constant medium along each pixel's own ray, cut across its steepest index axis."""
    volume, distance = scene.volume, world_opacity_distance(scene)
    medium = ClassifiedField(*extinction_and_color(scene.transfer_function, volume.physical(volume.voxels), distance))
    rays = camera_rays(scene.camera, scene.width, scene.height)
    inverse = np.linalg.inv(scene.index_to_world)
    start, step = rays.origin @ inverse[:3, :3].T + inverse[:3, 3], rays.step @ inverse[:3, :3].T
    every = np.arange(len(start))
    axis = np.abs(step).argmax(axis=1)
    along = step[every, axis]
    slices = np.array(volume.shape_xyz)[axis]
    rgb, transmitted = np.zeros((len(start), 3)), np.ones(len(start))
    for n in range(-2, 2 * max(volume.shape_xyz) + 1):
        weight = {"slice": 1.0 - n % 2, "simpson": (1.0 + n % 2) / 3.0}[depth_rule]
        position = np.where(along > 0.0, n / 2.0, slices - 1.0 - n / 2.0)
        at = start + step * ((position - start[every, axis]) / along)[:, None]
        inside = ((at >= medium.low) & (at < medium.high)).all(axis=1)
        sampled = medium.at(at[inside])
        length = (weight * rays.length_per_depth / np.abs(along))[inside]
        tau = sampled[:, 3] * length
        part = np.divide(-np.expm1(-tau), tau, out=np.ones_like(tau), where=tau > 0.0)
        rgb[inside] += (transmitted[inside] * length * part)[:, None] * sampled[:, :3]
        transmitted[inside] *= np.exp(-tau)
    return np.concatenate((rgb, 1.0 - transmitted[:, None]), axis=1).reshape(scene.height, scene.width, 4)


@pytest.mark.parametrize(
    "depth_rule, perspective, azimuth, elevation",
    [
        (rule, (n + r) % 2 == 1, *view)
        for n, view in enumerate(((35, 25), (-100, 50), (170, -60), (45, 35.26439), (90, 0)))
        for r, rule in enumerate(("slice", "simpson"))
    ],
)
@pytest.mark.parametrize("name, bounds", (("smooth", (0.08, 0.9)), ("thin", (0.35, 3.5))))
def test_high_density_picture_is_the_rule_along_each_ray(
    stage, name, bounds, azimuth, elevation, perspective, depth_rule
):
    """Looking along an axis the kinks of all slices fall on the same pixels, which is what the bounds are for.
    Rays exactly on the 45-degree tie may go by either axis, hence the 99.9th percentile beside the maximum."""
    field = np.pad(FIELDS[name](24)[:, :, 2:], ((1, 1), (0, 0), (1, 1)))
    scene = stage.on_turntable(field, azimuth, elevation, perspective, size=(48, 48), fov=50.0, spacing=(1.0, 1.1, 0.9))
    picture = stage.render(scene, depth_rule=depth_rule, sheet_density=5.0, termination=0.0).rgba
    found = difference(picture, sampled_at_sheets(scene, depth_rule))
    rmse, p999 = bounds
    assert found.rmse < rmse and found.p999 < p999 and found.largest < 4.0 * p999


@pytest.mark.parametrize("classification", ("pre", "post"))
@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("elevation", (75, -75))
def test_every_second_slice_is_slice_planes_of_the_volume_without_the_others(
    stage, classification, perspective, elevation
):
    """Outer slices are empty, for the ramps in front of them are not alike.  The tables of values that post classifies
    by begin and end where the volumes do."""
    field = np.pad(FIELDS["smooth"](24)[:19], ((1, 1), (0, 0), (0, 0)))
    scene = stage.on_turntable(field, 20.0, elevation, perspective, size=(48, 48), fov=10.0)
    halved = replace(scene, volume=stage.volume(field[::2], spacing=(1.0, 1.0, 2.0)))
    every_second, planes = (
        stage.render(each, classification=classification, depth_rule=rule)
        for each, rule in ((scene, "slice-2"), (halved, "slice"))
    )
    found = difference(every_second.rgba, planes.rgba)
    rmse, largest = {"pre": (1e-3, 3e-3), "post": (0.1, 1.0)}[classification]
    assert found.rmse < rmse and found.largest < largest and planes.rgba.max() > 0.3
    assert difference(every_second.rgba, stage.render(scene, classification=classification).rgba).rmse > 3.0 * rmse
