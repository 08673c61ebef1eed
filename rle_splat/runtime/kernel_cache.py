"""numba's on-disk cache of compiled kernels, with another key and checked files.

The key of a kernel on disk holds everything that decides over its machine code: see ``kernel_digest``.  numba itself
does not compile a kernel again when a function that it inlines or a constant that it uses has changed.

A kernel is looked for among those that came with the installation (``shipped_kernels``), then in the user's folder: in
this order a picture has the same bits however many kernels the folder holds.

A kernel that cannot be kept, on a full or read-only disk, works all the same.  A file that is damaged counts as
missing: its kernel is compiled again.  (numba itself executes damaged machine code, or raises until the folder is
deleted.)

This module relies on numba's internals; only ``numba_internals`` imports it.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import contextmanager, suppress
from functools import cache

from llvmlite.binding import add_symbol
from numba.core.caching import (
    Cache,
    CompileResultCacheImpl,
    IndexDataCacheFile,
    NullCache,
    UserProvidedCacheLocator,
)
from numba.core.runtime import _nrt_python

from .kernel_digest import digest_of
from .shipped_kernels import ShippedKernels, entry_name

SEAL = 16  # bytes of digest at the end of each file, after the part that numba reads
KEPT_EDITIONS = 4  # of a kernel for the same arguments and processor, from different sources


class _Sealed:
    """A file opened for writing that computes the digest of what is written."""

    def __init__(self, file):
        self.file, self.digest = file, hashlib.blake2b(digest_size=SEAL)

    def write(self, content):
        self.digest.update(content)
        return self.file.write(content)


def _refuse_damaged(path) -> None:
    """Raise OSError when the file is missing or differs from what was written."""
    with open(path, "rb") as file:
        content = file.read()
    if hashlib.blake2b(content[:-SEAL], digest_size=SEAL).digest() != content[-SEAL:]:
        raise OSError(f"{path} is damaged")


class _SealedFiles(IndexDataCacheFile):
    """The index and the compiled versions of one kernel, each file with a digest of its content at the end."""

    def _load_index(self):
        try:
            _refuse_damaged(self._index_path)
            return super()._load_index()
        except (OSError, AttributeError, ImportError):  # an index of an earlier version may name classes that are gone
            return {}

    def _load_data(self, name):
        _refuse_damaged(self._data_path(name))
        return super()._load_data(name)

    def save(self, key, data):
        """Write a version of the kernel, then the index that names it; remove the oldest editions of the version.

        The file's name is made from the key.  numba numbers the files instead: of two processes that compile two
        versions at once, both may take the same number, and the index then gives one's machine code for the other's
        arguments.

        Parameters
        ----------
        key : tuple
            The types of the arguments, the processor, and the digest of the sources.
        """
        versions = self._load_index()
        versions.pop(key, None)  # the latest comes last
        digest = hashlib.blake2b(repr(key).encode(), digest_size=8).hexdigest()
        versions[key] = f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"
        editions = [other for other in versions if other[:-1] == key[:-1]]
        for old in editions[:-KEPT_EDITIONS]:
            with suppress(OSError):  # another process has removed it, or has it open on Windows
                os.remove(self._data_path(versions[old]))
            del versions[old]
        self._save_data(versions[key], data)
        self._save_index(versions)

    @contextmanager
    def _open_for_write(self, filepath):
        with super()._open_for_write(filepath) as file:
            sealed = _Sealed(file)
            yield sealed
            file.write(sealed.digest.digest())


class _Folder(UserProvidedCacheLocator):
    """The folder of our kernels alone; numba's setting of a folder, which others may use, stays as it is."""

    path = ""

    def __init__(self, py_func, py_file):
        """Choose a subfolder by the module's name.

        A file on disk refers to the classes of arguments by their modules, so the same package imported under another
        name needs files of its own.  Where it is installed does not matter: the key holds the code.  Eight digits
        distinguish modules: Windows allows paths of 260 characters, and with numba's forty digits a third of the
        kernels would not fit in the folder that Blender gives an extension.
        """
        super().__init__(py_func, py_file)
        digits = hashlib.blake2b(py_func.__module__.encode(), digest_size=4).hexdigest()
        folder = os.path.basename(os.path.dirname(os.path.abspath(py_file)))
        self._cache_path = os.path.join(self.path, f"{folder}_{digits}")

    @classmethod
    def from_function(cls, py_func, py_file):
        return super(UserProvidedCacheLocator, cls).from_function(py_func, py_file)  # its own reads numba's setting

    def get_source_stamp(self):
        return ""  # the key says what the kernel was compiled from, the file's date does not matter

    def get_disambiguator(self):
        return ""  # numba's is the number of the first line, which changes with the text above


SHIPPED = ShippedKernels()


def keep_in(folder) -> None:
    """Set the folder for the kernels that are compiled or loaded from now on."""
    _Folder.path = str(folder)


class _KernelFolder(CompileResultCacheImpl):
    """Kernels in that folder only: nothing may be written beside the sources."""

    _locator_classes = [_Folder]


@cache
def _register_memory_functions() -> None:
    """Give LLVM the addresses of the functions by which kernels allocate memory and free it.

    numba does so when it prepares to compile, and then also loads all that it knows of Python and numpy.  Kernels
    from disk need nothing of that (measured: 0.09 s of a picture whose kernels are all on disk).  A kernel that is
    compiled later has numba prepare then.
    """
    for name, address in _nrt_python.c_helpers.items():
        add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


class KernelCache(Cache):
    """The on-disk cache of one kernel's versions, one for each combination of argument types.

    Parameters
    ----------
    dispatcher : numba.core.dispatcher.Dispatcher
        The kernel.
    """

    _impl_class = _KernelFolder

    def __init__(self, dispatcher):
        super().__init__(dispatcher.py_func)
        self._digest = digest_of(dispatcher)
        self._cache_file = _SealedFiles(self._cache_path, self._impl.filename_base, "")

    def _index_key(self, sig, codegen):
        return sig, codegen.magic_tuple(), self._digest

    def load_overload(self, sig, target_context):
        """Return a version from disk, or None; as numba's own method, but without preparing to compile."""
        _register_memory_functions()
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_shipped(sig, target_context) or self._load_overload(sig, target_context)
        except OSError:
            return None

    def _load_shipped(self, sig, target_context):
        """A version that came with the installation, or None."""
        triple, _, _ = target_context.codegen().magic_tuple()
        data = SHIPPED.load(entry_name(self._py_func, sig, triple), self._digest)
        return None if data is None else self._impl.rebuild(target_context, data)

    def save_overload(self, sig, data):
        """Keep a version on disk where that is possible."""
        try:
            super().save_overload(sig, data)
        except OSError:
            return  # the next process compiles it again


def cache_of(dispatcher):
    """Return the on-disk cache of a kernel; one that keeps nothing where there is no folder for it."""
    try:
        return KernelCache(dispatcher)
    except (OSError, RuntimeError):  # RuntimeError: numba has found no place
        return NullCache()
