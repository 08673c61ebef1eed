"""Volumes in time on the command line: one frame, several numbered pictures, and what is wrong with frames."""

import json
import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from rle_splat.cli import frames as frames_module
from rle_splat.cli import series
from tests.cli.conftest import ROOT, SHAPE_XYZ, ball

pytestmark = pytest.mark.usefixtures("by_numpy")  # no kernels to compile

QUICK = ["--size", "24", "--quality", "draft", "--preset", "faint"]


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
    words = ("--size", "24", "--preset", "faint", "--json", tmp_path / "report.json")
    done = call("render", sequence, "-o", tmp_path / "out.npy", "--frames", 1, 2, *words, *raw_options)
    assert done.code == 0, done.err
    plans = [frame["plan"] for frame in json.loads((tmp_path / "report.json").read_text())["frames"]]
    assert plans[0]["aim"] == 80.0 and plans[0]["expected"] > 0.0 and plans[0]["why"] in done.out
    assert plans[1]["quality"] == "standard" and plans[1]["held"] and not plans[0]["held"]
    assert plans[1]["depth_rule"] == plans[0]["depth_rule"]


@pytest.mark.parametrize("words, sentence", [
    (("--frame", 3), "Time point 3 is missing: there is no file with the number 10"),
    (("--frame", 5), "There is no time point 5: ball_8.raw is the first of 4 files"),
    (("--frame", 0), "There is no time point 0"),
    (("--frames", 2, 1), "--frames is 2 1; give the first and the last frame"),
    (("--frames", 0, 1), "--frames is 0 1"),
    (("--frame", 1, "--frames", 1, 2), "--frame and --frames contradict each other"),
])  # fmt: skip
def test_wrong_frames_are_one_sentence_and_no_picture(sequence, call, raw_options, tmp_path, words, sentence):
    done = call("render", sequence, "-o", tmp_path / "out.npy", *words, *raw_options, *QUICK)
    assert done.code == 2 and sentence in done.err and len(done.err.strip().splitlines()) == 1
    assert not list(tmp_path.glob("*.npy"))


def test_places_are_checked_before_any_frame(raw, call, raw_options, tmp_path, monkeypatch):
    """However many frames there are, none is looked at."""
    turn = raw, *raw_options, *QUICK, "--turn", 1, "--frames", 1, 100_000_000
    with monkeypatch.context() as patch:
        patch.setattr(frames_module, "_frame", None)
        refused = call("render", *turn[:-1], 10**12, "-o", tmp_path / "r.npy")
        assert refused.code == 2 and "counted from 1 to 1000000000 at most" in refused.err
    made, one = [], frames_module._frame
    monkeypatch.setattr(frames_module, "_frame", lambda *given: made.append(given[1]) or one(*given))
    (tmp_path / "r_0077.npy").mkdir()
    raw.rename(raw.with_name("ball_123456.npy"))
    turn = raw.with_name("ball_123456.npy"), *turn[1:]
    for output, said in (
        ("missing/r.npy", "does not exist; make it first"), ("r.npy", "r_0077.npy: it is a folder"),
        ("data/ball.npy", "ball_123456.npy is read by this command"), ("s.npy", "s_0001.npy is named twice"),
    ):  # fmt: skip
        refused = call("render", *turn, "-o", tmp_path / output, "--json", tmp_path / "s_0001.npy")
        assert refused.code == 2 and said in refused.err, refused
    refused = call("render", *turn, "-o", tmp_path / "s.npy", "-o", tmp_path / "s.npy")
    assert refused.code == 2 and "s_0001.npy is named twice" in refused.err
    assert len(made) < 20 and not [path for path in tmp_path.glob("*.npy") if path.is_file()]


def test_a_file_alone_has_no_frames(raw, call, raw_options, tmp_path):
    done = call("render", raw, "-o", tmp_path / "out.npy", "--frame", 1, *raw_options, *QUICK)
    assert done.code == 2 and "ball.raw holds one volume" in done.err


def test_frames_that_exist_are_kept_when_a_later_one_is_missing(sequence, call, raw_options, tmp_path):
    done = call("render", sequence, "-o", tmp_path / "out.npy", "--frames", 1, 4, *raw_options, *QUICK)
    assert done.code == 2 and "Time point 3 is missing" in done.err
    assert sorted(path.name for path in tmp_path.glob("*.npy")) == ["out_0001.npy", "out_0002.npy"]
    assert not list(tmp_path.glob(".*.part-*"))


