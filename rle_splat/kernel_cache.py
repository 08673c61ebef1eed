"""numba's cache of compiled kernels, made to survive what happens to files.

A kernel that cannot be kept, on a full or read-only disk, works all the same.  A file that is not as it was written,
cut short or flipped, is as if it were not there: what it held is compiled again and written anew.  (numba by itself
raises whatever went wrong, every time, until the folder is deleted; machine code it takes as it finds it.)
"""

from __future__ import annotations

import hashlib
from contextlib import contextmanager

from numba.core.caching import (
    Cache,
    CompileResultCacheImpl,
    IndexDataCacheFile,
    NullCache,
    UserProvidedCacheLocator,
)

SEAL = 16  # bytes of digest at the end of every file, behind what numba reads of it


class _Sealed:
    """A file to write to that knows the digest of what was written."""

    def __init__(self, file):
        self.file, self.digest = file, hashlib.blake2b(digest_size=SEAL)

    def write(self, content):
        self.digest.update(content)
        return self.file.write(content)


def _refuse_damaged(path) -> None:
    """OSError when the file is not there, or not as it was written."""
    with open(path, "rb") as file:
        content = file.read()
    if hashlib.blake2b(content[:-SEAL], digest_size=SEAL).digest() != content[-SEAL:]:
        raise OSError(f"{path} is damaged")


class _SealedFiles(IndexDataCacheFile):
    """The index and the kernels of one function, each file with a digest of what is before it."""

    def _load_index(self):
        try:
            _refuse_damaged(self._index_path)
        except OSError:
            return {}
        return super()._load_index()

    def _load_data(self, name):
        _refuse_damaged(self._data_path(name))
        return super()._load_data(name)

    def save(self, key, data):
        """Each version of a kernel under a name of its own, and named in the index once it is there.

        numba numbers them: of two processes that compile two versions at once, both may take the same number, and the
        index then hands out one's machine code for the other's arguments.
        """
        versions = self._load_index()
        digest = hashlib.blake2b(repr(key).encode(), digest_size=8).hexdigest()
        versions[key] = f"{self._index_name.removesuffix('.nbi')}.{digest}.nbc"
        self._save_data(versions[key], data)
        self._save_index(versions)

    @contextmanager
    def _open_for_write(self, filepath):
        with super()._open_for_write(filepath) as file:
            sealed = _Sealed(file)
            yield sealed
            file.write(sealed.digest.digest())


class _Kept(CompileResultCacheImpl):
    """In numba's folder for caches only: never beside the sources, where nothing may be written."""

    _locator_classes = [UserProvidedCacheLocator]


class KernelCache(Cache):
    """The cache of one kernel's versions, one for each combination of argument types."""

    _impl_class = _Kept

    def __init__(self, py_func):
        super().__init__(py_func)
        files = self._cache_file
        self._cache_file = _SealedFiles(self._cache_path, self._impl.filename_base, files._source_stamp)

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except OSError:
            return None

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError:
            return  # it will be compiled again another time


def cache_of(py_func):
    """The cache for a kernel; one that keeps nothing where there is no folder for it."""
    try:
        return KernelCache(py_func)
    except (OSError, RuntimeError):  # RuntimeError: numba found no place
        return NullCache()
