"""ruff finds nothing in any file, and would format none otherwise."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("words", (["check"], ["format", "--check"]), ids=" ".join)
def test_ruff(words):
    command = [sys.executable, "-m", "ruff", *words, "--no-cache", "."]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 0, f"{found.stdout}{found.stderr}python3 dev.py lint --fix mends what can be mended"
