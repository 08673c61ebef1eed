"""Where the package brings its kernels, nothing compiles: pictures of each quality preset with each effect, and with
every two; command lines with each option.  Stored types that docs list as still compiled do compile.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from devtools.kernels import is_made
from rle_splat.runtime.cache_folder import CACHE_VARIABLE, NUMBA_VARIABLE
from rle_splat.runtime.jit import compiled, shipped_level

if not compiled():
    pytest.skip("nothing is compiled without numba", allow_module_level=True)

from rle_splat.runtime.shipped_kernels import FOLDER, file_name

ROOT = Path(__file__).resolve().parents[2]
# What would compile ends there, which is noted.
BEGIN = """
import json
from contextlib import contextmanager
from rle_splat.runtime import jit

class Compiles(BaseException):
    pass

def stop():
    raise Compiles

compiling, count = [], 0
@contextmanager
def noting(name):
    global count
    count += 1
    try:
        with jit.while_compiling(stop):
            yield
    except Compiles:
        compiling.append(name)
"""
# Every case with a small volume and picture, with the stored types in turn, so that each preset has each of them; and
# one of a scan's usual size.
DRAW = """
from dataclasses import replace
from devtools import reference_pictures
from rle_splat import render
from rle_splat.pipeline.prepare import STORED_TYPES

reference_pictures.SIZES = dict.fromkeys(reference_pictures.SIZES, (48, 36))
shells, smoke = reference_pictures.shells, reference_pictures.smoke
reference_pictures.shells, reference_pictures.smoke = lambda _: shells(20), lambda _: smoke((16, 20, 24))
drawn = set()
for number, case in enumerate(reference_pictures.effect_cases()):
    volume, quality = case.scene.volume, case.quality
    stored = volume.voxels.dtype.name
    if stored == "uint8" and not case.scene.channels:
        stored = STORED_TYPES[(number + number // 16) % len(STORED_TYPES)]  # 16 cases of each scene
        drawn.add((quality.name, quality.classification, case.scene.camera.type, stored))
    scene = replace(case.scene, volume=replace(volume, voxels=volume.voxels.astype(stored)))
    with noting(f"{case.name} {stored}"):
        render(scene, replace(quality, threads=1))
assert len(drawn) == 16 * len(STORED_TYPES), len(drawn)
voxels = volume.voxels
for axis, side in enumerate(voxels.shape):
    voxels = voxels.repeat(-(-256 // side), axis)
with noting("256 voxels a side"):
    render(replace(case.scene, volume=replace(volume, voxels=voxels)), replace(case.quality, threads=1))
"""
# Every two of the effects that are prepared, at once; the stored types in turn, so that each effect has each of them at
# each preset: few kernels have a version for each type.
TOGETHER = """
from dataclasses import replace
from itertools import combinations
from rle_splat.pipeline import prepare
from rle_splat.pipeline.prepare import PICTURES, STORED_TYPES, picture_steps
from rle_splat.runtime.steps import drain
from rle_splat.scene import RleSplatError

prepare.SIDE = 24

words = sorted({word for picture in PICTURES for word in picture.scene.split()})
presets = [(quality, "post") for quality in ("standard", "fine", "strict")] + [("standard", "pre")]
drawn = set()
for number, together in enumerate(combinations(words, 2)):
    for turn, (quality, classification) in enumerate(presets, number):
        stored = STORED_TYPES[turn % len(STORED_TYPES)]
        drawn |= {(word, quality, classification, stored) for word in together}
        picture = replace(PICTURES[0], scene=" ".join(together), quality=quality, classification=classification)
        with noting(f"{picture.scene}, {quality}, {classification}, {stored}"):
            try:
                drain(picture_steps(picture, stored))
            except RleSplatError:  # some exclude each other
                pass
assert len(drawn) == len(words) * len(presets) * len(STORED_TYPES)
"""
OTHER_TYPES = """
from rle_splat.pipeline.prepare import PICTURES, STORED_TYPES, picture_steps
from rle_splat.runtime.steps import drain
from rle_splat.volume.volume import STORED_TYPES as ALL

for stored in ALL:
    if stored not in STORED_TYPES:
        with noting(stored):
            drain(picture_steps(PICTURES[0], stored))
"""
# Files of every type whose values fit into one that kernels travel for.
FROM_FILES = """
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from rle_splat.pipeline import prepare
from rle_splat.pipeline.render import render_steps
from rle_splat.read.formats import read_volume, write_volume
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality
from rle_splat.volume.volume import STORED_TYPES as ALL

ball = prepare._ball("uint8")
for stored in ALL:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.nrrd"
        write_volume(replace(ball, voxels=(ball.voxels // 2).astype(stored)), path)
        volume = read_volume(path)
    with noting(stored):
        drain(render_steps(prepare._scene(prepare.PICTURES[0], volume), Quality.preset("standard")))
"""
COMMAND = """
from tests.cli import every_option

wrong = every_option.run_all(noting)
assert not wrong, wrong
"""
END = "print(json.dumps([count, compiling]))"


def find_compiling(program: str, cache: Path) -> tuple[int, list[str]]:
    """How many pictures or command lines a program has made in a process of its own, and those that would compile."""
    if not (shipped_level() and is_made(FOLDER / file_name())):
        pytest.skip("there are no kernels of these sources for this processor: dev.py kernels makes them")
    environ = {name: value for name, value in os.environ.items() if name != NUMBA_VARIABLE}
    environ |= {CACHE_VARIABLE: str(cache), "PYTHONPATH": str(ROOT)}
    program = f"{BEGIN}{program}{END}"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=environ, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_no_preset_with_any_effect_compiles(tmp_path):
    count, compiling = find_compiling(DRAW, tmp_path)
    assert count > 250 and compiling == []


@pytest.mark.slow
def test_no_two_effects_together_compile(tmp_path):
    count, compiling = find_compiling(TOGETHER, tmp_path)
    assert count > 170 and compiling == []


def test_other_stored_types_compile_as_documented(tmp_path):
    _, compiling = find_compiling(OTHER_TYPES, tmp_path)
    page = (ROOT / "docs/explanation/measurements.md").read_text(encoding="utf-8")
    (listed,) = re.findall(r"^Still compiled .*?: volumes of (.*?);", page, re.MULTILINE | re.DOTALL)
    assert compiling == re.findall(r"`(\w+)`", listed)


def test_files_of_other_types_with_values_that_fit_compile_nothing(tmp_path):
    assert find_compiling(FROM_FILES, tmp_path) == [8, []]


@pytest.mark.slow
def test_no_option_of_the_command_line_compiles(tmp_path):
    """See ``NOT_DRIVEN`` in tests/cli/every_option.py for what is left out."""
    count, compiling = find_compiling(COMMAND, tmp_path)
    assert count > 120 and compiling == []
