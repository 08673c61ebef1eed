"""Group F of the catalogue, load and faults: renders at once, cancelled, without room on disk or in memory, and with a
kernel cache that is not as it was written.  Most of it in processes of their own, which must end as they should."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from devtools.places import BPY_PYTHON, running_python
from rle_splat.pipeline.render import render, render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime import jit, memory
from rle_splat.runtime.jit import CACHE_VARIABLE, compiled, kernel, parallel_call
from rle_splat.runtime.parallel import share_out
from rle_splat.scene import Cancelled
from tests.stability.pictures import scene
from tests.ways import compile_here

ROOT = Path(__file__).resolve().parents[2]
WITH_KERNELS = pytest.mark.skipif(not compiled(), reason="there are no kernels without numba")
COUNTED = "whole numbers"
LIBRARIES = str(Path(sys.prefix) / "lib")  # of the test environment


def run(program, *words, python=sys.executable, **environ):
    """What a program in a process of its own prints; it must end by itself, and well."""
    done = subprocess.run(
        [python, "-c", program, *map(str, words)], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **environ}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.returncode}: {done.stderr[-2000:]}"
    return done.stdout


# --- F1, F6: at once ------------------------------------------------------------------------------------------

AT_ONCE = """
import sys, threading
import numpy as np
from rle_splat.runtime.jit import numba
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.pipeline.render import render, render_steps
from rle_splat.runtime.steps import drain
from tests.stability.pictures import SCENES, scene

wanted = {name: render(*scene(name)).rgba for name in SCENES}
try:
    layer = numba.threading_layer()
except ValueError:
    layer = "none"
store, wrong, done = StageCache(), [], []

def background(names, cache, times):
    try:
        for n in range(times):
            for name in names:
                if (render(*scene(name), cache=cache).rgba != wanted[name]).any():
                    wrong.append(name)
    except BaseException as problem:
        wrong.append(repr(problem))
    done.append(1)

threads = [
    threading.Thread(target=background, args=(SCENES, None, 2)),
    threading.Thread(target=background, args=(SCENES[::-1], store, 2)),
]
for thread in threads:
    thread.start()
for n in range(4):  # and the viewport, on the main thread, which begins one picture and wants another at once
    first, second = (render_steps(*scene(name), cache=StageCache()) for name in (SCENES[n % 3], SCENES[(n + 1) % 3]))
    for _ in range(2):
        next(first)
    if (drain(second).rgba != wanted[SCENES[(n + 1) % 3]]).any() or (drain(first).rgba != wanted[SCENES[n % 3]]).any():
        wrong.append("viewport")
for thread in threads:
    thread.join()
