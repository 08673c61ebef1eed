"""Glass tints what is seen through it, against plain ray-triangle intersection, and leaves all else as it is."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rle_splat.accuracy.planner.tolerance import render_within
from rle_splat.accuracy.rays import camera_rays
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.effects.analyze import analyze
from rle_splat.effects.mesh_depth import SAMPLE_COLUMNS, SAMPLE_ROWS
from rle_splat.pipeline.render import render
from rle_splat.scene import NO_DEPTH, Quality, RleSplatError, Scene
from rle_splat.view.projection import depth_row
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.effects.test_mesh_depth import intersect
from tests.ways import NUMPY, both

SIZE = 40, 32
Z, Y, X = np.mgrid[:14, :15, :16] - 7.0
BALL = Volume((90.0 - 12.0 * np.sqrt(X**2 + Y**2 + Z**2)).astype(np.float32), np.eye(4))
DENSE = TransferFunction(opacity=((0.0, 0.0), (40.0, 0.9)), color=((0.0, 0.9, 0.4, 0.2), (90.0, 0.3, 0.6, 0.9)))
HAZE = TransferFunction(opacity=((0.0, 0.0), (40.0, 0.01)), color=((0.0, 0.9, 0.4, 0.2), (90.0, 0.3, 0.6, 0.9)))
GREEN = (0.4, 0.9, 0.5, 1.0)


def scene_of(function=DENSE, perspective=True, **more):
    camera, matrix = turntable(BALL, 25.0, 15.0, 1.2, perspective, 40.0)
    return Scene(BALL, function, camera, *SIZE, matrix, **more)


def middle_depth(scene):
    """Planar depth of the volume's center."""
    return float(depth_row(scene.camera) @ scene.index_to_world @ (7.5, 7.0, 6.5, 1.0))


def pane(scene, ahead, half=200.0, shift=0.0):
    """Two triangles across the view at a depth, ``half`` wide on either side of ``shift``."""
    corners = np.array([(x, y, -ahead, 1.0) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))])
    corners[:, 0] += shift
    world = (corners @ scene.camera.matrix_world.T)[:, :3]
    return world[[[0, 1, 2], [0, 2, 3]]]


def behind_glass(scene, *panes):
    """The scene with (triangles, share) panes."""
    triangles = np.concatenate([one for one, _ in panes])
    shares = np.concatenate([np.tile(share, (len(one), 1)) for one, share in panes])
    return replace(scene, panes=triangles, pane_shares=shares)


@pytest.mark.parametrize("perspective", [False, True])
def test_what_is_behind_a_pane_is_multiplied_by_its_share(perspective, way):
    scene = scene_of(perspective=perspective)
    near = 0.5 * middle_depth(scene)
    plain, share = render(scene), np.array((0.4, 0.9, 0.5, 0.8), np.float32)
    found = render(behind_glass(scene, (pane(scene, near), share)))
    assert plain.rgba[..., 3].max() > 0.99
    np.testing.assert_allclose(found.rgba, plain.rgba * share, rtol=1e-6)
    np.testing.assert_array_equal(found.depth, plain.depth)
    twice = render(behind_glass(scene, (pane(scene, near), share), (pane(scene, 0.9 * near), GREEN)))
    np.testing.assert_allclose(twice.rgba, plain.rgba * share * np.float32(GREEN), rtol=1e-6)


@NUMPY
def test_clear_glass_changes_no_bit(way):
    scene = scene_of()
    clear = behind_glass(scene, (pane(scene, 0.5 * middle_depth(scene), half=2.0), (1.0, 1.0, 1.0, 1.0)))
    np.testing.assert_array_equal(render(clear).rgba.view(np.uint32), render(scene).rgba.view(np.uint32))


def test_random_panes_before_and_behind_what_is_seen(way):
    """Each ray of a pixel counts the panes before the picture's depth, or before the middle of what stays clear."""
    scene, random = scene_of(), np.random.default_rng(3)
    center = (scene.index_to_world @ (7.0, 7.0, 7.0, 1.0))[:3]
    triangles = center + 12.0 * random.standard_normal((9, 3, 3))
    shares = random.random((9, 4))
    plain, found = render(scene), render(replace(scene, panes=triangles, pane_shares=shares))
    width, height = SIZE
    ends = np.where(plain.depth < NO_DEPTH, plain.depth, middle_depth(scene)).astype(np.float64)
    ahead, passed = -scene.camera.matrix_world[:3, 2], np.zeros((height, width, 4))
    for right, down in zip(SAMPLE_COLUMNS, SAMPLE_ROWS):
        column, row = np.meshgrid(np.arange(width) + right, np.arange(height) + down)
        rays = camera_rays(scene.camera, width, height, column, row)
        one = np.ones((height, width, 4))
        for triangle, share in zip(triangles, shares):
            depth = intersect(rays.origin, rays.direction, [triangle], ahead).reshape(height, width)
            one[(depth >= scene.camera.clip_start) & (depth < ends)] *= share
        passed += one / len(SAMPLE_COLUMNS)
    off = np.abs(found.rgba - plain.rgba * passed).max(axis=-1)
    assert (np.abs(passed - 1.0).max(axis=-1) > 0.1).mean() > 0.3 and (off < 1e-6).mean() > 0.995


