"""Proves that the single rays of a quality go where its picture is steepest and make it better there: they are the
truth T2 up to their slabs, all else is as without them; a crop, any number of threads and numpy give the same; what
rays know nothing of is left alone; and the report says how many there were."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rle_splat.accuracy.metrics import LEVEL
from rle_splat.accuracy.rays import camera_rays
from rle_splat.accuracy.truths import truth
from rle_splat.classify.transfer_function import GradientOpacity, Shade, TransferFunction
from rle_splat.effects.mesh_depth import mesh_depth
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import use_reference
from rle_splat.scene import NO_DEPTH, NO_RAYS, Clip, Light, Mist, Quality, RleSplatError
from rle_splat.warp import steep as steepness
from rle_splat.warp.steep import ALWAYS, TILE, most_in_tile, steep_pixels
from tests.truths.other_rays import depth_to_plane
from tests.ways import both

PROJECTIONS = pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
SIZE, STEEP = (72, 64), 0.3
COLORS = ((0.0, 0.9, 0.3, 0.1), (0.6, 0.2, 0.8, 0.3), (1.0, 0.3, 0.4, 1.0))
BONE = TransferFunction("bone", None, ((0.45, 0.0), (0.55, 0.9), (1.0, 0.95)), COLORS, 1.0, None)
POST = Quality(rays=STEEP, sheet_density=1.0, termination=1e-6)


@cache
def knots():
    """A field whose surfaces are opaque, bent, and cut by the volume's faces; some of it is no number."""
    z, y, x = np.mgrid[:18, :20, :22].astype(np.float64)
    field = 0.5 + 0.5 * np.sin(0.5 * x + 0.3 * y) * np.cos(0.45 * y - 0.6 * z + 0.3) * np.cos(0.2 * x * z / 9.0)
    field[4, 5, 6:9] = np.nan
    return field.astype(np.float32)


def scene_of(stage, perspective=False, **more):
    return stage.on_turntable(
        knots(), perspective=perspective, size=SIZE, fit=0.9, **{"transfer_function": BONE, **more}
    )


def without(quality):
    return replace(quality, rays=NO_RAYS, name="without")  # a preset's name would call for a plan


@pytest.mark.parametrize(
    "name, slabs, perspective", (("standard", 4, False), ("fine", 6, True), ("strict", 8, False), ("strict", 8, True))
)
def test_steep_pixels_are_the_truth_and_others_as_they_were(stage, name, slabs, perspective):
    scene, quality = scene_of(stage, perspective), replace(Quality.preset(name), rays=STEEP)
    before, after = render(scene, without(quality)), render(scene, quality)
    steep = steep_pixels(before.rgba, STEEP)
    assert 0.01 < steep.mean() < 0.9
    assert (after.rgba[~steep] == before.rgba[~steep]).all() and (after.depth[~steep] == before.depth[~steep]).all()
    true = truth(scene, "T2", tolerance=1e-8)[0].reshape(before.rgba.shape)
    errors = [np.sqrt(((rendering.rgba - true)[steep] ** 2).mean()) / LEVEL for rendering in (before, after)]
    assert errors[1] < 0.5 and errors[1] < 0.5 * errors[0], errors
    assert after.report["rays"] == {"pixels": steep.sum(), "share": steep.mean(), "slabs": slabs}
    assert after.report["stages_ms"]["rays"] > 0.0 and after.report["plan"]["rays"] == STEEP
    assert before.report["rays"]["pixels"] == 0 and before.report["stages_ms"]["rays"] == 0.0


@PROJECTIONS
def test_a_crop_is_the_same_part_of_the_picture(stage, perspective):
    scene = scene_of(stage, perspective, headlight=True)
    whole, cache = render(scene, POST), StageCache()
    crops = (0, 0, 9, 64), (23, 17, 60, 44), (31, 30, 32, 31), (60, 50, 72, 64), (1, 1, 71, 63)
    for left, top, right, bottom in crops:
        part = render(replace(scene, crop=(left, top, right, bottom)), POST, cache=cache)
        assert (part.rgba == whole.rgba[top:bottom, left:right]).all()
        assert (part.depth == whole.depth[top:bottom, left:right]).all()
        assert part.report["image"]["crop"] == [left, top, right, bottom]


