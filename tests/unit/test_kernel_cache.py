"""The cache of compiled kernels: several processes that compile at once, and whoever had loaded numba before."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rle_splat import jit
from rle_splat.jit import CACHE_VARIABLE, compiled

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.kernel_cache import _SealedFiles

ROOT = Path(__file__).resolve().parents[2]


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
    assert len(list(tmp_path.glob("*.nbc"))) == 2  # what is compiled once more takes the place of what was there


def test_folders_that_another_process_removes_meanwhile_are_no_fault(tmp_path, monkeypatch):
    """Two that start at once after an update both remove the oldest kernels."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    folders = [tmp_path / f"{jit.KERNEL_PREFIX}{n}" for n in range(jit.KEPT_VERSIONS + 2)]
    for age, folder in enumerate(folders):
        folder.mkdir()
        os.utime(folder, (1e9 - age, 1e9 - age))
    stat = Path.stat

    def vanishing(path, **how):
        if path == folders[1]:
            raise FileNotFoundError(path)
        return stat(path, **how)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "stat", vanishing)
        assert jit._kernel_folder().parent == tmp_path
    assert [folder for folder in folders if folder.exists()] == [folders[0], *folders[2 : jit.KEPT_VERSIONS]]


BESIDE_ANOTHER = """
import os, sys
import numba
numba.config.CACHE_DIR = theirs = os.path.join(sys.argv[1], "theirs")
from rle_splat import jit
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
    done = subprocess.run(
        [sys.executable, "-c", BESIDE_ANOTHER, tmp_path], cwd=ROOT, capture_output=True, text=True, check=False,
        env=environ,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["True 3 7 True", "3 False False"], done.stderr
    kept = [{file.name.partition("-")[0] for file in (tmp_path / own).rglob("*.nbi")} for own in ("theirs", "ours")]
    assert kept == [{"another.next_to"}, {"footprints.tap_count", "footprints.first_tap"}]


KERNELS = """
import numpy as np
from rle_splat.jit import kernel

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
CALL = """
import sys
import numpy as np
from numba.core.runtime import rtsys
import kept_kernels
for name in sys.argv[1:]:
    kernel = getattr(kept_kernels, name)
    given = kernel(np.arange(4.0))
    print(np.sum(given), sum(kernel.stats.cache_hits.values()), rtsys._init, "rle_splat.kernel_compiler" in sys.modules)
"""


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
    assert _called(tmp_path, "doubled") == ["12.0 0 True True"]
    assert _called(tmp_path, "doubled") == ["12.0 1 False False"]
    assert _called(tmp_path, "doubled", "sum_of_doubled") == ["12.0 1 False False", "12.0 0 True True"]
    assert _called(tmp_path, "sum_of_doubled", "doubled") == ["12.0 1 False False", "12.0 1 False False"]
    # The one that is called is loaded only to be linked in.
    for kept in (tmp_path / "kernels").rglob("*sum_of_doubled*"):
        kept.unlink()
    assert _called(tmp_path, "sum_of_doubled") == ["12.0 0 True True"]


WITHOUT_COMPILER = """
import sys
sys.modules["rle_splat.kernel_lowering"] = None
from rle_splat.jit import NUMBA_PROBLEM, compiled
print(compiled(), "kernel_lowering" in NUMBA_PROBLEM)
"""


def test_a_compiler_that_cannot_be_loaded_is_told_where_there_is_no_kernel_yet(tmp_path):
    assert _called(tmp_path, program=WITHOUT_COMPILER) == ["False True"]
    _called(tmp_path, "doubled")
    assert _called(tmp_path, program=WITHOUT_COMPILER) == ["True False"]


def test_kernels_of_another_numba_are_in_a_folder_of_their_own(monkeypatch):
    here = jit._kernel_folder()
    monkeypatch.setattr(jit.numba, "__version__", "0.0.1")
    assert jit._kernel_folder() != here and jit._kernel_folder().parent == here.parent
