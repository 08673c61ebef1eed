"""Memory: what there is, and what work will take."""

import importlib
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.effects.mesh_depth import SAMPLES
from rle_splat.encode.encode import encode
from rle_splat.pipeline import memory_estimate as estimate
from rle_splat.pipeline import quick_estimate
from rle_splat.pipeline.encode_scene import encode as encode_scene
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.read import streaming
from rle_splat.read.formats import read_volume
from rle_splat.runtime import memory
from rle_splat.runtime.jit import compiled
from rle_splat.scene import CLASSIFICATIONS, Light, Quality
from rle_splat.splat import scratch
from tests.unit.memory_setup import BANDED, FUNCTION, GIB, POST, QUALITY, blobs, noise, scene_of, traced

ROOT = Path(__file__).resolve().parents[2]


# --- what there is --------------------------------------------------------------------------------------------


def test_what_there_is_is_a_part_of_the_machine():
    assert 0 < memory.available_bytes() <= memory.total_bytes() < memory.UNLIMITED


@pytest.mark.skipif(memory.resource is None, reason="this system has no limits of address space")
def test_the_limit_of_the_process_counts():
    program = (
        "import resource; from rle_splat.runtime import memory; before = memory.available_bytes(); "
        f"resource.setrlimit(resource.RLIMIT_AS, ({GIB}, {GIB})); print(memory.available_bytes(), before)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    limited, before = map(int, done.stdout.split())
    assert 0 < limited < GIB and limited <= before


@pytest.mark.parametrize("first", (True, False))
def test_the_least_that_any_control_group_leaves_counts(first, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "GROUPS", tmp_path)
    monkeypatch.setattr(memory, "GROUP_OF_PROCESS", tmp_path / "cgroup")
    (tmp_path / "cgroup").write_text("4:memory:/outer/inner\n1:cpu:/other\n" if first else "0::/outer/inner\n")
    root = tmp_path / "memory" if first else tmp_path
    inner = root / "outer" / "inner"
    inner.mkdir(parents=True)
    limit, used = ("memory.limit_in_bytes", "memory.usage_in_bytes") if first else ("memory.max", "memory.current")
    for group, numbers in ((root, ("9000", "10")), (root / "outer", ("5000", "4000")), (inner, ("max", "700"))):
        (group / limit).write_text(numbers[0])
        (group / used).write_text(numbers[1])
    prefix = "total_" if first else ""
    (root / "outer" / "memory.stat").write_text(f"anon 3\n{prefix}inactive_file 300\n{prefix}active_file 20\n")
    assert memory._group_free() == 5000 - 4000 + 320
    (inner / limit).write_text("1000")
    assert memory._group_free() == 300
    assert memory.available_bytes() == 300


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has it from a call, not from files")
def test_where_the_system_tells_nothing_all_of_it_is_there(tmp_path, monkeypatch):
    for name in ("MEMINFO", "GROUP_OF_PROCESS", "ADDRESS_SPACE_USED"):
        monkeypatch.setattr(memory, name, tmp_path / "none")
    assert memory.available_bytes() == memory.total_bytes()


class _OfWindows(np.ndarray):
    """Its sums have the type that numpy 1 gives them on Windows."""

    def sum(self, dtype=np.int32):
        return super().sum(dtype=dtype)


def test_counts_beyond_32_bits_are_summed_as_64():
    counted = [np.full(4, 2**30, np.int32).view(_OfWindows) for _ in range(2)]
    found = estimate.VoxelCount.in_rows(noise(4), counted)
    assert found.count == found.pieces == 2**32


# --- what work will take --------------------------------------------------------------------------------------


# Part of an estimate -> the stages whose results it is of.
STAGES_OF = {
    "visible": ("visible", "relevant"), "normals": ("surfaces", "normals"), "runs": ("runs",),
    "records": ("records", "scalars", "codes"),
}  # fmt: skip


def held_by_stages(scene, quality):
    """(Parts of an estimate -> bytes that a picture's stages really hold, the picture's own estimate, its report)."""
    cache = StageCache()
    report = render(scene, quality, cache=cache).report
    sizes = Counter()
    for (stage, _), (_, size, _) in cache._results.items():
        sizes[stage] += size
    held = {part: sum(sizes[stage] for stage in stages) for part, stages in STAGES_OF.items()}
    if scene.volume.voxels.dtype.kind == "f":
        held["visible"] += sizes["properties"]  # else they are a table of values, which does not grow with the voxels
    return held, report["memory_estimate_bytes"], report["volume"]


@pytest.mark.parametrize("dtype", (np.uint8, np.int16, np.float32))
@pytest.mark.parametrize("classification", CLASSIFICATIONS)
def test_the_parts_of_an_estimate_are_what_the_stages_hold(classification, dtype):
    quality = replace(QUALITY, classification=classification)
    held, counted, report = held_by_stages(scene_of(noise(64, dtype)), quality)
    assert counted["records"] == held["records"] > 0
    assert held["visible"] <= counted["visible"] <= 1.2 * held["visible"]
    # Runs along x stand for those along the other axes.
    assert held["runs"] <= counted["runs"] <= 5.0 * held["runs"]
    assert counted["normals"] == held["normals"]
    assert report["visible_voxels"] > 100_000


@pytest.mark.parametrize("dtype", (np.uint8, np.int16, np.float32))
def test_the_quick_estimate_is_near_what_the_stages_hold(dtype):
    volume = noise(dtype=dtype)
    quick = quick_estimate.estimate_memory(volume, FUNCTION, QUALITY)
    held = held_by_stages(scene_of(volume), QUALITY)[0]
    shown = int((volume.voxels > 80).sum())
    assert quick.visible_voxels == (pytest.approx(shown, rel=0.01) if dtype == np.float32 else shown)
    assert quick.volume == volume.voxels.nbytes and quick.visible_fraction == quick.visible_voxels / volume.voxels.size
    assert quick.records == pytest.approx(held["records"], rel=0.01)
    assert quick.normals == pytest.approx(held["normals"], rel=0.01)
    assert held["visible"] <= quick.visible <= 1.2 * held["visible"]
    assert held["runs"] <= quick.runs <= 3.0 * held["runs"]


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
def test_the_estimate_of_a_histogram_is_near_the_others(dtype):
    volume = noise(dtype=dtype)
    values, counts = np.unique(volume.voxels, return_counts=True)
    found = quick_estimate.count_in_histogram(volume.shape_xyz, volume.voxels.dtype.name, values, counts, FUNCTION)
    rough = quick_estimate.estimate_visible(found, QUALITY, picture=1000)
    quick = quick_estimate.estimate_memory(volume, FUNCTION, QUALITY)
    assert rough.visible_voxels == (volume.voxels > 80).sum() and rough.volume == volume.voxels.nbytes
    assert rough.needed == pytest.approx(quick.needed, rel=0.05) and rough.picture == 1000


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@pytest.mark.parametrize("size, record", ((64, 16), (64, 8), (900, 16)))
def test_the_estimate_of_a_picture_covers_what_it_takes(size, record, dtype):
    scene, quality = scene_of(noise(dtype=dtype), size), replace(QUALITY, record=record)
    render(scene, quality)  # whatever is made once
    rendering, peak = traced(lambda: render(scene, quality))
    needed = rendering.report["memory_estimate_bytes"]["needed"]
    assert 0.9 * peak <= needed <= 2.0 * peak  # writing a file, which is in it too, is not done here


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dtype", "size", "headlight"),
    ((np.uint8, 160, True), (np.uint8, 160, False), (np.float32, 160, False), (np.uint8, 600, True)),
)  # fmt: skip
def test_the_estimate_of_a_picture_of_scalars_covers_what_it_takes(dtype, size, headlight):
    scene = scene_of(blobs(128, dtype), size, BANDED, headlight)
    render(scene, POST)  # whatever is made once
    rendering, peak = traced(lambda: render(scene, POST))
    needed = rendering.report["memory_estimate_bytes"]["needed"]
    assert rendering.report["volume"]["visible_voxels"] > 200_000
    # Writing a file, which is in it too, is not done here.
    assert 0.9 * peak <= needed <= 2.4 * peak, (needed, peak)


