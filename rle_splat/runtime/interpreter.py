"""What Python does beside running a program, and need not while modules load or kernels are compiled."""

from __future__ import annotations

import gc
from contextlib import contextmanager

# Python's pieces are of a power of two: for 288 KB of variables one of 512 KB, whose rest is enough for some 400 calls.
ROOM = 36 * 2**10


@contextmanager
def collector_paused():
    """Python's collector off: what a compiler makes stays, and looking through it takes a tenth of its time; so does
    what numba makes when it is loaded.

    So that it is not looked through as soon as the collector is on again, which would take another tenth, it is put
    among what is old: frozen, and at once thawed.
    """
    paused = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if paused:
            if gc.get_freeze_count() == 0:  # else it is somebody else's to thaw
                gc.freeze()
                gc.unfreeze()
            gc.enable()


def with_room(function):
    """The function, with room for the variables of all that it calls.

    Python keeps variables in pieces of 16 KB of memory. Where one is full, each further call asks the system for
    another and each return gives it back, and a compiler that comes to work at such a brink does so for most of its
    calls (counted: 130 000 times in a first picture; where the brinks are depends on who calls). A function that needs
    more than a piece gets a larger one, whose rest is for what it calls.
    """
    function.__code__ = function.__code__.replace(co_stacksize=ROOM)
    return function