print(layer, len(done), len(wrong), *wrong[:3])
"""


@WITH_KERNELS
@pytest.mark.parametrize("layer", ("workqueue", "omp", "tbb"))
def test_F1_renders_at_once_from_three_threads(record, layer):
    """Two in the background, one of them with a store, while a third begins pictures and asks for others."""
    needs = f"from numba.np.ufunc import {layer}pool" if layer != "workqueue" else ""
    # The package index' TBB lies where no loader looks unless it is told.
    there = {"LD_LIBRARY_PATH": os.pathsep.join(filter(None, (LIBRARIES, os.environ.get("LD_LIBRARY_PATH"))))}
    whole = {**os.environ, **there}
    if needs and subprocess.run([sys.executable, "-c", needs], capture_output=True, env=whole, check=False).returncode:
        pytest.skip(f"numba's threading layer {layer} is not on this machine")
    there |= {"NUMBA_THREADING_LAYER": layer, "NUMBA_NUM_THREADS": "4"}
    found, done, wrong, *_ = run(AT_ONCE, **there).split()
    assert found == layer and int(done) == 2
    record("F1", "wrong pictures of three threads that render at once", int(wrong), 0, "either", why=COUNTED)


@kernel(inner=True)
def _take_room(begin, end, size, sums):
    for i in range(begin, end):
        room = np.empty(size if i == 77 else 1, np.float64)
        room[0] = i
        sums[i] = room[0]


@kernel
def take_room(size, sums):
    share_out(_take_room, sums.size, (size, sums))


def test_F6_a_parallel_call_within_another_is_refused_not_waited_for(record):
    refused = 0
    for _ in range(2):
        with parallel_call(1):
            with pytest.raises(RuntimeError, match="within parallel_call"), parallel_call(1):
                pass
            refused += 1
    record("F6", "parallel calls within others that hang", 2 - refused, 0, "either", why=COUNTED)


@WITH_KERNELS
@pytest.mark.parametrize("threads", (1, 2))
def test_F5_a_part_of_a_loop_without_room_fails_the_whole(record, threads):
    """On whatever thread it happens; and the next call finds everything in order."""
    sums = np.zeros(1000)
    for size, fails in ((4, False), (1 << 60, True), (4, False)):
        sums[:] = 0.0
        if fails:
            with pytest.raises(MemoryError), parallel_call(threads):
                take_room(size, sums)
            continue
        with parallel_call(threads):
            take_room(size, sums)
        missing = (sums != np.arange(1000)).sum()
        record("F5", "rows missing after a loop that had no room", missing, 0, "either", why=COUNTED)


# --- A15: cancelled -------------------------------------------------------------------------------------------


def test_A15_cancelled_a_hundred_times_at_random(record):
    """By closing the work, by an exception from whoever hears of its progress, and by Ctrl-C there."""
    random = np.random.default_rng(15)
    names = ("parallel", "inside", "post")
    undisturbed = {name: render(*scene(name)).rgba for name in names}
    steps = {name: len(list(render_steps(*scene(name)))) for name in names}
    store, wrong, cancelled = StageCache(), 0, 0
    for turn in range(100):
        name = names[turn % 3]
        stop = int(random.integers(1, steps[name] + 1))
        if turn % 2:
            work = render_steps(*scene(name), cache=store)
            for _ in range(stop):
                next(work, None)  # what is kept saves steps, so it may end before
            work.close()
        else:
            problem, heard = (Cancelled, KeyboardInterrupt)[turn % 4 // 2], []

            def hear(step, heard=heard, stop=stop, problem=problem):
                heard.append(step)
                if len(heard) >= stop:
                    raise problem

            with suppress(problem):
                render(*scene(name), progress=hear, cache=store)
            cancelled += len(heard) >= stop
        if turn % 10 == 9:
            for other in names:
                wrong += (render(*scene(other), cache=store).rgba != undisturbed[other]).any()
            store = StageCache()
    assert cancelled > 20
    record(
        "A15",
        "wrong pictures after a hundred cancelled at random",
        wrong,
        0,
        "float32",
        why="of sums that are cancelled none is kept",
    )


# --- F3, F4: the disk -----------------------------------------------------------------------------------------

# The first tables of a process, of voxels at random: they take three kernels, of which none takes long to compile.
FIRST_TABLES = """
import sys, resource
limit = int(sys.argv[1])
if limit:  # no file may grow beyond: what a full disk does, to one process
    import signal
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
import hashlib
import numpy as np
from rle_splat.classify.visible import VisibleVoxels
from rle_splat.encode.encode import table_steps
from rle_splat.runtime import jit
from rle_splat.runtime.steps import drain
rows = np.random.default_rng(1).random((9 * 10, 30)) < 0.5
starts = np.append(0, np.cumsum(rows.sum(axis=1)))
pieces = (np.diff(rows.astype(np.int8), axis=1, prepend=0) == 1).sum(axis=1).astype(np.int32)
column, total = np.nonzero(rows)[1].astype(np.uint16), hashlib.sha256()
for axis in (0, 2):
    tables = drain(table_steps(VisibleVoxels((30, 10, 9), starts, pieces, column, column, 0), axis))
    for table in (tables.scanline_pointers, tables.data_pointers, tables.runs):
        total.update(table.tobytes())
