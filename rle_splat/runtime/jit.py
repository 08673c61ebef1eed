"""numba, met politely: one decorator for every kernel, a cache in a writable place, one parallel call at a time.

Without numba (or with one that cannot load) everything still works through the numpy twins that stand beside
the kernels; ``compiled(backend)`` is the one place where that choice is made.
"""

from __future__ import annotations

import hashlib
import os
import queue
import shutil
import stat
import sys
import tempfile
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from importlib import import_module
from pathlib import Path

from ..scene import RleSplatError
from .interpreter import collector_paused

CACHE_VARIABLE = "RLE_SPLAT_CACHE"
NUMBA_VARIABLE = "NUMBA_CACHE_DIR"  # where somebody wants all that numba compiles: it comes first
KERNEL_PREFIX = "kernels-"
KEPT_VERSIONS = 4
CONSTANTS = "scene"  # the room without kernels of which kernels take constants, NO_DEPTH and the like


def cache_folder() -> Path:
    """A folder for compiled kernels that the user can write to and nobody else: within $NUMBA_CACHE_DIR, else
    $RLE_SPLAT_CACHE, else the platform's cache folder, else a temporary one.  Blender's bridge sets the second to the
    extension's own user folder before kernels load."""
    numbas = os.environ.get(NUMBA_VARIABLE)
    if numbas and _are_usable(Path(numbas), Path(numbas, "rle_splat")):
        return _resolved(Path(numbas, "rle_splat"))
    with suppress(RuntimeError):  # a user without a home
        preferred = _preferred_folders()
        if _are_usable(*preferred):
            return _resolved(preferred[-1])
    return _temporary_folder()


def _preferred_folders() -> tuple[Path, ...]:
    """The folder for kernels, after the one that a variable gives it in, if any."""
    if os.environ.get(CACHE_VARIABLE):
        return (Path(os.environ[CACHE_VARIABLE]),)
    if sys.platform == "win32":
        return (Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "rle_splat" / "cache",)
    if sys.platform == "darwin":
        return (Path.home() / "Library" / "Caches" / "rle_splat",)
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"]), Path(os.environ["XDG_CACHE_HOME"], "rle_splat")
    return (Path.home() / ".cache" / "rle_splat",)


def _resolved(folder: Path) -> Path:
    """Without symbolic links, which somebody might turn to another place once it was looked at."""
    return Path(os.path.realpath(folder))


def _are_usable(*folders: Path) -> bool:
    """Whether the user can write to all of these folders, which are made if need be, and nobody else."""
    try:
        for folder in map(_resolved, folders):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
            if not _is_private(folder):
                return False
        return True
    except OSError:
        return False


def _is_private(folder: Path) -> bool:
    """Whether nobody but the user can have put anything into a folder: what is loaded from it is run."""
    if not hasattr(os, "getuid"):  # Windows, where no users share these folders
        return True
    found = folder.lstat()
    # Many systems give each user a group of the same number, whose members may by default write what the user writes.
    others = stat.S_IWOTH | (0 if found.st_gid == found.st_uid else stat.S_IWGRP)
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & others


def _temporary_folder() -> Path:
    """The user's own among the temporary ones, where another may have made it before; or a place where nothing can be
    kept."""
    with suppress(OSError):
        shared = Path(tempfile.gettempdir())
        if not hasattr(os, "getuid"):
            return shared / "rle_splat-user"
        folder = shared / f"rle_splat-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        if _is_private(folder):
            return folder
    return Path(os.devnull) / "rle_splat"  # below a file


