"""The on-disk cache of kernels: its key, several processes that compile at once, other users of numba."""

import os
import pkgutil
import shutil
import subprocess
import sys
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

import pytest

import rle_splat
from rle_splat.runtime import cache_folder as places
from rle_splat.runtime.cache_folder import CACHE_VARIABLE, NUMBA_VARIABLE
from rle_splat.runtime.jit import compiled

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.runtime.kernel_cache import KEPT_EDITIONS, KernelCache, _Folder, _SealedFiles
from rle_splat.runtime.numba_internals import Kernel
from tests.ways import compile_here

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def nothing_told_to_numba(monkeypatch):
    """Whoever runs the tests may have told numba a folder; these choose their own."""
    monkeypatch.delenv(NUMBA_VARIABLE, raising=False)


def test_two_processes_at_once_do_not_take_each_others_machine_code(tmp_path, monkeypatch):
    """One begins to keep a version of a kernel; before it has, another process keeps another version."""
    one, other, later = (_SealedFiles(str(tmp_path), "kernel-1.py311", "stamp") for _ in range(3))
    write = one._save_data

    def interrupted(name, data):
        with monkeypatch.context() as patch:
            patch.setattr(other, "_load_index", dict)  # read before the one had written its own
            other.save(("float64",), "for float64")
        write(name, data)

    monkeypatch.setattr(one, "_save_data", interrupted)
    one.save(("float32",), "for float32")
    found = {key: later.load((key,)) for key in ("float32", "float64")}
    assert "for float32" in found.values() or "for float64" in found.values()
    assert all(data in (None, f"for {key}") for key, data in found.items()), found


def test_every_version_is_found_again(tmp_path):
    for key in ("float32", "float64", "float32"):
        _SealedFiles(str(tmp_path), "kernel-1.py311", "stamp").save((key,), key)
    again = _SealedFiles(str(tmp_path), "kernel-1.py311", "stamp")
    assert [again.load((key,)) for key in ("float32", "float64", "int8")] == ["float32", "float64", None]
    assert len(list(tmp_path.glob("*.nbc"))) == 2  # what is compiled once more replaces the former file


class _Argument:
    """The type of a kernel's argument."""


@pytest.mark.parametrize("gone", ["class", "module"])
def test_an_index_that_names_a_class_of_an_earlier_version_counts_as_missing(tmp_path, monkeypatch, gone):
    files = _SealedFiles(str(tmp_path), "kernel-1.py311", "stamp")
    with monkeypatch.context() as patch:
        if gone == "module":
            patch.setitem(sys.modules, "earlier_module", sys.modules[__name__])
            patch.setattr(_Argument, "__module__", "earlier_module")
        files.save((_Argument,), "for the class")
    with monkeypatch.context() as patch:
        if gone == "class":
            patch.delattr(sys.modules[__name__], "_Argument")
        assert files.load(("float32",)) is None
        files.save(("float32",), "for float32")
    assert files.load(("float32",)) == "for float32"


def test_the_oldest_editions_of_a_kernel_are_removed(tmp_path):
    """The last part of a key is the digest of the sources."""
    files = _SealedFiles(str(tmp_path), "kernel-1.py311", "stamp")
    files.save(("int8", "a processor", "first"), "of int8")
    for edition in range(KEPT_EDITIONS + 2):
        files.save(("float64", "a processor", edition), edition)
    found = [files.load(("float64", "a processor", edition)) for edition in range(KEPT_EDITIONS + 2)]
    assert found == [None, None, *range(2, KEPT_EDITIONS + 2)]
    assert files.load(("int8", "a processor", "first")) == "of int8"
    assert len(list(tmp_path.glob("*.nbc"))) == KEPT_EDITIONS + 1


BESIDE_ANOTHER = """
import os, sys
import numba
numba.config.CACHE_DIR = theirs = os.path.join(sys.argv[1], "theirs")
from rle_splat.runtime import jit
from rle_splat.view.footprints import tap_count
import another
print(jit.nothing_compiled_yet(), tap_count(1.5), another.next_to(6), numba.config.CACHE_DIR == theirs)
os.environ["NUMBA_FULL_TRACEBACKS"] = "1"  # so that numba reads all settings again
from rle_splat.view.footprints import first_tap
print(first_tap(1, 3.5, 1.0), jit.nothing_compiled_yet(), numba.config.CACHE_DIR == theirs)
"""
ANOTHER = """
import numba

@numba.njit(cache=True)
def next_to(number):
    return number + 1
"""


