"""Pictures and frames on a Dask cluster have the bits of those of one machine; what a cluster cannot do is a sentence.

One cluster within this process serves all tests but that of a lost worker, which needs processes.
"""

import json
import os
import signal
import socket

import numpy as np
import pytest

from rle_splat.cli import cluster, cluster_worker

WORDS = ["--size", "90x70", "--backend", "numpy", "--quality", "draft", "--elevation", "20"]


@pytest.fixture
def render(call, raw, raw_options, tmp_path):
    """``render("a.npy", ...)`` -> the path of the picture, whose report is beside it."""

    def run(name, *words):
        path = tmp_path / name
        result = call("render", raw, *raw_options, *WORDS, "-o", path, "--json", path.with_suffix(".json"), *words)
        assert result.code == 0, result.err
        assert "dashboard" in result.out or "--dask" not in words
        return path

    return run


def test_a_picture_has_the_bits_of_one_machine(render, address):
    whole = np.load(render("whole.npy"))
    assert whole[..., 3].max() > 0.3
    for name, words in (("a", ()), ("b", ("--tile", "33"))):
        path = render(f"{name}.npy", "--dask", address, *words)
        np.testing.assert_array_equal(np.load(path), whole)
        report = json.loads(path.with_suffix(".json").read_text())
        assert report["workers"] == 2 and report["tiles"]["count"] > 1 and report["image"]["width"] == 90
    part = render("c.npy", "--dask", address, "--crop", "11", "5", "70", "44", "--tile", "16")
    np.testing.assert_array_equal(np.load(part), whole[5:44, 11:70])
    assert cluster_worker._JOBS == {}


def test_frames_are_tasks_and_whole_ones_are_kept(render, address, tmp_path):
    words = "--frames", "1", "3", "--turn", "40"
    render("one.npy", *words)
    render("dask.npy", *words, "--dask", address)
    for number in (1, 2, 3):
        made, alone = (np.load(tmp_path / f"{name}_000{number}.npy") for name in ("dask", "one"))
        np.testing.assert_array_equal(made, alone)
    (tmp_path / "dask_0002.npy").write_bytes(b"half")
    frames = json.loads(render("dask.npy", *words, "--dask", address).with_suffix(".json").read_text())["frames"]
    assert [frame.get("kept", False) for frame in frames] == [True, False, True]
    assert [frame["outputs"] for frame in frames] == [[str(tmp_path / f"dask_000{n}.npy")] for n in (1, 2, 3)]
    # One machine keeps what a cluster has made.
    frames = json.loads(render("dask.npy", *words).with_suffix(".json").read_text())["frames"]
    assert all(frame["kept"] for frame in frames)


def test_a_wrong_scene_is_the_sentence_of_one_machine(refused, raw, raw_options, address, tmp_path, write_json):
    matrix = np.eye(4)
    matrix[0, 3] = 1e4
    camera = write_json({"matrix_world": matrix.tolist(), "type": "ORTHO"})
    words = raw, *raw_options, "--camera", camera, "--size", "64", "--backend", "numpy", "-o", tmp_path / "a.npy"
    assert "does not see the volume" in refused("render", *words, "--dask", address)
    assert not list(tmp_path.glob("*.npy")) and not list(tmp_path.glob(".*"))


def test_workers_without_the_data_or_of_another_version(refused, raw, raw_options, address, tmp_path, monkeypatch):
    words = *raw_options, *WORDS, "-o", tmp_path / "a.npy", "--dask", address
    assert "cannot read" in refused("render", tmp_path / "missing.raw", *words)
    monkeypatch.setattr(cluster, "source_hash", lambda: "another")
    assert "has another version of RLE Splat" in refused("render", raw, *words)


def test_nobody_answers(refused, raw, raw_options, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "SECONDS", 1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        free = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    for address in (free, "nonsense://x"):
        sentence = refused("render", raw, *raw_options, *WORDS, "-o", tmp_path / "a.npy", "--dask", address)
        assert "No Dask scheduler answers at" in sentence


def test_a_lost_worker_costs_its_tasks_alone(render, monkeypatch):
    whole = np.load(render("whole.npy"))
    put, killed = cluster.Cluster.results, []

    def kill_one(self, *arguments):
        for found in put(self, *arguments):
            if not killed:
                killed.append(next(iter(self.client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)
            yield found

    monkeypatch.setattr(cluster.Cluster, "results", kill_one)
    path = render("a.npy", "--dask", "--workers", "2", "--tile", "16")
    np.testing.assert_array_equal(np.load(path), whole)
    assert killed
