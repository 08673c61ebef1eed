"""Proves what the modes show: the largest, smallest and mean value of each ray, against numpy along the axes and
against a brute-force sampler elsewhere; and absorption alone, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import radius_from_center
from rle_splat.accuracy.rays import camera_rays
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.encode_scene import encode
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import use_reference
from rle_splat.scene import NO_DEPTH, Quality, RleSplatError
from rle_splat.volume.volume import Volume
from tests.truths.closed_forms import box_depths, composed, sphere_length

VALUE_MODES = ("mip", "minip", "average")
# A viewer's window: gray from black to white, and the opacity says how much of it.
WINDOW = TransferFunction(opacity=((0.0, 0.0), (1.0, 1.0)), color=((0.0, 1.0, 1.0, 1.0),), shade=None)
EXACT = dict(classification="post", sheet_density=0.0, warp_filter="bilinear")
# azimuth, elevation -> what numpy calls the axis, and how its result lies in the picture
VIEWS = {
    (0.0, 0.0): lambda project, field: project(field, 1)[::-1],
    (180.0, 0.0): lambda project, field: project(field, 1)[::-1, ::-1],
    (90.0, 0.0): lambda project, field: project(field, 2)[::-1],
    (0.0, 90.0): lambda project, field: project(field, 0)[::-1],
}
NUMPY = {
    "mip": lambda field, axis: field.max(axis),
    "minip": lambda field, axis: field.min(axis),
    # Of values that are linear between voxels, from the first to the last.
    "average": lambda field, axis: np.trapezoid(field, axis=axis) / (field.shape[axis] - 1),
}


def random_field(seed=5, size=14):
    return np.random.default_rng(seed).uniform(0.05, 0.95, (size, size, size)).astype(np.float32)


def smooth_field(size=16):
    z, y, x = np.mgrid[:size, :size, :size].astype(float)
    return 0.5 + 0.2 * np.sin(0.5 * x + 0.2 * y) + 0.15 * np.cos(0.45 * y - 0.3 * z) + 0.1 * np.sin(0.4 * z)


def seen(stage, field, mode, azimuth=0.0, elevation=0.0, fit=1.0, size=None, tf=WINDOW, **more):
    side = max(np.shape(field))
    return stage.on_turntable(
        field, azimuth, elevation, fit=fit, size=size or (side, side), transfer_function=tf, mode=mode, **more
    )


def trilinear(field, points):
    """Brute force: eight voxels by hand, float64; points (N, 3) as x, y, z."""
    field = np.asarray(field, np.float64)
    cell = np.clip(np.floor(points).astype(int), 0, np.array(field.shape[::-1]) - 2)
    share, total = points - cell, 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, share, 1.0 - share), axis=1)
        x, y, z = (cell + corner).T
        total = total + weight * field[z, y, x]
    return total


def sampled(scene, samples=600):
    """(N, samples) values along the path of each ray in the box of voxel centers, NaN for rays that miss it; and (N,)
    the length of that path along the camera's axis."""
    rays = camera_rays(scene.camera, scene.width, scene.height)
    high = np.array(scene.volume.shape_xyz) - 1.0
    enter, leave = box_depths(rays, scene.index_to_world, np.zeros(3), high)
    enter = np.maximum(enter, scene.camera.clip_start)
    leave = np.minimum(leave, scene.camera.clip_end)
    values = np.full((len(enter), samples), np.nan)
    to_index = np.linalg.inv(scene.index_to_world)
    for n in np.flatnonzero(leave > enter):
        depth = enter[n] + (leave[n] - enter[n]) * (np.arange(samples) + 0.5) / samples
        points = rays.origin[n] + rays.step[n] * depth[:, None]
        points = points @ to_index[:3, :3].T + to_index[:3, 3]
        values[n] = trilinear(scene.volume.voxels, np.clip(points, 0.0, high))
    return values, leave - enter


@pytest.mark.parametrize("mode", VALUE_MODES)
@pytest.mark.parametrize("view", VIEWS)
def test_along_an_axis_numpy_finds_the_same_value(stage, mode, view):
    """To the last bit but one of float32, by a sheet pixel for each voxel."""
    field = random_field()
    picture = stage.render(seen(stage, field, mode, *view), **EXACT).rgba[..., 3]
    true = VIEWS[view](NUMPY[mode], field)
    inside = (slice(1, -1),) * 2  # the outermost pixels lie on the box's faces, where rounding decides
    assert true.std() > 0.01
    np.testing.assert_allclose(picture[inside], true[inside], atol=3e-7 if mode != "average" else 2e-6)


