"""Two trees in turns, and a lamp that moves, at tiny sizes.  No time is asserted."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import lamp_moves, turns
from benchmarks.scenes import shells
from rle_splat.runtime.jit import compiled

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")


def test_a_tree_beside_itself_has_the_same_plan_and_memory():
    root = Path(turns.__file__).resolve().parents[1]
    trees = {name: turns.Tree(root) for name in turns.TREES}
    case = dict(volume="CT head", quality="draft", light="headlight", change="opacities")
    found = turns.measure(trees, 1, [(35, 25)], True, **case)
    before, now = found["earlier"], found["this"]
    assert before["plan"] == now["plan"] and before["bytes"] == now["bytes"] > 4.0
    assert min(before["least"], now["least"]) > 0.0


@pytest.mark.parametrize("change", ("camera", "opacities", "sun"))
def test_each_turn_changes_one_thing(change):
    volume, function = shells(24)
    light = "sun" if change == "sun" else "headlight"
    first, second = (turns.scene_of(volume, function, light, change, (35, 25), turn) for turn in (0, 1))
    changed = {
        "camera": not np.array_equal(first.camera.matrix_world, second.camera.matrix_world),
        "opacities": first.transfer_function != second.transfer_function,
        "sun": any(not np.array_equal(a.matrix_world, b.matrix_world) for a, b in zip(first.lights, second.lights)),
    }
    assert [name for name, differs in changed.items() if differs] == [change]


def test_drafts_after_lamps_move(read_rows, monkeypatch):
    monkeypatch.setattr(lamp_moves, "scenes", lambda names: [("shells", *shells(24))])
    monkeypatch.setattr(lamp_moves, "WIDTH", 16)
    monkeypatch.setattr(lamp_moves, "HEIGHT", 12)
    assert lamp_moves.main(["--repeats", "2", "--threads", "1"]) == 0
    rows = read_rows("lamp-moves")
    assert [row["lamp"] for row in rows] == list(lamp_moves.KINDS)
    assert all(row["median_ms"] >= row["least_ms"] > 0.0 for row in rows)


@pytest.mark.parametrize("kind", lamp_moves.KINDS)
def test_a_lamp_lights_the_volume_and_moves(kind):
    volume, function = shells(24)
    first, second = (lamp_moves.lit_scene(volume, function, kind, turned).lights[0] for turned in (0.0, 3.0))
    assert first.type == kind and not np.array_equal(first.matrix_world, second.matrix_world)
    assert np.linalg.norm(first.matrix_world[:3, 3]) > 0.0 and first.matrix_world[2, 2] > 0.0
