"""Which kernels run: their names, collected for the report of a picture."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar

_NAMES: ContextVar[set | None] = ContextVar("called_kernels", default=None)


@contextmanager
def noting_kernels(names: set):
    """Add to ``names`` each kernel that Python calls in this block, as module and name: ``warp.resample._resample``.

    Kernels that other kernels call are not noted, and none is with plain numba (``jit``).  The block must not contain
    a generator's ``yield``: code of others would run in it.
    """
    outside = _NAMES.set(names)
    try:
        yield
    finally:
        _NAMES.reset(outside)


def note_call(function) -> None:
    """Add a kernel, given as its Python function, to the names that ``noting_kernels`` collects."""
    names = _NAMES.get()
    if names is not None:
        names.add(f"{function.__module__.rpartition('rle_splat.')[2]}.{function.__name__}")