@pytest.mark.parametrize("perspective, lit", ((False, True), (True, False), (True, True)))
def test_the_same_with_any_number_of_threads_and_without_numba(stage, lit, perspective):
    more = {}
    if lit:
        shade = Shade(ambient=0.2, diffuse=0.7, specular=0.4, shininess=12.0)
        lights = (Light(energy=2.0, color=(1.0, 0.6, 0.3), matrix_world=np.diag((1.0, -1.0, -1.0, 1.0))),)
        more = {"transfer_function": replace(BONE, shade=shade), "lights": lights}
    scene = scene_of(stage, perspective, **more)
    found = render(scene, POST)
    one = render(scene, replace(POST, threads=1))
    assert (found.rgba == one.rgba).all() and (found.depth == one.depth).all()
    with use_reference():
        reference = render(scene, POST)
    assert reference.report["rays"] == found.report["rays"] and found.report["rays"]["pixels"] > 50
    steep = steep_pixels(render(scene, without(POST)).rgba, STEEP)
    assert np.abs(reference.rgba - found.rgba)[steep].max() < 4e-6
    assert ((reference.depth == NO_DEPTH) == (found.depth == NO_DEPTH))[steep].all()
    assert np.abs(reference.depth - found.depth)[steep & (found.depth != NO_DEPTH)].max() < 1e-4


MIDDLE = np.array(((4.0, 0.0, 0.0, 10.5), (0.0, 5.0, 0.0, 9.5), (0.0, 0.0, 4.0, 8.5), (0.0, 0.0, 0.0, 1.0)))
POINT, NORMAL = (10.0, 9.0, 8.0), np.array((0.5, -0.6, 0.4))


def wall(start=-300.0):
    """Two triangles of a plane through the volume; ``start``: where they begin, 300 behind the point at the most."""
    u = np.cross(NORMAL, (0.0, 0.0, 1.0))
    v = np.cross(NORMAL, u)
    a, b, c, d = (np.array(POINT) + s * u + t * v for s, t in ((start, -300), (300, -300), (300, 300), (start, 300)))
    return np.array(((a, b, c), (a, c, d)))


@PROJECTIONS
@pytest.mark.parametrize("clips", ((), (Clip("box", MIDDLE, "outside"),)), ids=("whole", "cut"))
@pytest.mark.parametrize("given", ("triangles", "ray_ends"))
def test_steep_pixels_end_at_meshes(stage, given, clips, perspective):
    scene = scene_of(stage, perspective, clips=clips)
    far = depth_to_plane(camera_rays(scene.camera, *SIZE), POINT, NORMAL)
    ended = replace(
        scene, **{"triangles": wall()} if given == "triangles" else {"ray_ends": far.reshape(SIZE[::-1]).astype("f4")}
    )
    before, after = render(ended, without(POST)), render(ended, POST)
    steep = steep_pixels(before.rgba, STEEP)
    true = truth(scene, "T2", far=far, tolerance=1e-8)[0].reshape(before.rgba.shape)
    errors = [np.sqrt(((rendering.rgba - true)[steep] ** 2).mean()) / LEVEL for rendering in (before, after)]
    assert steep.sum() > 60 and errors[1] < (0.9 if clips else 0.5) and errors[1] < 0.5 * errors[0], errors
    assert np.abs(render(scene, POST).rgba - after.rgba).max() > 0.3, "the mesh hides nothing"


@PROJECTIONS
def test_a_crop_of_a_cut_volume_with_a_mesh_has_the_pixels_of_the_whole(stage, perspective):
    scene = scene_of(stage, perspective, triangles=wall(0.3), clips=(Clip("box", MIDDLE, "outside"),))
    left, top, right, bottom = crop = (20, 13, 57, 49)
    whole, part = render(scene, POST), render(replace(scene, crop=crop), POST)
    assert part.report["rays"]["pixels"] > 50
    np.testing.assert_array_equal(part.rgba, whole.rgba[top:bottom, left:right])
    np.testing.assert_array_equal(part.depth, whole.depth[top:bottom, left:right])


