"""Pictures and frames on a Dask cluster have the bits of those of one machine; what a cluster cannot do is a sentence.

One cluster within this process serves all tests but those of a lost worker and of Ctrl+C, which need processes.
"""

import gc
import json
import logging
import os
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest

from rle_splat.cli import cluster, cluster_worker
from rle_splat.cli.main import main

WORDS = ["--size", "90x70", "--quality", "draft", "--elevation", "20"]


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


def test_two_commands_on_one_scheduler(render, raw, raw_options, address, tmp_path, monkeypatch):
    """Each worker reads the volume once for each; of a command that was killed nothing is kept."""
    whole, read = np.load(render("whole.npy")), []
    put, picture = cluster.Cluster.results, cluster_worker._picture_of
    monkeypatch.setattr(cluster_worker, "_picture_of", lambda job: read.append(job.key) or picture(job))
    monkeypatch.setitem(cluster_worker._JOBS, "Client-of-a-killed-command", None)

    def other_between(self, *arguments):
        for number, found in enumerate(put(self, *arguments)):
            if number == 1 and len(set(read)) == 1:
                words = "render", raw, *raw_options, *WORDS, "-o", tmp_path / "b.npy", "--dask", address, "--tile", 16
                assert main([str(word) for word in words]) == 0
            yield found

    monkeypatch.setattr(cluster.Cluster, "results", other_between)
    render("a.npy", "--dask", address, "--tile", "16")
    for name in ("a", "b"):
        np.testing.assert_array_equal(np.load(tmp_path / f"{name}.npy"), whole)
    assert len(read) == 2 and cluster_worker._JOBS == {}  # both workers are threads of this process


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
    camera = write_json({"matrix_world": matrix.tolist(), "type": "ORTHO", "ortho_scale": 6.0})
    words = raw, *raw_options, "--camera", camera, "--size", "64", "-o", tmp_path / "a.npy"
    assert "does not see the volume" in refused("render", *words, "--dask", address)
    assert not list(tmp_path.glob("*.npy")) and not list(tmp_path.glob(".*"))


def test_workers_without_the_data_or_of_another_version(refused, raw, raw_options, address, tmp_path, monkeypatch):
    words = *raw_options, *WORDS, "-o", tmp_path / "a.npy", "--dask", address
    assert "cannot read" in refused("render", tmp_path / "missing.raw", *words)
    monkeypatch.setattr(cluster, "source_hash", lambda: "another")
    assert "has another version of RLE Splat" in refused("render", raw, *words)
    monkeypatch.setitem(sys.modules, "rle_splat.cli.made", None)
    assert "does not have the package rle-splat" in refused("render", raw, *words)


def test_files_that_this_command_alone_reads(call, raw, raw_options, address, tmp_path, write_json, monkeypatch):
    camera = {"matrix_world": [[1, 0, 0, 8], [0, 1, 0, 8], [0, 0, 1, 60], [0, 0, 0, 1]], "type": "ORTHO",
              "ortho_scale": 24.0}  # fmt: skip
    words = "--camera-path", write_json([camera], "path.json"), "--motion", write_json([{}, {}], "motion.json")
    can = os.access
    monkeypatch.setattr(os, "access", lambda name, mode: not str(name).endswith(".json") and can(name, mode))
    words = raw, *raw_options, *WORDS[:-2], *words, "-o", tmp_path / "a.npy", "--dask", address
    result = call("render", *words)
    assert result.code == 0, result.err
    assert np.load(tmp_path / "a_0001.npy")[..., 3].max() > 0.3


def test_nobody_answers(refused, raw, raw_options, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "SECONDS", 1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        free = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    for address in (free, "nonsense://x"):
        sentence = refused("render", raw, *raw_options, *WORDS, "-o", tmp_path / "a.npy", "--dask", address)
        assert "No Dask scheduler answers at" in sentence
        gc.collect()  # a client that failed ends here: within the next one's start it would wait for its own lock


def test_dask_tells_as_much_afterward_as_before(render, address):
    logger, inner = logging.getLogger("distributed"), logging.getLogger("distributed.comm.tcp")
    before = logger.level, inner.level
    try:
        logger.setLevel(logging.INFO)
        inner.setLevel(logging.NOTSET)
        render("a.npy", "--dask", address)
        assert (logger.level, inner.level) == (logging.INFO, logging.NOTSET)
    finally:
        logger.setLevel(before[0])
        inner.setLevel(before[1])


@pytest.mark.skipif(os.name == "nt", reason="Windows has no groups of processes that a signal reaches")
def test_ctrl_c_is_one_sentence(raw, raw_options, tmp_path):
    """A terminal sends it to the workers too."""
    words = "render", raw, *raw_options, "--size", "900", "--tile", "16", "-o", tmp_path / "a.npy"
    process = subprocess.Popen(
        [sys.executable, "-m", "rle_splat", *map(str, words), "--dask", "--workers", "1"], start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stdout.readline().startswith(b"Cluster of 1 workers")
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate()
    assert (process.returncode, out, err.decode()) == (130, b"", "Stopped; nothing was written.\n")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_a_lost_scheduler_is_no_full_disk(call, raw, raw_options, address, tmp_path, monkeypatch):
    """The pictures are begun by then; the package gives its error no number."""
    from distributed.comm import CommClosedError

    def close(*_):
        raise CommClosedError("connection closed")

    monkeypatch.setattr(cluster.Cluster, "submit", close)
    result = call("render", raw, *raw_options, *WORDS, "-o", tmp_path / "a.tif", "--dask", address)
    assert result.code == 2
    assert result.err == "The connection to the Dask scheduler was lost; run the command again.\n"


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
