"""Everything that relies on numba's internals, behind one check of numba's version.

Importing this module raises ImportError where numba is not of a version that it was tested with.  ``jit`` then uses
numba's public interface alone.  The internals are:

- ``Kernel``: the dispatcher's class, its ``compile`` and ``_cache``; the options ``_nrt``, ``forceinline``,
  ``no_cpython_wrapper`` and ``no_cfunc_wrapper``.
- ``kernel_cache``: the files of numba's on-disk cache.
- ``parallel.share_out``: the entry of numba's thread pool.
- ``fingerprint``: the function by which numba finds the version of a kernel for arguments.
"""

from __future__ import annotations

import numba

KNOWN_VERSIONS = ("0.68.0", "0.68.1")

if numba.__version__ not in KNOWN_VERSIONS:
    raise ImportError(f"numba {numba.__version__} is not a version that RLE Splat knows ({', '.join(KNOWN_VERSIONS)})")

from numba._dispatcher import compute_fingerprint as fingerprint  # noqa: E402
from numba.core.caching import NullCache  # noqa: E402
from numba.core.registry import CPUDispatcher  # noqa: E402

from .called_kernels import note_call  # noqa: E402
from .kernel_cache import cache_of, keep_in  # noqa: E402

__all__ = ["compile_with", "fingerprint", "keep_in"]


class Kernel(CPUDispatcher):
    """A kernel that notes its calls from Python (measured: 1 microsecond a call) and is kept on disk."""

    def __call__(self, *arguments):
        note_call(self.py_func)
        return super().__call__(*arguments)

    def compile(self, signature):
        """Load the version for a signature from disk, or compile it and keep it there."""
        if isinstance(self._cache, NullCache):
            self._cache = cache_of(self)
        return super().compile(signature)


def compile_with(function, options: dict, *, inner: bool, counted: bool):
    """Make a kernel of a function.

    Parameters
    ----------
    function : callable
    options : dict
        Options of ``numba.njit``.
    inner, counted : bool
        See ``jit.kernel``.

    Returns
    -------
    CPUDispatcher
        A ``Kernel`` unless ``inner``.
    """
    # A part that is not inlined is compiled by itself and within each kernel, and of what is loaded the first counts:
    # its rounding can depend on whether a kernel came from disk.  Parts that make arrays are not inlined all the same:
    # with them inlined, a process that ran out of memory crashed in one run of two.
    forceinline = inner and not counted
    options = {**options, "forceinline": forceinline, "no_cfunc_wrapper": True, "_nrt": counted}
    if inner:
        return numba.njit(no_cpython_wrapper=True, **options)(function)
    dispatcher = numba.njit(**options)(function)
    dispatcher.__class__ = Kernel
    return dispatcher
