"""Mutated files of every format end in a volume or in one sentence: no crash, no hang, no other exception."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
COUNT = int(os.environ.get("RLE_SPLAT_FUZZ", "400"))
MOST_MEGABYTES = 64  # more than the honest files took; they are small


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits the memory of a process as Linux does")
@pytest.mark.parametrize("seed", [1, 2])
def test_mutated_files(tmp_path, seed):
    words = [sys.executable, "-m", "tests.read.fuzz_child", str(tmp_path / "files"), str(seed), str(COUNT // 2)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["other"] == [] and result["slow"] == [], result
    assert result["read"] + result["refused"] == COUNT // 2 and result["refused"] > COUNT // 8
    assert result["megabytes"] < MOST_MEGABYTES
