"""Ctrl-C at any place within ``parallel_call``: the right to run kernels is free again."""

import sys

import pytest

from rle_splat.runtime import jit
from rle_splat.runtime.jit import parallel_call


class Interrupt:
    """A profiler that raises KeyboardInterrupt at its ``number``-th event of those at which Python looks whether a
    signal has come: where a function of C has returned, and where one of Python begins."""

    def __init__(self, number: int | None):
        self.number, self.seen = number, 0

    def __call__(self, frame, event, argument):
        if event in ("c_return", "call"):
            self.seen += 1
            if self.seen == self.number:
                raise KeyboardInterrupt


def profiled(interrupt) -> bool:
    """Whether an interrupted call, which does nothing, was interrupted."""
    try:
        sys.setprofile(interrupt)
        with parallel_call(1):
            pass
        sys.setprofile(None)
        return False
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(None)


def test_an_interrupt_anywhere_does_not_lose_the_token():
    with parallel_call(2):
        pass  # numba gets its threads ready
    threads = jit.numba.get_num_threads() if jit.numba is not None else 0
    everything = Interrupt(None)
    assert not profiled(everything) and everything.seen > 10
    lost = {}
    for number in range(1, everything.seen):
        assert profiled(Interrupt(number)), number
        state = jit._TOKEN.qsize(), jit._HOLDS_TOKEN.get()
        if state != (1, False):
            lost[number] = state
            jit._HOLDS_TOKEN.set(False)
            if jit._TOKEN.empty():
                jit._TOKEN.put(None)
    assert lost == {}
    if jit.numba is not None:
        jit.numba.set_num_threads(threads)
    with parallel_call(0) as count:
        assert count == jit.available_threads()


@pytest.mark.parametrize("threads", (1, 2))
def test_an_interrupt_in_the_work_leaves_everything_as_it_was(threads):
    before = jit.numba.get_num_threads() if jit.numba is not None else 0
    with pytest.raises(KeyboardInterrupt), parallel_call(threads):
        raise KeyboardInterrupt
    assert (jit._TOKEN.qsize(), jit._HOLDS_TOKEN.get()) == (1, False)
    assert jit.numba is None or jit.numba.get_num_threads() == before
