"""Which kernels run: their names, collected for the report of a picture."""

from __future__ import annotations

from contextvars import ContextVar

_NAMES: ContextVar[set | None] = ContextVar("called_kernels", default=None)


class NotingKernels:
    """Context in which ``names`` gets each kernel that Python calls, as module and name: ``warp.resample._resample``.

    Kernels that other kernels call are not noted, and none is with plain numba (``jit``).  The block must not contain
    a generator's ``yield``: code of others would run in it.

    Parameters
    ----------
    names : set of str
    """

    __slots__ = ("_names", "_outside")  # and no generator, which takes twice as long: a frame enters it ten times

    def __init__(self, names: set):
        self._names = names

    def __enter__(self) -> None:
        self._outside = _NAMES.set(self._names)

    def __exit__(self, *_) -> None:
        _NAMES.reset(self._outside)


def note_call(function) -> None:
    """Add a kernel, given as its Python function, to the names that ``NotingKernels`` collects."""
    names = _NAMES.get()
    if names is not None:
        names.add(f"{function.__module__.rpartition('rle_splat.')[2]}.{function.__name__}")
