"""Loops shared out among threads: every part is done once, whatever the number of threads and of parts."""

import numpy as np
import pytest

from rle_splat.runtime.jit import available_threads, compiled, kernel, parallel_call
from rle_splat.runtime.parallel import share_out

pytestmark = pytest.mark.skipif(not compiled(), reason="nothing is shared out without kernels")


@kernel(inner=True)
def _add(begin, end, amount, sums, pair):
    names, weight = pair
    for i in range(begin, end):
        sums[i] += amount * weight
        names[i] = 1 if names[i] == 0 else -1


@kernel
def add(amount, sums, count, pair):
    share_out(_add, count, (amount, sums, pair))


@pytest.mark.parametrize("threads", (1, 2, 0))
@pytest.mark.parametrize("count", (0, 1, 2, 31, 32, 33, 1000, 100_003))
def test_every_item_is_done_once(threads, count):
    sums, names = np.arange(count + 2, dtype=np.float64), np.zeros(count + 2, np.int8)
    with parallel_call(threads):
        add(2, sums, count, (names, 0.5))
    np.testing.assert_array_equal(sums[:count], np.arange(count) + 1.0)
    np.testing.assert_array_equal(names, [1] * count + [0, 0])
    np.testing.assert_array_equal(sums[count:], (count, count + 1))


@kernel(inner=True)
def _note_parts(begin, end, begins):
    for i in range(begin, end):
        begins[i] = begin


@kernel
def note_parts(begins):
    share_out(_note_parts, begins.size, (begins,))


def test_parts_are_short_enough_to_even_out():
    begins = np.zeros(1000, np.int64)
    with parallel_call(0) as threads:
        note_parts(begins)
    lengths = np.bincount(begins)
    assert threads == available_threads() and lengths.sum() == 1000
    assert lengths.max() <= 1000 // (8 * threads)
