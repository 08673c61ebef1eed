"""What the first picture ever has to compile: each kernel of the common pipeline once, and no other."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.runtime.jit import compiled, nothing_compiled_yet
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.ways import NUMPY

ROOT = Path(__file__).resolve().parents[2]
PIPELINE = """
import gc, json, sys
from dataclasses import replace
import numpy as np
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.runtime.jit import numba
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.pipeline.render import render
from rle_splat.scene import Light, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

voxels = np.random.default_rng(0).integers(0, 255, (20, 18, 16)).astype(np.uint8)
volume, cache = Volume(voxels, np.eye(4)), StageCache()
camera, matrix = turntable(volume, 20, 10)
tf = TransferFunction(opacity=((80, 0.0), (250, 0.6)), color=((0, 0.2, 0.4, 0.8),))
scene = Scene(volume, tf, camera, 24, 24, matrix, headlight=True)
for edited in (
    scene,
    replace(scene, camera=turntable(volume, 24, 10)[0]),
    replace(scene, lights=(Light("SUN"),)),
    replace(scene, transfer_function=replace(tf, opacity=((60, 0.0), (250, 0.6)))),
    replace(scene, transfer_function=replace(tf, shade=Shade(specular=0.0))),
):
    render(edited, Quality.preset("draft", classification=sys.argv[1]), cache=cache)
folders = ("rle_splat.volume", "rle_splat.classify", "rle_splat.shade", "rle_splat.encode")
kernels = [k for k in gc.get_objects() if isinstance(k, numba.core.dispatcher.Dispatcher)]
kernels = [k for k in kernels if k.py_func.__module__.startswith(folders)]
outer = [k for k in kernels if not k.targetoptions.get("no_cpython_wrapper")]
print(json.dumps({k.py_func.__name__: len(k.signatures) for k in outer if k.signatures}))
"""


@pytest.mark.slow
@pytest.mark.skipif(not compiled(), reason="nothing is compiled without numba")
@pytest.mark.parametrize("classification, kernels", (("pre", 7), ("post", 8)))
def test_the_common_road_compiles_each_kernel_once(classification, kernels):
    words = [sys.executable, "-c", PIPELINE, classification]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found) == kernels and set(found.values()) == {1}, found


THUMBNAILS = """
import gc, json, sys
import numpy as np
from rle_splat.classify.default import default_transfer_function
from rle_splat.classify.presets import PRESETS, fit_preset
from rle_splat.pipeline.fitting import fitting_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.pipeline.thumbnail import thumbnail_steps
from rle_splat.runtime.jit import numba
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

def versions():
    kernels = [k for k in gc.get_objects() if isinstance(k, numba.core.dispatcher.Dispatcher)]
    outer = [k for k in kernels if not k.targetoptions.get("no_cpython_wrapper")]
    return {(k.py_func.__name__, repr(signature)) for k in outer for signature in k.signatures}

z, y, x = np.mgrid[:40, :40, :40] - 19.5
voxels = np.clip(255 - 12 * np.sqrt(x**2 + y**2 + z**2), 0, 255).astype(sys.argv[1])
voxels.flags.writeable = False
volume, cache = Volume(voxels, np.eye(4)), StageCache()
function, _ = default_transfer_function(volume)
ends = np.full((60, 80), np.inf, np.float32)
ends[20:30, 20:30] = 50.0
for azimuth, elevation in json.loads(sys.argv[2]):
    camera, matrix = turntable(volume, azimuth, elevation, perspective=True)
    seen_by = {"crop": (5, 5, 70, 50), "ray_ends": ends}
    scene = Scene(volume, function, camera, 80, 60, matrix, **seen_by)
    drain(fitting_steps(scene, Quality.preset("draft"), cache, is_draft=True))
before = versions()
for name in PRESETS:
    drain(thumbnail_steps(volume, fit_preset(name, volume)[0], 1.0, StageCache()))
