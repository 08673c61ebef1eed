"""No step of a picture of 512^3 voxels is longer than 30 ms, by the work that its kernels do and not by a clock."""

import sys
from collections import Counter

import pytest

from benchmarks.frames import view_scene
from benchmarks.lamps import under
from benchmarks.scenes import shells
from rle_splat.encode.encode_kernels import WORD
from rle_splat.pipeline.render import render_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime import jit
from rle_splat.scene import Quality
from rle_splat.shade.light_sweep import BAND as SWEPT
from rle_splat.volume.blocks import BLOCK_Z
from rle_splat.warp.resample import ROWS

pytestmark = [
    pytest.mark.slow, pytest.mark.skipif(jit.internals is None, reason="counts the calls of compiled code"),
]  # fmt: skip
MOST_MS = 30.0


def bits(words):
    return WORD * words.size


def in_rows(row_start, first, count):
    return row_start[first + count] - row_start[first]


# Kernel -> (nanoseconds for a unit of work, how many units a call has): about the most that was measured in a long step
# of these pictures, processor time of one thread of an AMD EPYC with 7 to 10 processes on its two processors.
KERNELS = {
    "classify.classify_kernels.mark_by_table": (0.45, lambda rows, *_: rows.size),
    "classify.gaps._close_planes": (0.09, lambda words, _: bits(words)),
    "classify.relevant._count_kept": (0.02, lambda words, *_: bits(words)),
    "classify.relevant._fill_kept": (0.6, lambda words, *_: bits(words)),
    "classify.relevant._mark_relevant": (
        0.85, lambda voxels, first, last, *_: (last - first) * BLOCK_Z * voxels[0].size,
    ),
    "encode.encode_kernels.count_across": (0.06, lambda words, *_: bits(words)),
    "encode.encode_kernels.fill_across_runs": (0.1, lambda words, *_: bits(words)),
    "encode.encode_kernels.fill_row_runs": (0.14, lambda rows, _, width, *__: rows.size * width),
    "encode.encode_kernels.place_across": (9.0, lambda *a: a[5].size // a[4]),
    "encode.encode_kernels.place_rows": (9.0, lambda *a: a[5].size // a[4]),
    "encode.pooling._pool": (1.6, lambda *a: a[5] ** 3 * a[6].size),
    "raycast.scalar_rays.trace_rays": (46000.0, lambda *a: len(a[-1][0])),
    "shade.light_nodes._read": (30.0, lambda first, count, *a: in_rows(a[3][0], first, count)),
    "shade.light_nodes._shade_bands": (5.0, lambda first, count, layers, *a: count * SWEPT * a[2] * layers[0].size),
    "shade.shading._write_records": (12.0, lambda a, *_: in_rows(a[2], a[1] * a[0], a[5].size)),
    "shade.surface_normals._find": (8.0, lambda *a: (a[5] - a[4]) * a[1][0].size),
    "shade.surface_normals._smooth": (6.0, lambda *a: a[-1].size),
    "shade.surface_points._place": (60.0, lambda first, count, *a: in_rows(a[6], first, count)),
    "splat.scalar_sheets.splat_scalar_rows": (
        2.0, lambda *a: (a[14] - a[13]) * (a[18].shape[1] + a[0].width) * len(a[1].begin),
    ),
    "splat.sheet_buffer.splat_rows": (1.0, lambda *a: (a[8] - a[7]) * (a[12].shape[1] + a[0].width) * len(a[1].begin)),
    "volume.blocks._extremes": (0.25, lambda voxels, *_: voxels.size),
    "volume.gradient._sobel": (23.0, lambda _, lists, *__: lists[0][-1] - lists[0][0]),
    "warp.resample._resample": (35.0, lambda bands, a: bands * ROWS * a[-6][0]),
    "warp.spline_prefilter._filter_lines": (2.0, lambda _, a: a[3].size),
    "warp.steep._spread": (1.1, lambda picture, _: picture.size),
}  # fmt: skip
VIEWS = (35, 25), (80, 10), (-60, 75)  # along all three principal axes
PICTURES = (
    ("draft", "post", "sun, occlusion", VIEWS[0]), ("standard", "post", "sun", VIEWS[1]),
    ("fine", "post", "headlight", VIEWS[2]), ("standard", "pre", "headlight", VIEWS[1]),
)  # fmt: skip


def list_steps(monkeypatch, voxels, function, quality: str, classification: str, lamps: str, view):
    """What the kernels of each step of a picture do: [(milliseconds, Counter of them by kernel)]."""
    call, done = jit.internals.Kernel.__call__, Counter()

    def count(kernel, *arguments):
        name = f"{kernel.py_func.__module__.removeprefix('rle_splat.')}.{kernel.py_func.__name__}"
        per_unit, units = KERNELS[name]
        done[name] += 1e-6 * per_unit * float(units(*arguments))
        return call(kernel, *arguments)

    scene = under(view_scene(voxels, function, view, 512, shaded=False), lamps)
    found = []
    with monkeypatch.context() as patch:
        patch.setattr(jit.internals.Kernel, "__call__", count)
        plan = Quality.preset(quality, classification=classification, threads=1)
        for _ in render_steps(scene, plan, cache=StageCache()):
            found.append(Counter(done))
            done.clear()
    return sorted(found, key=Counter.total, reverse=True)


@pytest.fixture(scope="module")
def volume():
    return shells(512)


@pytest.mark.parametrize("picture", PICTURES, ids=lambda picture: " ".join(picture[:3]))
def test_no_step_is_longer_than_a_redraw_may_be(monkeypatch, record_property, volume, picture):
    *how, view = picture
    steps = list_steps(monkeypatch, *volume, *how, view)
    listed = [f"{step.total():.0f} ms: {', '.join(name for name, _ in step.most_common(3))}" for step in steps[:5]]
    record_property("longest", listed)
    assert 10.0 < steps[0].total() < MOST_MS, listed
    assert sum(step.total() for step in steps) > 100.0


def test_a_step_that_does_all_at_once_is_found(monkeypatch, volume):
    monkeypatch.setattr(sys.modules["rle_splat.encode.encode"], "RECORDS_AT_ONCE", 1 << 23)
    steps = list_steps(monkeypatch, *volume, "standard", "pre", "headlight", VIEWS[1])
    assert steps[0].total() > MOST_MS
