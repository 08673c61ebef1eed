"""The buffer pool: memory that arrays leave serves others, and never two at once."""

import sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime import buffer_pool

MANY = 1 << 18  # float32 numbers that are worth it here


@pytest.fixture(autouse=True)
def nothing_idle(monkeypatch):
    monkeypatch.setattr(buffer_pool, "LEAST", 4 * MANY)
    buffer_pool.forget()
    yield
    buffer_pool.forget()


def place(array):
    return array.__array_interface__["data"][0]


@pytest.mark.parametrize("shape", (0, 7, (0, 3), (5, 0), MANY, (3, MANY), (MANY, 2, 3), (1, 1 << 21)))
@pytest.mark.parametrize("dtype", (np.uint8, "u2", np.float32, np.float64))
def test_arrays_are_as_numpy_makes_them(shape, dtype):
    made, ordinary = buffer_pool.empty(shape, dtype), np.empty(shape, dtype)
    assert type(made) is np.ndarray and made.shape == ordinary.shape and made.dtype == ordinary.dtype
    assert made.nbytes == ordinary.nbytes and made.flags.c_contiguous and made.flags.aligned and made.flags.writeable
    made[...] = 1
    assert (made == 1).all()


def test_what_one_array_left_serves_the_next_of_about_its_size():
    first = buffer_pool.empty((MANY, 4), np.float32)
    where = place(first)
    first = None
    second = buffer_pool.empty((4 * MANY * 9 // 10,), np.float32)
    assert place(second) == where
    assert place(buffer_pool.empty((MANY, 4), np.float32)) != where


def test_memory_serves_no_other_while_any_view_of_it_is_left():
    first = buffer_pool.empty((3, MANY), np.float32)
    where, part = place(first), first.T[5:, 1]
    part[:] = 3.0
    first = None
    others = [buffer_pool.empty((3, MANY), np.float32) for _ in range(3)]
    for other in others:
        other[:] = 7.0
    assert where not in map(place, others) and (part == 3.0).all()
    part = None
    assert place(buffer_pool.empty((3, MANY), np.float32)) == where


def test_little_is_held_that_no_array_uses(monkeypatch):
    monkeypatch.setattr(buffer_pool._Loan, "most_idle", 3 * buffer_pool.LEAST)
    arrays = [buffer_pool.empty(buffer_pool.LEAST, np.uint8) for _ in range(5)]
    last = [place(array) for array in arrays][-3:]
    while arrays:
        arrays.pop(0)
    assert sorted(map(place, buffer_pool._Loan.idle)) == sorted(last)
    too_large = buffer_pool.empty(buffer_pool.MOST + 1, np.uint8)
    assert too_large.base is None


def test_what_does_not_fit_goes_back_before_more_is_taken():
    arrays = [buffer_pool.empty(n * buffer_pool.LEAST, np.uint8) for n in (1, 1, 1, 4)]
    while arrays:
        arrays.pop(0)
    last = buffer_pool.empty(2 * buffer_pool.LEAST, np.uint8)
    sizes = [memory.size // buffer_pool.LEAST for memory in buffer_pool._Loan.idle]
    assert sizes == [1, 4] and last.size == 2 * buffer_pool.LEAST


def test_a_store_that_is_emptied_gives_everything_back():
    cache = StageCache()
    job = cache.job()
    job.get("records", 1, lambda: buffer_pool.empty(MANY, np.float32))
    job.keep()
    job = None
    cache.clear()
    assert not buffer_pool._Loan.idle


def test_memory_that_is_left_while_memory_is_counted_is_no_mistake(monkeypatch):
    """A collection of garbage, or another thread, may end an array's life at any step of another's end."""
    complaints, others = [], []

    class Idle(deque):
        def __iter__(self):
            for memory in super().__iter__():
                others.clear()
                yield memory

    monkeypatch.setattr(buffer_pool._Loan, "idle", Idle())
    monkeypatch.setattr(sys, "unraisablehook", complaints.append)
    first, *others[:] = [buffer_pool.empty(buffer_pool.LEAST, np.uint8) for _ in range(4)]
    first = None
    assert first is None and len(buffer_pool._Loan.idle) == 4 and not complaints


def test_threads_never_share():
    def work(number):
        random = np.random.default_rng(number)
        for _ in range(60):
            arrays = [buffer_pool.empty(int(random.integers(MANY, 2 * MANY)), np.float32) for _ in range(3)]
            for n, array in enumerate(arrays):
                array[:] = 10 * number + n
            assert all((array == 10 * number + n).all() for n, array in enumerate(arrays))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))
