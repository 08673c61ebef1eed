"""Runs of benchmarks are kept, and compared with those of other commits; the times here are made up."""

import pytest

from benchmarks import history, run


@pytest.fixture
def keep(monkeypatch):
    """``keep(commit, yardstick, **times)``: a run of the benchmark "made" with these milliseconds by volume."""

    def keep(commit: str, yardstick: float, arguments=("--size", "16"), **times: float) -> None:
        monkeypatch.setattr(run, "name_commit", lambda: commit)
        monkeypatch.setattr(run, "measure_yardstick", lambda: yardstick)
        one = run.Run("made", arguments, 1, key=("volume",), time="ms")
        one.rows += [{"volume": name, "ms": spent} for name, spent in times.items()]
        one.keep()

    return keep


def test_slower_rows_are_listed(keep, capsys):
    keep("aaa", 10.0, head=100.0, foot=200.0, engine=50.0)
    keep("bbb", 10.0, head=150.0, foot=200.0, engine=40.0)
    assert history.main(["made"]) == 1
    first, *slower = capsys.readouterr().out.splitlines()[-2:]
    assert "bbb against aaa, 3 rows" in first and "1.00 in the median" in first
    assert slower == ["  1.50  head"]


def test_a_slower_machine_makes_no_row_slower(keep, capsys):
    keep("aaa", 10.0, head=100.0)
    keep("bbb", 20.0, head=200.0)
    assert history.main(["made"]) == 0
    assert "1.00 in the median; the machine, by its yardstick: 2.00" in capsys.readouterr().out


def test_only_runs_with_the_same_options_of_another_commit_are_compared(keep, capsys):
    keep("aaa", 10.0, head=100.0)
    keep("bbb", 10.0, ("--size", "512"), head=1.0)
    keep("ccc", 10.0, head=300.0)
    keep("ccc", 10.0, head=200.0)
    assert history.main(["made"]) == 1 and "2.00  head" in capsys.readouterr().out
    assert history.main(["made", "--before", "ccc"]) == 0 and "ccc against ccc" in capsys.readouterr().out
    assert history.main(["made", "--before", "bbb"]) == 2


def test_without_two_runs_or_rows_in_common_nothing_is_compared(keep, capsys):
    assert history.main(["made"]) == 2
    keep("aaa", 10.0, head=100.0)
    assert history.main(["made"]) == 2 and "can be compared" in capsys.readouterr().err
    keep("bbb", 10.0, foot=100.0)
    assert history.main(["made"]) == 2 and "no row in common" in capsys.readouterr().err


def test_a_run_names_its_commit_and_its_machine(results, capsys):
    run.Run("made", ()).keep(more=1)
    (found,) = history.read_runs("made")
    assert found["commit"].removesuffix("+").isalnum() or not found["commit"]
    assert found["more"] == 1 and found["yardstick_ms"] > 0.0 and found["circumstances"]["cores"]