@PROJECTIONS
def test_rays_past_silhouettes_are_mixed(stage, perspective):
    """Each pixel is what it would be with and without the wall, by the share that the wall covers of it."""
    everywhere, scene = replace(POST, rays=1e-9), scene_of(stage, perspective)
    part = replace(scene, triangles=wall(0.3))
    free, hidden, found = (
        render(one, everywhere).rgba for one in (scene, replace(scene, triangles=wall()), part)
    )  # fmt: skip
    covered = np.isfinite(mesh_depth(part.triangles, part.camera, *SIZE)).mean(axis=-1)[..., None]
    edge = ((covered > 0.0) & (covered < 1.0))[..., 0]
    assert edge.sum() > 20 and np.abs(free - hidden)[edge].max() > 0.2
    assert np.abs(found - covered * hidden - (1.0 - covered) * free)[edge].max() < 2.0 * LEVEL
    assert np.abs(found - np.where(covered > 0.0, hidden, free))[~edge].max() < 1.0 * LEVEL


@PROJECTIONS
def test_depths_of_rays_are_where_half_is_absorbed(stage, perspective):
    scene = scene_of(stage, perspective)
    everywhere = render(scene, replace(POST, rays=1e-9))
    depth = truth(scene, "T2", tolerance=1e-8)[1].reshape(everywhere.depth.shape)
    traced = steep_pixels(render(scene, without(POST)).rgba, 1e-9)
    both = traced & (depth != NO_DEPTH) & (everywhere.depth != NO_DEPTH)
    # Where hardly anything is absorbed about the half, a hair's breadth of light decides which surface it is.
    assert both.sum() > 500 and np.quantile(np.abs(everywhere.depth - depth)[both], 0.95) < 0.05
    assert ((depth == NO_DEPTH) != (everywhere.depth == NO_DEPTH))[traced].mean() < 0.005


def test_what_was_shown_before_does_not_change_a_picture(stage):
    cache = StageCache()
    wide = replace(BONE, name="wide", opacity=((0.1, 0.0), (0.3, 0.5), (1.0, 0.9)))
    quality = replace(POST, depth_rule="gauss2")
    render(scene_of(stage, transfer_function=wide), quality, cache=cache)
    again = render(scene_of(stage), quality, cache=cache)
    assert (again.rgba == render(scene_of(stage), quality).rgba).all()


@pytest.mark.parametrize("change", ("mist", "mode", "gradients"))
def test_what_rays_know_nothing_of_is_left_to_the_sheets(stage, change):
    scene = scene_of(stage)
    steep = replace(BONE, gradient_opacity=GradientOpacity(0.05, 0.3))
    changes = {
        "mist": {"mist": Mist(1.0, 60.0)}, "mode": {"mode": "xray"}, "gradients": {"transfer_function": steep},
    }  # fmt: skip
    changed = replace(scene, **changes[change])
    rendering = render(changed, POST)
    assert rendering.report["rays"]["pixels"] == 0
    assert (rendering.rgba == render(changed, without(POST)).rgba).all()
    assert (rendering.rgba != render(scene, POST).rgba).any()


def test_rays_are_of_post_alone():
    assert Quality.preset("strict").classified("pre").rays == NO_RAYS
    assert replace(POST, depth_rule="simpson", name="custom").classified("pre").rays == NO_RAYS
    for wrong in ({"classification": "pre", "rays": 0.5}, {"rays": -0.1}, {"rays": np.nan}):
        with pytest.raises(RleSplatError):
            Quality(**wrong)


@PROJECTIONS
def test_of_noise_no_more_than_a_part_is_traced_and_a_crop_has_the_same_pixels(stage, perspective, monkeypatch):
    monkeypatch.setattr(steepness, "ENOUGH", 100)
    noise, quality = np.random.default_rng(5).random((24, 24, 24)).astype(np.float32), replace(POST, rays=0.05)
    scene = stage.on_turntable(noise, perspective=perspective, size=SIZE, fit=1.0, transfer_function=BONE)
    whole, plain, cache = render(scene, quality), render(scene, without(quality)), StageCache()
    traced = (whole.rgba != plain.rgba).any(axis=-1)
    assert 0.8 < steep_pixels(plain.rgba, quality.rays).mean()
    assert whole.report["rays"]["pixels"] == 5 * 4 * ALWAYS  # tiles, those that the frame cuts among them
    assert 0.9 * whole.report["rays"]["pixels"] < traced.sum() <= whole.report["rays"]["pixels"]
    for left, top, right, bottom in ((0, 0, 9, 64), (23, 17, 60, 44), (31, 32, 32, 33), (48, 48, 72, 64)):
        part = render(replace(scene, crop=(left, top, right, bottom)), quality, cache=cache)
        assert (part.rgba == whole.rgba[top:bottom, left:right]).all()
        assert (part.depth == whole.depth[top:bottom, left:right]).all()


