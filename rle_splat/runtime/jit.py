"""The decorator of all kernels, and the right to run parallel ones.

There are three cases, decided once when this module is imported:

- numba is of a version that ``numba_internals`` knows.  Kernels are kept on disk and share loops among threads.
- numba is of another version: *plain numba*.  Kernels run on one thread and are compiled again by each process.
  ``PLAIN_NUMBA`` says why.
- numba cannot be loaded: ``numba`` is None, and callers use the reference implementations in numpy.
  ``NUMBA_PROBLEM`` says why.

No setting of numba or of the process is changed: other programs in the same process use the same numba.
"""

from __future__ import annotations

import os
import queue
import sys
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from importlib import import_module
from pathlib import Path

from ..scene import RleSplatError
from .cache_folder import CACHE_VARIABLE, NUMBA_VARIABLE, cache_folder, kernel_folder
from .called_kernels import NotingKernels

__all__ = [
    "CACHE_VARIABLE", "KERNELS", "NUMBA_PROBLEM", "NUMBA_VARIABLE", "PLAIN_NUMBA", "NotingKernels", "available_threads",
    "cache_folder", "compiled", "first_load_steps", "inner_loop", "is_loaded", "kernel", "need_kernels", "note_loaded",
    "nothing_compiled_yet", "numba", "parallel_call", "prange", "read_only", "run_either", "shipped_level",
    "shipped_problem", "thread_count", "use_reference", "while_compiling",
]  # fmt: skip

NUMBA_PROBLEM = ""  # why numba cannot be used at all, for people
PLAIN_NUMBA = ""  # why only numba's public interface is used, for people
KERNELS = Path(os.devnull, "kernels")  # where kernels are kept; nothing can be written here

try:
    import numba
    from llvmlite import ir  # noqa: F401 - see ``llvm``
    from numba.core import cgutils, types  # noqa: F401
    from numba.extending import intrinsic  # noqa: F401

    if numba.config.DISABLE_JIT:
        raise RuntimeError("the variable NUMBA_DISABLE_JIT turns compiling off")
except Exception as problem:  # a broken install fails in many ways (ImportError, OSError, AttributeError, SystemError)
    numba = None
    NUMBA_PROBLEM = f"{type(problem).__name__}: {problem}"

internals = None
if numba is not None:
    try:
        from . import numba_internals as internals

        KERNELS = kernel_folder(numba.__version__)
        internals.keep_in(KERNELS)
    except Exception as problem:  # whatever another version of numba lacks
        internals = None
        PLAIN_NUMBA = str(problem) or type(problem).__name__


def nothing_compiled_yet() -> bool:
    """Whether kernels are kept on disk, and none is there yet: the next picture compiles all that it needs."""
    return internals is not None and not (_LOADED or shipped_level() or any(KERNELS.rglob("*.nbi")))


def shipped_level() -> str:
    """The level of processors that this installation's kernels are made for; "" where it has none for this process."""
    return "" if internals is None else internals.SHIPPED.level


def shipped_problem() -> str:
    """Why kernels of this installation are not used, for people; "" where all are, and where none came with it."""
    return "" if internals is None else internals.SHIPPED.problem


def first_load_steps():
    """Generator: import what numba imports when it loads its first kernel, a module at a step.  Yields 0."""
    for name in internals.IMPORTED_BY_KERNELS if internals is not None else ():
        if name not in sys.modules:
            import_module(name)
            yield 0.0