def test_kernels_agree_with_their_reference():
    scene = scene_of()
    panes = (pane(scene, 0.5 * middle_depth(scene), 3.0, shift) for shift in (0.0, 1.5))
    one, two = both(partial(render, behind_glass(scene, *((each, GREEN) for each in panes))))
    np.testing.assert_allclose(one.rgba, two.rgba, atol=1e-3)  # samples share their light while they are thin


def test_threads_and_crops_have_the_same_bits():
    scene = scene_of()
    scene = behind_glass(scene, (pane(scene, 0.5 * middle_depth(scene), 2.0, 1.0), GREEN))
    whole = render(scene, Quality(threads=2)).rgba
    np.testing.assert_array_equal(render(scene, Quality(threads=1)).rgba, whole)
    part = render(replace(scene, crop=(9, 5, 31, 28)), Quality(threads=1)).rgba
    np.testing.assert_array_equal(part, whole[5:28, 9:31])


@NUMPY
def test_haze_is_tinted_by_panes_before_its_middle(way):
    scene = scene_of(HAZE)
    plain, middle = render(scene), middle_depth(scene)
    assert (plain.depth == NO_DEPTH).all()
    for ahead, share in ((middle - 1.0, np.float32(GREEN)), (middle + 1.0, 1.0)):
        found = render(behind_glass(scene, (pane(scene, ahead), GREEN)))
        np.testing.assert_allclose(found.rgba, plain.rgba * share, rtol=1e-6)


@NUMPY
def test_it_is_on_or_off_for_a_reason(way):
    scene = scene_of()
    for ahead, on, reason in (
        (0.5, True, "glass is in or in front of the volume"), (3.0, False, "all glass is behind the volume")
    ):  # fmt: skip
        effect = analyze(behind_glass(scene, (pane(scene, ahead * middle_depth(scene)), GREEN)), Quality())["glass"]
        assert (effect.on, effect.reason) == (on, reason)
    assert analyze(scene, Quality())["glass"].reason == "the scene has no glass"
    before = behind_glass(scene, (pane(scene, 0.5 * middle_depth(scene)), GREEN))
    off = render(replace(before, effects={"glass": False}))
    np.testing.assert_array_equal(off.rgba, render(scene).rgba)


@NUMPY
@pytest.mark.parametrize(
    ("panes", "shares", "sentence"),
    [
        (np.zeros((1, 3, 3)), None, "panes must be triangles of shape"),
        (np.zeros((2, 3, 3)), np.ones((1, 4)), "panes must be triangles of shape"),
        (np.zeros((1, 3, 3)), np.full((1, 4), 1.5), "must be numbers from 0 to 1"),
        (np.zeros((1, 3, 3)), np.full((1, 4), np.nan), "must be numbers from 0 to 1"),
        (np.full((1, 3, 3), np.nan), np.ones((1, 4)), "must be finite"),
    ],
)  # fmt: skip
def test_wrong_panes_end_in_a_sentence(panes, shares, sentence, way):
    with pytest.raises(RleSplatError, match=sentence):
        render(scene_of(panes=panes, pane_shares=shares))


def test_a_tolerance_is_kept_through_glass():
    """It is kept without the glass, which makes no error larger."""
    scene = scene_of()
    plain = render_within(scene, 1.0, probes=200)
    found = render_within(behind_glass(scene, (pane(scene, 0.5 * middle_depth(scene)), GREEN)), 1.0, probes=200)
    np.testing.assert_allclose(found.rgba, plain.rgba * np.float32(GREEN), atol=2.0 / 255.0)
    assert found.report["error"]["kept"] and plain.report["error"]["kept"]
    rows = {row["name"]: row for row in found.report["effects"]}
    assert rows["glass"]["on"] and rows["glass"]["ms"] > 0.0 and len(rows) == len(plain.report["effects"])
