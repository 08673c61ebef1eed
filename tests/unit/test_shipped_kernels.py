"""Kernels that come with an installation: found under any name of the package, refused where they do not fit."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from devtools.kernels import kernel_file
from devtools.places import running_python
from rle_splat.runtime.cache_folder import CACHE_VARIABLE, NUMBA_VARIABLE
from rle_splat.runtime.jit import compiled

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.runtime.shipped_kernels import LEVEL, entry_name, file_name, is_level_reached

ROOT = Path(__file__).resolve().parents[2]
pytestmark = [pytest.mark.slow, pytest.mark.skipif(
    not is_level_reached(), reason=f"this processor does not reach {LEVEL}, which kernels are shipped for"
)]  # fmt: skip

# Calls a kernel, by the name of the package; prints the runs that it writes, whether it was compiled, and any problem.
CALL = """
import importlib, sys
import numpy as np
def ours(name):
    return importlib.import_module(sys.argv[1] + name)
jit = ours(".runtime.jit")
kernel = ours(".encode.encode_kernels").fill_row_runs
starts, runs = np.zeros((1, 1), np.int64), np.zeros(3, np.uint16)
compilations = []
with jit.while_compiling(lambda: compilations.append(1)), jit.parallel_call(1):
    kernel(starts, np.array([[12]], np.uint64), 9, starts, runs)
print(*runs, "compiled" if compilations else "loaded", jit.shipped_level(), jit.shipped_problem())
"""
PACK = """
from devtools.pack_kernels import pack
from pathlib import Path
print(pack(Path(sys.argv[2]), b""))
"""
TAKE = """
import sys
from devtools.pack_kernels import main
main(sys.argv[1], "", sys.argv[2])
"""
WITHOUT_AVX2 = """
import llvmlite.binding
features = llvmlite.binding.get_host_cpu_features()
features["avx2"] = False
llvmlite.binding.get_host_cpu_features = lambda: features
"""
OF_OTHERS = "The compiled code of this installation is of other sources"
LOADED, COMPILED = f"2 2 5 loaded {LEVEL} ", "2 2 5 compiled"


@pytest.fixture(scope="module")
def packed(tmp_path_factory) -> Path:
    """A file with the kernel, made in a process that compiles for the level."""
    folder = tmp_path_factory.mktemp("packed")
    said = run(CALL + PACK, ROOT, folder / "cache", "rle_splat", folder / file_name(),
               NUMBA_CPU_NAME=LEVEL, NUMBA_CPU_FEATURES="")  # fmt: skip
    assert said.splitlines()[-1] == "1"
    return folder / file_name()


@pytest.fixture
def installation(packed, tmp_path):
    """``installation(*folders)`` -> a copy of the package within these folders, with the file of kernels."""

    def install(*folders: str) -> Path:
        package = tmp_path.joinpath(*folders, "rle_splat")
        shutil.copytree(ROOT / "rle_splat", package, ignore=shutil.ignore_patterns("__pycache__", "kernels"))
        (package / "kernels").mkdir()
        shutil.copy(packed, package / "kernels")
        return package

    return install


def run(program: str, root: Path, cache: Path, *words, **variables: str) -> str:
    """What a process says that finds packages in ``root`` and keeps kernels in ``cache``."""
    names = (CACHE_VARIABLE, NUMBA_VARIABLE, "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
    environ = {name: value for name, value in os.environ.items() if name not in names}
    environ |= {CACHE_VARIABLE: str(cache), "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1", **variables}
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, words)], cwd=root, env=environ, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def called(package: Path, cache: Path, program: str = CALL, name: str = "rle_splat", **variables: str) -> str:
    root = package.parents[name.count(".")]
    return run(program, root, cache, name, **variables).removesuffix("\n")


def test_a_shipped_kernel_is_loaded_and_never_copied(installation, tmp_path):
    package, cache = installation(), tmp_path / "cache"
    assert called(package, cache) == LOADED
    assert list(cache.rglob("*.nb*")) == []


def test_it_is_found_whatever_the_name_of_the_package_is(installation, tmp_path):
    """As Blender imports an extension; with spaces and other letters, in a path as long as Windows allows or longer."""
    first, last = "Jörg's größte Extensions", ("bl_ext", "user_default", "rle_splat")
    longest = max(len(str(file.relative_to(ROOT / "rle_splat"))) for file in (ROOT / "rle_splat").rglob("*.*"))
    folders = ["long " * 24 + "path", "LONG " * 24 + "PATH"]
    if os.name == "nt":
        room = 259 - len(str(tmp_path.joinpath(first, *last))) - 2 - longest
        folders = [("long " * 60)[:room].strip()]
    package = installation(first, *folders, *last[:-1])
    for folder in package.parents[:2]:
        (folder / "__init__.py").touch()
    assert len(str(package)) + 1 + longest > 250
    assert called(package, tmp_path / "cache", name="bl_ext.user_default.rle_splat") == LOADED


def test_where_nothing_can_be_written_it_is_loaded_all_the_same(installation, tmp_path):
    package = installation()
    for path in (*package.rglob("*"), package):
        path.chmod(0o555 if path.is_dir() else 0o444)
    assert called(package, Path(os.devnull, "cache"), TMPDIR=str(tmp_path / "no folder")) == LOADED
    for path in (package, *(path for path in package.rglob("*") if path.is_dir())):
        path.chmod(0o755)


def test_it_comes_before_the_users_own(installation, tmp_path):
    """Whose folder is not looked at, so that pictures do not depend on what it holds."""
    package, cache = installation(), tmp_path / "cache"
    file = package / "kernels" / file_name()
    file.rename(package / "aside.zip")
    assert called(package, cache).startswith(COMPILED)
    assert called(package, cache).startswith("2 2 5 loaded")
    for index in list(cache.rglob("*.nbi")):
        index.unlink()
        index.mkdir()  # reading it fails
    (package / "aside.zip").rename(file)
    assert called(package, cache) == LOADED


def test_a_kernel_of_other_sources_is_remarked_and_not_used(installation, tmp_path):
    package = installation()
    path = package / "encode" / "line_bits.py"
    source = path.read_text(encoding="utf-8")
    assert source.count("runs[run] = x - end\n") == 1
    path.write_text(source.replace("runs[run] = x - end\n", "runs[run] = x - end + 40\n"), encoding="utf-8")
    assert called(package, tmp_path / "cache").startswith(f"42 42 5 compiled {LEVEL} {OF_OTHERS}")


def test_a_mac_looks_for_kernels_of_the_first_one_with_such_a_processor(tmp_path):
    feigned = """
