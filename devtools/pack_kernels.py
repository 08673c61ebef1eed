"""Compile what default pictures need and pack it into a file, in an environment with numba:

    python -m devtools.pack_kernels FILE COMMENT [few]

NUMBA_CPU_NAME names the processor that the kernels are for.  With "few" they are those of the first picture alone.  The
number of kernels is printed.
"""

from __future__ import annotations

import os
import sys
import zipfile
from pathlib import Path

from numba.core.serialize import dumps

from rle_splat.pipeline.prepare import PICTURES, STORED_TYPES, picture_steps, prepare_steps
from rle_splat.runtime.kernel_cache import KernelCache
from rle_splat.runtime.numba_internals import Kernel
from rle_splat.runtime.shipped_kernels import entry_name
from rle_splat.runtime.steps import drain

EPOCH = (1980, 1, 1, 0, 0, 0)  # one date, so that the same kernels make the same file


def used_kernels():
    """The kernels that this process has called, each once."""
    modules = [module for name, module in sorted(sys.modules.items()) if name.startswith("rle_splat.")]
    found = {id(value): value for module in modules for value in vars(module).values() if type(value) is Kernel}
    return [kernel for kernel in found.values() if kernel.overloads]


def pack(path: Path, comment: bytes) -> int:
    """Write the versions of kernels that this process has called to a file; returns their number."""
    path.parent.mkdir(exist_ok=True)
    partial = path.with_suffix(".part")
    with zipfile.ZipFile(partial, "w") as archive:
        archive.comment = comment
        for kernel in used_kernels():
            cache, codegen = KernelCache(kernel), kernel.targetctx.codegen()
            for types in kernel.overloads:
                key = cache._index_key(types, codegen)
                entry = zipfile.ZipInfo(entry_name(kernel.py_func, types, codegen.magic_tuple()[0]), EPOCH)
                entry.comment = key[-1].encode()
                archive.writestr(entry, dumps(cache._cache_file.load(key)), zipfile.ZIP_DEFLATED, 9)
        count = len(set(archive.namelist()))
        if count != len(archive.namelist()):
            raise RuntimeError("two versions of a kernel have one name in the file")
    os.replace(partial, path)
    return count


if __name__ == "__main__":
    few = sys.argv[3:] == ["few"]
    drain(picture_steps(PICTURES[0], STORED_TYPES[0]) if few else prepare_steps())
    print(pack(Path(sys.argv[1]), sys.argv[2].encode()))
