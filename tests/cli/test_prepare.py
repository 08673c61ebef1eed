"""``rle-splat prepare`` compiles what default pictures need."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rle_splat.pipeline import prepare
from rle_splat.runtime import jit
from rle_splat.runtime.steps import Progress, drain
from rle_splat.scene import RleSplatError
from tests.ways import compile_here

ROOT = Path(__file__).resolve().parents[2]
needs_numba = pytest.mark.skipif(not jit.compiled(), reason="nothing is compiled without numba")
# What a process that did something has of each kernel that is kept on disk: the types of its arguments, once each.
VERSIONS = """
import json, sys
from rle_splat.runtime.numba_internals import Kernel
found = [one for module in list(sys.modules.values()) for one in vars(module).values() if type(one) is Kernel]
print(json.dumps([f"{one.__module__}.{one.__name__} {types}" for one in found for types in one.signatures]))
"""
PREPARES = """
from rle_splat.pipeline.prepare import prepare_steps
from rle_splat.runtime.steps import drain
drain(prepare_steps())
"""
RENDERS = """
import json, sys
from rle_splat.cli.main import main
for words in json.load(sys.stdin):
    assert main(words) == 0, words
"""
ONE_PICTURE = """
import sys
from rle_splat.cli.main import main
from rle_splat.pipeline import prepare
prepare.PICTURES = [one for one in prepare.PICTURES if one.name == "pre-classified, unlit"]  # the least to compile
prepare.STORED_TYPES = prepare.STORED_TYPES[:1]
sys.exit(main(["prepare", *sys.argv[1:]]))
"""


@pytest.fixture
def environ(tmp_path):
    """Of a process that compiles all kernels, in a folder of their own that is empty at first."""
    own = {name: value for name, value in os.environ.items() if name != jit.NUMBA_VARIABLE}
    return {**own, **(compile_here() if jit.compiled() else {}), jit.CACHE_VARIABLE: str(tmp_path / "kernels")}


def run(environ, *words, given=None):
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=environ, input=given, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def scan(folder, stored: str, side: int) -> list[str]:
    """A raw volume of so many voxels a side, as the words that render it."""
    x = np.linspace(0.0, 250.0, side)
    path = folder / f"{stored}.raw"
    np.minimum(np.minimum(x[:, None, None], x[:, None]), x).astype(stored).tofile(path)
    return ["render", str(path), "--shape", *3 * [str(side)], "--dtype", stored, "-o", str(folder / "p.npy")]


def versions(program, given=None) -> set[str]:
    """The kernels that a program needs, each with the types of its arguments, wherever they were compiled."""
    return set(json.loads(run(os.environ, "-c", program + VERSIONS, given=given).splitlines()[-1]))


@needs_numba
@pytest.mark.slow
def test_default_pictures_need_no_other_kernels(tmp_path):
    """Neither the first one of a scan of the usual size, nor those of other types, views, lights and qualities."""
    lights = tmp_path / "lights.json"
    lights.write_text(json.dumps([{"type": "POINT", "energy": 1e7, "matrix_world": np.eye(4).tolist()}]))
    functions = (
        [], ["--perspective"], ["--azimuth", "90"], ["--elevation", "80"], ["--azimuth", "30", "--elevation", "20"],
        ["--lights", str(lights), "--perspective"], ["--lights", str(lights), "--shadows"],
    )  # fmt: skip
    modes = ([], ["--quality", "draft"])
    scans = [[*scan(tmp_path, stored, 80), "--size", "64"] for stored in prepare.STORED_TYPES]
    renders = [[*words, *function, *mode] for words in scans for function in functions for mode in modes]
    (tmp_path / "large").mkdir()
    given = json.dumps([scan(tmp_path / "large", "uint8", 256), *renders])
    versions(RENDERS, given)  # a process that compiles a kernel lists what is inside it, too
    needed = versions(RENDERS, given)
    assert len(needed) > 20 and any("splat_scalar_rows" in one for one in needed)
    assert needed - versions(PREPARES) == set()


@needs_numba
@pytest.mark.slow
def test_what_is_prepared_is_kept_and_told(environ, tmp_path):
    """Of the kernels of one picture those that are not there: the small ones, for the sake of time."""
    kept, report = tmp_path / "kernels", tmp_path / "report.json"
    run({**environ, jit.CACHE_VARIABLE: str(jit.KERNELS.parent)}, "-c", ONE_PICTURE)
    whole = {path.relative_to(jit.KERNELS) for path in jit.KERNELS.rglob("*.nbc")}
    few = shutil.ignore_patterns("*.fill_row_runs-*", "*._write_records-*", "*.mark_by_table-*")
    shutil.copytree(jit.KERNELS, kept / jit.KERNELS.name, ignore=few)
    before = set(kept.rglob("*.nbc"))
    assert 0 < len(before) < len(whole)

    said = run(environ, "-c", ONE_PICTURE, "--json", str(report))
    assert said.splitlines()[-1].startswith("Compiled ") and str(kept) in said
    told = json.loads(report.read_text())
    names = [path.name.partition("-")[0] for path in set(kept.rglob("*.nbc")) - before]
    assert names and sorted(name for picture in told["pictures"] for name in picture["kernels"]) == sorted(names)
    assert told["new"] == len(names) and told["seconds"] > sum(picture["seconds"] for picture in told["pictures"]) > 0

    said = run(environ, "-c", ONE_PICTURE)
    assert said.count("\n") == 1 and said.startswith("Nothing to do") and str(kept) in said


def test_without_numba_one_sentence_says_so(environ):
    done = subprocess.run(
        [sys.executable, "-m", "rle_splat", "prepare"], cwd=ROOT, env={**environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and "numba, which cannot be loaded" in done.stderr


@pytest.fixture
def one_picture(monkeypatch):
    """Of one picture and type."""
    monkeypatch.setattr(prepare, "PICTURES", prepare.PICTURES[:1])
    monkeypatch.setattr(prepare, "STORED_TYPES", ("uint8",))


@needs_numba
def test_a_preparation_says_how_far_it_is(one_picture):
    steps = prepare.prepare_steps()
    said = []
    with pytest.raises(StopIteration) as done:
        while True:
            said.append(next(steps))
    assert (said[-1].fraction, said[-1].message) == (1.0, "Done")
    assert [step.fraction for step in said] == sorted(step.fraction for step in said)
    assert all(isinstance(step, Progress) for step in said)
    assert [one.picture for one in done.value.value] == ["orthographic, uint8"]


@needs_numba
def test_where_no_kernel_can_be_kept_none_is_prepared(monkeypatch):
    monkeypatch.setattr(jit, "KERNELS", Path(os.devnull, "kernels"))
    with pytest.raises(RleSplatError, match="cannot be kept"):
        drain(prepare.prepare_steps())