@pytest.mark.parametrize("n, size", ((24, 128), (32, 256)))
def test_the_estimate_covers_what_single_rays_take(n, size):
    """Of a small picture they take most: so many are followed at a time."""
    if not compiled():
        pytest.skip("the reference implementation takes more than kernels do")
    scene, quality = scene_of(noise(n), size), Quality.preset("fine", rays=0.01, threads=2)
    render(scene, quality)  # whatever is made once
    rendering, peak = traced(lambda: render(scene, quality))
    assert rendering.report["rays"]["share"] > 0.5
    assert 0.9 * peak <= rendering.report["memory_estimate_bytes"]["needed"] <= 2.0 * peak


MEASURED = """
import sys
from dataclasses import replace
import numpy as np
from rle_splat.pipeline.render import render
from rle_splat.scene import Quality
from tests.unit.memory_setup import noise, scene_of

def status(name):
    return next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith(name + ":"))

classification, meshes = sys.argv[1], sys.argv[2] == "meshes"
quality = Quality.preset("fine", classification=classification)
def scene(n, size):
    made = scene_of(noise(n), size)
    corners = np.array([[(0.0, 0.1, 0.2), (1.0, 0.5, 0.9), (0.2, 1.0, 0.4)]]) * (n - 1)
    turned = corners @ made.index_to_world[:3, :3].T + made.index_to_world[:3, 3]
    return replace(made, triangles=turned) if meshes else made

large = scene(104, 640)
large.volume.value_counts
render(scene(16, 32), quality)
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")
before = status("VmRSS")
rendering = render(large, quality)
print(rendering.report["memory_estimate_bytes"]["needed"], status("VmHWM") - before)
"""


