"""Loading a library in steps, so that a window stays alive while a format's library is imported for the first time.

Python compiles each source of a library once, which takes most of the first import: for pydicom and nibabel about a
second. So sources without a compiled file are compiled one by one, as the import would. Then what the library imports
is imported piece by piece, and the library itself last.
"""

import sys
from contextlib import suppress
from importlib import import_module
from importlib.util import cache_from_source, find_spec
from pathlib import Path
from py_compile import PyCompileError
from py_compile import compile as compile_source

from ..runtime.steps import Progress
from .header import library

# What the libraries import first, in an order in which no piece takes long.
_DICOM = ("email.parser", "urllib.request", "importlib.metadata", "http.client", "pylibjpeg", "pydicom")
PIECES = {"pydicom": _DICOM, "nibabel": (*_DICOM, "nibabel.filebasedimages", "nibabel")}
# Folders of libraries that reading does not import: tests, programs, tables of structured reports.
LEFT_OUT = ("tests", "testing", "benchmarks", "cli", "cmdline", "sr")


def library_steps(name: str, package: str, formats: str):
    """Generator of Progress: ``header.library`` in steps; RleSplatError if this Python lacks the library.

    Parameters
    ----------
    name : str
        One of PIECES.
    package, formats : str
        As for ``header.library``.

    Returns
    -------
    module
    """
    if name not in sys.modules:
        doing = Progress(0.0, f"Loading {package}")
        yield doing
        for piece in PIECES[name]:
            for _ in _compile_steps(piece.partition(".")[0]):
                yield doing
            with suppress(ImportError):  # of a part that may be missing; that of the library itself is reported below
                import_module(piece)
            yield doing
    return library(name, package, formats)


def _compile_steps(package: str):
    """Generator: compile the sources of a package that was never imported, if compiled ones can be written."""
    if package in sys.modules or package in sys.stdlib_module_names or sys.dont_write_bytecode:
        return
    found = find_spec(package)
    if found is None or not found.origin or not found.submodule_search_locations:
        return
    root = Path(found.origin).parent
    for source in sorted(root.rglob("*.py")):
        parts = source.relative_to(root).parts
        if set(parts).intersection(LEFT_OUT) or Path(cache_from_source(source)).exists():
            continue
        try:
            compile_source(str(source), quiet=2)
        except (OSError, PyCompileError):
            return  # the folder cannot be written
        yield
