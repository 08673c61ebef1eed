"""The machine code of the kernels that ``dev.py kernels`` has made: what processors and Pythons may differ in."""

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from devtools.kernels import is_made
from rle_splat.runtime.jit import compiled

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.runtime.shipped_kernels import FOLDER, LEVEL, ShippedKernels, file_name, is_level_reached

pytestmark = [pytest.mark.slow, pytest.mark.skipif(
    not is_level_reached(), reason=f"this processor does not reach {LEVEL}, which kernels are shipped for"
)]  # fmt: skip

# Functions and objects of Python's stable interface, and two that all versions export with the same meaning.
OF_ALL_PYTHONS = {
    "PyArg_UnpackTuple", "PyBytes_FromStringAndSize", "PyErr_Clear", "PyErr_Format", "PyErr_Occurred", "PyErr_SetNone",
    "PyErr_SetString", "PyEval_RestoreThread", "PyEval_SaveThread", "PyExc_RuntimeError", "PyExc_StopIteration",
    "PyExc_SystemError", "PyExc_TypeError", "PyExc_ValueError", "PyFloat_AsDouble", "PyFloat_FromDouble",
    "PyLong_AsLongLong", "PyLong_AsUnsignedLongLong", "PyNumber_Float", "PyNumber_Long", "PyObject_Hash",
    "PyObject_IsTrue",
    "PyTuple_GetItem", "PyTuple_Pack", "PyTuple_Size", "Py_DecRef", "Py_IncRef", "PyUnicode_FromKindAndData",
    "_Py_NoneStruct",
}  # fmt: skip


@pytest.fixture(scope="module")
def machine_codes(tmp_path_factory) -> dict[Path, str]:
    """A file of machine code for each kernel that ``dev.py kernels`` has made of these sources, with its name."""
    path = FOLDER / file_name()
    if not is_made(path):
        pytest.skip("there are no kernels of these sources: dev.py kernels makes them")
    shipped, folder, found = ShippedKernels(), tmp_path_factory.mktemp("machine codes"), {}
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
    for entry in entries:
        (_, _, (machine_code, *_)), description = shipped.load(entry.filename, entry.comment.decode())[:2]
        file = folder / f"{entry.filename}.o"
        file.write_bytes(machine_code)
        found[file] = description.qualname
    return found


def dump(file: Path, *options: str) -> str:
    return subprocess.run(["objdump", *options, file], capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(shutil.which("objdump") is None, reason="objdump, which disassembles, is not installed")
def test_no_kernel_estimates_a_reciprocal_or_a_root(machine_codes):
    """Such instructions round differently on processors of different makers."""
    found, seen = {}, 0
    for file, name in machine_codes.items():
        listing = dump(file, "-d", "--no-show-raw-insn")
        seen += len(re.findall(r"\b[vf]sqrt\w*", listing))
        estimates = re.findall(r"\b(?:v?(?:rsqrt|rcp)|frsqrt|frecp)\w*", listing)
        if estimates:
            found[name] = estimates
    assert found == {} and seen > 10, "they are read, and have roots"


@pytest.mark.skipif(shutil.which("objdump") is None, reason="objdump, which lists symbols, is not installed")
def test_kernels_need_nothing_of_python_that_its_versions_differ_in(machine_codes):
    """One Python compiles for all: see devtools/pack_kernels.py."""
    called = set()
    for file in machine_codes:
        called |= set(re.findall(r"\*UND\*\s+\w+\s+(_?Py\w+)", dump(file, "-t")))
    assert "PyArg_UnpackTuple" in called, "they are read"
    assert called - OF_ALL_PYTHONS == set()