@pytest.mark.parametrize("far", (1e6, 1e30, -1e30))
@pytest.mark.parametrize("mode", VALUE_MODES)
def test_one_extreme_voxel_changes_the_rays_through_it_alone(stage, mode, far):
    field, extreme = random_field(), random_field()
    extreme[3, 4, 5] = far
    without, with_it = (render(seen(stage, one, mode), Quality(**EXACT)).rgba for one in (field, extreme))
    differs = (np.abs(with_it - without) > 0.1 / 255.0).any(axis=-1)
    assert differs.sum() <= 9 and without[..., 3].max() > 0.2


@pytest.mark.parametrize("slope", (2.0, -2.0))
def test_whole_numbers_are_exact_and_slopes_may_be_negative(stage, slope):
    stored = np.random.default_rng(3).integers(-3000, 3000, (12, 12, 12)).astype(np.int16)
    ends = sorted((slope * -3000.0 + 7.0, slope * 3000.0 + 7.0))
    tf = TransferFunction(opacity=((ends[0], 0.0), (ends[1], 1.0)), color=((0.0, 1.0, 1.0, 1.0),), shade=None)
    scene = replace(seen(stage, stored, "mip", tf=tf), volume=Volume(stored, np.eye(4), slope=slope, intercept=7.0))
    picture = stage.render(scene, **EXACT).rgba[..., 3].astype(np.float64)
    found = ends[0] + picture * (ends[1] - ends[0])
    true = (slope * stored + 7.0).max(axis=1)[::-1]
    np.testing.assert_allclose(found[1:-1, 1:-1], true[1:-1, 1:-1], atol=2e-3)  # of alphas rounded to float32


@pytest.mark.parametrize("perspective", (False, True))
@pytest.mark.parametrize("mode", VALUE_MODES)
def test_oblique_rays_against_a_sampler(stage, mode, perspective):
    scene = seen(
        stage, smooth_field(), mode, 35.0, 25.0, fit=1.5, size=(24, 24), perspective=perspective,
        headlight=True,  # of no consequence
    )  # fmt: skip
    values, path = sampled(scene)
    with np.errstate(invalid="ignore"):
        true = {"mip": np.max, "minip": np.min, "average": np.mean}[mode](values, axis=1).reshape(24, 24)
    inside = (path > 2.0).reshape(24, 24)
    errors = {}
    for rule in ("slice", "midpoint-8"):
        picture = stage.render(scene, classification="post", depth_rule=rule, sheet_density=4.0).rgba[..., 3]
        assert (picture[~np.isfinite(true)] < 0.75).all() and (picture[0, 0], picture[-1, -1]) == (0.0, 0.0)
        errors[rule] = np.abs(picture - true)[inside]
    assert true[inside].std() > 0.04
    assert errors["slice"].mean() < 0.008 and errors["slice"].max() < 0.09
    assert errors["midpoint-8"].mean() < 0.0011 and errors["midpoint-8"].max() < 0.012


def test_minip_is_mip_of_the_negated_volume(stage):
    field = random_field(7)
    negated = TransferFunction(opacity=((-1.0, 1.0), (0.0, 0.0)), color=((0.0, 1.0, 1.0, 1.0),), shade=None)
    there = dict(azimuth=20.0, elevation=-35.0, size=(30, 30))
    one = stage.render(seen(stage, field, "minip", **there), classification="post")
    other = stage.render(seen(stage, -field, "mip", tf=negated, **there), classification="post")
    assert one.rgba[..., 3].std() > 0.05
    np.testing.assert_allclose(one.rgba, np.where(other.rgba[..., 3:] > 0, other.rgba, 0.0), atol=2e-6)
    np.testing.assert_array_equal(one.depth, other.depth)


def test_the_average_of_a_ramp_is_the_value_in_the_middle_of_the_path(stage):
    z, y, x = np.mgrid[:16, :16, :16].astype(float)
    ramp = 0.1 + (x + 2.0 * y + 1.5 * z) / 90.0
    scene = seen(stage, ramp, "average", 30.0, 40.0, fit=1.6, size=(32, 32))
    rays = camera_rays(scene.camera, 32, 32)
    enter, leave = box_depths(rays, scene.index_to_world, np.zeros(3), np.full(3, 15.0))
    middle = rays.at_depth(0.5 * (enter + leave)) @ np.linalg.inv(scene.index_to_world)[:3, :3].T
    middle = middle + np.linalg.inv(scene.index_to_world)[:3, 3]
    true = (0.1 + middle @ (1.0, 2.0, 1.5) / 90.0).reshape(32, 32)
    long = ((leave - enter) > 4.0).reshape(32, 32)
    picture = stage.render(scene, classification="post", depth_rule="midpoint-8", sheet_density=3.0).rgba[..., 3]
    assert long.sum() > 200
    np.testing.assert_allclose(picture[long], true[long], atol=0.002)