print(json.dumps([len(before), sorted({name for name, _ in versions() - before})]))
"""
ALONG_AN_AXIS = {"count_across", "fill_across_runs", "place_across", "fill_row_runs"}  # take 3 to 12 ms to load, each


@pytest.mark.slow
@pytest.mark.skipif(not compiled(), reason="nothing is compiled without numba")
@pytest.mark.parametrize(
    "stored, views, more", (("uint8", ((5, 5), (95, 5), (5, 85)), set()), ("int16", ((95, 5),), ALONG_AN_AXIS))
)
def test_thumbnails_load_no_kernels_beside_those_of_a_viewports_drafts(stored, views, more):
    """But for those that make tables along a principal axis which no draft has had."""
    words = [sys.executable, "-c", THUMBNAILS, stored, json.dumps(views)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    drafted, loaded = json.loads(done.stdout)
    assert drafted > 8 and set(loaded) <= more


def _said(first_ever, monkeypatch, classification):
    """What is said of each step of a picture, in order."""
    pipeline = importlib.import_module("rle_splat.pipeline.render")
    watch = importlib.import_module("rle_splat.pipeline.watch_steps")
    monkeypatch.setattr(watch, "nothing_compiled_yet", lambda: first_ever)
    volume = Volume(np.random.default_rng(0).integers(0, 255, (9, 10, 11)).astype(np.uint8), np.eye(4))
    camera, matrix = turntable(volume, 20, 10)
    tf = TransferFunction(opacity=((80, 0.0), (250, 0.6)), color=((0, 0.2, 0.4, 0.8),), shade=Shade())
    quality = Quality.preset("draft", classification=classification)
    steps = pipeline.render_steps(Scene(volume, tf, camera, 12, 12, matrix, headlight=True), quality)
    return [step.message for step in steps]


@pytest.mark.skipif(not compiled(), reason="nothing is compiled without numba")
@pytest.mark.parametrize("classification", ("pre", "post"))
def test_every_step_of_the_first_picture_says_that_code_is_compiled(monkeypatch, classification):
    *said, last = _said(True, monkeypatch, classification)
    assert last == "Done" and all("ompiling" in message and "first time" in message for message in said)
    named = {"pre": "Encoding", "post": "Shading"}[classification]
    assert any(message.startswith(named) for message in said)
    known = [message for message in _said(False, monkeypatch, classification) if message != said[-1]]
    assert not any("compiling" in message for message in known)


@NUMPY
def test_without_kernels_nothing_is_said_of_them(monkeypatch, way):
    assert not any("compiling" in message for message in _said(True, monkeypatch, "post"))


@pytest.mark.skipif(not compiled(), reason="nothing is compiled without numba")
def test_whether_anything_was_compiled_is_seen_on_disk(monkeypatch, tmp_path):
    monkeypatch.setattr("rle_splat.runtime.jit.KERNELS", tmp_path / "kernels")
    monkeypatch.setattr("rle_splat.runtime.jit._LOADED", set())  # what other tests have loaded
    monkeypatch.setattr("rle_splat.runtime.jit.shipped_level", lambda: "")
    assert nothing_compiled_yet()
    (tmp_path / "kernels" / "splat").mkdir(parents=True)
    assert nothing_compiled_yet()
    (tmp_path / "kernels" / "splat" / "one.nbi").touch()
    assert not nothing_compiled_yet()


IMPORTS = """
from rle_splat.runtime.jit import first_load_steps
print(len(list(first_load_steps())), len(list(first_load_steps())))
"""


@pytest.mark.skipif(not compiled(), reason="nothing is imported without numba")
def test_what_numba_imports_for_its_first_kernel_is_imported_in_steps():
    """So that a window is drawn between them."""
    command = [sys.executable, "-c", IMPORTS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=300)
    first, again = map(int, done.stdout.split())
    assert first > 1 and again == 0
