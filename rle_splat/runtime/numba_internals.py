"""Everything that relies on numba's internals, behind one check of numba's version.

Importing this module raises ImportError where numba is not of a version that it was tested with.  ``jit`` then uses
numba's public interface alone.  The internals are:

- ``Kernel``: the dispatcher's class, its ``compile`` and ``_cache``; the options ``_nrt``, ``forceinline``,
  ``no_cpython_wrapper`` and ``no_cfunc_wrapper``.
- ``kernel_cache``, ``shipped_kernels``: the files of numba's on-disk cache, and what is in them.
- ``parallel.share_out``: the entry of numba's thread pool.
- ``OwnCopy``: what a code library does with the libraries that are linked into it.
- ``fingerprint``: the function by which numba finds the version of a kernel for arguments.
"""

from __future__ import annotations

import hashlib

import numba

KNOWN_VERSIONS = ("0.68.0", "0.68.1")

if numba.__version__ not in KNOWN_VERSIONS:
    raise ImportError(f"numba {numba.__version__} is not a version that RLE Splat knows ({', '.join(KNOWN_VERSIONS)})")

from numba._dispatcher import compute_fingerprint as fingerprint  # noqa: E402
from numba.core.caching import NullCache  # noqa: E402
from numba.core.registry import CPUDispatcher  # noqa: E402

from .called_kernels import note_call  # noqa: E402
from .kernel_cache import SHIPPED, cache_of, keep_in  # noqa: E402

__all__ = ["SHIPPED", "OwnCopy", "compile_with", "fingerprint", "keep_in"]

# Modules of numba that its first kernel brings in.
IMPORTED_BY_KERNELS = (
    "numba.cpython.hashing",
    "numba.cpython.unicode",
    "numba.cpython.charseq",
    "numba.misc.quicksort",
    "numba.np.arrayobj",
)
MANGLED = "_ZN"  # names of functions that numba compiled begin so


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
    # A part that is not inlined is compiled by itself and within each kernel; ``OwnCopy`` keeps the two apart.  Parts
    # that make arrays are not inlined: with them inlined, a process that ran out of memory crashed in one run of two.
    forceinline = inner and not counted
    options = {**options, "forceinline": forceinline, "no_cfunc_wrapper": True, "_nrt": counted}
    if inner:
        return numba.njit(no_cpython_wrapper=True, **options)(function)
    dispatcher = numba.njit(**options)(function)
    dispatcher.__class__ = Kernel
    return dispatcher


class OwnCopy:
    """The functions of a compiled part, to be linked into one kernel under names of its own.

    Of two functions of the same name, the one that is loaded first counts.  A part is loaded when it is compiled,
    before the kernel whose copy of it was optimized once more and may round otherwise.  A kernel from disk comes with
    its own copy alone.

    Parameters
    ----------
    library : numba.core.codegen.CPUCodeLibrary
        Of the part.
    kernel : str
        Name of the function that calls the part.
    """

    def __init__(self, library, kernel: str):
        self._library = library
        self._prefix = f"k{hashlib.blake2b(kernel.encode(), digest_size=8).hexdigest()}."
        self._reload_init = library._reload_init

    def name_of(self, name: str) -> str:
        """The name in the copy of a function of the part."""
        return self._prefix + name

    def _ensure_finalized(self) -> None:
        self._library._ensure_finalized()

    def _get_module_for_linking(self):
        module = self._library._get_module_for_linking().clone()
        for function in module.functions:
            if not function.is_declaration and function.name.startswith(MANGLED):
                function.name = self.name_of(function.name)
        return module