def test_the_depth_of_a_maximum_is_where_it_is(stage):
    field = random_field(9)
    scene = seen(stage, field, "mip")
    found = stage.render(scene, **EXACT).depth[1:-1, 1:-1]
    nearest = (found - np.argmax(field, axis=1)[::-1][1:-1, 1:-1]).mean()
    np.testing.assert_allclose(found - nearest, np.argmax(field, axis=1)[::-1][1:-1, 1:-1], atol=1e-4)
    eye = scene.camera.matrix_world[:3, 3]
    assert nearest == pytest.approx(np.linalg.norm(eye - 0.5 * (np.array(field.shape) - 1.0)) - 6.5, abs=1e-3)
    assert (stage.render(replace(scene, mode="average"), **EXACT).depth == NO_DEPTH).all()


def test_air_is_transparent_and_only_what_can_decide_a_pixel_is_kept(stage):
    """A bump of opacity: the largest value of a ray is the largest, also where it is not shown itself."""
    field = np.zeros((16, 16, 16), np.float32)
    field[4:12, 4:12, 4:12] = 0.5
    field[4:12, 4:12, 8:12] = 0.9
    bump = TransferFunction(opacity=((0.3, 0.0), (0.5, 1.0), (0.7, 0.0)), color=((0.0, 0.2, 0.6, 1.0),), shade=None)
    scene = seen(stage, field, "mip", tf=bump)
    rendering = stage.render(scene, **EXACT)
    rgba = rendering.rgba
    np.testing.assert_allclose(rgba[6:10, 5:7], np.broadcast_to((0.2, 0.6, 1.0, 1.0), (4, 2, 4)), atol=1e-6)
    assert (rgba[6:10, 9:11] == 0.0).all() and (rgba[:3] == 0.0).all()
    assert (rendering.depth[6:10, 9:11] == NO_DEPTH).all()
    assert 0 < rendering.report["volume"]["visible_voxels"] <= 10**3
    average = stage.render(replace(scene, mode="average"), **EXACT)
    assert average.report["volume"]["visible_voxels"] == 16**3
    needed = [found.report["memory_estimate_bytes"]["needed"] for found in (rendering, average)]
    assert needed[0] < needed[1]


def test_clip_distances_end_the_path(stage):
    field = random_field(11)
    scene = seen(stage, field, "mip")
    near = np.linalg.norm(scene.camera.matrix_world[:3, 3] - 6.5) - 6.5
    scene = replace(scene, camera=replace(scene.camera, clip_start=near + 3.9, clip_end=near + 8.1))
    picture = stage.render(scene, **EXACT).rgba[..., 3]
    np.testing.assert_allclose(picture[1:-1, 1:-1], field[:, 4:9].max(axis=1)[::-1][1:-1, 1:-1], atol=1e-6)


def test_what_is_no_number_is_left_out(stage):
    field = random_field(13)
    field[:, :, 8:] = np.nan
    field[6, 6, 3] = np.nan
    shown = replace(WINDOW, opacity=((0.0, 0.5), (1.0, 1.0)))  # also the lowest values
    for mode in VALUE_MODES:
        rgba = stage.render(seen(stage, field, mode, tf=shown), **EXACT).rgba
        assert np.isfinite(rgba).all()
        assert (rgba[:, 9:] == 0.0).all() and (rgba[1:-1, 1:7, 3] > 0.5).all()


# --- absorption alone -----------------------------------------------------------------------------------------


def absorbing(*points, **more):
    """Colored, to be shown white."""
    return TransferFunction(
        opacity=points, color=((0.0, 0.9, 0.3, 0.1),), opacity_unit_distance=1.0, shade=None, **more
    )


@pytest.mark.parametrize("depth_rule", ("slice", "preintegrated", "simpson"))
def test_xray_of_a_slab_is_beers_law(stage, depth_rule):
    tf = absorbing((0.0, 0.0), (0.4, 0.0), (0.4, 0.08))
    scene = seen(stage, np.full((16, 16, 16), 0.5), "xray", 30.0, 20.0, fit=1.6, size=(40, 40), tf=tf)
    rays = camera_rays(scene.camera, 40, 40)
    enter, leave = box_depths(rays, scene.index_to_world, np.zeros(3), np.full(3, 15.0))
    true = composed(-np.log1p(-0.08) * np.maximum(leave - enter, 0.0), (1.0, 1.0, 1.0)).reshape(40, 40, 4)
    found = stage.render(scene, classification="post", depth_rule=depth_rule, sheet_density=3.0)
    np.testing.assert_allclose(found.rgba, true, atol=0.006)
    dark = true[..., 3] > 0.52
    assert dark.any() and (found.depth[true[..., 3] < 0.48] == NO_DEPTH).all()
    half = (enter + np.log(2.0) / -np.log1p(-0.08)).reshape(40, 40)
    error = np.abs(found.depth - half)[dark]
    assert np.median(error) < 1e-3 and (error > 0.05).mean() < 0.01  # at the box's edges the depth is its neighbors'


