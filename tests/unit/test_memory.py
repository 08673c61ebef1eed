"""Memory: what there is, what work will take, and refusals before it is taken, with what would fit."""

import importlib
import subprocess
import sys
import tracemalloc
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.comparison.decode import decode
from rle_splat.effects.mesh_depth import SAMPLES
from rle_splat.encode.encode import encode
from rle_splat.pipeline import memory_estimate as estimate
from rle_splat.pipeline import quick_estimate
from rle_splat.pipeline.encode_scene import encode_scene
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.read.formats import read_volume
from rle_splat.runtime import memory
from rle_splat.runtime.jit import compiled
from rle_splat.scene import CLASSIFICATIONS, Quality, RleSplatError, Scene
from rle_splat.splat import scratch
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume
from tests.encoded import to_volume_order

ROOT = Path(__file__).resolve().parents[2]
QUALITY = Quality.preset("draft", classification="pre")
FUNCTION = TransferFunction(opacity=((80, 0.0), (120, 0.3)), color=((80, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8)))
GIB = 1 << 30
# Of scalars: what is shown is a range of values, and most of what is in runs of several voxels.
POST = Quality(classification="post", depth_rule="slice", sheet_density=0.7, warp_filter="bilinear", rays=0.05)
BANDED = replace(FUNCTION, opacity=((80, 0.0), (120, 0.3), (150, 0.3), (170, 0.0)))