@contextmanager
def while_compiling(begun):
    """Call ``begun()`` whenever numba starts to compile a function in this block."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, _):
            begun()

        def on_end(self, _):
            """Nothing is due then."""

    with event.install_listener("numba:compile", Listener()):
        yield


# Kernels, and types of arguments that they have been loaded for.
_LOADED: set[tuple] = set()


def is_loaded(function, arguments: tuple) -> bool:
    """Whether ``note_loaded`` was called for this kernel and arguments of these types.

    This is quicker (measured: 8 microseconds) than a call of the kernel that does nothing (25).  Always False with
    plain numba.
    """
    return internals is not None and (function, internals.fingerprint(arguments)) in _LOADED


def note_loaded(function, arguments: tuple) -> None:
    """See ``is_loaded``."""
    if internals is not None:
        _LOADED.add((function, internals.fingerprint(arguments)))


# NaN tests must survive and sums must keep their order, so none of nnan, ninf, reassoc, afn.
FASTMATH = {"contract", "arcp", "nsz"}


# numba's workqueue layer aborts the process when two parallel kernels run at once, so threads take turns with one
# token.  (A queue needs no import of threading, which the Extensions platform refuses.)
_TOKEN: queue.SimpleQueue = queue.SimpleQueue()
_TOKEN.put(None)
# Whether the current thread holds the token: each thread has its own context.
_HOLDS_TOKEN: ContextVar[bool] = ContextVar("holds_token", default=False)


def kernel(function=None, *, parallel=False, inline="never", exact=False, inner=False, counted=True):
    """Compile a function of arrays and scalars in nopython mode, without the GIL; keep the result on disk.

    Parameters
    ----------
    function : callable, optional
        The function; without it, a decorator is returned.
    parallel : bool
        Whether ``prange`` runs on several threads.
    inline : {"never", "always"}
        Whether numba inlines the function into kernels that call it.
    exact : bool
        Round after each operation as numpy does, for values that decide between branches.
    inner : bool
        Only other kernels call it: it has no entry from Python and is not kept on disk by itself.  LLVM inlines it
        unless references to arrays are counted.
    counted : bool
        Whether references to arrays are counted.  Without, the kernel must not create or return arrays.

    Returns
    -------
    numba.core.dispatcher.Dispatcher
        Without numba, the function itself; callers then use the reference implementation instead.
    """

    def decorate(f):
        if numba is None:
            return f
        options = dict(
            nogil=True, parallel=parallel, inline=inline, error_model="numpy", fastmath=False if exact else FASTMATH
        )
        if internals is None:
            return numba.njit(**options)(f)
        return internals.compile_with(f, options, inner=inner, counted=counted)

    return decorate if function is None else decorate(function)


# For loops inside a kernel that holds their arrays.  Counting references costs an atomic operation for each array that
# is passed (measured: a fifth of the splat's time).
inner_loop = partial(kernel, inner=True, counted=False)


def read_only(array):
    """Return a view of an array that cannot be written to.

    numba compiles a kernel once for each combination of writable and read-only inputs, so inputs that may be either
    are always passed like this.
    """
    view = array.view()
    view.flags.writeable = False
    return view


prange = range if numba is None else numba.prange


# Whether kernels do the work of the current thread; the only place where this is decided.
_COMPILED: ContextVar[bool] = ContextVar("compiled", default=numba is not None)


def compiled() -> bool:
    """Whether kernels do the work (True), or the reference implementations in numpy, as where numba is missing."""
    return _COMPILED.get()


def run_either(threads: int, kernel_function, reference, *arguments) -> None:
    """Call a parallel kernel on ``threads`` threads, or its reference implementation where no kernels run."""
    if not compiled():
        reference(*arguments)
        return
    with parallel_call(threads):
        kernel_function(*arguments)


@contextmanager
def use_reference(wanted: bool = True):
    """Let the reference implementations in numpy do the work of this thread inside the block; for tests.

    What counts is where work runs, not where it begins: a generator that is made in the block and drained after it
    runs kernels, and each of its steps may differ.  The block must not contain a ``yield``: code of others would run
    in it.  Results of both ways must not share a StageCache, whose keys do not tell them apart.

    Parameters
    ----------
    wanted : bool
        False changes nothing, so that one loop can go through both ways.
    """
    before = _COMPILED.set(_COMPILED.get() and not wanted)
    try:
        yield
    finally:
        _COMPILED.reset(before)


def need_kernels(what: str) -> None:
    """Raise RleSplatError where no kernels run; ``what``: the subject of the sentence, which has no reference."""
    if not compiled():
        raise RleSplatError(f"{what} needs numba, which cannot be loaded ({NUMBA_PROBLEM}); install numba 0.68.")


def available_threads() -> int:
    """Return the largest number of threads for a parallel kernel; 1 with plain numba."""
    return 1 if internals is None else int(numba.config.NUMBA_NUM_THREADS)


def thread_count(requested: int) -> int:
    """Return the number of threads for a request; 0 requests one per core."""
    most = available_threads()
    return most if requested <= 0 else min(requested, most)


@contextmanager
def parallel_call(threads: int = 0):
    """Hold the right to run parallel kernels on ``threads`` threads; the block gets the number in force.

    Another thread that requests it meanwhile waits.

    Raises
    ------
    RuntimeError
        When the same thread holds the right already: it would wait for itself.
    """
    if _HOLDS_TOKEN.get():
        raise RuntimeError("parallel_call within parallel_call: a thread would wait for itself")
    count, held = thread_count(threads), []
    try:
        try:
            _HOLDS_TOKEN.set(True)
            # One call of C takes the token and notes it.  Ctrl-C raises where such a call returns; between two calls
            # it would lose the token, and each later kernel would wait for ever.
            held.extend(map(_TOKEN.get, (True,)))
            with _numba_threads(count):
                yield count
        finally:
            if held:
                _TOKEN.put(None)  # the first call in here, for the same reason
    finally:
        _HOLDS_TOKEN.set(False)


@contextmanager
def _numba_threads(count: int):
    if numba is None:
        yield
        return
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(count)
        yield
    finally:
        numba.set_num_threads(before)