def test_xray_of_a_ball_is_its_chord(stage):
    tf = absorbing((0.0, 0.06), (9.0, 0.06), (9.0, 0.0))
    scene = seen(stage, radius_from_center(24), "xray", 35.0, 25.0, size=(48, 48), tf=tf)
    rays = camera_rays(scene.camera, 48, 48)
    center = (scene.index_to_world @ (11.5, 11.5, 11.5, 1.0))[:3]
    chord = sphere_length(rays, center, 9.0)
    true = composed(-np.log1p(-0.06) * chord, (1.0, 1.0, 1.0)).reshape(48, 48, 4)
    found = stage.render(scene, classification="post", depth_rule="preintegrated-2", sheet_density=3.0).rgba
    np.testing.assert_allclose(found, true, atol=0.1)  # at the rim a step of opacity is seen edge-on
    assert true.max() > 0.6 and np.abs(found - true).mean() < 0.003


@pytest.mark.parametrize("depth_rule", ("preintegrated", "simpson"))
def test_xray_is_what_a_white_medium_shows(stage, depth_rule):
    """The same sheets in the order of sight: no color, no order, the same picture; and the truth T2 of it."""
    tf = absorbing((0.2, 0.0), (0.5, 0.3), (0.8, 0.05))
    scene = seen(stage, smooth_field(), "xray", 35.0, 25.0, fit=1.3, size=(32, 32), tf=tf)
    white = replace(scene, mode="composite", transfer_function=replace(tf, color=((0.0, 1.0, 1.0, 1.0),)))
    knobs = dict(classification="post", depth_rule=depth_rule, sheet_density=2.0, termination=0.0)
    one, other = stage.render(scene, **knobs), stage.render(white, **knobs)
    np.testing.assert_allclose(one.rgba, other.rgba, atol=2e-6)
    np.testing.assert_allclose(one.depth, other.depth, rtol=0.02)  # inside a sheet linear, not exponential
    true, _ = truth(scene, "T2", tolerance=1e-6)
    assert np.abs(one.rgba.reshape(-1, 4) - true).max() < 0.04
    with pytest.raises(RleSplatError, match="mip"):
        truth(replace(scene, mode="mip"), "T2")


# --- how they are made ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("perspective", (False, True))
@pytest.mark.parametrize("mode", ("xray", *VALUE_MODES))
def test_any_number_of_threads_and_numpy_make_the_same_picture(stage, mode, perspective):
    field = random_field(17, 12)
    field[3, 4, 5] = np.nan
    tf = absorbing((0.3, 0.0), (0.9, 0.4))
    scene = seen(stage, field, mode, 25.0, -30.0, size=(41, 37), perspective=perspective, tf=tf, headlight=True)
    scene = replace(scene, camera=replace(scene.camera, clip_end=scene.camera.clip_end))
    one, two = (stage.render(scene, classification="post", threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.rgba, two.rgba)
    np.testing.assert_array_equal(one.depth, two.depth)
    with use_reference():
        reference = stage.render(scene, classification="post")
    np.testing.assert_allclose(one.rgba, reference.rgba, atol=1e-4)
    same = np.isclose(one.depth, reference.depth, atol=1e-3)
    assert same.mean() > 0.99


def test_the_modes_look_at_no_gradients_and_no_light_and_post_is_taken_where_it_is_not_asked_for(stage):
    shaded = replace(WINDOW, shade=Shade())
    field = random_field(19, 12)
    scene = stage.on_turntable(field, transfer_function=shaded, mode="mip", size=(20, 20), headlight=True)
    cache = StageCache()
    pre = render(scene, Quality(classification="pre", kernel="bspline2"), cache=cache)
    assert not {"normals", "light", "lights", "table", "properties"} & set(cache.made)
    assert "The mode mip shows values, so the classification post was used, not pre." in pre.report["remarks"]
    assert pre.report["plan"]["classification"] == "post"
    same = render(scene, Quality(classification="post"), cache=cache)
    np.testing.assert_array_equal(pre.rgba, same.rgba)
    off = render(replace(scene, effects={"mode": False}), Quality())
    np.testing.assert_array_equal(off.rgba, render(replace(scene, mode="composite"), Quality()).rgba)


def test_modes_are_refused_where_there_are_no_values(stage):
    scene = stage.on_turntable(random_field(2, 8), transfer_function=WINDOW)
    stored = replace(scene, volume=encode(scene), mode="mip")
    with pytest.raises(RleSplatError, match="the mode mip needs the volume itself"):
        render(stored, Quality(classification="pre"))
    with pytest.raises(RleSplatError, match="no mode called 'sum'"):
        replace(scene, mode="sum")
