"""A voxel scanline against its runs laid out one voxel at a time, and its samples four at a time against one by one."""

import numpy as np
import pytest

from rle_splat.runtime.jit import compiled, kernel
from rle_splat.runtime.lanes import GROUP
from rle_splat.splat.arguments import Records
from rle_splat.splat.pixel_block import BLOCK, is_voxel_by_voxel, place_tent, resample_tent, resample_voxel_by_voxel
from rle_splat.splat.voxel_scanline import add_runs

pytestmark = pytest.mark.skipif(not compiled(), reason="of kernels")
WIDTH, MARGIN = 90, 1


@kernel
def add(line, reach, marks, scale, shift, weight, runs, voxels, voxel, live):
    count = live.shape[0]
    add_runs(line, reach, MARGIN, marks, 0, scale, shift, 1.0, weight, runs, 0, voxels, voxel, WIDTH, live, count)


@kernel
def sample(line, cells, fractions, start, scale, top, one_by_one, together):
    """Both ways, where both are meant; whether they are."""
    place_tent(cells, fractions, 0, start, scale, top)
    resample_tent(line, cells, fractions, 0, one_by_one, 0)
    meant = is_voxel_by_voxel(cells, 0)
    if meant:
        resample_voxel_by_voxel(line, cells, fractions, 0, together, 0)
    return meant


def runs_of(seen):
    """Transparent and non-transparent lengths in turn."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], seen)).astype(int)))
    return np.diff(np.concatenate(([0], edges, [len(seen)] if not len(edges) or edges[-1] < len(seen) else [])))


LIVE = {
    "all": ((-3, WIDTH + 5),), "some": ((5, 40), (47, 49), (70, WIDTH + 1)), "one voxel": ((33, 34),),
    "none of it": ((-9, -1),),
}  # fmt: skip


@pytest.mark.parametrize("live", LIVE)
@pytest.mark.parametrize("share", (0.05, 0.3, 0.7, 0.97, 1.0))
def test_runs_of_several_slices_are_added_and_what_is_beside_them_stays_zero(share, live):
    rng = np.random.default_rng(int(100 * share))
    inside = np.zeros(WIDTH, bool)
    for low, high in LIVE[live]:
        inside[max(low, 0) : max(high, 0)] = True
    for shift, scale in ((3.25, 1.0), (-11.5, 0.4), (0.0, 3.7)):
        line = np.zeros(4 * (WIDTH + 2 * MARGIN + GROUP), np.float32)
        expected = np.zeros((WIDTH, 4), np.float32)
        reach, marks = np.array((WIDTH + MARGIN, 0, 0, 0), np.int64), np.zeros((1, 8), np.uint64)
        touched = np.zeros(WIDTH, bool)
        for weight in (np.float32(0.75), np.float32(0.3)):
            seen = rng.random(WIDTH) < share
            records = rng.random((seen.sum(), 4), dtype=np.float32)
            # The last records of all, with some of other scanlines before them.
            voxels = Records.of(np.concatenate((np.full((7, 4), 1e9, np.float32), records)), None)
            add(
                line, reach, marks, scale, shift, weight, runs_of(seen).astype(np.uint16), voxels, 7,
                np.array(LIVE[live], np.int64),
            )  # fmt: skip
            put = np.zeros((WIDTH, 4), np.float32)
            put[seen] = records
            expected[inside] += weight * put[inside]
            touched |= seen & inside
        found = line.reshape(-1, 4)
        np.testing.assert_allclose(found[MARGIN : MARGIN + WIDTH], expected, rtol=3e-7)
        assert not found[MARGIN : MARGIN + WIDTH][~touched].any()
        assert not found[:MARGIN].any() and not found[MARGIN + WIDTH :].any()
        columns = np.flatnonzero(touched)
        assert (reach[1] > 0) == (len(columns) > 0)
        if len(columns):
            assert (reach[0], reach[1]) == (columns[0] + MARGIN, columns[-1] + 1 + MARGIN)
        # Every block of which a pixel lies within a voxel of one that was touched is marked.
        pixels = np.arange(8 * 64 * BLOCK)
        near = np.abs((pixels - shift) / scale - columns[:, None]) < 1.0
        blocks = near.any(axis=0).reshape(-1, BLOCK).any(axis=1)
        marked = np.unpackbits(marks.astype("<u8").view(np.uint8), bitorder="little").astype(bool)
        assert marked[blocks].all()
        assert marked.sum() <= 2 * blocks.sum() + 2


@pytest.mark.parametrize("start", (-20.0, -0.75, 0.0, 0.3, 40.0 + 1e-7, 71.99, 88.5, 200.0))
def test_samples_a_voxel_apart_are_the_same_four_at_a_time(start):
    rng = np.random.default_rng(3)
    line = rng.random(4 * (WIDTH + 2 * MARGIN), dtype=np.float32)
    found = 0
    for scale in (1.0, 1.0 + 1e-9, 0.5):
        cells, fractions = np.zeros(BLOCK, np.int32), np.zeros(BLOCK, np.float32)
        one_by_one, together = np.zeros((2, 4 * BLOCK), np.float32)
        meant = sample(line, cells, fractions, start, scale, WIDTH + 0.5, one_by_one, together)
        assert meant == (np.diff(cells) == 4).all()
        found += meant
        if meant:
            np.testing.assert_array_equal(together, one_by_one)
    assert (found > 0) == (0.0 <= start + 1.0 and start + BLOCK < WIDTH + 1.0)
