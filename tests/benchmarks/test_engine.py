"""The engine's table at a tiny size: its columns, its truths, its words.  No time is asserted."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import engine
from benchmarks.frames import view_scene
from benchmarks.scenes import shells
from benchmarks.vtk_caster import VTK_PROBLEM, VtkCaster
from rle_splat.jit import compiled
from rle_splat.scene import Quality

SMALL = dict(size=32, threads=1, views=((0, 0), (35, 25)), repeats=1, probes=16)


@pytest.fixture(scope="module")
def small():
    volume, tf = shells(24)
    return volume, tf


@pytest.fixture(scope="module")
def one_shell(small):
    """A shell one voxel thick, which every quality resolves, some better than others.  (The three of ``small`` are a
    fifth of a voxel.)"""
    volume, tf = small
    return volume, replace(tf, opacity=((86.0, 0.0), (110.0, 0.3), (134.0, 0.0)))


@pytest.mark.skipif(not compiled(), reason="slow without kernels")
@pytest.mark.parametrize("perspective", [False, True])
def test_rows(one_shell, perspective):
    rows = engine.measure(*one_shell, perspective=perspective, shaded=False, with_vtk=False, **{**SMALL, "probes": 64})
    assert [row["quality"] for row in rows] == list(engine.QUALITIES)
    classified = {row["quality"]: row["classification"] for row in rows}
    assert classified.pop(engine.PAPER_LIKE) == "pre" and set(classified.values()) == {"post"}
    t1, t2 = ({row["quality"]: row[truth]["rmse"] for row in rows} for truth in ("t1", "t2"))
    assert 2.0 * t2["strict"] < t2["fine"] < t2["standard"] < 0.7 * min(t2["draft"], t2[engine.PAPER_LIKE])
    assert t1[engine.PAPER_LIKE] < t2[engine.PAPER_LIKE] and 3.0 * t2["strict"] < t1["strict"]  # what each claims
    assert all(row["vtk_ms"] is None for row in rows)
    assert all(row["frame_ms"] > 0.0 and row["encode_ms"] > 0.0 for row in rows)
    assert "not here" in engine.line("shell", rows[0])


@pytest.mark.skipif(not compiled(), reason="slow without kernels")
def test_shaded_pictures_are_judged_by_the_truth_that_they_claim(small):
    names = ("strict", engine.PAPER_LIKE)
    rows = engine.measure(*small, perspective=False, shaded=True, with_vtk=False, qualities=names, **SMALL)
    post, pre = ({truth: row[truth]["rmse"] for truth in ("t1", "t2")} for row in rows)
    assert 3.0 * post["t2"] < post["t1"] and pre["t1"] < 10.0 and pre["t1"] < pre["t2"]
    assert len(engine.line("shells", rows[0])) == len(engine.header())


def test_a_table_for_the_page():
    row = {
        "volume": "shells", "perspective": True, "shaded": False, "size": 64, "threads": 1, "kept_fraction": 0.0876,
        "vtk_ms": 40.0, "encode_ms": 5.24, "quality": "draft", "frame_ms": 7.25, "against_vtk": 0.18125,
    }  # fmt: skip
    other = {**row, "quality": "standard", "frame_ms": 21.0, "against_vtk": None, "shaded": True}
    where = {**engine.circumstances(1), "others_busy_cores": 0.0}
    lines = engine.markdown([row, other], where).splitlines()
    assert lines[0] == "|  | p | px | threads | draft | standard | VTK | encode |"
    assert lines[2] == "| shells, perspective, unshaded | 8.8% | 64 | 1 | 7.2 (0.18) | - | 40 | 5.2 |"
    assert lines[3] == "| shells, perspective, shaded | 8.8% | 64 | 1 | - | 21.0 | 40 | 5.2 |"


def test_paper_like_is_the_papers_pipeline_on_the_convergent_model():
    quality, paper = engine.quality_of(engine.PAPER_LIKE, 2), Quality.paper()
    assert (quality.depth_rule, quality.sheet_density, quality.warp_filter) == (
        paper.depth_rule, paper.sheet_density, paper.warp_filter,
    )  # fmt: skip
    assert quality.model == "extinction" and quality.length_correction and quality.threads == 2


def test_scalar_truth_of_a_constant_volume(small):
    """T2 of a constant medium: 1 - exp(-sigma l) with l the path through the box of voxel centres."""
    volume, tf = small
    constant = type(volume)(np.full((9, 9, 9), 110, np.uint8), np.eye(4))
    scene = view_scene(constant, tf, (0, 0), 9)
    alpha = float(tf.alpha_at(110.0))
    rgba = engine.scalar_truth(scene, np.array([4]), np.array([4]))
    assert rgba[0, 3] == pytest.approx(1.0 - (1.0 - alpha) ** 8, abs=1e-6)


@pytest.mark.skipif(bool(VTK_PROBLEM), reason="the package vtk is not in this environment")
@pytest.mark.parametrize("perspective", [False, True])
def test_vtk_sees_the_same_frame(small, perspective):
    """Shifted by a pixel in any direction, VTK's picture agrees less with the truth of our camera."""
    volume, tf = small
    scene = view_scene(volume, tf, (35, 25), 48, perspective, shaded=False)
    caster = VtkCaster(scene, False, 1)
    picture, spent = caster.draw(scene)
    caster.close()
    assert spent > 0.0
    rows, columns = (a.ravel() for a in np.mgrid[2:46:3, 2:46:3])
    truth = engine.scalar_truth(scene, columns, rows)
    errors = {
        (down, right): np.abs(picture[rows + down, columns + right] - truth).mean()
        for down in (-1, 0, 1) for right in (-1, 0, 1)
    }  # fmt: skip
    assert min(errors, key=errors.get) == (0, 0)
