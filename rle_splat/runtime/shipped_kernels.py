"""Kernels that come with an installation: compiled for a level of processors that most machines reach.

``dev.py kernels`` compiles what ``rle-splat prepare`` covers, and packs it into one zip file for each version of
Python.  There is one level, so that all machines that reach it run the same machine code.  An entry's name is a digest
of the kernel's name, the types of its arguments and the system; its comment is the digest of all else that decides over
its machine code, so a kernel that does not fit its source is not used.  The zip's checksums refuse a damaged one.
Nothing is written here.

The processes that make these files and those that use them know the package by different names.

This module relies on numba's internals; only ``numba_internals`` and ``kernel_cache`` import it.
"""

import hashlib
import io
import pickle
import re
import sys
import zipfile
import zlib
from functools import partial
from pathlib import Path

import numba
from llvmlite.binding import get_host_cpu_features

from .kernel_digest import PACKAGE

FOLDER = Path(__file__).parents[1] / "kernels"
MAKER = "rle_splat"  # the package's name in the process that made the files

# LLVM's name of the level, and the features of a processor that reaches it.  Intel's processors have those of x86-64-v3
# from 2013 on, and AMD's from 2015 on.  Apple's in a Mac are an M1 or later.
LEVEL, FEATURES = "x86-64-v3", (
    "avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sahf", "sse4.2", "xsave",
)  # fmt: skip
if sys.platform == "darwin":
    LEVEL, FEATURES = "apple-m1", ()
OURS = "The compiled code of this installation"
COMPILED_INSTEAD = "Code is compiled when a picture first needs it."


def file_name() -> str:
    """The name of the file for this version of Python and of numba."""
    return f"python{sys.version_info[0]}.{sys.version_info[1]}-numba{numba.__version__}-{LEVEL}.zip"


def is_level_reached() -> bool:
    """Whether this processor reaches the level."""
    features = get_host_cpu_features()
    return all(features.get(name, False) for name in FEATURES)


def entry_name(function, types, triple: str) -> str:
    """The name of a kernel's version in the file.

    Parameters
    ----------
    function : function
        Python's, that the kernel is compiled from.
    types : tuple of numba.types.Type
        Of the arguments; numba gives each a name of its own, whatever the package's name.
    triple : str
        LLVM's name of the system; that of macOS ends with the version of the running kernel, which does not count.
    """
    kernel = f"{function.__module__.removeprefix(PACKAGE)}.{function.__qualname__}"
    system = re.sub(r"(darwin|macosx?)[\d.]+$", r"\1", triple)
    return hashlib.blake2b(f"{kernel} {types!r} {system}".encode(), digest_size=16).hexdigest()


class ShippedKernels:
    """The kernels of one folder for this process.

    Parameters
    ----------
    folder : Path
        Where a folder without a file for this process is a problem, no folder is none: not every installation has one.

    Attributes
    ----------
    level : str
        That of the kernels, or "" where there are none.
    problem : str
        Why there are none, or not all, for people.
    """

    def __init__(self, folder: Path = FOLDER):
        self.level = self.problem = ""
        self._archive = None
        # A processor that the user has named is to be compiled for.
        if not folder.is_dir() or numba.config.CPU_NAME:
            return
        path = folder / file_name()
        if not is_level_reached():
            self.problem = f"{OURS} needs a processor with AVX2. {COMPILED_INSTEAD}"
        elif not path.is_file():
            versions = f"Python {sys.version_info[0]}.{sys.version_info[1]} with numba {numba.__version__}"
            self.problem = f"This installation has no compiled code for {versions}. {COMPILED_INSTEAD}"
        else:
            self._open(path)

    def _open(self, path: Path) -> None:
        try:
            # A copy in memory, of some MB: on Windows a file that is open keeps an extension from being removed.
            self._archive = zipfile.ZipFile(io.BytesIO(path.read_bytes()))
            self.level = LEVEL
        except (OSError, zipfile.BadZipFile):
            self._report_damage()

    def _report_damage(self) -> None:
        self.problem = f"{OURS} is damaged ({file_name()}); install it again. {COMPILED_INSTEAD}"

    def load(self, name: str, digest: str):
        """Return what numba rebuilds a kernel's version from, or None.

        Parameters
        ----------
        name : str
            See ``entry_name``.
        digest : str
            See ``kernel_digest``.
        """
        if self._archive is None or name not in self._archive.NameToInfo:
            return None
        entry = self._archive.NameToInfo[name]
        if entry.comment != digest.encode():
            self.problem = f"{OURS} is of other sources or of other settings of numba. {COMPILED_INSTEAD}"
            return None
        try:
            content = self._archive.read(entry)
        except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError):  # the last: it seems to be encrypted
            self._report_damage()
            return None
        return _Reader(io.BytesIO(content)).load()


class _Reader(pickle.Unpickler):
    """Finds what a file names in this package, whatever its name is here."""

    def find_class(self, module, name):
        found = super().find_class(_here(module), name)
        return partial(_rebuild_here, found) if name == "_rebuild_env" else found


def _rebuild_here(rebuild, module, *rest):
    """numba's function that rebuilds the environment of a kernel, which names the kernel's module."""
    return rebuild(_here(module), *rest)


def _here(module: str) -> str:
    """The name in this process of a module that a file names."""
    return PACKAGE + module.removeprefix(MAKER) if f"{module}.".startswith(f"{MAKER}.") else module
