"""The digest of everything that decides over a kernel's machine code.

It covers the kernel's own code and options, and in turn those of each function that its code names: kernels,
intrinsics, the helpers and classes with which intrinsics write instructions.  It covers the values of the constants
that they name, and the settings of numba and LLVM that change machine code.  Comments, docstrings and line numbers are
not part of it, nor is any function that the kernel does not use, nor the name that this package has in a process.

Code of numba, llvmlite, numpy and Python is covered by name: the cache is emptied for another version of numba.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType

import llvmlite.binding
import numba
import numpy as np

# Settings of numba that change machine code.  numba's own key holds the processor and its features.
SETTINGS = (
    "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "ENABLE_AVX", "DISABLE_INTEL_SVML", "USING_SVML", "LLVM_REFPRUNE_PASS",
    "LLVM_REFPRUNE_FLAGS", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "EXTEND_VARIABLE_LIFETIMES",
)  # fmt: skip
PACKAGE = __name__.rpartition(".runtime.")[0]  # the name that this package has in this process
FOREIGN = {"numba", "llvmlite", "numpy", *sys.stdlib_module_names}
NOT_CODE = ("__doc__", "__module__", "__firstlineno__")  # of a class: a line above it changes no kernel


def _within(name: str) -> str:
    """The name of a module of ours within the package; the whole name of any other."""
    return name.removeprefix(PACKAGE)


def digest_of(kernel) -> str:
    """Return the digest of a kernel, as 32 hexadecimal digits.

    Parameters
    ----------
    kernel : numba.core.dispatcher.Dispatcher
    """
    digest = hashlib.blake2b(digest_size=16)
    for text in (*_settings(), *_parts(kernel, set())):
        digest.update(text.encode())
        digest.update(b"\0")
    return digest.hexdigest()


def _settings() -> Iterator[str]:
    """What all kernels depend on, read when a kernel is first needed: programs may set it after the import."""
    yield f"LLVM {llvmlite.binding.llvm_version_info}, llvmlite {llvmlite.__version__}"
    for name in SETTINGS:
        yield f"{name} = {getattr(numba.config, name, None)}"


def _parts(value, seen: set) -> Iterator[str]:
    """Texts that together say what a value is; ``seen`` holds the functions and classes that were described before."""
    value = _unwrap(value)
    if isinstance(value, (FunctionType, type, ModuleType)) or hasattr(value, "py_func"):
        module = _within(getattr(value, "__module__", None) or "")
        yield f"{type(value).__name__} {module}.{_within(_name(value))}"
        if id(value) in seen or isinstance(value, ModuleType) or _is_foreign(value):
            return
        seen.add(id(value))
    if hasattr(value, "py_func"):
        yield from _parts(dict(value.targetoptions), seen)
        yield from _parts(value.py_func, seen)
    elif isinstance(value, FunctionType):
        yield from _code_parts(value.__code__, value.__doc__, value.__globals__, seen)
        for held in (
            value.__defaults__,
            value.__kwdefaults__,
            *(cell.cell_contents for cell in value.__closure__ or ()),
        ):
            yield from _parts(held, seen)
    elif isinstance(value, type):
        yield from _parts(getattr(value, "_fields", ()), seen)
        for name, member in sorted(vars(value).items()):
            member = _unwrap(member)
            if isinstance(member, (FunctionType, int, float, str)) and name not in NOT_CODE:
                yield name
                yield from _parts(member, seen)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape}"
        yield hashlib.blake2b(np.ascontiguousarray(value).tobytes()).hexdigest()
    elif isinstance(value, (tuple, list)):
        yield f"{type(value).__name__} of {len(value)}"
        for item in value:
            yield from _parts(item, seen)
    elif isinstance(value, dict):
        yield from _parts(sorted(value.items(), key=lambda item: str(item[0])), seen)
    elif isinstance(value, (set, frozenset)):
        yield from _parts(sorted(value, key=str), seen)
    elif not isinstance(value, ModuleType):
        text = str(value)
        yield f"{type(value).__name__} {'' if ' at 0x' in text else text}"


def _code_parts(code: CodeType, doc: str | None, names: dict, seen: set) -> Iterator[str]:
    """The instructions of a function, its constants, and the globals that it names; ``names``: the globals."""
    yield code.co_code.hex()
    yield " ".join((*code.co_names, *code.co_varnames, *code.co_freevars))
    modules = [names[name] for name in code.co_names if isinstance(names.get(name), ModuleType)]
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant, _doc_of(constant), names, seen)
        elif constant is None or constant != doc:
            yield from _parts(constant, seen)
    for name in code.co_names:
        if name in names:
            yield name
            yield from _parts(names[name], seen)
        for module in modules:
            if not _is_foreign(module) and name in vars(module):
                yield f"{_within(module.__name__)}.{name}"
                yield from _parts(vars(module)[name], seen)


def _doc_of(code: CodeType) -> str | None:
    """The docstring of a nested function: its first constant, where that is a text of several words."""
    first = code.co_consts[0] if code.co_consts else None
    return first if isinstance(first, str) and " " in first else None


def _unwrap(value):
    """The function within an intrinsic, a property or a class method; else the value itself."""
    if isinstance(value, property):
        return value.fget
    if isinstance(value, type) or hasattr(value, "py_func"):
        return value
    return getattr(value, "__wrapped__", value)


def _name(value) -> str:
    return getattr(value, "__qualname__", None) or getattr(value, "__name__", "")


def _is_foreign(value) -> bool:
    """Whether a function, a class or a module is not of RLE Splat."""
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
    return (module or "builtins").partition(".")[0] in FOREIGN
