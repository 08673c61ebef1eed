"""Where the runs of benchmarks are kept in tests."""

import json

import pytest

from benchmarks import run


@pytest.fixture(autouse=True)
def results(tmp_path, monkeypatch):
    """The folder of kept runs."""
    folder = tmp_path / "results"
    monkeypatch.setattr(run, "RESULTS", folder)
    return folder


@pytest.fixture
def read_rows(results):
    """``read_rows(name)``: the rows of the only run of a benchmark."""

    def read(name: str) -> list[dict]:
        (line,) = (results / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
        return json.loads(line)["rows"]

    return read
