"""Proves that the picture does not pop where the principal axis changes: both axes give the same picture there, and
what is left between them is faded over."""

from dataclasses import replace
from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest

from benchmarks.phantoms import FIELDS
from rle_splat.classify.classification import classify
from rle_splat.encode.encode import encode
from rle_splat.pipeline.render import render
from rle_splat.runtime.steps import drain
from rle_splat.scene import QUALITY_PRESETS, Quality
from rle_splat.splat.splat import splat_steps
from rle_splat.view.base_plane import base_plane
from rle_splat.view.eye import index_view
from rle_splat.view.principal_axis import axis_shares
from rle_splat.warp.warp import warp_steps

LEVEL = 1.0 / 255.0
ANGLES = (43.0, 44.0, 44.9, 45.0, 45.1, 46.0, 47.0)


def by_axis(scene, axis, quality):
    """The picture of an orthographic scene with its principal axis forced."""
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    sign = -1 if view.eye[axis] > 0.0 else 1
    shape = scene.volume.shape_xyz
    plane = base_plane(view, shape, axis, sign, quality.depth_rule, quality.sheet_density)
    classified = classify(scene.volume, scene.transfer_function, scene.index_to_world)
    image = drain(splat_steps(encode(classified, classified.color, axis), plane, quality))
    return drain(warp_steps([image], view, scene.region, quality, 1.0))[0]


@pytest.mark.parametrize("azimuth", ANGLES)
def test_either_axis_gives_the_same_picture_at_standard(stage, azimuth):
    """At most one level of difference anywhere within two degrees of the switch, on smooth data."""
    scene = smooth_scene(stage, azimuth)
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


BAND = 2.0  # degrees, the quality's own
SMOOTH = np.pad(FIELDS["smooth"](40), 1)


def smooth_scene(stage, azimuth, elevation=20.0, **more):
    return stage.on_turntable(SMOOTH, azimuth, elevation, size=(96, 96), **more)


@pytest.mark.parametrize("classification", ["pre", "post"])
@pytest.mark.parametrize("name", QUALITY_PRESETS)
def test_nothing_jumps_where_the_axis_switches(stage, name, classification):
    """A hair to either side of the switch the pictures are the same, at every quality, whatever either axis errs, but
    for rays that end a sheet earlier, at a transmittance that does not show."""
    quality = Quality.preset(name, classification=classification)
    before, after = (render(smooth_scene(stage, 45.0 + side), quality) for side in (-1e-4, 1e-4))
    axes = [made.report["plan"]["base_planes"][0]["principal_axis"][1] for made in (before, after)]
    assert sorted(axes) == ["x", "y"] and before.rgba[..., 3].max() > 0.9
    assert np.abs(before.rgba - after.rgba).max() < 0.02 * LEVEL + quality.termination
    plain = replace(quality, axis_fade=0.0)
    before, after = (render(smooth_scene(stage, 45.0 + side), plain).rgba for side in (-1e-4, 1e-4))
    assert np.abs(before - after).max() > 0.1 * LEVEL  # which is what fading is for


@pytest.mark.parametrize("classification", ["pre", "post"])
def test_steps_through_the_switch_are_no_larger_than_others(stage, classification):
    """Frames a quarter of a degree apart at standard: by fading, the axes' own errors come in no faster than the
    picture moves, where a switch would show."""

    def largest(first, last, **knobs):
        quality = Quality.preset("standard", classification=classification, **knobs)
        path = [render(smooth_scene(stage, angle), quality).rgba for angle in np.arange(first, last + 0.01, 0.25)]
        return max(np.abs(one - other).max() for one, other in pairwise(path))

    assert largest(42.5, 47.5) < 1.25 * max(largest(39.0, 42.0), largest(48.0, 51.0))
    if classification == "post":
        assert largest(44.625, 45.375, axis_fade=0.0) > 1.5 * largest(44.625, 45.375)


def test_an_axis_fades_in_evenly(stage):
    """Shares go from one to a half over the band, sum to one, and are continuous through the corner of three axes."""

    def shares(azimuth, elevation=20.0, band=BAND):
        scene = smooth_scene(stage, azimuth, elevation)
        view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
        found = np.zeros(3)
        for axis, sign, share in axis_shares(view, band):
            assert sign == (-1 if view.eye[axis] > 0.0 else 1)
            found[axis] = share
        assert abs(found.sum() - 1.0) < 1e-12
        return found

    assert sorted(shares(45.0)) == pytest.approx([0.0, 0.5, 0.5]) and sorted(shares(42.9))[1:] == [0.0, 1.0]
    assert sorted(shares(45.0 - 0.5 * BAND))[1] == pytest.approx(0.25, abs=1e-6)
    assert shares(44.0, band=0.0).max() == 1.0
    corner = np.degrees(np.arctan(np.sqrt(0.5)))
    assert shares(45.0, corner) == pytest.approx(np.full(3, 1.0 / 3.0), abs=1e-6)
    for elevation in np.linspace(corner - 3.0, corner + 3.0, 7):
        path = [shares(azimuth, elevation) for azimuth in np.linspace(41.0, 49.0, 161)]
        assert np.abs(np.diff(path, axis=0)).max() < 0.05


def test_a_fade_is_cropped_and_kept_apart_as_any_picture_is(stage):
    """Crops to the bit, depths of the leading axis, none in perspective, and what it is mixed from in the report."""
    scene = smooth_scene(stage, 44.5)
    whole = render(scene, Quality())
    part = render(replace(scene, crop=(20, 31, 77, 60)), Quality())
    np.testing.assert_array_equal(part.rgba, whole.rgba[31:60, 20:77])
    np.testing.assert_array_equal(part.depth, whole.depth[31:60, 20:77])
    planes = whole.report["plan"]["base_planes"]
    assert len(planes) == 2 and planes[0]["share"] > planes[1]["share"] > 0.2
    alone = [render(scene, Quality(axis_fade=0.0)), leading_alone(planes[1]["principal_axis"], scene)]
    mixed = sum(plane["share"] * made.rgba.astype(np.float64) for plane, made in zip(planes, alone, strict=True))
    np.testing.assert_allclose(whole.rgba, mixed, atol=2e-7)
    np.testing.assert_array_equal(whole.depth, alone[0].depth)
    wide = render(smooth_scene(stage, 44.5, perspective=True), Quality())
    assert all(plane["share"] == 1.0 for plane in wide.report["plan"]["base_planes"])


def leading_alone(name, scene):
    """The picture from one axis alone, by its name in a report."""
    only = ("xyz".index(name[1]), 1 if name[0] == "+" else -1, 1.0)
    with patch("rle_splat.pipeline.views.axis_shares", lambda view, band: [only]):
        return render(scene, Quality())