@pytest.mark.skipif(sys.platform != "linux" or not Path("/proc/self/clear_refs").exists(), reason="only Linux has it")
@pytest.mark.slow
@pytest.mark.parametrize("classification, meshes", (("pre", ""), ("post", "meshes")))
def test_the_estimate_covers_what_the_system_sees_a_picture_take(classification, meshes):
    """All of it: scratch that is kept, samples of meshes, and what no tracer of Python's own is told."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, classification, meshes], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    needed, taken = map(int, done.stdout.split())
    assert taken > 50e6 and 0.9 * taken <= needed <= 2.0 * taken, (needed, taken)


LONG_SESSION = """
import itertools
from statistics import median
from dataclasses import replace
from rle_splat.classify.presets import PRESETS, fit_preset
from rle_splat.pipeline.render import render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import Light, Quality
from rle_splat.view.turntable import turntable
from tests.unit.memory_setup import noise, scene_of

def status(name):
    return next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith(name + ":"))

cache, names = StageCache(most_bytes=1 << 24), itertools.cycle(PRESETS)
scene = scene_of(noise(20), 64)
kinds = ({}, {"mode": "mip"}, {"headlight": False, "lights": (Light("SUN"),), "volume_shadows": True})
resident = []
for number in range(220):
    camera, matrix = turntable(scene.volume, 7.0 * number, 20.0)
    function, _ = fit_preset(next(names), scene.volume)
    seen = replace(scene, camera=camera, volume_matrix=matrix, transfer_function=function, **kinds[number % 3])
    drain(render_steps(seen, Quality(threads=1, classification="pre" if number % 7 == 6 else "post"), cache=cache))
    resident.append(status("VmRSS"))
