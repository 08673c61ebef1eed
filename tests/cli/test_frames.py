"""Volumes in time on the command line: one frame, several numbered pictures, and what is wrong with frames."""

import json

import numpy as np
import pytest

from tests.cli.conftest import SHAPE_XYZ, ball

QUICK = ["--size", "24", "--backend", "numpy", "--quality", "draft", "--preset", "x-ray"]


@pytest.fixture
def sequence(tmp_path):
    """Three numbered raw files, of which each is darker than the one before, and a gap before the last."""
    folder = tmp_path / "data"
    folder.mkdir()
    for number, share in ((8, 1.0), (9, 0.5), (11, 0.25)):
        (ball() * share).astype(np.uint8).tofile(folder / f"ball_{number}.raw")
    return folder / "ball_8.raw"


def test_a_frame_of_numbered_files_is_the_picture_of_its_file(sequence, call, raw_options, tmp_path):
    done = call("render", sequence, "-o", tmp_path / "a.npy", "--frame", 2, *raw_options, *QUICK)
    assert done.code == 0, done.err
    done = call("render", sequence.with_name("ball_9.raw"), "-o", tmp_path / "b.npy", *raw_options, *QUICK)
    assert done.code == 0, done.err
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), np.load(tmp_path / "b.npy"))


def test_frames_are_numbered_pictures_with_the_look_of_the_first(sequence, call, raw_options, tmp_path):
    report = tmp_path / "report.json"
    words = (*raw_options, *QUICK, "--json", report)
    done = call("render", sequence, "-o", tmp_path / "out.npy", "--frames", 1, 2, *words)
    assert done.code == 0, done.err
    pictures = [np.load(tmp_path / f"out_000{frame}.npy") for frame in (1, 2)]
    assert sorted(path.name for path in tmp_path.glob("*.npy")) == ["out_0001.npy", "out_0002.npy"]
    assert pictures[1][..., 3].sum() < 0.8 * pictures[0][..., 3].sum() > 0.0  # as dark as the voxels, not fitted anew
    frames = json.loads(report.read_text())["frames"]
    assert [frame["outputs"] for frame in frames] == [[str(tmp_path / f"out_000{n}.npy")] for n in (1, 2)]
    assert frames[0]["volume"]["shape_xyz"] == list(SHAPE_XYZ)


def test_all_frames_have_the_plan_of_the_first(sequence, call, raw_options, tmp_path):
    words = ("--size", "24", "--backend", "numpy", "--preset", "x-ray", "--json", tmp_path / "report.json")
    done = call("render", sequence, "-o", tmp_path / "out.npy", "--frames", 1, 2, *words, *raw_options)
    assert done.code == 0, done.err
    plans = [frame["plan"] for frame in json.loads((tmp_path / "report.json").read_text())["frames"]]
    assert plans[0]["aim"] == 32.0 and plans[0]["expected"] > 0.0 and plans[0]["why"] in done.out
    assert plans[1]["quality"] == "standard, held" and plans[1]["depth_rule"] == plans[0]["depth_rule"]


@pytest.mark.parametrize("words, sentence", [
    (("--frame", 3), "Frame 3 is missing: there is no file with the number 10"),
    (("--frame", 5), "There is no frame 5: ball_8.raw is the first of 4 files"),
    (("--frame", 0), "There is no frame 0"),
    (("--frames", 2, 1), "--frames is 2 1; give the first and the last frame"),
    (("--frames", 0, 1), "--frames is 0 1"),
    (("--frame", 1, "--frames", 1, 2), "--frame and --frames contradict each other"),
])  # fmt: skip
def test_wrong_frames_are_one_sentence_and_no_picture(sequence, call, raw_options, tmp_path, words, sentence):
    done = call("render", sequence, "-o", tmp_path / "out.npy", *words, *raw_options, *QUICK)
    assert done.code == 2 and sentence in done.err and len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.glob("*.npy"))


def test_a_file_alone_has_no_frames(raw, call, raw_options, tmp_path):
    done = call("render", raw, "-o", tmp_path / "out.npy", "--frame", 1, *raw_options, *QUICK)
    assert done.code == 2 and "ball.raw holds one volume" in done.err


def test_frames_that_exist_are_kept_when_a_later_one_is_missing(sequence, call, raw_options, tmp_path):
    done = call("render", sequence, "-o", tmp_path / "out.npy", "--frames", 1, 4, *raw_options, *QUICK)
    assert done.code == 2 and "Frame 3 is missing" in done.err
    assert sorted(path.name for path in tmp_path.glob("*.npy")) == ["out_0001.npy", "out_0002.npy"]
    assert not list(tmp_path.glob(".*"))
