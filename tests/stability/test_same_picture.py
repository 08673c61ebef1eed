"""The same picture everywhere: threads, runs, processes, kernel caches, processors, widths, Pythons (A5, A12, A13)."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rle_splat.runtime.jit import compiled, use_reference
from rle_splat.splat import pixel_block
from tests.stability.pictures import SCENES, pictures
from tests.ways import both

ROOT = Path(__file__).resolve().parents[2]
WITH_KERNELS = pytest.mark.skipif(not compiled(), reason="there are no kernels without numba")
BITS = "bits are counted"
# Those that share kernels.
ALIKE = {"pre": ("parallel", "inside"), "opacity": ("opacities",), "post": ("post",)}


def elsewhere(folder, *arguments, python=sys.executable, **environ) -> dict[str, np.ndarray]:
    """The pictures of another process."""
    file = folder / "pictures.npz"
    done = subprocess.run(
        [python, "-m", "tests.stability.pictures", file, *arguments], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **environ}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    with np.load(file) as made:
        return dict(made)


def differing(one, other) -> int:
    """How many numbers do not have the same bits."""
    assert one.shape == other.shape and one.dtype == other.dtype == np.float32
    return int((one.view(np.uint32) != other.view(np.uint32)).sum())


@WITH_KERNELS
def test_A5_one_to_sixty_four_threads(record, tmp_path):
    """More threads than there may be cores, in a process that is told to have them."""
    here, counts = pictures(threads=(1,)), (*range(1, 9), 64)
    made = elsewhere(tmp_path, "--threads", *map(str, counts), NUMBA_NUM_THREADS="64")
    assert len(made) == len(counts) * len(SCENES)
    for name in SCENES:
        assert here[f"{name} 1"][..., 3].max() > 0.3
        for threads in counts:
            changed = differing(made[f"{name} {threads}"], here[f"{name} 1"])
            record("A5", "numbers that differ between 1 and 2 to 8 and 64 threads", changed, 0, "either", why=BITS)


def test_A12_run_to_run_and_process_to_process(record, tmp_path, way):
    first = pictures()
    alike = {"NUMBA_DISABLE_JIT": "1"} if way == "numpy" else {}
    for made in (pictures(), elsewhere(tmp_path, **alike)):
        changed = sum(differing(made[name], first[name]) for name in first)
        record("A12", "numbers that differ from run to run and process to process", changed, 0, "either", why=BITS)


@WITH_KERNELS
@pytest.mark.deep
def test_A13_another_processor(record, tmp_path):
    """Kernels compiled for a processor without fused multiply-add."""
    here = pictures(("parallel",), (1,))["parallel 1"]
    others = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    plain = elsewhere(tmp_path, "--scenes", "parallel", "--threads", "1", **others)["parallel 1"]
    error = float(np.abs(plain[..., :4] - here[..., :4]).max())
    record(
        "A13", "difference of kernels for a processor without FMA and wide vectors", error, 1e-6, "float32",
        why="asked for by more sheets than a test can wait for",
    )  # fmt: skip


@WITH_KERNELS
@pytest.mark.parametrize("kind", ALIKE)
def test_A13_kernels_and_their_reference_implementations(record, width, kind):
    fast, slow = both(lambda: pictures(ALIKE[kind]))
    for name in fast:
        error = float(np.abs(fast[name][..., :4] - slow[name][..., :4]).max())
        if name.startswith("post"):
            claim = "difference between kernels and their reference implementations, post-classified"
            looser = "a rounding may turn to the next entry of the lookup table"
            record("A13", claim, error, 2e-3, width, why="only with `--all`", looser=looser)
        else:
            record("A13", "difference between kernels and their reference implementations", error, 1e-5, width)


@pytest.mark.parametrize("kind", ALIKE)
def test_A13_single_and_double_width(record, monkeypatch, way, kind):
    single = pictures(ALIKE[kind])
    monkeypatch.setattr(pixel_block, "MOST_SHEETS_IN_SINGLE", 0)
    double = pictures(ALIKE[kind])
    for name in single:
        error = float(np.abs(single[name][..., :4] - double[name][..., :4]).max())
        # T falls below its least, 1/1024, a sheet sooner or later.
        record("A13", "difference between the two widths", error, 2e-5, "either", why="between them")


def other_pythons():
    """The environments for Blender's Pythons that this checkout has."""
    name = "Scripts/python.exe" if sys.platform == "win32" else "bin/python"
    return sorted(python for python in (ROOT / ".venvs").glob(f"bpy-*/{name}") if python.exists())


@pytest.mark.parametrize("python", other_pythons() or [None], ids=lambda p: p.parts[-3] if p else "none")
def test_A13_other_versions_of_python_and_numpy(record, tmp_path, python):
    """Each of Blender's, by the reference implementations; its kernels are compared with those in tests/blender."""
    if python is None:
        pytest.skip("no environment of another Python is at hand")
    with use_reference():
        here = pictures()
    there = elsewhere(tmp_path, python=python, NUMBA_DISABLE_JIT="1")
    for name in here:
        error = float(np.abs(here[name][..., :4] - there[name][..., :4]).max())
        record("A13", "difference between versions of Python and numpy", error, 1e-5, "float32", why="as float32")
