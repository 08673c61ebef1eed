"""The parts of numba and LLVM in which intrinsics are written.

``ir``: LLVM instructions (llvmlite).  ``types``: numba's types.  ``cgutils``: helpers that write instructions.
``intrinsic``: makes a function that writes instructions callable from kernels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .jit import numba


class _Missing:
    """Stands for all of them without numba, so that modules of intrinsics can be imported; no kernel calls them."""

    def __getattr__(self, name):
        return self

    def __call__(self, *_, **__):
        return self


if TYPE_CHECKING:
    ir: Any
    types: Any
    cgutils: Any
    intrinsic: Any  # numba's own type has the function's first parameter, which callers leave out
elif numba is not None:
    from llvmlite import ir
    from numba.core import cgutils, types
    from numba.extending import intrinsic
else:
    ir = types = cgutils = intrinsic = _Missing()

__all__ = ["cgutils", "intrinsic", "ir", "types"]
