"""Pictures of each quality preset, with each effect, compile nothing where the package brings its kernels."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from devtools.kernels import BASELINE, is_made
from rle_splat.runtime.cache_folder import CACHE_VARIABLE, NUMBA_VARIABLE
from rle_splat.runtime.jit import compiled, shipped_level

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.runtime.shipped_kernels import FOLDER, file_name

ROOT = Path(__file__).resolve().parents[2]
# Every case with each stored type, in small; a picture ends where it would compile, which is noted.
DRAW = """
import json
from dataclasses import replace
from devtools import reference_pictures
from rle_splat import render
from rle_splat.pipeline.prepare import STORED_TYPES
from rle_splat.runtime import jit

class Compiles(BaseException):
    pass

def stop():
    raise Compiles

reference_pictures.SIZES = dict.fromkeys(reference_pictures.SIZES, (48, 36))
compiling, count = [], 0
for case in reference_pictures.effect_cases():
    volume = case.scene.volume
    several = volume.voxels.dtype == "uint8" and not case.scene.channels
    for stored in STORED_TYPES if several else (volume.voxels.dtype,):
        scene = replace(case.scene, volume=replace(volume, voxels=volume.voxels.astype(stored)))
        count += 1
        try:
            with jit.while_compiling(stop):
                render(scene, replace(case.quality, threads=1))
        except Compiles:
            compiling.append(f"{case.name} {stored}")
print(json.dumps([count, compiling]))
"""


@pytest.mark.slow
def test_no_preset_with_any_effect_compiles(tmp_path):
    if not (shipped_level() and is_made(FOLDER / file_name(BASELINE))):
        pytest.skip("there are no kernels of these sources for this processor: dev.py kernels makes them")
    environ = {name: value for name, value in os.environ.items() if name != NUMBA_VARIABLE}
    environ |= {CACHE_VARIABLE: str(tmp_path), "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", DRAW], cwd=ROOT, env=environ, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    count, compiling = json.loads(done.stdout)
    assert count > 400 and compiling == []
