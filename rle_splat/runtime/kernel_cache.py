"""numba's cache of compiled kernels, made to survive what happens to files.

A kernel that cannot be kept, on a full or read-only disk, works all the same.  A file that is not as it was written,
cut short or flipped, is as if it were not there: what it held is compiled again and written anew.  (numba by itself
raises whatever went wrong, every time, until the folder is deleted; machine code it takes as it finds it.)
"""

from __future__ import annotations

import hashlib
import os
from contextlib import contextmanager
from functools import cache

from llvmlite.binding import add_symbol, parse_bitcode
from numba.core.caching import (
    Cache,
    CompileResultCacheImpl,
    IndexDataCacheFile,
    NullCache,
    UserProvidedCacheLocator,
)
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import compile_result
from numba.core.runtime import _nrt_python

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


class _KeptLibrary(JITCodeLibrary):
    """Machine code from a file.  What a caller of the kernel would link in, LLVM's own code, is read when one is
    compiled: reading it takes longer than all else that a load needs (measured: 31 of 50 ms for ten kernels)."""

    def __init__(self, codegen, name, machine_code, bitcode, defines):
        super().__init__(codegen, name)
        self._bitcode = bitcode
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._finalize_final_module()
        codegen._engine._defined_symbols.update(defines)

    def _get_module_for_linking(self):
        if self._shared_module is None:
            self._shared_module = parse_bitcode(self._bitcode)
        return self._shared_module


class _Folder(UserProvidedCacheLocator):
    """A folder for our kernels alone, wherever numba keeps what others have it keep."""

    path = ""

    def __init__(self, py_func, py_file):
        """Within it, one for each room under each name that it is imported by: what is kept names the classes of
        arguments by their modules, and under another name these are not found.

        Eight digits tell them apart: Windows lets a path have 260 characters, and with numba's forty the names of a
        third of the kernels would not fit behind the folder that Blender gives an extension.
        """
        super().__init__(py_func, py_file)
        room = os.path.dirname(os.path.abspath(py_file))
        digits = hashlib.blake2b(f"{py_func.__module__} {room}".encode(), digest_size=4).hexdigest()
        self._cache_path = os.path.join(self.path, f"{os.path.basename(room)}_{digits}")

    @classmethod
    def from_function(cls, py_func, py_file):
        return super(UserProvidedCacheLocator, cls).from_function(py_func, py_file)  # whose own asks numba's setting


def keep_in(folder) -> None:
    """Have the kernels whose caches are made from now on kept in this folder."""
    _Folder.path = str(folder)


class _Kept(CompileResultCacheImpl):
    """In that folder only: never beside the sources, where nothing may be written."""

    _locator_classes = [_Folder]

    def reduce(self, result):
        """What numba keeps, and the names of all that the machine code defines."""
        kept = super().reduce(result)  # finishes the library
        module = result.library._final_module
        named = (*module.functions, *module.global_variables)
        return tuple(value.name for value in named if not value.is_declaration), *kept

    def rebuild(self, target_context, kept):
        """As numba's ``CompileResult._rebuild``, but for the library."""
        defines, (name, _, code), about, environment, signature, objectmode, lifted, annotation, begin, others = kept
        for function in begin:
            function()
        codegen = target_context.codegen()
        library = _KeptLibrary(codegen, name, *code, defines)
        entry = target_context.get_executable(library, about, environment)
        for other in others:
            codegen.set_env(other.env_name, other)
        return compile_result(
            target_context=target_context, typing_context=target_context.typing_context, library=library,
            environment=environment, entry_point=entry, fndesc=about, type_annotation=annotation, signature=signature,
            objectmode=objectmode, lifted=lifted, reload_init=begin, referenced_envs=others,
        )  # fmt: skip


@cache
def _tell_of_memory() -> None:
    """What kernels call to get memory and give it back is made known to LLVM, by the names that numba gives it.

    numba does so when it gets ready to compile, which takes a hundred times as long: it reads its knowledge of Python
    and numpy, and sees to every type.  Machine code that was kept needs nothing of that (measured: 0.13 s of a picture
    whose kernels are all on disk).  What is compiled later has numba get ready then.
    """
    for name, address in _nrt_python.c_helpers.items():
        add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


class KernelCache(Cache):
    """The cache of one kernel's versions, one for each combination of argument types."""

    _impl_class = _Kept

    def __init__(self, py_func):
        super().__init__(py_func)
        files = self._cache_file
        self._cache_file = _SealedFiles(self._cache_path, self._impl.filename_base, files._source_stamp)

    def load_overload(self, sig, target_context):
        """As numba's own, without getting ready to compile."""
        _tell_of_memory()
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
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