def test_another_add_on_and_ours_keep_what_they_compile_each_in_its_own_folder(tmp_path):
    """Where the other has loaded numba and told it a folder before, and whatever it tells numba afterwards."""
    (tmp_path / "another.py").write_text(ANOTHER, encoding="utf-8")
    environ = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environ |= {CACHE_VARIABLE: str(tmp_path / "ours"), "PYTHONPATH": os.pathsep.join((str(ROOT), str(tmp_path)))}
    environ |= compile_here()
    done = subprocess.run(
        [sys.executable, "-c", BESIDE_ANOTHER, tmp_path], cwd=ROOT, capture_output=True, text=True, check=False,
        env=environ,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["True 3 7 True", "3 False False"], done.stderr
    kept = [{file.name.partition("-")[0] for file in (tmp_path / own).rglob("*.nbi")} for own in ("theirs", "ours")]
    assert kept == [{"another.next_to"}, {"footprints.tap_count", "footprints.first_tap"}]


KERNELS = """
import numpy as np
from rle_splat.runtime.jit import kernel
from rle_splat.runtime.parallel import share_out

@kernel(inner=True)
def double_some(begin, end, values, out):
    scratch = np.empty(1, np.float64)
    for i in range(begin, end):
        scratch[0] = values[i]
        out[i] = 2.0 * scratch[0]

@kernel
def double_all(values, out):
    share_out(double_some, values.size, (values, out))

@kernel
def doubled(values):
    out = np.empty(values.size, np.float64)
    for i in range(values.size):
        out[i] = 2.0 * values[i]
    return out

@kernel
def sum_of_doubled(values):
    total = 0.0
    for value in doubled(values):
        total += value
    return total
"""
# Whether a kernel and its part define compiled functions, and those of the same name.
NAMES = """
import numpy as np
import kept_kernels
from rle_splat.runtime.jit import parallel_call
with parallel_call():
    kept_kernels.double_all(np.arange(4.0), np.empty(4))
whole, part = (
    {
        function.name for overload in one.overloads.values() for function in overload.library.get_defined_functions()
        if "_ZN" in function.name
    }
    for one in (kept_kernels.double_all, kept_kernels.double_some)
)
print(len(whole) > 1, len(part) > 0, whole & part)
"""
CALL = """
import sys
import numpy as np
from numba.core.runtime import rtsys
import kept_kernels
for name in sys.argv[1:]:
    kernel = getattr(kept_kernels, name)
    given = kernel(np.arange(4.0))
    print(np.sum(given), sum(kernel.stats.cache_hits.values()), rtsys._init)
"""


def test_a_kernel_runs_its_own_copy_of_a_part_even_when_just_compiled(tmp_path):
    """Of functions of one name the first that was loaded would run: the part's, which is not on disk."""
    assert _called(tmp_path, program=NAMES) == ["True True set()"]


def _called(folder, *names, program=CALL):
    """What a process of its own says, whose kernels are kept in a folder."""
    (folder / "kept_kernels.py").write_text(KERNELS, encoding="utf-8")
    os.utime(folder / "kept_kernels.py", (0, 0))  # as old in every process
    paths = os.pathsep.join(map(str, (ROOT, folder)))
    done = subprocess.run(
        [sys.executable, "-c", program, *names], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": paths, CACHE_VARIABLE: str(folder / "kernels")},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_kernel_on_disk_is_called_without_getting_ready_to_compile(tmp_path):
    """It may take memory and give it away; and another kernel that is compiled later calls it."""
    assert _called(tmp_path, "doubled") == ["12.0 0 True"]
    assert _called(tmp_path, "doubled") == ["12.0 1 False"]
    assert _called(tmp_path, "doubled", "sum_of_doubled") == ["12.0 1 False", "12.0 0 True"]
    assert _called(tmp_path, "sum_of_doubled", "doubled") == ["12.0 1 False", "12.0 1 False"]
    # The one that is called is loaded only to be linked in.
    for kept in (tmp_path / "kernels").rglob("*sum_of_doubled*"):
        kept.unlink()
    assert _called(tmp_path, "sum_of_doubled") == ["12.0 0 True"]


OF_A_PAIR = """
from typing import NamedTuple
from rle_splat.runtime.jit import kernel

class Pair(NamedTuple):
    one: int
    other: int

@kernel
def both(pair):
    return pair.one + pair.other
"""
CALL_BOTH = """
import importlib
for name in ("outer.inner.pairs", "inner.pairs"):
    module = importlib.import_module(name)
    print(module.both(module.Pair(1, 2)), sum(module.both.stats.cache_hits.values()))
"""


def test_a_package_that_is_imported_by_two_names_has_its_kernels_under_each(tmp_path):
    """As Blender imports an extension, and as whoever starts a program in the extension's folder does."""
    outer = tmp_path / "outer"
    (outer / "inner").mkdir(parents=True)
    for folder in (outer, outer / "inner"):
        (folder / "__init__.py").write_text("", encoding="utf-8")
    (outer / "inner" / "pairs.py").write_text(OF_A_PAIR, encoding="utf-8")
    paths = os.pathsep.join(map(str, (ROOT, tmp_path, outer)))
    environ = {**os.environ, CACHE_VARIABLE: str(tmp_path / "kept"), "PYTHONPATH": paths, "PYTHONSAFEPATH": "1"}
    for hits in (0, 1):
        done = subprocess.run(
            [sys.executable, "-c", CALL_BOTH], cwd=outer, capture_output=True, text=True, check=False, env=environ
        )
        assert done.stdout.splitlines() == [f"3 {hits}"] * 2, done.stderr


OF_MANY_FILES = """
import numpy as np
from rle_splat.encode.encode_kernels import fill_row_runs
from rle_splat.runtime.jit import parallel_call
starts, runs = np.zeros((1, 1), np.int64), np.zeros(3, np.uint16)
with parallel_call(1):
    fill_row_runs(starts, np.array([[12]], np.uint64), 9, starts, runs)
print(*runs, sum(fill_row_runs.stats.cache_hits.values()))
"""


class Copy:
    """A copy of the package, in which sources are edited; kernels are kept in a folder of their own."""

    def __init__(self, folder: Path, variable: str = CACHE_VARIABLE):
        self.folder = folder / "rle_splat"
        shutil.copytree(ROOT / "rle_splat", self.folder, ignore=shutil.ignore_patterns("__pycache__", "kernels"))
        others = (CACHE_VARIABLE, NUMBA_VARIABLE, "NUMBA_OPT")
        self.environ = {name: value for name, value in os.environ.items() if name not in others}
        self.environ |= {variable: str(folder / "kept"), "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}

    def edit(self, name: str, before: str, after: str) -> None:
        path = self.folder / name
        source = path.read_text(encoding="utf-8")
        assert source.count(before) == 1, name
        path.write_text(source.replace(before, after), encoding="utf-8")

    def runs(self, **environ) -> str:
        """The runs that a kernel writes, and whether it was loaded from disk."""
        done = subprocess.run(
            [sys.executable, "-c", OF_MANY_FILES], cwd=self.folder, capture_output=True, text=True, check=False,
            env={**self.environ, **environ},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()


def test_a_folder_that_the_user_has_given_numba_is_used(tmp_path):
    copy = Copy(tmp_path, NUMBA_VARIABLE)
    assert [copy.runs(), copy.runs()] == ["2 2 5 0", "2 2 5 1"]


def test_settings_parts_and_constants_of_other_files_are_in_the_key_of_a_kernel_and_nothing_else(tmp_path):
    copy = Copy(tmp_path)
    assert [copy.runs(), copy.runs(NUMBA_OPT="1")] == ["2 2 5 0"] * 2
    copy.edit("scene/quality.py", "MODELS = ", "# A remark.\nUNUSED = 7\nMODELS = ")  # no kernels there
    lines, shift = copy.folder / "encode" / "line_bits.py", copy.folder / "shift.py"
    lines.write_text("# A line above the kernels.\n" + lines.read_text(encoding="utf-8"), encoding="utf-8")
    assert copy.runs() == "2 2 5 1"
    copy.edit("encode/line_bits.py", "runs[run] = x - end\n", "runs[run] = x - end + SHIFT\n")
    copy.edit("encode/line_bits.py", "from ..runtime.jit", "from ..shift import SHIFT\nfrom ..runtime.jit")
    shift.write_text("SHIFT = 1\n", encoding="utf-8")
    assert copy.runs() == "3 3 5 0"
    shift.write_text("SHIFT = 2\n", encoding="utf-8")
    assert copy.runs() == "4 4 5 0"
    shift.write_text("SHIFT = 1\n", encoding="utf-8")
    assert copy.runs() == "3 3 5 1"  # an earlier edition is still there


TOLD_NOT_TO = """
from rle_splat.runtime.jit import NUMBA_PROBLEM, compiled
import rle_splat.pipeline.render
print(compiled(), "NUMBA_DISABLE_JIT" in NUMBA_PROBLEM)
"""


def test_without_kernels_where_numba_is_told_to_compile_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert _called(tmp_path, program=TOLD_NOT_TO) == ["False True"]


MOST_CHARACTERS = 259  # of a path on Windows, where nobody has allowed more
# The folder that Blender gives an extension there, of a user with the longest name that Windows allows.
IN_BLENDER = "\\".join((
    "C:", "Users", "n" * 20, "AppData", "Roaming", "Blender Foundation", "Blender", "5.10", "extensions", ".user",
    "user_default", "rle_splat", "cache", places.KERNEL_PREFIX + "0" * 16, "",
))  # fmt: skip


def test_all_names_fit_into_the_paths_of_windows(tmp_path, monkeypatch):
    """Those of files that are being written, too, which are the longest."""
    monkeypatch.setattr(_Folder, "path", str(tmp_path))
    written, open_for_write = set(), _SealedFiles._open_for_write

    @contextmanager
    def noting(self, path):
        with open_for_write(self, path) as sealed:
            written.add(os.path.relpath(sealed.file.name, tmp_path))
            yield sealed

    monkeypatch.setattr(_SealedFiles, "_open_for_write", noting)
    modules = {found.name for found in pkgutil.walk_packages(rle_splat.__path__, "rle_splat.")}
    for name in modules - {"rle_splat.__main__"}:
        for kernel in vars(import_module(name)).values():
            if isinstance(kernel, Kernel):
                KernelCache(kernel)._cache_file.save(("any",), "any")
    assert len(written) > 100
    longest = max(written, key=len)
    assert len(IN_BLENDER) + len(longest) <= MOST_CHARACTERS, longest
