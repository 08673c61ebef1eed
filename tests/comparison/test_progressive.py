"""Previews: coarse to fine, at the same position, as bright as the picture, and never further from it than they say."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.phantoms import smooth_shell
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.comparison.medium import scene_medium
from rle_splat.encode import nodes
from rle_splat.pipeline import previews as progressive
from rle_splat.pipeline.encode_scene import encode_scene
from rle_splat.pipeline.render import render
from rle_splat.pipeline.scan_source import ScanSource
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.jit import numba
from rle_splat.runtime.steps import drain
from rle_splat.scene import Light, Quality, RleSplatError

BACKENDS = ["numpy", pytest.param("numba", marks=pytest.mark.skipif(numba is None, reason="numba is not installed"))]
# What the renderer itself may be off by, in a preview and in the picture: its filter rings beside sharp edges.
SLACK, SHARP_SLACK = 2.5 / 255.0, 6.0 / 255.0


@pytest.fixture(autouse=True)
def small_volumes(monkeypatch):
    """Volumes of test size have previews too."""
    monkeypatch.setattr(progressive, "LEAST_SIDE", 8)


def speckled(n=37, seed=5):
    """Sharp-edged clutter in every opacity: (n, n + 3, n + 1) float64."""
    random = np.random.default_rng(seed)
    coarse = random.random((n // 3 + 2, n // 3 + 2, n // 3 + 2)) < 0.4
    filled = coarse.repeat(3, 0).repeat(3, 1).repeat(3, 2)[:n, : n + 3, : n + 1]
    return np.where(filled, random.random(filled.shape) ** 3, 0.0)


def nodes_of(stand, field, level, backend):
    """(Nodes, dense records (nz, ny, nx, 4), brightest) of a field."""
    medium = scene_medium(stand.scene(field), stand.quality)
    records = np.concatenate(
        (medium.classified.extinction[:, None] * medium.colors, medium.classified.extinction[:, None]), axis=1)
    brightest = float(medium.colors.max())

    def write(positions, out):
        first, last = positions.span
        out[: last - first] = records[first:last]

    made = drain(nodes.node_steps(medium.classified.voxels, write, level, brightest, backend))
    return made, medium.field[1:-1, 1:-1, 1:-1], brightest


def extended(records, brightest):
    return np.concatenate((records, brightest * records[..., 3:] - records[..., :3]), axis=-1)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("level", (1, 2, 3))
def test_nodes_against_brute_force(stand, monkeypatch, backend, level):
    monkeypatch.setattr(nodes, "VOXELS_AT_ONCE", 1000)  # several pieces of work
    made, dense, brightest = nodes_of(stand, speckled(19), level, backend)
    for step in range(2):  # the level itself, and the one that is made of it
        side = 2 ** (level + step)
        shape = tuple(-(-n // side) for n in dense.shape[:3])
        padded = np.zeros((*(side * n for n in shape), 7))
        padded[tuple(slice(n) for n in dense.shape[:3])] = extended(dense.astype(np.float64), brightest)
        blocks = padded.reshape(shape[0], side, shape[1], side, shape[2], side, 7)
        assert made.level == level + step and made.means.shape == (*shape, 4)
        np.testing.assert_allclose(made.means, blocks.mean(axis=(1, 3, 5))[..., :4], atol=1e-6)
        np.testing.assert_allclose(made.least, blocks.min(axis=(1, 3, 5)), atol=1e-6)
        np.testing.assert_allclose(made.most, blocks.max(axis=(1, 3, 5)), atol=1e-6)
        made = made.coarser()


def trilinear(values, points):
    """(m, c) of (nz, ny, nx, c) at points (m, 3) z, y, x in index units, zero outside."""
    values = np.pad(values, ((2, 2), (2, 2), (2, 2), (0, 0))).astype(np.float64)
    points = np.clip(points + 2.0, 0.0, np.array(values.shape[:3]) - 1.001)
    base = np.floor(points).astype(int)
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        weight = np.abs(1.0 - np.array(corner) - (points - base)).prod(axis=1)
        total = total + weight[:, None] * values[tuple((base + corner).T)]
    return total


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("level", (1, 2))
def test_stored_errors_bound_the_difference_of_the_media_everywhere(stand, backend, level):
    made, dense, brightest = nodes_of(stand, speckled(19), level, backend)
    errors = nodes.node_errors(made, backend)
    random = np.random.default_rng(1)
    points = random.uniform(-1.0, np.array(dense.shape[:3]), (200000, 3))  # z, y, x, the ramps outside included
    at = (points - 0.5 * (2**level - 1)) / 2**level
    voxels, means = trilinear(dense, points), trilinear(made.means, at)
    difference = np.abs(extended(voxels, brightest) - extended(means, brightest)).max(axis=1)
    bound = trilinear(errors[..., None], at + 1.0)[:, 0]
    assert (difference <= bound + 1e-5).all()
    assert difference.max() > 0.5 * bound.max()  # and it is not just any large number


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
def test_previews_come_coarse_to_fine_within_their_errors(stand, perspective):
    scene = stand.scene(smooth_shell(68), size=(48, 44), perspective=perspective)
    true = stand.truth(scene)
    shown = list(progressive.previews(scene, stand.quality))
    assert [preview.level for preview in shown] == [3, 2, 1, 0]
    errors = [stand.error(preview.rendering, true).rmse for preview in shown]
    assert errors == sorted(errors, reverse=True) and errors[-1] < 0.2 and errors[-2] < 6.0 < errors[0]
    claims = [preview.mean_error for preview in shown]
    assert claims == sorted(claims, reverse=True) and claims[-1] == 0.0 and claims[-2] < 0.45
    for preview in shown:
        off = np.abs(preview.rendering.rgba - true).max(axis=2)
        assert (off <= preview.error + SLACK).all() and off.mean() <= preview.mean_error + 0.002
        assert preview.error.shape == off.shape
    plain = render(scene, stand.quality)
    np.testing.assert_array_equal(shown[-1].rendering.rgba, plain.rgba)
    np.testing.assert_array_equal(shown[-1].rendering.depth, plain.depth)


def test_previews_keep_the_optical_depth_in_its_place(stand):
    """Under parallel rays every level has as much of it as the voxels, and about the same middle: no half node off."""
    thin = replace(stand.scene(smooth_shell(9)).transfer_function, opacity=((0.0, 0.0), (1.0, 0.04)))
    field = smooth_shell(68)
    field[:20] *= 0.3
    field[:, 40:] *= 0.6
    shown = list(progressive.previews(stand.scene(field, function=thin, size=(48, 44)), stand.quality))
    assert len(shown) == 4
    depths = [-np.log1p(-preview.rendering.rgba[..., 3].astype(np.float64)) for preview in shown]
    np.testing.assert_allclose([depth.sum() for depth in depths], depths[-1].sum(), rtol=0.01)
    for axis in np.indices(depths[0].shape):
        positions = np.array([(axis * depth).sum() / depth.sum() for depth in depths])
        assert np.abs(positions - positions[-1]).max() < 0.1


def test_a_crop_is_previewed_alone(stand):
    scene = stand.scene(smooth_shell(36), size=(48, 44), perspective=True)
    crop = (11, 5, 40, 22)
    part = (slice(5, 22), slice(11, 40))
    whole = list(progressive.previews(scene, stand.quality))
    cropped = list(progressive.previews(replace(scene, crop=crop), stand.quality))
    for one, other in zip(whole, cropped, strict=True):
        assert one.level == other.level
        np.testing.assert_array_equal(one.rendering.rgba[part], other.rendering.rgba)
        np.testing.assert_array_equal(one.error[part], other.error)


@pytest.mark.parametrize("lit", ("plain", "headlight", "lamp"))
def test_errors_hold_for_sharp_edges_and_bright_colors(stand, lit):
    function = TransferFunction(
        name="bright", opacity=((0.0, 0.0), (0.02, 0.0), (0.02, 0.05), (1.0, 1.0)),
        color=((0.0, 0.9, 0.1, 0.0), (0.3, 0.0, 1.0, 0.2), (1.0, 0.1, 0.2, 1.0)), opacity_unit_distance=1.0,
        shade=None if lit == "plain" else Shade(0.3, 0.9, 0.4, 8.0))
    place = np.eye(4)
    place[:3, 3] = 60.0, -50.0, 40.0
    lamp = Light("POINT", energy=9e5, matrix_world=place)
    scene = stand.scene(
        speckled(), size=(40, 40), perspective=True, function=function, headlight=lit == "headlight",
        lights=(lamp,) if lit == "lamp" else ())
    shown = list(progressive.previews(scene, stand.quality))
    picture = shown[-1].rendering.rgba
    if lit == "lamp":
        assert picture[..., :3].max() > 1.2
    assert [preview.level for preview in shown] == [2, 1, 0]
    for preview in shown[:-1]:
        off = np.abs(preview.rendering.rgba - picture).max(axis=2)
        assert (off <= preview.error + SHARP_SLACK).all()
        assert off.mean() <= preview.mean_error and off.max() > 0.1


def test_both_backends_preview_alike(stand):
    pytest.importorskip("numba")
    scene = stand.scene(speckled(), size=(32, 30))
    one, other = (
        list(progressive.previews(scene, replace(stand.quality, backend=backend))) for backend in ("numpy", "numba"))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a.rendering.rgba, b.rendering.rgba, atol=2e-4)
        np.testing.assert_allclose(a.error, b.error, atol=5e-3)


def shown_by(steps):
    """Levels of the Previews that a generator yields, and what it returns."""
    levels = []
    while True:
        try:
            step = next(steps)
        except StopIteration as finished:
            return levels, finished.value
        if isinstance(step, progressive.Preview):
            levels.append(step.level)


def test_a_quick_picture_has_no_previews_and_a_slow_one_few(stand, monkeypatch):
    scene = stand.scene(smooth_shell(68), size=(48, 44))
    plain = render(scene, stand.quality)
    levels, picture = shown_by(progressive.progressive_steps(scene, stand.quality))
    assert levels == []
    np.testing.assert_array_equal(picture.rgba, plain.rgba)
    monkeypatch.setattr(progressive, "WORTH_WAITING", 1e-3)
    monkeypatch.setattr(progressive, "PER_PREVIEW_PIXEL", 1.0)  # previews would take longer than the picture
    levels, picture = shown_by(progressive.progressive_steps(scene, stand.quality))
    assert levels == [1]
    np.testing.assert_array_equal(picture.rgba, plain.rgba)


def test_previews_of_what_is_not_classified_voxels_claim_no_bound(stand):
    """They are the same averages; the picture is the one that is made at once."""
    scene = stand.scene(smooth_shell(68), size=(48, 44))
    quality = Quality.preset("standard", classification="post")
    of_voxels = [shown.rendering.rgba for shown in progressive.previews(scene, quality.classified("pre"))]
    *shown, picture = progressive.previews(scene, quality)
    assert len(shown) == len(of_voxels) - 1 > 0
    for preview, rgba in zip(shown, of_voxels):
        assert preview.error is None and preview.mean_error is None
        assert preview.describe() == f"preview of {2**preview.level} voxels a side"
        np.testing.assert_array_equal(preview.rendering.rgba, rgba)
    np.testing.assert_array_equal(picture.rendering.rgba, render(scene, quality).rgba)
    assert picture.rendering.report["plan"]["classification"] == "post" and picture.level == 0


def test_a_preview_is_left_out_where_only_the_picture_fits(stand, monkeypatch):
    """Tables of the scalar are smaller than those of classified voxels, which nodes are made of."""
    scene = stand.scene(smooth_shell(68), size=(48, 44))

    def refuse(*_):
        raise RleSplatError("This would not fit.")
        yield

    monkeypatch.setattr(ScanSource, "classify_steps", refuse)
    levels = [preview.level for preview in progressive.previews(scene, Quality())]
    assert levels == [0]
    with pytest.raises(RleSplatError, match="not fit"):
        list(progressive.previews(scene, stand.quality))


def test_where_there_are_none(stand, monkeypatch):
    scene = stand.scene(smooth_shell(36), size=(32, 30))
    stored = replace(scene, volume=encode_scene(scene, stand.quality))
    for shown, quality in ((stored, stand.quality), (scene, Quality.paper()), (stand.scene(smooth_shell(7)), None)):
        assert [preview.level for preview in progressive.previews(shown, quality)] == [0]
    monkeypatch.setattr(progressive, "available_bytes", lambda: 10000)  # no memory to spare
    assert [preview.level for preview in progressive.previews(scene, stand.quality)] == [0]


def test_levels_are_bounded(monkeypatch):
    monkeypatch.setattr(progressive, "LEAST_SIDE", 32)
    for shape in ((256, 256, 256), (1024, 1024, 1024), (512, 512, 46), (65, 3, 3), (2000, 300, 20)):
        levels = progressive.preview_levels(shape)
        assert levels == tuple(range(levels[0], levels[-1] + 1))
        assert np.prod(nodes.nodes_shape(shape, levels[0])) <= progressive.MOST_NODES
        assert max(nodes.nodes_shape(shape, levels[-1])) >= 32 > max(nodes.nodes_shape(shape, levels[-1] + 1))
    assert progressive.preview_levels((62, 62, 62)) == ()


def test_a_camera_move_does_not_average_again(stand):
    cache, field = StageCache(1 << 28), smooth_shell(36)
    for azimuth in (10.0, 20.0, 100.0):
        list(progressive.previews(stand.scene(field, azimuth), stand.quality, cache))
    assert cache.made["pyramid"] == 1 and cache.made["visible"] == 1
    function = replace(stand.scene(field).transfer_function, shade=Shade(0.2, 0.8, 0.0, 1.0))
    for azimuth in (10.0, 20.0):  # a headlight moves with the camera, and colors with it
        list(progressive.previews(stand.scene(field, azimuth, function=function, headlight=True), stand.quality, cache))
    assert cache.made["pyramid"] == 3
    assert sum(stage == "pyramid" for stage, _ in cache.contents) == 2


def test_stopping_at_a_preview_leaves_the_store_good(stand):
    cache, scene = StageCache(1 << 28), stand.scene(smooth_shell(36), size=(32, 30))
    plain = render(scene, stand.quality)
    steps = progressive.progressive_steps(scene, stand.quality, cache, every=True)
    while not isinstance(next(steps), progressive.Preview):
        pass
    steps.close()
    np.testing.assert_array_equal(render(scene, stand.quality, cache=cache).rgba, plain.rgba)
    assert cache.made["visible"] == 1


def test_a_preview_says_what_it_is(stand):
    first, *_, last = progressive.previews(stand.scene(smooth_shell(36), size=(32, 30)), stand.quality)
    assert first.describe() == f"preview of 4 voxels a side, mean error at most {100 * first.mean_error:.0f} %"
    assert last.describe() == "the picture itself"
