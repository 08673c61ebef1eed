"""The paper's tables at a tiny size: what must hold whatever the machine does.  No time is asserted."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import paper, records
from benchmarks.data_sets import PAPER, stand_in
from benchmarks.paper_words import explain, table_1, table_2
from benchmarks.records import compare_records
from rle_splat.pipeline.scan_source import classify_and_shade
from rle_splat.runtime.jit import compiled
from rle_splat.runtime.steps import Clock
from rle_splat.scene import Quality
from rle_splat.splat.pixel_block import BLOCK

from benchmarks.frames import view_scene  # isort: skip

pytestmark = pytest.mark.skipif(not compiled(), reason="the baselines are compiled kernels")
DATA = PAPER[0]


@pytest.fixture(scope="module")
def small():
    function = DATA.transfer_function()
    return stand_in((20, 24, 18), (1.0, 1.0, 1.0), 0.1, function), function


@pytest.fixture(scope="module")
def row(small):
    views = ((0, 0), (60, 10))
    return paper.measure(DATA, *small, paper.quality_of("paper", 1), 32, views=views, repeats=1, errors=False)


def test_memory_differs_between_record_sizes_by_the_records_alone(row):
    memory = row["memory_bytes"]
    assert list(memory) == [16, 8]
    for record, sizes in memory.items():
        assert sizes["voxel_data"] == 3 * record * row["kept_voxels"]
        assert sizes["total"] == sum(count for name, count in sizes.items() if name != "total")
        assert memory[16]["total"] - sizes["total"] == 3 * (16 - record) * row["kept_voxels"]
    nx, ny, nz = row["shape_xyz"]
    # Scanlines run along x under principal z and y, along y under principal x: 4 bytes each.
    assert memory[16]["scanline_pointers"] == 4 * (2 * ny * nz + nx * nz)


def test_shorter_records_err_little(small):
    scenes, quality = [view_scene(*small, (20, 10), 24, shaded=False)], Quality.preset("standard", threads=1)
    rows = compare_records(scenes, quality, probes=9, repeats=1)
    assert [row["record"] for row in rows] == [16, 8]
    best, short = (row["against_16"]["largest"] for row in rows)
    assert best == 0.0 < short < 1.0  # where a linear alpha of 8 bits is 59 levels off
    assert 0.0 < abs(rows[0]["t1"]["largest"] - rows[1]["t1"]["largest"]) <= short + 1e-9
    assert f"{short:.2f}" in records.line("somebody", "standard", rows) and "8 B against 16" in records.header()


def test_bound_is_one_over_p(row):
    assert row["bound"] == pytest.approx(1.0 / row["kept_fraction"])
    assert row["kept_fraction"] == pytest.approx(row["kept_voxels"] / row["voxels"])


def test_footprints_reach_more_than_they_are_made_of(row):
    covered = row["covered_fractions"]
    assert row["kept_fraction"] < covered["pixels"] < covered["blocks"] <= 1.0


def test_every_view_is_timed_on_its_own_axis(row):
    assert sorted(view["axis"] for view in row["views"]) == [0, 1]
    assert all(view[name] > 0.0 for view in row["views"] for name in view if name.endswith("_ms"))


def test_covered_fractions_of_one_voxel(small):
    volume, function = small
    voxels = np.zeros_like(volume.voxels)
    voxels[9, 12, 10] = 255
    scene = view_scene(replace(volume, voxels=voxels), function, (0, 0), 16)
    classified, _ = classify_and_shade(scene, paper.quality_of("paper", 1), Clock())
    assert classified.visible_voxels == 1
    covered = paper.covered_fractions(classified)
    nx, ny, nz = volume.shape_xyz
    cells = [(nx + 1) * (ny + 1) * nz, (nx + 1) * (nz + 1) * ny, (ny + 1) * (nz + 1) * nx]
    assert covered["pixels"] == pytest.approx(np.mean([4 / n for n in cells]))
    # The footprint covers cells 10 and 11 along x (for principal z and y), 12 and 13 along y (for principal x).
    shares = []
    for length, at, others in ((nx, 10, (ny + 1) * nz), (nx, 10, (nz + 1) * ny), (ny, 12, (nz + 1) * nx)):
        reached = 2 * len({at // BLOCK, (at + 1) // BLOCK})
        shares.append(reached / (-(-(length + 1) // BLOCK) * others))
    assert covered["blocks"] == pytest.approx(np.mean(shares))


def test_tables_hold_the_papers_figures_and_ours(row):
    rows = [(DATA, {**row, "called": "somebody"})]
    first, second = "\n".join(table_1(rows)), "\n".join(table_2(rows))
    assert "5.1" in first and "20x24x18" in first and "somebody" in first
    for sizes in row["memory_bytes"].values():
        ours = sizes["total"] / 2**20
        assert f"{ours:.1f} ({ours / 5.1:.2f})" in first
    assert "7.38" in second and "18.0" in second and f"{row['bound']:.1f}" in second


def test_a_smaller_speedup_is_explained_and_a_larger_one_is_not(row):
    named = {**row, "called": "somebody"}
    low = " ".join(explain(DATA, {**named, "splat_speedup": 2.0}))
    high = " ".join(explain(DATA, {**named, "splat_speedup": 40.0}))
    assert "Early termination saves" in low and "Early termination saves" not in high
    assert "2.0x here, 18x in the paper" in low


def test_a_speedup_beyond_the_papers_own_bound_is_called_so(row):
    named = {**row, "called": "somebody"}
    foot = next(data for data in PAPER if data.name == "X-ray foot")
    assert "256 of its" not in " ".join(explain(DATA, named))
    assert "256 MB of its machine's 256 MB" in " ".join(explain(foot, named))