print(jit.compiled(), total.hexdigest())
"""


@pytest.fixture(scope="module")
def right():
    """What FIRST_TABLES prints where its kernels are compiled for this processor and can be kept."""
    return run(FIRST_TABLES, 0, **compile_here()).split()


@WITH_KERNELS
@pytest.mark.skipif(memory.resource is None, reason="this system has no limits of file size")
def test_F3_A12_no_room_on_the_disk_for_the_kernels(record, tmp_path, right):
    """Too little for machine code: every kernel is compiled, the tables come, and nothing half-written stays."""
    there = {CACHE_VARIABLE: str(tmp_path), "NUMBA_CACHE_DIR": "", **compile_here()}
    wrong = run(FIRST_TABLES, 4096, **there).split() != right
    record("F3", "first tables wrong without room on the disk", wrong, 0, "either", why=COUNTED)
    record("A12", "tables that differ with a cold kernel cache", wrong, 0, "either", why=COUNTED)
    left = [*tmp_path.rglob("*.tmp.*"), *tmp_path.rglob("*.nbc")]
    record("F3", "files left half-written", len(left), 0, "either", why=COUNTED)


SMALL_KERNEL = """
import resource, signal, sys
if sys.argv[1] == "full":
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
from rle_splat.runtime import jit
from rle_splat.view.footprints import tap_count
print(jit.compiled(), tap_count(1.5), len(tap_count.signatures))
"""


@WITH_KERNELS
@pytest.mark.skipif(memory.resource is None, reason="this system has no limits of file size")
@pytest.mark.parametrize("place", ("full", "unwritable", "nowhere"))
def test_F3_nothing_can_be_written(record, tmp_path, place):
    """Not a byte; below a file, where no folder can be made; and no other folder either."""
    (tmp_path / "file").write_text("")
    nowhere = str(tmp_path / "file" / "cache")
    folder = str(tmp_path) if place == "full" else nowhere
    there = {CACHE_VARIABLE: folder, "NUMBA_CACHE_DIR": "", "TMPDIR": str(tmp_path), **compile_here()}
    if place == "nowhere":
        there["NUMBA_CACHE_DIR"] = nowhere
    wrong = run(SMALL_KERNEL, place, **there).split() != ["True", "3", "1"]
    record("F3", "kernels that do not work where they cannot be kept", wrong, 0, "either", why=COUNTED)
    if place == "unwritable":
        assert list(tmp_path.glob("rle_splat-*/kernels-*/**/*.nbc"))  # in another folder
    assert not list((ROOT / "rle_splat" / "view").rglob("*.nbc"))  # never beside the sources


@WITH_KERNELS
def test_F4_a_kernel_cache_corrupted_on_purpose_and_warm(record, tmp_path, right):
    """Every file of it cut, emptied, overwritten or with a single bit flipped, machine code included."""
    random = np.random.default_rng(4)
    there = {CACHE_VARIABLE: str(tmp_path), "NUMBA_CACHE_DIR": "", **compile_here()}
    assert right[0] == "True"
    shutil.copytree(jit.KERNELS, tmp_path / jit.KERNELS.name)  # with all that the tables need
    files = sorted(file for file in tmp_path.rglob("*.nb?"))
    assert len(files) >= 6
    damages = (
        lambda content: content[: len(content) // 2], lambda content: b"", lambda content: b"no kernel" * 99,
        lambda content: flipped(content, int(random.integers(8 * len(content)))),
    )  # fmt: skip
    for n, file in enumerate(files):
        file.write_bytes(damages[n % len(damages)](file.read_bytes()))
    for state in ("damaged", "mended"):
        wrong = run(FIRST_TABLES, 0, **there).split() != right
        claim = "tables wrong with a damaged kernel cache, and with one mended and warm"
        record("F4", claim, wrong, 0, "either", why=COUNTED)
        if state == "damaged":  # the index of each function and its kernels are whole again
            touched = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nb?")}
    again = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nb?")}
    record("F4", "kernels compiled once more after they were mended", sum(touched[f] != again[f] for f in again), 0,
           "either", why=COUNTED)  # fmt: skip


def flipped(content: bytes, bit: int) -> bytes:
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


# --- F5: the memory -------------------------------------------------------------------------------------------

LITTLE_MEMORY = """
import resource, sys
import numpy as np
from rle_splat.pipeline import memory_estimate
from rle_splat.runtime import memory
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.pipeline.render import render, render_steps
from rle_splat.scene import Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

