"""Proves what post-classified channels show: values of each are interpolated and classified by its own table,
extinctions add up, and the mixture is lit once.

The references share no code with the renderer: a march along rays in numpy, the truth T2, and closed forms.
"""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.accuracy.light_model import PostLight
from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.planner.checks import measurable_scene
from rle_splat.accuracy.planner.tolerance import render_within
from rle_splat.accuracy.transfer import mean_extinction as true_mean_extinction
from rle_splat.accuracy.transfer import world_opacity_distance
from rle_splat.accuracy.truths import truth
from rle_splat.classify.lookup_table import lookup_table
from rle_splat.classify.shown_nearby import mean_extinction, nearby_steps
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import Channel, Clip, Labels, Light, Mist, Quality, RleSplatError
from rle_splat.volume.volume import Volume
from tests.ways import both

N = 14
SHADE = Shade(0.2, 0.7, 0.3, 15.0)
COLORS = (0.9, 0.2, 0.1), (0.1, 0.8, 0.3), (0.2, 0.3, 1.0)
KINDS = ((np.uint8, 200.0), (np.float32, 3.0), (np.uint16, 30000.0))
LIT = {"headlight": {}, "sun": {"lights": (Light(casts_shadow=True),), "headlight": False, "volume_shadows": True}}


def blobs(seed):
    """(N, N + 1, N + 2) smooth bumps, 0 to 1."""
    z, y, x = np.indices((N, N + 1, N + 2)) / N
    centers = np.random.default_rng(seed).random((4, 3)) * 0.7 + 0.15
    found = sum(np.exp(-((x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2) / 0.04) for a, b, c in centers)
    return found / found.max()


def function(low, high, alpha, color, shade=SHADE, unit=1.0):
    """Opacity from 0 at ``low`` to ``alpha`` at ``high``; the color gets brighter, so that order along a ray shows."""
    return TransferFunction(
        opacity=((low, 0.0), (high, alpha)), color=((low, *(0.5 * np.array(color))), (2.0 * high, *color)),
        opacity_unit_distance=unit, shade=shade,
    )  # fmt: skip


def parts(count, shade=SHADE):
    """So many volumes of different types and their transfer functions."""
    found = []
    for number, ((kind, scale), color) in enumerate(zip(KINDS[:count], COLORS)):
        volume = Volume((blobs(number) * scale).astype(kind), np.eye(4))
        found.append((volume, function(0.35 * scale, 0.7 * scale, 0.5, color, shade, (1.0, 3.0, 2.0)[number])))
    return found


def scene_of(stage, given, perspective=False, size=(40, 36), **more):
    """A scene of volumes and transfer functions, the first with the further ones as channels."""
    (volume, tf), *further = given
    shape = volume.voxels.shape
    scene = stage.on_turntable(np.zeros(shape), 25.0, 20.0, perspective, size, 1.1)
    fields = {"headlight": tf.shade is not None, **more}
    return replace(
        scene, volume=volume, transfer_function=tf, channels=tuple(Channel(*each) for each in further), **fields
    )


def fine(**knobs):
    usual = {"depth_rule": "preintegrated-4", "sheet_density": 3.0, "warp_filter": "cubic", "rays": 0.0}
    return Quality(name="custom", termination=1 / 4096, **usual | knobs)


def optics(value, tf):
    """(n, 3) color and (n,) extinction of values, by interpolation between a transfer function's points."""
    alpha = np.interp(value, *np.array(tf.opacity).T)
    color = np.stack([np.interp(value, *np.array(tf.color)[:, [0, c]].T) for c in (1, 2, 3)], axis=1)
    return np.nan_to_num(color), -np.log1p(-np.nan_to_num(alpha)) / tf.opacity_unit_distance


def of_channels(scene, at):
    """(n, 3) source and (n,) extinction at points (n, 3): each channel trilinear, then classified."""
    source, sigma = 0.0, 0.0
    for one in (scene, *scene.channels):
        color, own = optics(trilinear(one.volume.voxels, at), one.transfer_function)
        source, sigma = source + color * own[:, None], sigma + own
    return source, sigma


def marched(scene, steps=8, medium=of_channels):
    """(H, W, 4) by sums over ``steps`` samples to a voxel of each ray; ``medium``: what there is at points."""
    camera, shape = scene.camera, np.array(scene.volume.voxels.shape[::-1])
    columns, rows = np.meshgrid(np.arange(scene.width) + 0.5, np.arange(scene.height) + 0.5)
    assert camera.sensor_fit == "VERTICAL"
    x, y = (((2.0 * columns - scene.width) / scene.height).ravel(), (1.0 - 2.0 * rows / scene.height).ravel())
    start, way = np.zeros((len(x), 3)), np.tile((0.0, 0.0, -1.0), (len(x), 1))
    if camera.type == "PERSP":
        way[:, :2] = np.stack((x, y), axis=1) * (0.5 * camera.sensor_height / camera.lens)
    else:
        start[:, :2] = np.stack((x, y), axis=1) * (0.5 * camera.ortho_scale)
    start = start @ camera.matrix_world[:3, :3].T + camera.matrix_world[:3, 3]
    way = way @ camera.matrix_world[:3, :3].T
    to_index = np.linalg.inv(scene.index_to_world)
    length = np.linalg.norm(way, axis=1)
    first, step = start @ to_index[:3, :3].T + to_index[:3, 3], way @ to_index[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.sort(np.stack((-first / step, (shape - 1 - first) / step)), axis=0)
    enter, leave = ends[0].max(axis=1), ends[1].min(axis=1)
    hits, count = leave > enter, steps * shape.sum()
    first, step, enter, length = first[hits], step[hits], enter[hits], length[hits]
    through, total = np.ones(len(first)), np.zeros((len(first), 3))
    delta = (leave[hits] - enter) / count
    for number in range(count):
        at = first + (enter + (number + 0.5) * delta)[:, None] * step
        source, sigma = medium(scene, at)
        depth = sigma * delta * length
        share = np.divide(-np.expm1(-depth), sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
        total += (through * share)[:, None] * source
        through *= np.exp(-depth)
    rgba = np.zeros((scene.height * scene.width, 4))
    rgba[hits] = np.concatenate((total, 1.0 - through[:, None]), axis=1)
    return rgba.reshape(scene.height, scene.width, 4)


def trilinear(voxels, at):
    cell = np.clip(np.floor(at), 0, np.array(voxels.shape[::-1]) - 2).astype(int)
    share, found = np.clip(at - cell, 0.0, 1.0), 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod([s if c else 1.0 - s for s, c in zip(share.T, corner)], axis=0)
        x, y, z = (cell + corner).T
        found = found + weight * voxels[z, y, x].astype(np.float64)
    return found


@pytest.mark.parametrize("perspective", (False, True), ids=("orthographic", "perspective"))
@pytest.mark.parametrize("count", (2, 3))
def test_unlit_channels_are_a_march_along_rays(stage, count, perspective):
    scene = scene_of(stage, parts(count, None), perspective)
    expected = marched(scene)
    assert expected[..., 3].max() > 0.5, "something is seen"
    for knobs in ({}, {"depth_rule": "midpoint-8"}, {"rays": 1e-9}):
        picture = render(scene, fine(**knobs))
        assert picture.report["plan"]["classification"] == "post"
        error = np.abs(picture.rgba - expected).max(axis=-1)
        # In perspective sheets meet the faces of the box at a glance in some pixels, those of one volume, too.
        assert np.quantile(error, 0.99) < 0.8 * LEVEL and ("rays" not in knobs or error.max() < LEVEL), knobs
    without = render(replace(scene, channels=()), fine())
    assert np.abs(without.rgba - expected).max() > 20 * LEVEL, "the channels count"


@pytest.mark.parametrize("light", LIT)
@pytest.mark.parametrize("count", (2, 3))
def test_lit_channels_are_the_truth(stage, count, light):
    scene = scene_of(stage, parts(count), light == "sun", **LIT[light])
    true, depth = truth(scene, "T2", tolerance=1e-5, **shading_of(scene, "T2"))
    most = 1.2 * LEVEL if light == "sun" else 0.8 * LEVEL  # shadows are read from a grid, of one volume, too
    for knobs in ({}, {"rays": 1e-9}):
        picture = render(scene, fine(**knobs))
        error = np.abs(picture.rgba.reshape(-1, 4) - true).max(axis=1)
        assert np.quantile(error, 0.99) < most and ("rays" not in knobs or error.max() < 1.7 * most), knobs
        hit = (depth < 1e9) & (picture.depth.ravel() < 1e9)
        assert np.quantile(np.abs(picture.depth.ravel() - depth)[hit], 0.5) < 0.1
    assert picture.report["rays"]["pixels"] > 100


@pytest.mark.parametrize("light", ("unlit", *LIT))
def test_the_truth_is_a_march_along_rays(stage, light):
    """Of what it adds to T2 of one volume: the sum of channels.  The light of white, matte ambience is 1 everywhere."""
    shade = None if light == "unlit" else Shade(1.0, 0.0, 0.0, 1.0)
    scene = scene_of(stage, parts(3, shade), size=(12, 10), **LIT.get(light, {}))
    true, _ = truth(scene, "T2", tolerance=1e-7, **shading_of(scene, "T2"))
    np.testing.assert_allclose(true, marched(scene, 16).reshape(-1, 4), atol=0.02 * LEVEL)


def with_holes(given):
    """The same volumes, floating-point, with voxels that are no numbers: other ones in each."""
    found = []
    for number, (volume, tf) in enumerate(given):
        voxels = volume.voxels.astype(np.float32)
        voxels[:, :, 5 * number : 5 * number + 3] = np.nan
        found.append((Volume(voxels, np.eye(4)), tf))
    return found


def test_a_channel_is_transparent_where_it_has_no_value_and_others_are_seen(stage):
    scene = scene_of(stage, with_holes(parts(3, None)))
    expected = marched(scene)
    whole = marched(scene_of(stage, parts(3, None)))
    assert np.abs(whole - expected).max() > 20 * LEVEL, "holes are seen"
    for rule in ("midpoint-8", "preintegrated-4"):
        error = np.abs(render(scene, fine(depth_rule=rule)).rgba - expected)
        assert np.quantile(error, 0.99) < 1.0 * LEVEL, "a hole begins at a face of cells, which rays cross in a slab"
    by_rays = render(scene, fine(rays=1e-9)).rgba
    np.testing.assert_allclose(by_rays, expected, atol=1.0 * LEVEL)


@pytest.mark.parametrize("light", ("unlit", *LIT))
@pytest.mark.parametrize("depth_rule", ("midpoint-2", "preintegrated-1"))
def test_kernels_are_numpy(stage, depth_rule, light):
    given = with_holes(parts(3, None if light == "unlit" else SHADE))
    scene = scene_of(stage, given, True, (26, 24), **LIT.get(light, {}))
    for rays in (0.0, 1e-9) if depth_rule == "preintegrated-1" else (0.0,):  # rays are the same by both
        quality = fine(depth_rule=depth_rule, rays=rays)
        kernels, reference = both(lambda quality=quality: render(scene, quality).rgba)
        # Sheets of the kernels share light over optical depths of a few terminations.
        bound = 1e-5 if light == "unlit" or rays else 0.4 * LEVEL
        np.testing.assert_allclose(kernels, reference, atol=bound)


def test_clips_and_mist_cut_and_fade_all_channels(stage):
    turned = np.array(((0.8, -0.6, 0.0, 7.0), (0.6, 0.8, 0.0, 7.0), (0.0, 0.0, 1.0, 6.0), (0.0, 0.0, 0.0, 1.0)))
    clip = Clip("plane", turned @ np.array(((0, 0, 1, 0), (0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 0, 1))))
    scene = scene_of(stage, parts(3), clips=(clip,))
    true, _ = truth(scene, "T2", tolerance=1e-4, **shading_of(scene, "T2"))
    misty = replace(scene, mist=Mist(20.0, 30.0))
    for quality in (fine(depth_rule="midpoint-8"), fine(depth_rule="preintegrated-4")):
        picture = render(scene, quality)
        error = np.abs(picture.rgba.reshape(-1, 4) - true).max(axis=1)
        assert np.quantile(error, 0.98) < 1.0 * LEVEL
        whole = render(replace(scene, clips=()), quality).rgba
        assert np.abs(picture.rgba - whole).max() > 20 * LEVEL
        kernels, reference = both(lambda quality=quality: render(misty, quality).rgba)
        np.testing.assert_allclose(kernels, reference, atol=0.4 * LEVEL)
        assert np.abs(kernels - picture.rgba).max() > 5 * LEVEL


@pytest.mark.parametrize("light", ("unlit", *LIT))
def test_threads_and_crops_have_the_same_bits(stage, light):
    scene = scene_of(stage, parts(3, None if light == "unlit" else SHADE), size=(70, 64), **LIT.get(light, {}))
    for rule in ("midpoint-2", "preintegrated-1"):
        one, two = (render(scene, fine(depth_rule=rule, threads=threads)) for threads in (1, 2))
        assert one.rgba.tobytes() == two.rgba.tobytes() and one.depth.tobytes() == two.depth.tobytes()
        part = render(replace(scene, crop=(20, 10, 60, 50)), fine(depth_rule=rule))
        assert part.rgba.tobytes() == one.rgba[10:50, 20:60].tobytes()


@pytest.mark.parametrize("light", ("unlit", *LIT))
@pytest.mark.parametrize("depth_rule", ("midpoint-4", "preintegrated-1"))
def test_a_channel_that_shows_nothing_changes_no_bit(stage, depth_rule, light):
    own = parts(1, None if light == "unlit" else SHADE)
    tf = own[0][1]
    quality = fine(depth_rule=depth_rule)
    alone = render(scene_of(stage, own, **LIT.get(light, {})), quality)
    transparent = Volume(parts(2)[1][0].voxels, np.eye(4)), function(1.0, 2.0, 0.0, COLORS[1])
    empty = Volume(np.zeros(own[0][0].voxels.shape, np.uint16), np.eye(4)), tf
    for further in (transparent, empty):
        picture = render(scene_of(stage, [*own, further], **LIT.get(light, {})), quality)
        assert picture.rgba.tobytes() == alone.rgba.tobytes() and picture.depth.tobytes() == alone.depth.tobytes()


@pytest.mark.parametrize("light", ("unlit", *LIT))
def test_two_equal_channels_of_half_the_extinction_are_one(stage, light):
    ((volume, tf),) = parts(1, None if light == "unlit" else SHADE)
    half = replace(tf, opacity_unit_distance=2.0 * tf.opacity_unit_distance)
    for quality in (fine(), fine(depth_rule="midpoint-2"), fine(rays=1e-9)):
        one = render(scene_of(stage, [(volume, tf)], **LIT.get(light, {})), quality)
        two = render(scene_of(stage, [(volume, half), (volume, half)], **LIT.get(light, {})), quality)
        # Codes of T have 15 bits, and light is evaluated anew at a depth that rounding may just miss.
        np.testing.assert_allclose(two.rgba, one.rgba, atol=1e-5 if light == "unlit" else 0.05 * LEVEL)


def test_order_does_not_matter(stage):
    given = parts(3, None)
    pictures = [render(scene_of(stage, order), fine()).rgba for order in (given, given[::-1])]
    np.testing.assert_allclose(pictures[0], pictures[1], atol=2e-6)


def stains(count, shade=None):
    """So many volumes of microscopy, in primary colors."""
    primaries = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    made = zip(parts(count), primaries)
    return [
        (replace(volume, color=color), replace(tf, color=((0.0, *color),), shade=shade)) for (volume, tf), color in made
    ]


def test_light_of_stains_adds_up(stage):
    """Red and green at one place are yellow, as in ImageJ's composites, and each stays as bright as alone."""
    given = stains(3)
    alone = [render(scene_of(stage, [one])).rgba for one in given]
    opacity = 1.0 - np.prod([1.0 - one[..., 3] for one in alone], axis=0)
    found = render(scene_of(stage, given))
    np.testing.assert_allclose(found.rgba[..., :3], np.minimum(sum(alone)[..., :3], opacity[..., None]), atol=1e-6)
    np.testing.assert_allclose(found.rgba[..., 3], opacity, atol=1e-6)
    assert next(row for row in found.report["effects"] if row["name"] == "channels")["on"]
    forced = {"channels": True, "labels": True, "mode": False}
    labels = Labels(Volume(np.ones(given[0][0].voxels.shape, np.uint8), np.eye(4)), {5: None})
    again = render(scene_of(stage, given, effects=forced, labels=labels))
    np.testing.assert_allclose(again.rgba, found.rgba, atol=1e-6)
    (volume, red), _ = stains(2)
    green = replace(red, color=((0.0, 0.0, 1.0, 0.0),))
    yellow = render(scene_of(stage, [(volume, red), (volume, green)])).rgba
    np.testing.assert_array_equal(yellow[..., 0], yellow[..., 1])
    np.testing.assert_allclose(yellow[..., 0], render(scene_of(stage, [(volume, red)])).rgba[..., 0], atol=1e-6)
    assert yellow[..., 0].max() > 0.5


def test_lit_stains_hide_each_other(stage):
    """What is lit is a surface: colors are averaged, in the same picture as without colors of the file."""
    given = stains(2, SHADE)
    plain = [(replace(volume, color=None), tf) for volume, tf in given]
    pictures = [render(scene_of(stage, one)).rgba for one in (given, plain)]
    np.testing.assert_array_equal(*pictures)


def test_light_of_stains_has_no_reference(stage):
    for check in (lambda scene: render_within(scene, 1.0), lambda scene: measurable_scene(scene, Quality())):
        with pytest.raises(RleSplatError, match="whose pictures add up; choose a quality"):
            check(scene_of(stage, stains(2)))


def test_a_tolerance_is_kept(stage):
    scene = scene_of(stage, parts(2), size=(48, 40))
    picture = render_within(scene, 1.0)
    true, _ = truth(scene, "T2", tolerance=1e-4, **shading_of(scene, "T2"))
    assert np.abs(picture.rgba.reshape(-1, 4) - true).max() < 1.0 * LEVEL
    assert picture.report["error"]["truth"] == "T2" and picture.report["error"]["kept"]
    labeled = replace(scene, labels=Labels(Volume(np.ones(scene.volume.voxels.shape, np.uint8), np.eye(4)), {1: None}))
    for refused, quality in ((labeled, Quality()), (scene, Quality(classification="pre"))):
        with pytest.raises(RleSplatError, match="choose a quality, or for channels the classification post"):
            render_within(refused, 1.0, quality)
        with pytest.raises(
            RleSplatError, match="cannot be measured with labels, or with channels and the classification pre"
        ):
            measurable_scene(refused, quality)
    assert measurable_scene(scene, Quality()).channels


def ramps(slopes):
    """Volumes that rise by so many values a voxel along x, y, z each."""
    z, y, x = np.indices((12, 12, 12)).astype(np.float64)
    return [Volume((100.0 + a * x + b * y + c * z).astype(np.float32), np.eye(4)) for a, b, c in slopes]


def test_normals_are_the_mean_by_what_is_shown(stage):
    """Two ramps, along x and along y, of an extinction that is twice as large in the second: m of both is 1 long."""
    one, two = ramps([(4.0, 0.0, 0.0), (0.0, 4.0, 0.0)])
    flat = [function(0.0, 1.0, 0.3, COLORS[0], unit=unit) for unit in (2.0, 1.0)]
    scene = scene_of(stage, list(zip((one, two), flat)))
    m, beside = PostLight(scene, world_opacity_distance(scene)).surfaces(*np.full((3, 1), 6))
    matrix = scene.index_to_world[:3, :3]
    expected = -(matrix[:, 0] / 3.0 + 2.0 * matrix[:, 1] / 3.0)  # to lower values
    # E, the error of float32, leaves 1e-4 of the trust.
    np.testing.assert_allclose(m[0], expected, atol=2e-3)
    assert np.linalg.norm(beside[0] - 6.0) > 0.5


@pytest.mark.parametrize("kind", (np.uint8, np.int16, np.float32))
def test_what_is_shown_around_a_voxel(kind):
    """The renderer's mean extinction by a table is that of the truth, and of a sum over values."""
    volume = Volume((blobs(5) * 100.0).astype(kind), np.eye(4))
    opacity = (20.0, 0.0), (40.0, 0.6), (40.0, 0.1), (90.0, 0.0)
    tf = TransferFunction(opacity=opacity, color=((0.0, 1.0, 1.0, 1.0),), opacity_unit_distance=2.0, shade=None)
    table = lookup_table(volume, tf, volume.value_range, 2.0)
    low = np.array([0.0, 25.0, 30.0, 38.0, 50.0, 50.0, 95.0])
    high = np.array([10.0, 25.0, 35.0, 60.0, 200.0, 80.0, 99.0])
    values = low + (high - low) * ((np.arange(20000) + 0.5) / 20000)[:, None]
    depth = -np.log1p(-np.where(values < 40.0, np.interp(values, (20.0, 40.0), (0.0, 0.6)),
                                np.interp(values, (40.0, 90.0), (0.1, 0.0))))  # fmt: skip
    expected = depth.mean(axis=0) / 2.0
    np.testing.assert_allclose(true_mean_extinction(tf, low, high, 2.0), expected, atol=1e-4)
    np.testing.assert_allclose(mean_extinction(table, np.array((low, high), np.float32)), expected, atol=3e-3)


def test_values_around_a_voxel():
    voxels = np.random.default_rng(1).integers(0, 200, (5, 6, 7)).astype(np.float32)
    voxels[2, 3, 4] = np.nan
    volume = Volume(voxels, np.eye(4))
    kept = every_voxel(volume)
    low, high = drain(nearby_steps(volume, kept, ()))
    padded = np.pad(voxels, 1, constant_values=np.nan)
    around = np.stack([padded[z : z + 5, y : y + 6, x : x + 7] for z, y, x in np.ndindex(3, 3, 3)])
    np.testing.assert_array_equal(low, np.nanmin(around, axis=0).ravel())
    np.testing.assert_array_equal(high, np.nanmax(around, axis=0).ravel())


def every_voxel(volume):
    from rle_splat.classify.visible import VisibleVoxels

    nx, ny, nz = volume.shape_xyz
    column = np.tile(np.arange(nx, dtype=np.uint16), ny * nz)
    starts = np.arange(ny * nz + 1, dtype=np.int64) * nx
    return VisibleVoxels(volume.shape_xyz, starts, np.ones(ny * nz, np.int32), column, volume.voxels.ravel(), 0)


def test_a_change_of_a_channel_makes_a_new_picture(stage):
    """Each is that of a cache without anything in it."""
    given, cache = parts(2), StageCache()
    (_, own), (volume, tf) = given
    hole = volume.voxels.copy()
    hole[:, :7] = 0.0
    changes = [
        [given[0], (volume, function(1.2, 2.0, 0.3, COLORS[2]))],
        [given[0], (volume, function(1.2, 2.0, 0.3, COLORS[1]))],
        [given[0], (volume, replace(tf, opacity_unit_distance=9.0))],
        [given[0], (Volume(hole, np.eye(4)), tf)],
        [(given[0][0], replace(own, opacity=((60.0, 0.0), (90.0, 0.9)))), given[1]],
        given[:1],
    ]
    sun, seen = LIT["sun"], [render(scene_of(stage, given, **LIT["sun"]), fine(), cache=cache).rgba]
    for changed in changes:
        scene = scene_of(stage, changed, **sun)
        kept = render(scene, fine(), cache=cache).rgba
        assert kept.tobytes() == render(scene, fine()).rgba.tobytes()
        assert all(np.abs(kept - other).max() > 2 * LEVEL for other in seen)
        seen.append(kept)
    scene = scene_of(stage, given, **sun)
    assert render(scene, fine(), cache=cache).rgba.tobytes() == seen[0].tobytes()
    made = dict(cache.made)
    camera = replace(scene.camera, ortho_scale=2.0 * scene.camera.ortho_scale)
    render(replace(scene, camera=camera), fine(), cache=cache)
    assert cache.made == made, "nothing is made again when the camera moves"


def test_modes_keep_one_volume(stage):
    scene = scene_of(stage, parts(2))
    plain = render(scene, Quality())
    assert plain.report["plan"]["classification"] == "post" and not plain.report["remarks"]
    assert plain.report["error"]["truth"] == "T2" and plain.report["stages_ms"]["mixing"] > 0.0
    for mode in ("xray", "mip"):
        picture = render(replace(scene, mode=mode), Quality())
        alone = render(replace(scene, mode=mode, channels=()), Quality())
        assert picture.rgba.tobytes() == alone.rgba.tobytes()
        effect = next(effect for effect in picture.report["effects"] if effect["name"] == "channels")
        assert not effect["on"] and effect["reason"] == f"the mode {mode} shows the values of one volume"
    with pytest.raises(RleSplatError, match="The channel has"):
        replace(scene, channels=(Channel(Volume(np.zeros((3, 3, 3), np.uint8), np.eye(4)), parts(1)[0][1]),))