import numba, sys
sys.platform = "darwin"
from rle_splat.runtime import shipped_kernels
print(shipped_kernels.file_name(), shipped_kernels.is_level_reached())
"""
    said = run(feigned, ROOT, tmp_path).split()
    assert said == [kernel_file(running_python(), "macos-arm64"), "True"]


def test_the_version_of_the_running_system_does_not_count():
    """macOS' is in LLVM's name of the system; that of the system that made the files is another."""
    names = {entry_name(is_level_reached, (), f"arm64-apple-{system}") for system in ("darwin24.6.0", "darwin21.1.0")}
    assert len(names) == 1
    assert names != {entry_name(is_level_reached, (), "x86_64-apple-darwin24.6.0")}


def cut(content: bytes) -> bytes:
    return content[:-100]


def flip(content: bytes) -> bytes:
    """One byte within the kernel is another."""
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 255]) + content[middle + 1 :]


@pytest.mark.parametrize("damage", [cut, flip, lambda content: b""])
def test_a_damaged_file_is_remarked_and_the_kernel_compiled(installation, tmp_path, damage):
    package, cache = installation(), tmp_path / "cache"
    file = package / "kernels" / file_name()
    file.write_bytes(damage(file.read_bytes()))
    said = called(package, cache)
    assert said.startswith(COMPILED) and f"damaged ({file_name()})" in said


def test_kernels_of_another_numba_are_remarked(installation, tmp_path):
    """Their file has another name, as those of another Python have."""
    package = installation()
    file = package / "kernels" / file_name()
    file.rename(file.with_name(f"python3.11-numba0.1.0-{LEVEL}.zip"))
    said = called(package, tmp_path / "cache")
    assert said.startswith(COMPILED) and "has no compiled code for Python" in said


def test_an_older_processor_compiles_and_says_so(installation, tmp_path):
    said = called(installation(), tmp_path / "cache", WITHOUT_AVX2 + CALL)
    assert said.startswith(COMPILED) and "needs a processor with AVX2" in said


def test_for_a_processor_that_the_user_names_kernels_are_compiled(installation, tmp_path):
    said = called(installation(), tmp_path / "cache", NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="")
    assert said == f"{COMPILED}  "


def test_an_installation_that_brings_no_kernels_has_no_remark(installation, tmp_path):
    package = installation()
    shutil.rmtree(package / "kernels")
    assert called(package, tmp_path / "cache") == f"{COMPILED}  "


def test_a_file_for_another_python_has_the_same_kernels(packed, installation, tmp_path):
    """Loaded as those that this Python has compiled; a kernel of other sources is not taken for one of these."""
    package = installation()
    file = package / "kernels" / file_name()
    with zipfile.ZipFile(packed) as archive:
        other = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        for name, content in other.items():
            archive.writestr(name, content)  # without its digest, which is the other Python's
    shutil.copy(tmp_path / "other.zip", file)
    assert called(package, tmp_path / "cache").startswith(f"{COMPILED} {LEVEL} {OF_OTHERS}")
    assert run(TAKE, ROOT, tmp_path / "unused", file, tmp_path / "other.zip").split() == ["1"]
    assert called(package, tmp_path / "cache of others") == LOADED


def test_the_file_is_the_one_that_the_tools_make():
    assert kernel_file(running_python()) == file_name()
