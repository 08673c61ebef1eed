"""``rle-splat prepare`` compiles what default pictures need."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rle_splat.pipeline import prepare
from rle_splat.runtime import jit
from rle_splat.runtime.steps import Progress, drain
from rle_splat.scene import RleSplatError
from tests.ways import compile_here

ROOT = Path(__file__).resolve().parents[2]
needs_numba = pytest.mark.skipif(not jit.compiled(), reason="nothing is compiled without numba")
ONE_PICTURE = """
import sys
from rle_splat.cli.main import main
from rle_splat.pipeline import prepare
from rle_splat.splat import splat
prepare.PICTURES = [one for one in prepare.PICTURES if one.name == "pre-classified, unlit"]  # the least to compile
prepare.STORED_TYPES = prepare.STORED_TYPES[:1]
splat.compiled = lambda: False  # numpy splats: this kernel takes longer to compile than all others
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
    with pytest.raises(RleSplatError, match="could not be stored"):
        drain(prepare.prepare_steps())
