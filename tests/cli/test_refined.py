"""The classification refined from the command line: chosen by name, told in the report, refused where it is none."""

import json

import numpy as np


def test_a_finer_grid_is_chosen_and_told(call, raw, raw_options, tmp_path):
    found = {}
    for times in ("2", "4"):
        out, report = tmp_path / f"{times}.npy", tmp_path / f"{times}.json"
        done = call(
            "render", raw, *raw_options, "-o", out, "--json", report, "--size", "24", "--classification", "refined",
            "--refinement", times,
        )
        assert done.code == 0, done.err
        told = json.loads(report.read_text())
        assert told["plan"]["classification"] == "refined" and told["plan"]["refinement"] == int(times)
        assert told["error"]["truth"] == "T2" and told["volume"]["shape_xyz"] == [20, 16, 12]
        found[times] = np.load(out), told["volume"]["visible_voxels"]
    assert found["4"][1] > 4 * found["2"][1] and (found["2"][0] != found["4"][0]).any()


def test_a_refinement_of_nothing_is_refused(call, raw, raw_options, tmp_path):
    for words in (("--refinement", "3"), ("--refinement", "3", "--classification", "pre"),
                  ("--refinement", "3", "--quality", "fine"), ("--classification", "refined", "--refinement", "7"),
                  ("--classification", "refined", "--refinement", "fine")):  # fmt: skip
        done = call("render", raw, *raw_options, "-o", tmp_path / "x.npy", *words)
        assert done.code == 2 and "refine" in done.err and done.err.count("\n") <= 3, done.err


def test_a_rle_file_is_not_refined(call, raw, raw_options, tmp_path):
    encoded = tmp_path / "ball.rle"
    assert call("encode", raw, *raw_options, "-o", encoded, "--axes", "y").code == 0
    done = call("render", encoded, "-o", tmp_path / "x.npy", "--classification", "refined")
    assert done.code == 2 and "classified already" in done.err