def _last_changed(folder: Path) -> float:
    """Seconds since 1970; 0 where another process has removed the folder meanwhile."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return 0.0


def _kernel_folder() -> Path:
    """The folder for kernels compiled from exactly these sources.

    numba recompiles a kernel when its own file changes, but not when a file it inlines or takes constants from
    does, so the folder's name carries a hash of every file in a room that holds kernels, and in the one whose
    constants they take, and of numba's version.  The latest few are kept, for several versions side by side.
    """
    parent = cache_folder()
    sources = hashlib.blake2b(numba.__version__.encode(), digest_size=8)
    for room, _, names in sorted(os.walk(Path(__file__).parents[1])):
        contents = []
        for name in sorted(names):
            if name.endswith(".py"):
                with open(os.path.join(room, name), "rb", buffering=0) as file:
                    contents.append(file.read())
        if os.path.basename(room) == CONSTANTS or any(b"@kernel" in content for content in contents):
            sources.update(b"".join(contents))
    folder = parent / f"{KERNEL_PREFIX}{sources.hexdigest()}"
    if not folder.exists():
        earlier = sorted(parent.glob(f"{KERNEL_PREFIX}*"), key=_last_changed, reverse=True)
        for stale in earlier[KEPT_VERSIONS - 1 :]:
            shutil.rmtree(stale, ignore_errors=True)
    return folder


def nothing_compiled_yet() -> bool:
    """Whether there is no kernel on disk at all: what is rendered now compiles all that it needs."""
    return numba is not None and next(KERNELS.rglob("*.nbi"), None) is None


# Where OpenMP is the threading layer, its idle threads would spin on a core between kernels, and take it from the
# kernels of a single thread and from every other program.  Read once, when the first parallel kernel loads it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# LLVM's first level of optimisation in place of its third: kernels whose loops are wide already gain nothing from the
# others (measured: the same bits, frames within 3 %), and the first picture ever comes a second and a half sooner.
OPTIMISATION = 1

try:
    with collector_paused():
        import numba

        if numba.config.DISABLE_JIT:
            raise RuntimeError("it is told to compile nothing, by NUMBA_DISABLE_JIT")

        from .kernel_cache import NullCache, cache_of, keep_in

        # Not by numba's variables: where one is new, numba reads all of them again when it next compiles, and forgets
        # what another add-on has set in the program.
        if not os.environ.get("NUMBA_OPT"):
            numba.config.OPT = type(numba.config.OPT)(OPTIMISATION)
        KERNELS = _kernel_folder()
        keep_in(KERNELS)
        # Where there are kernels of this numba, the compiler has worked and is seldom needed: it is loaded with the
        # first kernel that is compiled.  Else here, where what is wrong with it can be told.
        if nothing_compiled_yet():
            import_module(".kernel_compiler", __package__)
    NUMBA_PROBLEM = ""
except Exception as problem:  # a broken install fails in many ways (ImportError, OSError, AttributeError, SystemError)
    numba = None
    NUMBA_PROBLEM = f"{type(problem).__name__}: {problem}"

# Whoever wants to know which kernels run puts a set here, see ``noting_kernels``.
_NOTED: ContextVar[set | None] = ContextVar("noted_kernels", default=None)

if numba is not None:

    class _NotedDispatcher(numba.core.registry.CPUDispatcher):
        """A kernel that tells, where it is called from Python, who has asked (measured: 1 microsecond a call)."""

        def __call__(self, *arguments):
            noted = _NOTED.get()
            if noted is not None:
                function = self.py_func
                noted.add(f"{function.__module__.rpartition('rle_splat.')[2]}.{function.__name__}")
            return super().__call__(*arguments)

        def compile(self, signature):
            """Or load from disk."""
            if isinstance(self._cache, NullCache):
                self._cache = cache_of(self.py_func)
            return super().compile(signature)


@contextmanager
def noting_kernels(names: set):
    """Add to ``names`` each kernel that is called from Python in here, as module and name: ``warp.resample.resample``.

    Kernels within others have no call of their own.  Not to be left open over a generator's yield: what runs then
    belongs to somebody else.
    """
    outside = _NOTED.set(names)
    try:
        yield
    finally:
        _NOTED.reset(outside)


# Kernels, and types of arguments that they have been loaded for.
_LOADED: set[tuple] = set()


def is_loaded(function, arguments: tuple) -> bool:
    """Whether ``note_loaded`` was told of this kernel for arguments of these types: quicker to ask (measured: 8
    microseconds) than a call that does nothing (25)."""
    return (function, numba._dispatcher.compute_fingerprint(arguments)) in _LOADED


def note_loaded(function, arguments: tuple) -> None:
    _LOADED.add((function, numba._dispatcher.compute_fingerprint(arguments)))


# NaN tests must survive and sums must keep their order, so none of nnan, ninf, reassoc, afn.
FASTMATH = {"contract", "arcp", "nsz"}


def _compiler(name: str):
    """A compiler of ``kernel_compiler``, which takes longer to load than all kernels of a picture together."""

    def begun(*arguments):
        return getattr(import_module(".kernel_compiler", __package__), name)(*arguments)

    return begun


# numba's workqueue layer aborts the whole process when two parallel kernels run at once, so a single token is
# passed round.  (A queue needs no import of threading, which the Extensions platform refuses.)
_TOKEN: queue.SimpleQueue = queue.SimpleQueue()
_TOKEN.put(None)
# Every thread has a context of its own, so this is whether the thread that asks holds the token already.
_HOLDS_TOKEN: ContextVar[bool] = ContextVar("holds_token", default=False)


def kernel(
    function=None, *, parallel=False, inline="never", forceinline=False, exact=False, inner=False, counted=True
):
    """Compile a kernel of arrays and scalars in nopython mode, cached on disk, without the GIL.

    ``forceinline``: for a part of another kernel's loop, so that handing it its arrays costs nothing.
    ``exact`` rounds after every operation as numpy does, for values that decide over a step.  ``inner``: only ever
    called by other kernels, which saves finishing it by itself (``kernel_compiler``) and keeping it on disk.
    ``counted``: whether references to arrays are counted; without, it must not make or return any.  Without numba the
    plain Python function comes back; callers choose the numpy twin instead of calling it.
    """

    def decorate(f):
        if numba is None:
            return f
        options = dict(
            nogil=True, parallel=parallel, inline=inline, forceinline=forceinline, error_model="numpy",
            fastmath=False if exact else FASTMATH, no_cfunc_wrapper=True, _nrt=counted,
        )
        if inner:
            return numba.njit(no_cpython_wrapper=True, pipeline_class=_compiler("InnerCompiler"), **options)(f)
        if not parallel:
            options["pipeline_class"] = _compiler("KernelCompiler")
        dispatcher = numba.njit(**options)(f)
        dispatcher.__class__ = _NotedDispatcher
        return dispatcher

    return decorate if function is None else decorate(function)


# For the loops inside a kernel that holds their arrays: counting references costs an atomic operation at every
# hand-over (measured: a fifth of the splat's time).
inner_loop = partial(kernel, inner=True, counted=False)


def read_only(array):
    """A view that cannot be written to.  numba compiles a kernel once more for each mixture of writable and
    read-only inputs, so inputs whose origin varies are always passed like this."""
    view = array.view()
    view.flags.writeable = False
    return view


prange = range if numba is None else numba.prange


def compiled(backend: str = "auto") -> bool:
    """Whether kernels (True) or their numpy twins (False) do the work.

    Raises RleSplatError when ``backend`` is "numba" and numba cannot be loaded.
    """
    if backend == "numpy":
        return False
    if numba is None and backend == "numba":
        raise RleSplatError(
            f"numba cannot be loaded ({NUMBA_PROBLEM}); install numba 0.68 or choose the numpy backend."
        )
    return numba is not None


def available_threads() -> int:
    """How many threads a parallel kernel may use at most."""
    return 1 if numba is None else int(numba.config.NUMBA_NUM_THREADS)


def thread_count(requested: int) -> int:
    """The number of threads for a request; 0 asks for one per core."""
    most = available_threads()
    return most if requested <= 0 else min(requested, most)


@contextmanager
def parallel_call(threads: int = 0):
    """Hold the right to run parallel kernels on ``threads`` threads; yields the number in force.

    Another thread that asks meanwhile waits; RuntimeError when this one holds the right already, for it would wait
    for itself for ever.
    """
    if _HOLDS_TOKEN.get():
        raise RuntimeError("parallel_call within parallel_call: a thread would wait for itself")
    count, held = thread_count(threads), []
    try:
        try:
            _HOLDS_TOKEN.set(True)
            # Taken and noted in a single call of C.  Ctrl-C raises an exception where such a call returns: one between
            # the two would lose the token, and every later kernel would wait for ever.
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
