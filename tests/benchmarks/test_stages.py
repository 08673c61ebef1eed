"""The table of stages at a tiny size: the whole call comes first.  No time is asserted."""

import json

import pytest

from benchmarks import stages
from benchmarks.scenes import shells
from rle_splat.runtime.jit import compiled

pytestmark = pytest.mark.skipif(not compiled(), reason="slow without kernels")


def test_table_and_report(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(stages, "scenes", lambda names: [("shells", *shells(24))])
    report = tmp_path / "stages.json"
    words = ["--size", "16", "--quality", "draft", "--threads", "1", "--views", "1", "--projection", "orthographic"]
    assert stages.main([*words, "--json", str(report)]) == 0
    rows = json.loads(report.read_text())
    assert [row["colors"] for row in rows] == ["unshaded", "shaded"]
    heads, *lines = capsys.readouterr().out.splitlines()[3:]
    assert heads.split()[5] == "whole" and len(lines) == len(rows)
    for row, line in zip(rows, lines):
        assert row["whole"] >= row["total"] > row["frame"] > 0.0 and f"{row['whole']:.1f}" in line
