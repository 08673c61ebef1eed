"""Proves that the libraries of formats are loaded in steps, compiled sources or not."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

CHILD = """
import json, sys
import numpy
from rle_splat.read.library_import import library_steps
name = sys.argv[1]
steps, count, began = library_steps(name, name, "Such"), 0, len(sys.modules)
most, before = 0, began
while True:
    try:
        next(steps)
    except StopIteration as end:
        module = end.value
        break
    finally:
        now = len(sys.modules)
        most, before = max(most, now - before), now
    count += 1
print(json.dumps([count, most / (now - began), module.__name__, module is sys.modules[name]]))
"""


def loaded(name: str, pyc: Path, **environ):
    """(steps, largest share of the modules that one imports, name of the result, whether it is the module)."""
    words = [sys.executable, "-c", CHILD, name]
    own = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environ = {**own, "PYTHONPYCACHEPREFIX": str(pyc), **environ}
    done = subprocess.run(words, capture_output=True, text=True, env=environ)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("name, pieces", [("pydicom", 6), ("nibabel", 8)])
def test_a_library_is_loaded_in_steps(tmp_path, name, pieces):
    pytest.importorskip(name)
    first, second = (loaded(name, tmp_path) for _ in range(2))
    assert first[2:] == second[2:] == [name, True]
    assert first[0] > 60 and second[0] == 1 + pieces, "sources are compiled one by one, once"
    if name == "pydicom":
        assert loaded(name, tmp_path / "other", PYTHONDONTWRITEBYTECODE="1")[0] == 1 + pieces
        assert not (tmp_path / "other").exists()
    assert max(first[1], second[1]) < 0.7, "no step imports nearly all of it"
