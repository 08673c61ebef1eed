"""Hierarchical splatting: the pyramid keeps what is there and knows its error; the cut obeys the threshold."""

import numpy as np
import pytest

from benchmarks.phantoms import blobs, smooth_shell
from rle_splat.comparison import laur_hanrahan, pyramid
from rle_splat.runtime.jit import numba
from rle_splat.scene import RleSplatError

needs_numba = pytest.mark.skipif(numba is None, reason="node splatting is a compiled kernel: numba is not installed")


@pytest.fixture(scope="module")
def voxels():
    random = np.random.default_rng(7)
    field = random.random((11, 6, 9, 4)).astype(np.float32)
    field[random.random((11, 6, 9)) < 0.6] = 0.0
    field[4:8, :4, 4:8] = (0.1, 0.2, 0.3, 0.5)  # one node of level 2 exactly
    return field


def members(voxels, level, node):
    """The records below one node, zeros beyond the grid included."""
    side = 2**level
    block = np.zeros((side, side, side, 4))
    z, y, x = (side * i for i in node)
    inside = voxels[z : z + side, y : y + side, x : x + side]
    block[: inside.shape[0], : inside.shape[1], : inside.shape[2]] = inside
    return block.reshape(-1, 4)


def test_means_and_deviations_against_brute_force(voxels):
    levels = pyramid.build(voxels, 3)
    assert [level.means.shape[:3] for level in levels] == [(11, 6, 9), (6, 3, 5), (3, 2, 3), (2, 1, 2)]
    for number, level in enumerate(levels):
        total = level.means.sum(axis=(0, 1, 2), dtype=np.float64) * 8.0**number
        np.testing.assert_allclose(total, voxels.sum(axis=(0, 1, 2), dtype=np.float64), rtol=1e-5)
        for node in np.ndindex(level.deviation.shape):
            below = members(voxels, number, node)
            np.testing.assert_allclose(level.means[node], below.mean(axis=0), atol=1e-6)
            assert level.deviation[node] == pytest.approx(np.abs(below - below.mean(axis=0)).max(), abs=1e-6)


@pytest.mark.parametrize("threshold", (0.0, 0.3, 0.6, 10.0))
def test_a_cut_shows_every_voxel_once_and_obeys_the_threshold(voxels, threshold):
    levels = pyramid.build(voxels, 3)
    covered = np.zeros((16, 8, 16), int)
    for number, found in enumerate(pyramid.cut(levels, threshold)):
        for node in found:
            within = tuple(slice(2**number * i, 2**number * (i + 1)) for i in node)
            covered[within] += 1
            assert levels[number].deviation[tuple(node)] <= threshold
            if number + 1 < len(levels):  # no coarser node would do
                assert levels[number + 1].deviation[tuple(node // 2)] > threshold
    seen = voxels[..., 3] > 0.0
    assert (covered[:11, :6, :9][seen] == 1).all() and covered.max() == 1


def test_nodes_come_front_to_back(stand):
    for azimuth, elevation in ((35.0, 25.0), (200.0, -50.0)):
        medium = stand.medium(stand.scene(blobs((13, 11, 9), 5), azimuth, elevation))
        tree = pyramid.build(medium.field[1:-1, 1:-1, 1:-1], 2)
        nodes = pyramid.cut(tree, 0.05)
        assert all(len(found) for found in nodes[:2])
        pixels, level_of, _ = laur_hanrahan.in_order(medium, tree, nodes)
        # Undo the ordering: which node is which follows from where it lies on the screen and its level.
        direction = -medium.view.eye[:3]
        corners = []
        for pixel, level in zip(pixels, level_of):
            centers = nodes[level][:, ::-1] * 2.0**level + 0.5 * (2**level - 1)
            at = centers @ medium.view.projection[:2, :3].T + medium.view.projection[:2, 3]
            match = np.flatnonzero(np.abs(at - pixel).max(axis=1) < 1e-9)
            assert len(match) == 1
            low = nodes[level][match[0], ::-1] * 2.0**level
            corners.append((low, low + 2.0**level))
        for before in range(len(corners)):
            for after in range(before + 1, len(corners)):
                # ``after`` must not lie wholly nearer than ``before`` along every axis.
                nearer = [
                    corners[after][1][a] <= corners[before][0][a] if direction[a] > 0
                    else corners[after][0][a] >= corners[before][1][a] for a in range(3)
                ]  # fmt: skip
                assert not all(nearer)


@needs_numba
def test_error_and_work_follow_the_threshold(stand):
    scene = stand.scene(smooth_shell(37), size=(64, 64))
    true, medium = stand.truth(scene), stand.medium(scene)
    errors, splats = [], []
    for threshold in (0.0, 0.01, 0.05, 0.2):
        prepared = laur_hanrahan.prepare(medium, stand.quality, threshold)
        splats.append(prepared.notes["splats"])
        errors.append(stand.error(prepared.draw(), true).rmse)
    assert splats[0] == medium.classified.visible_voxels and splats == sorted(splats, reverse=True)
    assert splats[-1] < 0.1 * splats[0]
    assert errors == sorted(errors) and errors[0] < 0.3 and errors[1] < 1.1 and errors[2] < 4.5


@needs_numba
def test_perspective_is_refused(stand):
    with pytest.raises(RleSplatError, match="parallel projection"):
        stand.draw(laur_hanrahan, stand.scene(blobs((9, 9, 9), 1), perspective=True))
