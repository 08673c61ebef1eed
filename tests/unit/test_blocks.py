"""Blocks of smallest and largest values against plain reductions, and hidden blocks that nothing looks into."""

import numpy as np
import pytest

from rle_splat.classify.relevant import count_kept, gather_kept
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.classify.visible import Visibility, mark_steps
from rle_splat.runtime.steps import drain
from rle_splat.volume.blocks import BLOCK_X, BLOCK_Y, BLOCK_Z, block_steps, cut_chunks
from rle_splat.volume.volume import Volume
from tests.ways import BY_TYPE

WHITE = ((0, 1, 1, 1),)


def grid(dtype, shape=(19, 21, 70), seed=1):
    low = -100 if np.dtype(dtype).kind != "u" else 0
    return Volume(np.random.default_rng(seed).integers(low, 120, shape).astype(dtype), np.eye(4))


@pytest.mark.parametrize(("dtype", "way"), BY_TYPE, indirect=["way"])
def test_every_block_holds_its_extremes(dtype, way, monkeypatch):
    volume = grid(dtype)
    voxels = volume.voxels.copy()
    if voxels.dtype.kind == "f":
        voxels[np.random.default_rng(2).random(voxels.shape) < 0.3] = np.nan
        voxels[:BLOCK_Z, :BLOCK_Y, :BLOCK_X] = np.nan
        voxels[-1, -1, -1] = np.inf
    monkeypatch.setattr("rle_splat.volume.blocks.VOXELS_AT_ONCE", 1)
    blocks = drain(block_steps(Volume(voxels, np.eye(4))))
    nan = np.isnan(voxels) if voxels.dtype.kind == "f" else np.zeros(voxels.shape, bool)
    assert blocks.nan_voxels == nan.sum() and blocks.low.shape == (3, 3, 3) and blocks.low.dtype == voxels.dtype
    for k in range(3):
        for j in range(3):
            for i in range(3):
                where = np.s_[8 * k : 8 * k + 8, 8 * j : 8 * j + 8, 32 * i : 32 * i + 32]
                inside = voxels[where][~nan[where]]
                if inside.size:
                    assert (blocks.low[k, j, i], blocks.high[k, j, i]) == (inside.min(), inside.max())
                else:
                    assert blocks.low[k, j, i] > blocks.high[k, j, i]


@pytest.mark.parametrize("slope", (2.0, -0.5))
@pytest.mark.parametrize("dtype", "uint8 int16 int32 float32".split())
def test_a_block_is_relevant_when_one_of_its_values_is_shown(dtype, slope):
    volume = Volume(grid(dtype).voxels, np.eye(4), slope=slope, intercept=3.0)
    for points in (((-400, 0.0), (-180, 0.0), (-170, 0.3), (-160, 0.0)), ((195, 0.0), (195, 0.4)), ((0, 0.0),)):
        shown = Visibility(volume, TransferFunction(opacity=points, color=WHITE))
        blocks = drain(block_steps(volume))
        relevant = shown.relevant(blocks)
        seen = np.asarray(shown.tf.alpha_at(volume.physical(volume.voxels))) > 0.0
        for k, j, i in np.ndindex(relevant.shape):
            if seen[8 * k : 8 * k + 8, 8 * j : 8 * j + 8, 32 * i : 32 * i + 32].any():
                assert relevant[k, j, i]
        assert relevant.any() == seen.any()


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
def test_what_is_hidden_is_not_looked_at(dtype):
    voxels = np.zeros((16, 16, 64), dtype)
    voxels[:8, 8:, 32:] = 90
    volume = Volume(voxels, np.eye(4))
    shown = Visibility(volume, TransferFunction(opacity=((50, 0.0), (60, 0.5)), color=WHITE))
    blocks = drain(block_steps(volume))
    assert shown.relevant(blocks).sum() == 1
    voxels[8:] = 90  # behind the back of the blocks: whoever looks there now would see it
    bits = drain(mark_steps(shown, blocks))
    assert len(gather_kept(shown.volume, bits, count_kept(bits), blocks)) == 8 * 8 * 32


def test_chunks_are_whole_and_cover_all_planes():
    assert list(cut_chunks(10, 100, 250)) == [(0, 2), (2, 4), (4, 6), (6, 8), (8, 10)]
    assert list(cut_chunks(10, 100, 50, multiple=4)) == [(0, 4), (4, 8), (8, 10)]
    assert list(cut_chunks(3, 0)) == [(0, 3)]
