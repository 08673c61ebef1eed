"""The table of stages at a tiny size: the whole call comes first.  No time is asserted."""

import pytest

from benchmarks import stages
from benchmarks.scenes import shells
from rle_splat.runtime.jit import compiled

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")


def test_table_and_report(read_rows, capsys, monkeypatch):
    monkeypatch.setattr(stages, "scenes", lambda names: [("shells", *shells(24))])
    words = ["--size", "16", "--quality", "draft", "--threads", "1", "--views", "1", "--projection", "orthographic"]
    assert stages.main(words) == 0
    rows = read_rows("stages")
    assert [row["colors"] for row in rows] == ["unshaded", "shaded"]
    heads, *lines = capsys.readouterr().out.splitlines()[4:-2]
    assert heads.split()[5] == "whole" and len(lines) == len(rows)
    for row, line in zip(rows, lines):
        assert row["whole"] >= row["total"] > row["frame"] > 0.0 and f"{row['whole']:.1f}" in line
