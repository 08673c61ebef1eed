"""Volumes with half as many voxels along each side, and pictures of volumes that are too large."""

from dataclasses import replace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline import fitting, memory_estimate
from rle_splat.pipeline.fitting import HALVED, TOO_LARGE, fitting_steps
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import Channel, Labels, Quality, RleSplatError, Scene, TooLargeError
from rle_splat.view.turntable import turntable
from rle_splat.volume.reduced import factors_of, majority, reduce_steps, sample_steps
from rle_splat.volume.volume import Volume

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

QUALITY = Quality.preset("draft")
N = 64


def ball() -> Volume:
    z, y, x = np.meshgrid(*(np.arange(N) - (N - 1) / 2,) * 3, indexing="ij")
    return Volume((100.0 * (np.sqrt(x**2 + y**2 + z**2) < 20.0)).astype(np.uint8), np.diag((0.5, 0.5, 0.5, 1.0)))


def scene_of(volume: Volume) -> Scene:
    function = TransferFunction(opacity=((50, 0.0), (60, 0.02)), color=((0, 0.9, 0.5, 0.2),))
    camera, matrix = turntable(volume, 20, 30)
    return Scene(volume, function, camera, 96, 96, matrix)


@pytest.mark.parametrize("dtype", ("uint8", "int16", "float32", "float64"))
@pytest.mark.parametrize("shape", ((4, 6, 8), (5, 7, 3), (2, 2, 2)))
def test_a_linear_field_stays_where_it_is(dtype, shape):
    """But for the last voxel of an odd side, which counts twice."""
    affine = np.array(((0.5, 0.1, 0, 3), (0, 0.7, 0, -2), (0, 0, 2, 5), (0, 0, 0, 1)), float)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")[::-1], axis=-1)
    fine = (8 * index @ (1, 2, 3)).astype(dtype)
    coarse = drain(reduce_steps(Volume(fine, affine, slope=2.0, value_unit="HU"), HALVED))
    assert coarse.voxels.dtype == dtype and coarse.voxels.shape == tuple((n + 1) // 2 for n in shape)
    assert coarse.slope == 2.0 and coarse.value_unit == "HU"
    whole = tuple(slice(0, n // 2) for n in shape)
    at = np.stack(np.meshgrid(*(np.arange(n // 2) for n in shape), indexing="ij")[::-1], axis=-1)
    world = at @ coarse.affine[:3, :3].T + coarse.affine[:3, 3]
    there = (world - affine[:3, 3]) @ np.linalg.inv(affine[:3, :3]).T
    np.testing.assert_allclose(coarse.voxels[whole], 8 * there @ (1, 2, 3), atol=1e-9)
    assert coarse.voxels.max() <= fine.max() and coarse.voxels.min() >= fine.min()


def test_means_of_whole_numbers_are_rounded_and_keys_differ():
    volume = Volume(np.array((0, 0, 0, 0, 0, 0, 3, 3), np.uint8).reshape(2, 2, 2), np.eye(4))
    coarse = drain(reduce_steps(volume, HALVED))
    assert coarse.voxels.item() == 1 and coarse.key != volume.key
    again = drain(reduce_steps(Volume(volume.voxels.copy(), np.eye(4)), HALVED))
    assert again.key == coarse.key, "of equal voxels"


def test_blocks_of_voxels_lie_where_the_volume_does():
    affine = np.array([[0, 0, 3.0, 5], [1, 0, 0, 6], [0, -1, 0, 7], [0, 0, 0, 1]])
    voxels = np.arange(9 * 20 * 31, dtype=np.uint16).reshape(9, 20, 31)
    volume = Volume(voxels, affine)
    factors = factors_of(volume, 10)
    assert factors == (3, 3, 1), "31 by 20 by 27 mm, in voxels of about 3 mm"
    small = drain(reduce_steps(volume, factors))
    assert small.shape_xyz == (11, 7, 9) and small.voxels.dtype == np.uint16 and not small.voxels.flags.writeable
    np.testing.assert_allclose(small.affine @ (2, 1, 3, 1), affine @ (7, 4, 3, 1))
    assert small.voxels[3, 1, 2] == voxels[3, 3:6, 6:9].mean()
    assert small.voxels[3, 1, 10] == voxels[3, 3:6, 30].mean(), "filled up with the voxels at the far face"


@pytest.mark.parametrize("level", (1, 2, 4))
def test_sampled_voxels_stay_where_they_are(level):
    affine = np.array([[0, 0, 3.0, 5], [1, 0, 0, 6], [0, -1, 0, 7], [0, 0, 0, 1]])
    volume = Volume(np.arange(9 * 20 * 31, dtype=np.uint16).reshape(9, 20, 31), affine)
    some = drain(sample_steps(volume, level))
    assert some.shape_xyz == volume_levels(volume, level)[level] == some.levels[level] and some.levels[0] == (31, 20, 9)
    for place in ((0, 0, 0), np.array(some.shape_xyz) - 1):
        x, y, z = np.linalg.solve(affine, some.affine @ (*place, 1))[:3].round(9).astype(int)
        assert some.voxels[tuple(place)[::-1]] == volume.voxels[z, y, x]
    assert "one was read" in some.remarks[-1] and not some.voxels.flags.writeable


def volume_levels(volume: Volume, most: int) -> list:
    """Shapes of the levels up to one: of each block of 2^level voxels the middle one, if the volume has it."""
    return [
        tuple(max(1, sum((i + 2**n // 2) < count for i in range(0, count, 2**n))) for count in volume.shape_xyz)
        for n in range(most + 1)
    ]  # fmt: skip


@pytest.mark.parametrize("level", (-1, 7))
def test_there_is_no_such_level(level):
    with pytest.raises(RleSplatError, match=f"There is no level {level}: the volume has those from 0 to 6"):
        drain(sample_steps(ball(), level))


@pytest.mark.parametrize("classification", ("pre", "post"))
def test_fewer_voxels_are_as_dense_as_the_volume(classification):
    scene, quality = scene_of(ball()), QUALITY.classified(classification)
    whole = render(scene, quality).rgba
    coarse, halvings = drain(fitting_steps(scene, quality, StageCache(), 1))
    assert halvings == 1
    assert coarse.rgba[..., 3].sum() == pytest.approx(whole[..., 3].sum(), rel=0.02)
    inside = np.s_[44:52, 44:52]
    np.testing.assert_allclose(coarse.rgba[inside], whole[inside], atol=0.04)


def test_drafts_of_a_large_volume_are_of_some_voxels(monkeypatch):
    """As dense as the volume; the picture that follows a draft is of averages."""
    scene = scene_of(ball())
    whole = render(scene, QUALITY).rgba
    monkeypatch.setattr(fitting, "LARGE", N**3 - 1)
    monkeypatch.setattr(fitting, "SAMPLED_BYTES", N**3 // 8)
    cache = StageCache()
    draft, halvings = drain(fitting_steps(scene, QUALITY, cache, is_draft=True))
    assert halvings == 1 and "some voxels" in dict(cache.contents) and "larger voxels" not in dict(cache.contents)
    assert draft.rgba[..., 3].sum() == pytest.approx(whole[..., 3].sum(), rel=0.03)
    assert drain(fitting_steps(scene, QUALITY, cache))[1] == 0


def test_what_fits_is_the_picture_itself_to_the_bit():
    scene = scene_of(ball())
    rendering, halvings = drain(fitting_steps(scene, QUALITY, StageCache()))
    assert halvings == 0
    np.testing.assert_array_equal(rendering.rgba, render(scene, QUALITY).rgba)


def test_what_is_too_large_is_halved_and_that_is_kept(monkeypatch):
    """Memory for a coarser ball, but not for the ball."""
    needs = {}
    refuse = memory_estimate.refuse_too_much

    def noting(wanted):
        needs[wanted.voxels] = max(wanted.needed, needs.get(wanted.voxels, 0))
        return refuse(wanted)

    monkeypatch.setattr("rle_splat.pipeline.source.refuse_too_much", noting)
    scene, cache = scene_of(ball()), StageCache()
    drain(fitting_steps(scene, QUALITY, StageCache(), 1))
    render(scene, QUALITY)
    assert needs[(N // 2) ** 3] < 0.8 * needs[N**3]
    free = 0.9 * needs[N**3] / memory_estimate.SPARE
    monkeypatch.setattr(memory_estimate, "available_bytes", lambda: free)
    with pytest.raises(TooLargeError, match="are free"):
        render(scene, QUALITY)
    rendering, halvings = drain(fitting_steps(scene, QUALITY, cache))
    assert halvings == 1 and rendering.rgba[..., 3].max() > 0.3
    (kept,) = (key for stage, key in cache.contents if stage == TOO_LARGE)
    needs.clear()
    again, halvings = drain(fitting_steps(scene, QUALITY, cache))
    assert halvings == 1 and N**3 not in needs and kept[1] == 0, "asked for the whole volume once more"
    np.testing.assert_array_equal(again.rgba, rendering.rgba)
    monkeypatch.setattr(memory_estimate, "available_bytes", lambda: 1000)
    with pytest.raises(RleSplatError):
        drain(fitting_steps(scene, QUALITY, StageCache()))


@pytest.mark.slow
@pytest.mark.parametrize("classification", ("pre", "post"))
def test_labels_and_channels_are_halved_with_the_volume(classification):
    """Half of the ball is hidden, the other in a color of its own; a channel shines beside it."""
    scene, quality = scene_of(ball()), QUALITY.classified(classification)
    z, y, x = np.indices((N, N, N))
    halves = replace(scene.volume, voxels=(scene.volume.voxels > 50) * (1 + (x + y + z < 3 * N // 2)).astype(np.uint8))
    block = replace(scene.volume, voxels=(100 * (np.maximum(abs(x - 20), abs(y - 20)) < 12)).astype(np.uint8))
    red = replace(scene.transfer_function, color=((0, 0.9, 0.0, 0.0),))
    labeled = replace(scene, labels=Labels(halves, {1: None, 2: red}))
    for mixed in (labeled, replace(scene, channels=(Channel(block, red),))):
        whole = render(mixed, quality).rgba
        coarse, halvings = drain(fitting_steps(mixed, quality, StageCache(), 1))
        assert halvings == 1
        assert coarse.rgba[..., 3].sum() == pytest.approx(whole[..., 3].sum(), rel=0.06)
        added = np.abs(whole - render(scene, quality).rgba).mean()
        assert np.abs(coarse.rgba - whole).mean() < 0.3 * added


def test_a_larger_voxel_has_the_label_of_most():
    blocks = np.zeros((2, 2, 4), np.int32)
    blocks[:, :, :2] = np.array((7, 2**31 - 1, 7, -5, 7, -5, 7, 7)).reshape(2, 2, 2)
    blocks[:, :, 2:] = np.array((-5, 1, -5, 1, -5, -5, 2, -5)).reshape(2, 2, 2)
    coarse = drain(reduce_steps(Volume(blocks, np.eye(4)), HALVED, majority))
    assert coarse.voxels.tolist() == [[[7, -5]]]