def steep_everywhere(rgba, threshold):
    """(H, W) bool: where neighbors differ, however many there are."""
    steep = np.zeros(rgba.shape[:2], bool)
    for row, column in np.ndindex(steep.shape):
        around = rgba[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].reshape(-1, 4)
        steep[row, column] = (around.max(axis=0) - around.min(axis=0) >= np.float32(threshold)).any()
    return steep


def test_steep_pixels_are_those_of_which_neighbors_differ():
    random = np.random.default_rng(3)
    for shape in ((1, 1), (1, 7), (9, 2), (33, 70)):
        rgba = random.random((*shape, 4)).astype(np.float32) ** 3
        expected = steep_everywhere(rgba, 0.97)
        assert not expected.size > 100 or 0.1 < expected.mean() < 0.4
        for found in both(lambda: steep_pixels(rgba, 0.97)):  # noqa: B023 - called at once
            assert (found == expected).all()


def test_up_to_five_levels_all_that_is_seen_is_traced():
    """An even square: its inside, where no neighbors differ, and the pixels around it."""
    rgba = np.zeros((9, 12, 4), np.float32)
    rgba[2:7, 3:9] = 0.4
    expected = np.zeros((9, 12), bool)
    expected[1:8, 2:10] = True
    for found in both(lambda: steep_pixels(rgba, steepness.UNLIMITED)):
        assert (found == expected).all()
    assert not steep_pixels(rgba, 1.01 * steepness.UNLIMITED)[4, 5]


def test_small_pictures_may_have_all_their_pixels_traced_and_large_ones_a_quarter():
    assert most_in_tile(1, 1, 0.5) >= most_in_tile(256, 256, 0.5) == TILE**2
    assert most_in_tile(512, 256, 0.5) == TILE**2 // 2
    assert most_in_tile(512, 512, 0.5) == most_in_tile(3840, 2160, 0.021) == TILE**2 // 4
    assert most_in_tile(3840, 2160, 0.02) == TILE**2


@pytest.mark.parametrize("first_pixel", ((0, 0), (5, 30)))
def test_of_a_tile_the_steepest_pixels_count_and_of_equal_ones_the_first(first_pixel):
    """Single lit pixels in the dark: each makes nine steep, as far apart as it is bright."""
    random = np.random.default_rng(7)
    rgba = random.choice(np.array((0.0, 0.1, 0.5, 0.75, 1.0), np.float32), (50, 41, 1), p=(0.9, 0.04, 0.02, 0.02, 0.02))
    rgba = np.repeat(rgba, 4, axis=2)
    around = np.pad(rgba[..., 0], 1, mode="edge")
    beside = [around[row : row + 50, column : column + 41] for row, column in np.ndindex(3, 3)]
    apart = np.max(beside, axis=0) - np.min(beside, axis=0)
    expected = np.zeros(apart.shape, bool)
    tiles = [(np.arange(size) + first) // TILE for size, first in zip(apart.shape[::-1], first_pixel, strict=True)]
    crowded = 0
    for row in np.unique(tiles[1]):
        for column in np.unique(tiles[0]):
            mine = [(y, x) for y in np.flatnonzero(tiles[1] == row) for x in np.flatnonzero(tiles[0] == column)]
            mine = [place for place in mine if apart[place] >= np.float32(0.05)]
            crowded += len(mine) > ALWAYS
            for place in sorted(mine, key=lambda place: -apart[place])[:ALWAYS]:
                expected[place] = True
    assert crowded > 4
    for found in both(lambda: steep_pixels(rgba, 0.05, ALWAYS, first_pixel)):
        assert (found == expected).all()
