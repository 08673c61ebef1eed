"""Memory on the command line: told before it is taken, refused by every command that could not have it."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest

from rle_splat.runtime.memory import bytes_text


@pytest.fixture
def short_of_memory(monkeypatch):
    """``short_of_memory(free)``: as if the machine had that many bytes."""

    def run(free):
        for module in ("pipeline.memory_estimate", "pipeline.stage_cache", "runtime.memory"):
            monkeypatch.setattr(f"rle_splat.{module}.available_bytes", lambda: free)

    return run


@pytest.mark.parametrize(
    "words, suffix, doing, begun, following",
    (
        (("render",), ".npy", "Keeping", "Finding the voxels that matter", "Splatting"),
        (("render", "--classification", "pre"), ".npy", "Classifying", "Counting", "Encoding"),
        (("encode",), ".rle", "Classifying", "Counting", "Encoding"),
    ),
)
def test_what_is_needed_is_told_before_it_is_taken(
    words, suffix, doing, begun, following, call, raw, raw_options, tmp_path
):
    report = tmp_path / "report.json"
    result = call(*words, raw, *raw_options, "-o", tmp_path / f"out{suffix}", "--json", report, "--progress")
    assert result.code == 0, result.err
    known = json.loads(report.read_text())
    kept, needed = known["volume"]["visible_voxels"], known["memory_estimate_bytes"]["needed"]
    told = result.err.index(f"{doing} {kept} voxels, about {bytes_text(needed)} in all")
    assert result.err.index(begun) < told < result.err.index(following)


@pytest.mark.parametrize("dtype", ("uint8", "float32"))
@pytest.mark.parametrize("words", ((), ("--classification", "pre")))
def test_information_tells_what_a_picture_then_takes(words, dtype, call, tmp_path):
    """Of the quality and the size that render has where it is told nothing else, and of records for pre; but not what
    each thread has for itself."""
    at = np.indices((48, 48, 48)) - 23.5
    path, told, found = tmp_path / "ball.raw", tmp_path / "told.json", tmp_path / "found.json"
    np.where((at**2).sum(axis=0) < 17.5**2, 180, 20).astype(dtype).tofile(path)
    options = ("--shape", "48", "48", "48", "--dtype", dtype)
    assert call("info", path, *options, "--json", told).code == 0
    words = (*options, *words, "--threads", "2")
    assert call("render", path, *words, "-o", tmp_path / "out.npy", "--json", found).code == 0
    known = json.loads(told.read_text())
    memory = known["memory_bytes"]
    needed = known["records"]["16"]["render"] if "pre" in words else memory["total"] - memory["voxels"]
    assert needed == pytest.approx(json.loads(found.read_text())["memory_estimate_bytes"]["needed"], rel=0.3)


@pytest.mark.parametrize(
    "words", (("render", "-o", "out.npy"), ("encode", "-o", "out.rle"), ("convert", "out.raw"), ("info",))
)
def test_voxels_that_do_not_fit_are_refused_before_they_are_unpacked(
    words, refused, raw, raw_options, tmp_path, short_of_memory, monkeypatch
):
    packed = tmp_path / "ball.raw.gz"
    packed.write_bytes(gzip.compress(raw.read_bytes()))
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    short_of_memory(3000)
    command, *rest = words
    target = rest if command == "convert" else []
    options = [] if command == "convert" else rest
    sentence = refused(command, packed, *target, *raw_options, *options)
    assert "need 3.8 KiB of memory and 2.9 KiB are free; close other programs, or write a coarser file" in sentence
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("axes, words", (("xyz", "one principal axis at a time"), ("y", "use voxel records of")))
def test_tables_that_do_not_fit_are_refused_with_what_to_do(
    axes, words, refused, call, raw, raw_options, tmp_path, short_of_memory
):
    report, target = tmp_path / "report.json", tmp_path / "out.rle"
    whole = call("encode", raw, *raw_options, "-o", tmp_path / "whole.rle", "--axes", axes, "--json", report)
    assert whole.code == 0, whole.err
    needed = json.loads(report.read_text())["memory_estimate_bytes"]["needed"]
    short_of_memory(int((0.6 if len(axes) == 3 else 0.95) * needed / 0.9))
    assert words in refused("encode", raw, *raw_options, "-o", target, "--axes", axes)
    assert not target.exists()