# --- frames that differ in their view -------------------------------------------------------------------------------


def frames_of(call, tmp_path, *words):
    """The reports of the frames that a command makes or keeps."""
    done = call("render", *words, "--json", tmp_path / "report.json")
    assert done.code == 0, done.err
    return json.loads((tmp_path / "report.json").read_text())["frames"], done.out


def test_a_turntable_has_the_pictures_of_its_angles(raw, call, raw_options, tmp_path):
    words = raw, *raw_options, *QUICK, "--elevation", 10
    frames, _ = frames_of(call, tmp_path, *words, "-o", tmp_path / "t.npy", "--frames", 2, 3, "--turn", 25)
    assert [frame["outputs"] for frame in frames] == [[str(tmp_path / f"t_000{n}.npy")] for n in (2, 3)]
    pictures = []
    for number, angle in ((2, 25), (3, 50)):
        assert call("render", *words, "-o", tmp_path / "one.npy", "--azimuth", angle).code == 0
        pictures.append(np.load(tmp_path / f"t_000{number}.npy"))
        np.testing.assert_array_equal(pictures[-1], np.load(tmp_path / "one.npy"))
    assert np.abs(pictures[0] - pictures[1]).max() > 0.01


def test_a_camera_path_has_a_camera_for_each_frame(raw, call, raw_options, write_json, tmp_path):
    cameras = []
    for across in (8.0, 11.0, 300.0):  # the last one sees nothing
        matrix = [[1, 0, 0, across], [0, 1, 0, 8], [0, 0, 1, 60], [0, 0, 0, 1]]
        cameras.append({"matrix_world": matrix, "type": "ORTHO", "ortho_scale": 24.0})
    words = raw, *raw_options, *QUICK
    path = write_json(cameras, "path.json")
    frames, _ = frames_of(call, tmp_path, *words, "-o", tmp_path / "p.npy", "--camera-path", path)
    assert len(frames) == 3 and np.load(tmp_path / "p_0003.npy").max() == 0.0
    for number in (1, 2):
        camera = write_json(cameras[number - 1], "camera.json")
        assert call("render", *words, "-o", tmp_path / "one.npy", "--camera", camera).code == 0
        np.testing.assert_array_equal(np.load(tmp_path / f"p_000{number}.npy"), np.load(tmp_path / "one.npy"))


def test_a_range_of_frames_is_like_another_range(sequence, call, raw_options, tmp_path):
    (tmp_path / "b").mkdir()
    words = sequence, *raw_options, "--size", 24  # the transfer function follows the values
    frames_of(call, tmp_path, *words, "-o", tmp_path / "a.npy", "--frames", 1, 2)
    frames_of(call, tmp_path, *words, "-o", tmp_path / "b/a.npy", "--frames", 2, 2, "--like", 1)
    np.testing.assert_array_equal(np.load(tmp_path / "a_0002.npy"), np.load(tmp_path / "b/a_0002.npy"))
    frames, _ = frames_of(call, tmp_path, *words, "-o", tmp_path / "a.npy", "--frames", 2, 2, "--like", 1)
    assert frames[0]["kept"]
    frames, _ = frames_of(call, tmp_path, *words, "-o", tmp_path / "a.npy", "--frames", 2, 2)
    assert "kept" not in frames[0]  # its own transfer function


# --- frames that are there already ----------------------------------------------------------------------------------


def kept(frames):
    return [frame.get("kept", False) for frame in frames]


