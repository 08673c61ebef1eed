"""numba of a version that is not known, and the settings of the process: neither changes tables, nor is changed.

Kernels of tables stand for all, since a plain numba compiles each in every process.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rle_splat.runtime.jit import PLAIN_NUMBA, compiled

if not compiled() or PLAIN_NUMBA:
    pytest.skip("there is no numba of a known version here", allow_module_level=True)

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow
ENCODE = """
import json, os, sys
import numba
config = {name: str(value) for name, value in vars(numba.config).items() if name.isupper()}
environ = dict(os.environ)
if sys.argv[2] == "other":
    numba.__version__ = "9.0.0"
elif sys.argv[2] == "lacking":
    import numba.core.caching
    del numba.core.caching.UserProvidedCacheLocator
import numpy as np
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.classify.visible import VisibleVoxels
from rle_splat.encode.encode import table_steps
from rle_splat.pipeline import report as reports
from rle_splat.pipeline.render import render
from rle_splat.runtime import jit
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

shown = np.random.default_rng(0).random((20, 18, 16)) < 0.6
report = {"remarks": []}
if sys.argv[2] != "lacking":
    rows = shown.reshape(-1, 16)
    starts, column = np.append(0, np.cumsum(rows.sum(axis=1))), np.nonzero(rows)[1].astype(np.uint16)
    pieces = (np.diff(rows.astype(np.int8), axis=1, prepend=0) == 1).sum(axis=1).astype(np.int32)
    np.save(sys.argv[1], drain(table_steps(VisibleVoxels((16, 18, 20), starts, pieces, column, column, 0), 2)).runs)
    volume = Volume(np.where(shown, 200, 0).astype(np.uint8), np.eye(4))
    camera, matrix = turntable(volume, 20, 10)
    tf = TransferFunction(opacity=((80, 0.0), (250, 0.6)), color=((0, 0.2, 0.4, 0.8),), shade=None)
    scene = Scene(volume, tf, camera, 24, 24, matrix)
    with jit.use_reference():  # numpy draws, since each kernel of a picture takes seconds to compile
        reports.compiled = lambda: True
        report = render(scene, Quality.preset("draft", classification="pre")).report
after = {name: str(value) for name, value in vars(numba.config).items() if name.isupper()}
print(json.dumps({
    "compiled": jit.compiled(), "plain": jit.PLAIN_NUMBA, "remarks": report["remarks"],
    "threads": jit.available_threads(),
    "kept": jit.KERNELS.exists(), "threads used": report.get("threads"),
    "changed": [name for name in config if after.get(name) != config[name]],
    "environ": dict(os.environ) == environ,
}))
"""


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A function that returns the runs of a table, or None, and a report, by a process with numba as named."""
    folder, done = tmp_path_factory.mktemp("plain"), {}

    def render(numba):
        if numba not in done:
            out = folder / f"{numba}.npy"
            process = subprocess.run(
                [sys.executable, "-c", ENCODE, str(out), numba], cwd=ROOT, capture_output=True, text=True,
                check=False, env={**os.environ, "NUMBA_CACHE_DIR": ""},
            )  # fmt: skip
            assert process.returncode == 0, process.stderr
            done[numba] = np.load(out) if out.exists() else None, json.loads(process.stdout.splitlines()[-1])
        return done[numba]

    return render


def test_a_known_numba_keeps_kernels_and_says_nothing(rendered):
    report = rendered("known")[1]
    assert report["compiled"] and report["plain"] == "" and report["kept"]
    assert not any("kernels" in remark for remark in report["remarks"])


def test_another_numba_makes_the_same_tables_and_it_is_said(rendered):
    runs, report = rendered("other")
    reason = "numba 9.0.0 is not a version that RLE Splat knows"
    assert report["compiled"] and report["plain"].startswith(reason)
    assert report["threads"] == report["threads used"] == 1 and not report["kept"]
    assert sum(reason in remark and "not stored" in remark for remark in report["remarks"]) == 1
    assert len(runs) > 1000
    np.testing.assert_array_equal(runs, rendered("known")[0])


def test_a_numba_that_lacks_an_internal_part_is_used_plainly(rendered):
    report = rendered("lacking")[1]
    assert report["compiled"] and "UserProvidedCacheLocator" in report["plain"] and not report["kept"]


@pytest.mark.parametrize("numba", ("known", "other"))
def test_no_setting_of_the_process_is_changed(rendered, numba):
    report = rendered(numba)[1]
    assert report["changed"] == [] and report["environ"]
