"""The parts of numba and LLVM in which intrinsics are written; None each without numba.

``ir``: LLVM instructions (llvmlite).  ``types``: numba's types.  ``cgutils``: helpers that write instructions.
``intrinsic``: makes a function that writes instructions callable from kernels.
"""

from __future__ import annotations

from .jit import numba

if numba is not None:
    from llvmlite import ir
    from numba.core import cgutils, types
    from numba.extending import intrinsic
else:
    ir = types = cgutils = intrinsic = None

__all__ = ["cgutils", "intrinsic", "ir", "numba", "types"]