def test_whole_frames_of_the_same_scene_are_kept(sequence, call, raw_options, tmp_path):
    words = sequence, *raw_options, *QUICK, "-o", tmp_path / "out.npy", "--frames", 1, 2
    frames, out = frames_of(call, tmp_path, *words)
    assert kept(frames) == [False, False] and "Kept" not in out
    first, second = tmp_path / "out_0001.npy", tmp_path / "out_0002.npy"
    bits = second.read_bytes()
    frames, out = frames_of(call, tmp_path, *words, "--threads", 1)
    assert kept(frames) == [True, True] and "Kept 2 pictures that were there already" in out

    second.write_bytes(bits[:-100])  # half-written
    abandoned, fresh = tmp_path / ".1.part-out_0002.npy", tmp_path / ".2.part-out_0002.npy"
    for part in (abandoned, fresh):
        part.touch()
    os.utime(abandoned, (1e9, 1e9))
    assert kept(frames_of(call, tmp_path, *words)[0]) == [True, False] and second.read_bytes() == bits
    assert fresh.exists() and not abandoned.exists()
    second.write_bytes(bits[:-1] + bytes([bits[-1] ^ 1]))  # of the right size
    assert kept(frames_of(call, tmp_path, *words)[0]) == [True, False] and second.read_bytes() == bits

    (sequence.with_name("ball_9.raw")).write_bytes(ball().tobytes())  # another volume
    assert kept(frames_of(call, tmp_path, *words)[0]) == [True, False] and second.read_bytes() != bits
    assert kept(frames_of(call, tmp_path, *words, "--again")[0]) == [False, False]
    assert first.exists()


@pytest.mark.parametrize("option", [("--fit", 1.5), ("--termination", 0.01), ("--no-shading",), ("--size", 20)])
def test_a_frame_by_other_options_is_made_again(raw, call, raw_options, tmp_path, option):
    words = raw, *raw_options, "--size", 24, "-o", tmp_path / "out.npy", "--frames", 1, 1
    words = *words, "--turn", 5
    assert kept(frames_of(call, tmp_path, *words)[0]) == [False]
    assert kept(frames_of(call, tmp_path, *words, *option)[0]) == [False]
    assert kept(frames_of(call, tmp_path, *words, *option)[0]) == [True]


@pytest.mark.parametrize("form", [(), ("--folder",)], ids=["file", "folder"])
def test_frames_of_a_rle_file_in_tiles_are_kept(raw, call, raw_options, tmp_path, form):
    tables = tmp_path / "ball.rle"
    assert call("encode", raw, *raw_options, "-o", tables, *form).code == 0
    words = tables, "--size", 24, "-o", tmp_path / "out.png", "--frames", 1, 2, "--turn", 90
    assert kept(frames_of(call, tmp_path, *words, "--tile", 16)[0]) == [False, False]
    assert kept(frames_of(call, tmp_path, *words)[0]) == [True, True]


@pytest.mark.parametrize("words, sentence", [
    (("--turn", 5), "--turn has no effect on one picture"),
    (("--again",), "--again has no effect on one picture"),
    (("--frames", 1, 2, "--turn", 400), "--turn is 400; give degrees from -360 to 360"),
    (("--frames", 1, 2, "--turn", 4, "--like", 1), "--like is for a time series"),
    (("--frames", 1, 2, "--like", 0), "--like is 0; give the number of a frame"),
    (("--frames", 1, 2, "--turn", 4, "--camera", "c.json"), "--turn and --camera contradict each other"),
    (("--camera-path", "{}"), "does not hold a list"),
    (("--camera-path", "[3]"), "Camera 1 of"),
    (("--camera-path", "[{}]", "--frames", 1, 2), "--frames is 1 2, and"),
    (("--camera-path", "[{}]", "--azimuth", 2), "--camera-path and --azimuth contradict each other"),
])  # fmt: skip
def test_wrong_series_are_one_sentence(refused, write_json, tmp_path, words, sentence):
    words = [write_json(word) if str(word)[0] in "[{" else word for word in words]
    assert sentence in refused("render", tmp_path / "missing.raw", "-o", tmp_path / "out.npy", *words)


def test_a_command_that_is_killed_keeps_its_whole_frames(raw, call, raw_options, tmp_path):
    words = raw, *raw_options, *QUICK, "--turn", 9, "-o", tmp_path / "k.npy", "--frames", 1
    command = [sys.executable, "-m", "rle_splat", "render", *map(str, (*words, 400))]
    by_numpy = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=ROOT, env=by_numpy)
    while not (tmp_path / "k_0003.npy").exists() and process.poll() is None:
        time.sleep(0.01)
    process.kill()
    assert process.wait() != 0, process.stderr.read()
    process.stderr.close()
    there = {path: path.read_bytes() for path in tmp_path.glob("k_*.npy")}
    assert 3 <= len(there) < 400
    frames, _ = frames_of(call, tmp_path, *words, 5)
    assert kept(frames)[:2] == [True, True]  # of the last ones the mark may be missing
    fresh = tmp_path / "fresh"
    fresh.mkdir()
    frames_of(call, fresh, *words[:-3], fresh / "k.npy", *words[-2:], 5)
    for path in there:
        assert int(path.stem[-4:]) > 5 or (fresh / path.name).read_bytes() == path.read_bytes() == there[path]