def noise(n=96, dtype=np.uint8, share=0.4):
    """Voxels of which about ``share`` are shown by FUNCTION, in runs of a few voxels."""
    values = np.random.default_rng(5).random((n, n, n // 4))
    return Volume(np.repeat(np.where(values < share, 200, 10), 4, axis=2).astype(dtype), np.eye(4))


def blobs(n=96, dtype=np.uint8):
    """Voxels of which BANDED shows blobs of 4 x 4 x 8, so that cells are kept in runs."""
    values = np.random.default_rng(5).random((n // 4, n // 4, n // 8)) < 0.04
    return Volume(np.kron(np.where(values, 130, 10), np.ones((4, 4, 8))).astype(dtype), np.eye(4))


def scene_of(volume, size=64, function=FUNCTION, headlight=True):
    camera, matrix = turntable(volume, 20, 10, width=size, height=size)
    return Scene(volume, function, camera, size, size, matrix, headlight=headlight)


# --- what there is --------------------------------------------------------------------------------------------


def test_what_there_is_is_a_part_of_the_machine():
    assert 0 < memory.available_bytes() <= memory.total_bytes() < memory.UNLIMITED


@pytest.mark.skipif(memory.resource is None, reason="this system has no limits of address space")
def test_the_limit_of_the_process_counts():
    program = (
        "import resource; from rle_splat.runtime import memory; before = memory.available_bytes(); "
        f"resource.setrlimit(resource.RLIMIT_AS, ({GIB}, {GIB})); print(memory.available_bytes(), before)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
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


def test_where_the_system_tells_nothing_all_of_it_is_there(tmp_path, monkeypatch):
    for name in ("MEMINFO", "GROUP_OF_PROCESS", "ADDRESS_SPACE_USED"):
        monkeypatch.setattr(memory, name, tmp_path / "none")
    assert memory.available_bytes() == memory.total_bytes()


# --- what work will take --------------------------------------------------------------------------------------


# Part of an estimate -> the stages whose results it is of.
STAGES_OF = {
    "visible": ("visible", "relevant", "light"), "normals": ("normals",), "runs": ("runs",),
    "records": ("records", "scalars", "lights", "normal codes"),
}  # fmt: skip


def held_by_stages(scene, quality):
    """(Parts of an estimate -> bytes that a picture's stages really hold, the picture's own estimate, its report)."""
    cache = StageCache()
    report = render(scene, quality, cache=cache).report
    sizes = Counter()
    for (stage, _), (_, size) in cache._results.items():
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
    # Runs along x stand for those along the other axes; finer voxels are shaded where the scan's are.
    assert held["runs"] <= counted["runs"] <= 5.0 * held["runs"]
    assert held["normals"] <= counted["normals"] <= (3.0 if classification == "refined" else 1.0) * held["normals"]
    assert report["visible_voxels"] > 100_000


@pytest.mark.parametrize("dtype", (np.uint8, np.int16, np.float32))
def test_the_quick_estimate_is_near_what_the_stages_hold(dtype):
    volume = noise(dtype=dtype)
    quick = quick_estimate.estimate(volume, FUNCTION, QUALITY)
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
    rough = quick_estimate.estimate_from_histogram(
        volume.shape_xyz, volume.voxels.dtype.name, values, counts, FUNCTION, QUALITY, picture=1000
    )
    quick = quick_estimate.estimate(volume, FUNCTION, QUALITY)
    assert rough.visible_voxels == (volume.voxels > 80).sum() and rough.volume == volume.voxels.nbytes
    assert rough.needed == pytest.approx(quick.needed, rel=0.05) and rough.picture == 1000


def traced(work):
    """(what ``work`` returns, the most bytes it held at a time)."""
    tracemalloc.start()
    try:
        result = work()
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("dtype", (np.uint8, np.float32))
@pytest.mark.parametrize("size, record", ((64, 16), (64, 4), (900, 16)))
def test_the_estimate_of_a_picture_covers_what_it_takes(size, record, dtype):
    scene, quality = scene_of(noise(dtype=dtype), size), replace(QUALITY, record=record)
    render(scene, quality)  # whatever is made once
    rendering, peak = traced(lambda: render(scene, quality))
    needed = rendering.report["memory_estimate_bytes"]["needed"]
    assert 0.9 * peak <= needed <= 2.0 * peak  # writing a file, which is in it too, is not done here


@pytest.mark.parametrize(
    ("dtype", "size", "headlight"),
    ((np.uint8, 160, True), (np.uint8, 160, False), (np.float32, 160, False), (np.float64, 160, False),
     (np.uint8, 700, True)),
)  # fmt: skip
def test_the_estimate_of_a_picture_of_scalars_covers_what_it_takes(dtype, size, headlight):
    scene = scene_of(blobs(160, dtype), size, BANDED, headlight)
    render(scene, POST)  # whatever is made once
    rendering, peak = traced(lambda: render(scene, POST))
    needed = rendering.report["memory_estimate_bytes"]["needed"]
    assert rendering.report["volume"]["visible_voxels"] > 400_000
    # Writing a file, which is in it too, is not done here.
    assert 0.9 * peak <= needed <= 2.4 * peak, (needed, peak)


@pytest.mark.parametrize("n, size", ((16, 64), (32, 256)))
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
from tests.unit.test_memory import noise, render, scene_of, Quality

def status(name):
    return next(1024 * int(line.split()[1]) for line in open("/proc/self/status") if line.startswith(name + ":"))

classification, meshes = sys.argv[1], sys.argv[2] == "meshes"
quality = Quality.preset("fine", classification=classification)
def scene(n, size):
    made = scene_of(noise(n), size)
    corners = np.array([[(0.0, 0.1, 0.2), (1.0, 0.5, 0.9), (0.2, 1.0, 0.4)]]) * (n - 1)
    turned = corners @ made.index_to_world[:3, :3].T + made.index_to_world[:3, 3]
    return replace(made, triangles=turned) if meshes else made

large = scene(128, 1000)
large.volume.value_counts
render(scene(16, 32), quality)
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")
before = status("VmRSS")
rendering = render(large, quality)
print(rendering.report["memory_estimate_bytes"]["needed"], status("VmHWM") - before)
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="only Linux tells a process's peak from now on")
@pytest.mark.parametrize("meshes", ("", "meshes"))
@pytest.mark.parametrize("classification", ("pre", "post"))
def test_the_estimate_covers_what_the_system_sees_a_picture_take(classification, meshes):
    """All of it: scratch that is kept, samples of meshes, and what no tracer of Python's own is told."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, classification, meshes], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    needed, taken = map(int, done.stdout.split())
    assert taken > 50e6 and 0.9 * taken <= needed <= 2.0 * taken, (needed, taken)


@pytest.mark.parametrize("classification", CLASSIFICATIONS)
def test_the_scratch_of_a_picture_is_as_large_as_is_said(classification, monkeypatch):
    if not compiled():
        pytest.skip("there are no kernels without numba")
    made, counted = [], []
    monkeypatch.setattr(scratch, "_memory", lambda size: made.append(size) or np.zeros(size, np.uint8))
    source = importlib.import_module("rle_splat.pipeline.source")
    monkeypatch.setattr(source, "scratch_bytes", lambda *a: counted.append(scratch.scratch_bytes(*a)) or 0)
    render(scene_of(noise(32), 200), replace(QUALITY, classification=classification, warp_filter="bilinear"))
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
    needed = quick_estimate.estimate(scene.volume, FUNCTION, quality, axes=3).needed
    assert 0.9 * peak <= needed <= 1.8 * peak


@pytest.mark.parametrize("axes", ((0,), (1,), (2,), (0, 1, 2)))
def test_encoding_streams_without_a_second_copy_of_the_volume(axes, tmp_path, monkeypatch):
    """128 MiB of voxels in a file: beside the tables and the list of what is shown, a tenth of that at most."""
    monkeypatch.setattr(sys.modules[encode.__module__], "VOXELS_AT_ONCE", 1 << 14)
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
    shown = kept * (2 + 1)  # its column and its value
    assert peak - tables - shown < 0.1 * volume.voxels.nbytes


def test_the_voxels_are_hashed_once():
    volume = noise(16)
    own = volume.voxel_key
    object.__setattr__(volume, "voxels", None)  # whoever looks again fails
    assert volume.key and volume.key != own
    assert noise(16).key == volume.key and replace(noise(16), slope=2.0).key != volume.key


# --- said before it is taken, or refused ----------------------------------------------------------------------


def short_of_memory(monkeypatch, free):
    """As if there were ``free`` bytes; and work on few voxels at a time, as large volumes have it."""
    # By the table of modules: the name rle_splat.encode is the facade's function.
    monkeypatch.setattr(sys.modules["rle_splat.encode.sizes"], "VOXELS_AT_ONCE", 1000)
    for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory"):
        monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: free)


def test_it_is_said_before_the_lists_are_made_and_while_they_are():
    """And in the words of the report, before anything that it speaks of is taken."""
    work, messages, held = render_steps(scene_of(noise()), QUALITY), [], None
    render(scene_of(noise(16)), QUALITY)  # whatever is made once
    tracemalloc.start()
    try:
        while True:
            messages.append(next(work).message)
            if held is None and " in all" in messages[-1]:
                held = tracemalloc.get_traced_memory()[0]
    except StopIteration as finished:
        report = finished.value.report
    finally:
        tracemalloc.stop()
    needed, kept = report["memory_estimate_bytes"]["needed"], report["volume"]["visible_voxels"]
    told = f"Classifying {kept} voxels, about {memory.bytes_text(needed)} in all"
    said = [n for n, message in enumerate(messages) if message == told]
    assert len(said) > 1, "only for a moment"
    assert messages.index("Counting") < said[0] and said[-1] < messages.index("Encoding")
    assert held < 0.1 * needed


@pytest.mark.parametrize(
    "share, axes, words",
    (
        (0.95, 1, "voxel records of 8 bytes would fit"), (0.66, 1, "voxel records of 4 bytes would fit"),
        (0.4, 1, "a narrower transfer function"), (0.001, 1, "crop or downsample the volume"),
        (0.67, 3, "voxel records of 8 bytes would fit"),
        (0.45, 3, "two principal axes at a time with voxel records of 4 bytes would fit"),
        (0.38, 3, "one principal axis at a time with voxel records of 8 bytes would fit"),
    ),
)
def test_too_little_memory_is_refused_with_what_would_fit(share, axes, words, monkeypatch):
    scene = scene_of(noise())
    short_of_memory(monkeypatch, 0)
    needed = quick_estimate.estimate(scene.volume, FUNCTION, QUALITY, axes=axes).needed
    short_of_memory(monkeypatch, int(share * needed / estimate.SPARE))
    work = (lambda: encode_scene(scene, QUALITY)) if axes == 3 else (lambda: encode_scene(scene, QUALITY, (1,)))

    def refused():
        with pytest.raises(RleSplatError, match="are free") as problem:
            work()
        return str(problem.value)

    sentence, peak = traced(refused)
    assert words in sentence and sentence.endswith(".") and sentence.count(". ") == 0, sentence
    assert peak < 0.2 * needed  # nothing was taken yet


def test_too_little_memory_for_scalars_is_refused_before_it_is_taken(monkeypatch):
    scene = scene_of(blobs(), function=BANDED)
    render(scene, POST)  # whatever is made once
    short_of_memory(monkeypatch, 2 << 20)

    def refused():
        with pytest.raises(RleSplatError, match="are free") as problem:
            render(scene, POST)
        return str(problem.value)

    sentence, peak = traced(refused)
    assert sentence.endswith(".") and sentence.count(". ") == 0 and peak < 3 << 20


def counted_in_rows(volume, shown):
    """As if each row of voxels showed so many, in pieces of five."""
    counts = np.full(volume.shape_xyz[1] * volume.shape_xyz[2], shown)
    return counts, counts // 5


def found_in_rows(volume, shown):
    return estimate.Found.in_rows(volume, counted_in_rows(volume, shown))


@pytest.mark.parametrize("share, words", ((0.6, "their neighbors counted, would fit"), (0.001, "crop or downsample")))
def test_what_is_said_to_fit_speaks_of_scalars(share, words, monkeypatch):
    """There are no voxel records to make smaller; what a narrower function leaves is counted in scalars."""
    volume = blobs()
    wanted = estimate.estimate_scalars(found_in_rows(volume, 48), 3, True, 1000)
    assert wanted.with_record(4) == wanted
    monkeypatch.setattr("rle_splat.pipeline.memory_estimate.available_bytes", lambda: int(share * wanted.needed))
    with pytest.raises(RleSplatError, match=words) as problem:
        estimate.refuse_too_much(wanted)
    assert "record" not in str(problem.value) and "shown, and their neighbors, need" in str(problem.value)


def test_the_estimate_of_scalars_counts_voxels_and_axes():
    volume = blobs()
    found = found_in_rows(volume, 10)
    one, three = (estimate.estimate_scalars(found, axes, True, 0) for axes in (1, 3))
    assert one.visible_voxels == 10 * 96 * 96 and one.records == 5 * one.visible_voxels  # a value and its light
    assert three.records == 3 * one.records and one.needed < three.needed and one.volume == volume.voxels.nbytes


def test_what_is_said_to_fit_fits(monkeypatch):
    scene = scene_of(noise())
    short_of_memory(monkeypatch, 0)
    needed = quick_estimate.estimate(scene.volume, FUNCTION, QUALITY).needed
    short_of_memory(monkeypatch, int(0.66 * needed / estimate.SPARE))
    with pytest.raises(RleSplatError, match="records of 4 bytes would fit"):
        encode_scene(scene, QUALITY, (0,))
    assert encode_scene(scene, replace(QUALITY, record=4), (0,)).axes[0].visible_voxels > 0


@pytest.mark.parametrize("picture", (0, 20_000))
@pytest.mark.parametrize("axes", (1, 3))
@pytest.mark.parametrize("dtype", (np.uint8, np.uint16, np.float32))
@pytest.mark.parametrize("classification", ("pre", "post"))
@pytest.mark.parametrize("n", (16, 64, 700))
def test_a_share_of_voxels_that_is_said_to_fit_fits(n, classification, dtype, axes, picture, monkeypatch):
    """Wherever those voxels are: here each stands alone, so that there is nothing that takes more."""
    voxels = np.broadcast_to(np.zeros((), dtype), (n, n, n))
    volume = SimpleNamespace(shape_xyz=(n, n, n), voxels=voxels, refinement=1)
    picture *= n  # where there is one it wants all of its axes at once

    def wanted(in_a_row, axes, record):
        counts = np.full(n * n, in_a_row)
        if classification == "post":
            found = estimate.Found.in_rows(volume, (counts, counts))
            return estimate.estimate_scalars(found, axes, True, picture)
        quality = replace(QUALITY, record=record)
        return estimate.estimate_of(volume, (counts, counts), quality, axes=axes, picture=picture)

    for short in (0.25, 0.4, 0.6):
        all_shown = wanted(n, axes, 4)
        free = short * all_shown.needed + (1.0 - short) * picture
        short_of_memory(monkeypatch, round(free / estimate.SPARE))
        with pytest.raises(RleSplatError) as problem:
            estimate.refuse_too_much(all_shown)
        sentence = str(problem.value)
        one_by_one = "one principal axis at a time" in sentence
        if "at most" not in sentence:
            fits = one_by_one and wanted(n, 1, 4).needed <= free
            assert fits or (n == 16 and "crop or downsample" in sentence)
            continue
        share = float(sentence.split("at most ")[1].split(" %")[0]) / 100.0
        needed = wanted(share * n, 1 if one_by_one else axes, 4).needed
        assert 0.85 * free < needed <= free and one_by_one == (axes == 3 and not picture)


def test_another_light_is_refused_too_when_it_no_longer_fits(monkeypatch):
    cache, scene = StageCache(), scene_of(noise(), headlight=False)
    render(scene, QUALITY, cache=cache)
    short_of_memory(monkeypatch, 3 << 20)
    with pytest.raises(RleSplatError, match="are free"):
        render(replace(scene, headlight=True), QUALITY, cache=cache)


def test_a_picture_too_large_is_refused_at_once(monkeypatch):
    scene = scene_of(noise(16))
    short_of_memory(monkeypatch, 8 * GIB)
    with pytest.raises(RleSplatError, match=r"65536 x 65536 pixels needs about .* GiB") as problem:
        render(replace(scene, width=65536, height=65536), QUALITY)
    fits = int(str(problem.value).split(" pixels would fit")[0].split()[-1])
    assert 5000 < fits < 20000


def test_what_is_kept_makes_room(monkeypatch):
    cache, scene = StageCache(), scene_of(noise())
    picture = render(scene, QUALITY, cache=cache).rgba
    assert cache.nbytes > 0
    cache.make_room(cache.nbytes)
    assert cache.nbytes > 0  # there is enough
    short_of_memory(monkeypatch, 100)
    cache.make_room(1000)
    assert cache.nbytes == 0 and cache.contents == ()
    monkeypatch.undo()
    np.testing.assert_array_equal(render(scene, QUALITY, cache=cache).rgba, picture)


def test_solid_noise_keeps_working():
    """Every voxel opaque and colored by itself: no run to skip, nothing alike."""
    values = np.random.default_rng(1).integers(0, 256, (20, 22, 24)).astype(np.uint8)
    function = TransferFunction(opacity=((0, 1.0),), color=((0, 0, 0, 1), (255, 1, 1, 0)), shade=None)
    scene = scene_of(Volume(values, np.eye(4)), function=function)
    stored = encode_scene(scene, QUALITY)
    grids = [to_volume_order(decode(stored.axes[axis]), axis) for axis in range(3)]
    assert (grids[0][..., 3] > 16.0).all()
    np.testing.assert_array_equal(grids[0], grids[1])
    np.testing.assert_array_equal(grids[0], grids[2])
    assert render(scene, QUALITY).rgba[32, 32, 3] > 0.99
