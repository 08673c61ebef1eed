"""Files appear whole or not at all; progress and reports are readable."""

from __future__ import annotations

import io
import json
import os
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from rle_splat.cli.progress import ProgressLine
from rle_splat.runtime import outputs
from rle_splat.runtime import whole_files as whole_files_module
from rle_splat.runtime.memory import bytes_text
from rle_splat.runtime.outputs import check_outputs, write_report
from rle_splat.runtime.whole_files import part_of, whole_file, whole_files
from rle_splat.scene import RleSplatError
from rle_splat.scene.plain import plain


def test_all_outputs_appear_together(tmp_path):
    targets = [tmp_path / "a", tmp_path / "b"]
    with whole_files(targets) as parts:
        for part in parts:
            part.write_text("new")
        assert not any(target.exists() for target in targets)
    assert [target.read_text() for target in targets] == ["new", "new"]
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("problem", [KeyboardInterrupt, ValueError, MemoryError])
def test_a_stop_leaves_the_old_file_and_nothing_else(tmp_path, problem):
    target = tmp_path / "a"
    target.write_text("old")
    with pytest.raises(problem), whole_files([target, tmp_path / "b"]) as parts:
        parts[0].write_text("half")
        raise problem
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("times", [2, 3])
def test_a_file_that_another_program_holds_is_renamed_again(tmp_path, monkeypatch, times):
    """A virus scanner on Windows looks at a new file for a moment."""
    replace, calls, pauses = os.replace, [], []

    def refuse(part, target):
        calls.append(target)
        if len(calls) <= times:
            raise PermissionError(13, "Access is denied")
        replace(part, target)

    monkeypatch.setattr(os, "replace", refuse)
    monkeypatch.setattr(whole_files_module, "time", SimpleNamespace(sleep=pauses.append))
    held = pytest.raises(RleSplatError, match="Access is denied") if times == 3 else nullcontext()
    with held, whole_file(tmp_path / "a") as part:
        part.write_text("new")
    assert len(calls) == 3 and 0.0 < sum(pauses) <= 0.5
    assert [path.name for path in tmp_path.iterdir()] == ([] if times == 3 else ["a"])


def test_impossible_outputs_are_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "no" / "a.png", tmp_path, tmp_path / "file" / "a.png"):
        with pytest.raises(RleSplatError, match="Cannot write"):
            check_outputs([path])
    with pytest.raises(RleSplatError, match="twice"):
        check_outputs([tmp_path / "a.png", tmp_path / "." / "a.png"])
    with pytest.raises(RleSplatError, match="read by this command"):
        check_outputs([tmp_path / "file"], inputs=[None, tmp_path / "file"])
    minds_case = not (tmp_path / "FILE").exists()
    if minds_case:
        os.link(tmp_path / "file", tmp_path / "FILE")  # as one file has both names on a disk that ignores case
    with pytest.raises(RleSplatError, match="read by this command"):
        check_outputs([tmp_path / "FILE"], inputs=[tmp_path / "file"])
    if minds_case:
        (tmp_path / "FILE").unlink()
    check_outputs([tmp_path / "a.png"])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_error_of_a_full_disk_names_the_file(tmp_path):
    """Of several, by those that are begun; of a temporary file by the file that it is for."""
    targets = [tmp_path / "a.png", tmp_path / "b.json"]
    for problem, names in (
        (OSError(28, "No space left on device"), targets[:1]),
        (OSError(13, "Permission denied", str(part_of(targets[1]))), targets[1:]),
    ):  # fmt: skip
        with pytest.raises(OSError) as raised, whole_files(targets) as parts:
            parts[0].write_text("half")
            raise problem
        assert raised.value.filename == ", ".join(map(str, names)) and list(tmp_path.iterdir()) == []
    for begun, problem in (
        (0, OSError(28, "No space left on device")), (0, FileNotFoundError(2, "No such file", "another")),
        (1, OSError("connection closed")),
    ):  # fmt: skip
        with pytest.raises(OSError) as raised, whole_files(targets) as parts:
            for part in parts[:begun]:
                part.write_text("half")
            raise problem
        assert raised.value is problem


def test_two_outputs_whose_names_differ_by_case(tmp_path, monkeypatch):
    """They are one file on the disks of Windows and macOS."""
    both = [tmp_path / "a.png", tmp_path / "A.png"]

    def part_of(path):
        return whole_files_module.part_of(path.with_name(path.name.lower()))

    monkeypatch.setattr(outputs, "part_of", part_of)
    with pytest.raises(RleSplatError, match=r"A\.png is named twice"):
        check_outputs(both)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="Windows needs a right to make links")
def test_a_loop_of_links_as_an_input(tmp_path):
    for name, other in (("a.nrrd", "b.nrrd"), ("b.nrrd", "a.nrrd")):
        (tmp_path / name).symlink_to(other)
    check_outputs([tmp_path / "a.png"], inputs=[tmp_path / "a.nrrd"])


def test_progress_is_one_line_that_clears_itself():
    stream = io.StringIO()
    with ProgressLine(True, stream) as line:
        line.show(0.25, "splatting")
        line.show(None, "warp")
    text = stream.getvalue()
    assert "25%  splatting" in text and "\n" not in text
    screen = ""
    for piece in text.split("\r"):  # what a terminal would show: each piece overwrites from the left
        screen = piece + screen[len(piece) :]
    assert screen.strip() == ""


def test_progress_is_silent_without_a_terminal():
    stream = io.StringIO()
    with ProgressLine(None, stream) as line:
        line.show(0.25, "splatting")
    assert stream.getvalue() == ""


def test_following_steps_returns_their_value_and_closes_them_on_a_stop():
    closed = []

    def steps(fail):
        try:
            yield SimpleNamespace(fraction=0.5, message="half")
            if fail:
                raise KeyboardInterrupt
            return "picture"
        finally:
            closed.append(True)

    with ProgressLine(False) as line:
        assert line.follow(steps(fail=False)) == "picture"
        with pytest.raises(KeyboardInterrupt):
            line.follow(steps(fail=True))
    assert closed == [True, True]


def test_reports_are_plain_json(tmp_path):
    path = tmp_path / "r.json"
    write_report(path, {"a": np.float32(0.5), "b": np.arange(2), "c": float("nan"), "d": (np.int64(3), None, True)})
    text = path.read_text()
    assert "NaN" not in text
    assert json.loads(text) == {"a": 0.5, "b": [0, 1], "c": None, "d": [3, None, True]}
    assert plain({1: path}) == {"1": str(path)}


@pytest.mark.parametrize("count, text", [(12, "12 bytes"), (1536, "1.5 KiB"), (3 << 40, "3072.0 GiB")])
def test_byte_counts(count, text):
    assert bytes_text(count) == text