def test_ctrl_c_says_that_whole_frames_are_kept(raw, call, raw_options, tmp_path, monkeypatch):
    render, made = series.render_prepared, []

    def stopped(*given):
        if made:
            raise KeyboardInterrupt
        made.append(given)
        return render(*given)

    monkeypatch.setattr(series, "render_prepared", stopped)
    done = call("render", raw, *raw_options, *QUICK, "--turn", 9, "-o", tmp_path / "k.npy", "--frames", 1, 9)
    assert (done.code, done.err) == (130, "Stopped; complete frames stay.\n")
    assert [path.name for path in tmp_path.glob("*.npy")] == ["k_0001.npy"]


# --- farms ------------------------------------------------------------------------------------------------------------

FLAMENCO = """
const tasks = [], author = {
    Task: (name, type) => ({ name, type, commands: [], addCommand(command) { this.commands.push(command); } }),
    Command: (name, parameters) => ({ name, parameters }),
};
function frameChunker(frames, size) {  // of one range, as the Manager cuts it
    const [first, last] = frames.split("-").map(Number), chunks = [];
    for (let from = first; from <= last; from += size) {
        const to = Math.min(from + size - 1, last);
        chunks.push(from === to ? `${from}` : `${from}-${to}`);
    }
    return chunks;
}
const given = JSON.parse(process.argv[1]), settings = {};
for (const { key, default: usual } of JOB_TYPE.settings) settings[key] = given[key] ?? usual;
compileJob({ settings, addTask: task => tasks.push(task) });
console.log(JSON.stringify(tasks));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_the_job_type_of_the_page_makes_the_frames(raw, call, raw_options, tmp_path):
    page = (ROOT / "docs" / "how-to" / "render-many-frames.md").read_text(encoding="utf-8")
    script = page.split("```js\n")[1].split("```")[0] + FLAMENCO
    options = " ".join(map(str, ("--turn 30", *raw_options, *QUICK)))
    given = {"volume": str(raw), "output": str(tmp_path / "out.npy"), "frames": "1-3", "chunk_size": 2}
    given["options"] = options
    words = ["node", "-e", script, json.dumps(given)]
    tasks = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    assert [task["name"] for task in tasks] == ["frames 1-2", "frames 3"]
    for task in tasks:
        (command,) = task["commands"]
        assert command["name"] == "exec" and command["parameters"]["exe"] == "rle-splat"
        assert call(*command["parameters"]["args"]).code == 0
    assert sorted(path.name for path in tmp_path.glob("*.npy")) == [f"out_{n:04}.npy" for n in (1, 2, 3)]


def test_labels_of_a_file_in_time_follow_the_frame(call, tmp_path):
    nibabel = pytest.importorskip("nibabel")
    values = np.repeat(ball().T[..., None], 2, axis=3).astype(np.uint8)
    maps = np.zeros(values.shape, np.uint8)
    maps[:, :, : values.shape[2] // 2, 1] = 1
    for name, voxels in (("beat", values), ("map", maps), ("second", maps[..., 1])):
        nibabel.save(nibabel.Nifti1Image(voxels, np.eye(4)), tmp_path / f"{name}.nii")

    hidden = tmp_path / "hidden.json"
    hidden.write_text(json.dumps([{"label": 1, "hidden": True}]))

    def pictures(labels, *words):
        line = ("render", tmp_path / "beat.nii", "-o", tmp_path / "out.npy", "--labels", tmp_path / labels)
        done = call(*line, "--label-functions", hidden, *words, *QUICK)
        assert done.code == 0, done.err
        found = [np.load(path) for path in sorted(tmp_path.glob("out*.npy"))]
        for path in tmp_path.glob("out*.npy"):
            path.unlink()
        return found

    first, second = pictures("map.nii", "--frames", 1, 2)
    (always,) = pictures("second.nii", "--frame", 2)
    np.testing.assert_array_equal(second, always)
    assert always[..., 3].sum() < 0.95 * first[..., 3].sum()
    np.testing.assert_array_equal(pictures("map.nii")[0], first)
    np.testing.assert_array_equal(pictures("map.nii", "--frame", 2)[0], second)