print(int(median(resident[90:130])), int(median(resident[180:])))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux says what is resident")
def test_hundreds_of_pictures_more_take_no_more_memory():
    """With views, presets, modes, lights and classifications that change, beside a full stage cache.

    The first ninety load kernels and fill buffers.  Single pictures leave up to 2 MB more than others, medians do not.
    """
    if not compiled():
        pytest.skip("the reference implementation takes minutes")
    done = subprocess.run([sys.executable, "-c", LONG_SESSION], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    early, late = map(int, done.stdout.split())
    # A quarter of a picture's 64 x 64 pixels of 16 bytes, kept of each.
    assert early > 50e6 and late - early < 90 * 64 * 64 * 4, (early, late)


@pytest.mark.parametrize("classification", CLASSIFICATIONS)
def test_the_scratch_of_a_picture_is_as_large_as_is_said(classification, monkeypatch):
    if not compiled():
        pytest.skip("there are no kernels without numba")
    made, counted = [], []
    monkeypatch.setattr(scratch, "_memory", lambda size: made.append(size) or np.zeros(size, np.uint8))
    source = importlib.import_module("rle_splat.pipeline.source")
    monkeypatch.setattr(source, "scratch_bytes", lambda *a: counted.append(scratch.scratch_bytes(*a)) or 0)
    shaded = replace(scene_of(noise(32), 200), lights=(Light("SUN"),), headlight=False, volume_shadows=True)
    render(shaded, replace(QUALITY, classification=classification, warp_filter="bilinear"))
    assert scratch.SPREAD * max(counted) == pytest.approx(max(made), rel=0.001)  # but for the ends of cache lines


def test_the_estimate_counts_the_samples_of_meshes_and_the_filters_copy():
    sheet = (SimpleNamespace(width=3000, height=3000),)
    plain, meshes, cubic = (
        estimate.picture_bytes(sheet, 100, 100, Quality(warp_filter=name), meshes=on)
        for name, on in (("bilinear", False), ("bilinear", True), ("cubic", False))
    )
    assert cubic - plain == 16 * 3000**2 and meshes > 1.9 * plain
    few = estimate.picture_bytes(sheet[:0], 1000, 1000, Quality(), meshes=True)
    assert few >= 4 * SAMPLES * 1000**2


@pytest.mark.parametrize("record", (16, 8))
def test_the_estimate_of_three_axes_covers_what_they_take(record):
    scene, quality = scene_of(noise()), replace(QUALITY, record=record)
    encode_scene(scene, quality)
    stored, peak = traced(lambda: encode_scene(scene, quality))
    assert len(stored.axes) == 3
    needed = quick_estimate.estimate_memory(scene.volume, FUNCTION, quality, axes=3).needed
    assert 0.9 * peak <= needed <= 1.8 * peak


@pytest.mark.parametrize("axes", ((0,), (1,), (2,), (0, 1, 2)))
def test_encoding_streams_without_a_second_copy_of_the_volume(axes, tmp_path, monkeypatch):
    """128 MiB of voxels in a file: beside the tables and the list of what is shown, a tenth of that at most."""
    monkeypatch.setattr(sys.modules[encode.__module__], "RECORDS_AT_ONCE", 1 << 14)
    monkeypatch.setattr(streaming, "LEAST_MAPPED", 1)
    shape, kept = (1024, 512, 256), 64**3
    path = tmp_path / "v.raw"
    with open(path, "wb") as file:
        file.truncate(int(np.prod(shape)))
    np.memmap(path, np.uint8, "r+", shape=shape[::-1])[30:94, 200:264, 500:564] = 200
    volume = read_volume(path, shape=shape, dtype="uint8")
    mapping = volume.voxels.base
    assert isinstance(mapping, np.memmap)
    encode_scene(scene_of(noise(16), headlight=False), QUALITY)  # whatever is made once
    stored, peak = traced(lambda: encode_scene(scene_of(volume, headlight=False), QUALITY, axes))
    tables = sum(one.nbytes for one in stored.axes.values())
    assert volume.voxels.base is mapping and stored.axes[axes[0]].visible_voxels == kept
    shown = kept * (2 + 1) + volume.voxels.size // 8  # its column and its value; a bit of every voxel
    assert peak - tables - shown < 0.1 * volume.voxels.nbytes


def test_the_voxels_are_hashed_once():
    volume = noise(16)
    own = volume.voxel_key
    object.__setattr__(volume, "voxels", None)  # whoever looks again fails
    assert volume.key and volume.key != own
    assert noise(16).key == volume.key and replace(noise(16), slope=2.0).key != volume.key