classification, *stages = sys.argv[1:]
noise = np.random.default_rng(0).integers(0, 256, (96, 96, 96)).astype(np.uint8)
volume = Volume(noise, np.eye(4))
tf = TransferFunction(opacity=((0, 0.01), (255, 0.02)), color=((0, 1, 0, 0), (255, 0, 0, 1)), shade=None)

def shown(side):
    camera, matrix = turntable(volume, 20, 10)
    return Scene(volume, tf, camera, side, side, matrix, headlight=False)

# How a picture ends whose process gets no more memory once it has come to a stage.
def outcome(large, stage):
    free, most = resource.getrlimit(resource.RLIMIT_AS)
    try:
        for step in render_steps(large, quality):
            if step.message.startswith(stage):
                used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
                resource.setrlimit(resource.RLIMIT_AS, (used + (1 << 18), most))
        return "finished"
    except RleSplatError as problem:
        assert str(problem).endswith(".") and "\\n" not in str(problem)
        return type(problem.__cause__).__name__.lstrip("_") if problem.__cause__ else "refused"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (free, most))

# Nobody looks how much there is: the system itself has to refuse.
for module in (memory, memory_estimate):
    module.available_bytes = lambda: 1 << 60
small, quality = shown(32), Quality(classification=classification, depth_rule="slice", sheet_density=0.7)
before = render(small, quality).rgba  # kernels are loaded
for stage in stages:
    large = shown(1600 if stage == "Splatting" else 64)
    wanted = render(large, quality).rgba if stage == "Splatting" else None
    said = outcome(large, stage)
    same = (render(small, quality).rgba == before).all()
    print(said, same and (wanted is None or (render(large, quality).rgba == wanted).all()))
"""

RAN_OUT = ("MemoryError", "ArrayMemoryError")  # Python's and numpy's


def check_ends(record, lines, stages, limited):
    """How pictures ended, as LITTLE_MEMORY prints it; in ``limited`` stages the memory must have run out."""
    assert len(lines) == len(stages)
    for stage, line in zip(stages, lines):
        said, same = line.split()
        wrong = said not in (*RAN_OUT, "refused", "finished") or same != "True"
        record("F5", "processes that do not go on after the memory ran out", wrong, 0, "either", why=COUNTED)
        assert stage not in limited or said in RAN_OUT  # the premise


@WITH_KERNELS
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="this system does not tell what a process uses")
@pytest.mark.parametrize("classification", ("pre", "post"))
def test_F5_memory_limited_by_the_system(record, classification):
    """Once the work has come to a stage the process gets a quarter of a MiB more.  One sentence, whose cause is the
    MemoryError; then the same pictures as before, and the next stage."""
    stages = ("Counting", "Classifying", "Encoding", "Splatting")
    lines = run(LITTLE_MEMORY, classification, *stages).splitlines()
    # The scalars' tables are all but made when they are put into scanlines.
    check_ends(record, lines, stages, ("Encoding", "Splatting") if classification == "pre" else ("Splatting",))


@WITH_KERNELS
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="this system does not tell what a process uses")
def test_F5_blender_goes_on_living(record):
    """The same inside Blender's own process, and Blender then does something of its own."""
    # Where its Python is of this version, the kernels that it needs are compiled already.
    versions = sorted(BPY_PYTHON, key=lambda version: (BPY_PYTHON[version] == running_python(), version))
    pythons = [ROOT / ".venvs" / f"bpy-{version}" / "bin" / "python" for version in versions]
    pythons = [python for python in pythons if python.exists()]
    if not pythons:
        pytest.skip("no environment with Blender is at hand")
    program = "import bpy\n" + LITTLE_MEMORY + "bpy.ops.mesh.primitive_cube_add()\nprint(len(bpy.data.objects))\n"
    program += "import os, sys\nsys.stdout.flush()\nos._exit(0)\n"  # bpy's own end can hang
    stages = ("Encoding", "Splatting")
    *lines, objects = run(program, "pre", *stages, python=pythons[-1]).splitlines()[-3:]
    check_ends(record, lines, stages, ())
    assert int(objects) >= 1
