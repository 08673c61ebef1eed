"""Systems that are settings or tables of our renderer: ours, the paper's, shear-warp, and every voxel visited."""

import numpy as np
import pytest

from benchmarks.phantoms import blobs, thin_shell
from rle_splat.comparison import ours
from rle_splat.comparison.ours import decode
from rle_splat.encode.encode import encode
from rle_splat.pipeline.render import render
from rle_splat.scene import Quality
from tests.encoded import validate
from tests.ways import NUMPY


@pytest.mark.parametrize("perspective", (False, True), ids=("ortho", "perspective"))
@pytest.mark.parametrize("model", ("extinction", "opacity"))
def test_every_voxel_visited_gives_the_same_bits(stand, perspective, model):
    """The baseline differs in what it skips, not in what it computes."""
    scene = stand.scene(blobs((20, 23, 17), 3), 70.0, 20.0, perspective)
    quality = Quality.preset("standard", classification="pre", model=model)
    medium = stand.medium(scene, quality)
    all_voxels = ours.prepare_unaccelerated(medium, quality)
    skipping = ours.prepare(medium, quality)
    np.testing.assert_array_equal(all_voxels.draw().rgba, skipping.draw().rgba)
    np.testing.assert_array_equal(skipping.draw().rgba, render(scene, quality).rgba)
    axes = len(medium.principal_axes)
    assert all_voxels.memory_bytes["voxel_data"] == axes * 20 * 23 * 17 * 16
    assert skipping.memory_bytes["voxel_data"] == axes * medium.classified.visible_voxels * 16


@pytest.mark.parametrize("axis", (0, 1, 2))
def test_tables_of_every_voxel_skip_nothing(stand, axis):
    medium = stand.medium(stand.scene(blobs((9, 7, 5), 8, width=(0.7, 1.0))))
    sparse = encode(medium.classified, medium.colors, axis)
    dense = ours.every_voxel(sparse)
    assert (dense.scanline_pointers >= 0).all() and dense.visible_voxels == 9 * 7 * 5 > sparse.visible_voxels > 0
    assert (dense.runs.reshape(-1, 2) == (0, dense.width)).all()
    np.testing.assert_array_equal(decode(dense), decode(sparse))
    validate(dense)


def test_shear_warp_is_coarser_than_ours_and_finer_than_the_letter_of_the_paper(stand):
    scene = stand.scene(thin_shell(32), size=(48, 48))
    true, medium = stand.truth(scene), stand.medium(scene)
    ladder = [
        stand.error(module(medium, stand.quality).draw(), true).rmse
        for module in (ours.prepare, ours.prepare_shear_warp, ours.prepare_paper)
    ]  # measured .19, 3.6, 5.4
    assert 5.0 * ladder[0] < ladder[1] < 0.9 * ladder[2] < 9.0
    plan = ours.prepare_shear_warp(medium, stand.quality).draw().report["plan"]
    assert (plan["depth_rule"], plan["sheet_density"], plan["warp_filter"]) == ("slice", 0.0, "bilinear")
    assert plan["termination"] == 0.05


@NUMPY
def test_without_numba_the_engine_still_draws(stand, way):
    scene = stand.scene(blobs((9, 8, 7), 1), size=(16, 16))
    quality = Quality.preset("draft", classification="pre")
    medium = stand.medium(scene, quality)
    for prepare in (ours.prepare, ours.prepare_shear_warp, ours.prepare_unaccelerated):
        assert prepare(medium, quality).draw().rgba.max() > 0.05
