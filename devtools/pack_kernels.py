"""Compile the kernels that travel with the extension and pack them into a file, in an environment with numba:

    python -m devtools.pack_kernels FILE COMMENT       compile, and pack
    python -m devtools.pack_kernels FILE COMMENT MADE  pack those of MADE, of another Python, for this one

NUMBA_CPU_NAME names the processor that the kernels are for.  The number of kernels is printed.

Machine code is the same for all Pythons: it calls them by functions of their stable interface alone (a test of
tests/unit/test_machine_code.py).  The digest of a kernel's sources is not, because it covers Python's instructions.
"""

from __future__ import annotations

import os
import pickle
import sys
import zipfile
from pathlib import Path

from numba import none
from numba.core.serialize import dumps

from rle_splat.pipeline.prepare import prepare_steps
from rle_splat.runtime.kernel_cache import KernelCache
from rle_splat.runtime.kernel_digest import digest_of
from rle_splat.runtime.numba_internals import Kernel
from rle_splat.runtime.shipped_kernels import entry_name
from rle_splat.runtime.steps import drain

EPOCH = (1980, 1, 1, 0, 0, 0)  # one date, so that the same kernels make the same file


def used_kernels():
    """The kernels that this process has called, each once."""
    modules = [module for name, module in sorted(sys.modules.items()) if name.startswith("rle_splat.")]
    found = {id(value): value for module in modules for value in vars(module).values() if type(value) is Kernel}
    return [kernel for kernel in found.values() if kernel.overloads]


def _compiled():
    """Yields each version of a kernel that this process has called: (name, digest, what numba rebuilds it from)."""
    for kernel in used_kernels():
        cache, codegen = KernelCache(kernel), kernel.targetctx.codegen()
        for types, compiled in kernel.overloads.items():
            if compiled.signature.return_type != none:  # what a picture calls fills arrays; this is a part of others
                continue
            key = cache._index_key(types, codegen)
            name = entry_name(kernel.py_func, types, codegen.magic_tuple()[0])
            yield name, key[-1], dumps(cache._cache_file.load(key))


def _made_for_another(path: Path):
    """Yields what ``_compiled`` does, of a file for another Python."""
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            content = archive.read(entry)
            description = pickle.loads(content)[1]  # it imports the kernel's module
            kernel = getattr(sys.modules[description.modname], description.qualname)
            yield entry.filename, digest_of(kernel), content


def pack(path: Path, comment: bytes, found=None) -> int:
    """Write the kernels' versions that this process has called, or those ``found``, to a file; returns their number."""
    path.parent.mkdir(exist_ok=True)
    partial = path.with_suffix(".part")
    with zipfile.ZipFile(partial, "w") as archive:
        archive.comment = comment
        for name, digest, content in found or _compiled():
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.comment = digest.encode()
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED, 9)
        count = len(set(archive.namelist()))
        if count != len(archive.namelist()):
            raise RuntimeError("two versions of a kernel have one name in the file")
    os.replace(partial, path)
    return count


def main(path: str, comment: str, made: str = "") -> None:
    if not made:
        drain(prepare_steps())
    print(pack(Path(path), comment.encode(), _made_for_another(Path(made)) if made else None))


if __name__ == "__main__":
    main(*sys.argv[1:])
