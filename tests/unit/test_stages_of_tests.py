"""The stages of dev.py test: what runs where, what waits for what, and what is said of what cannot run."""

from pathlib import Path
from threading import Event

import pytest

from devtools import real_blender_tests, testing
from devtools.places import Failure
from devtools.stages import Stage

TESTS = Path(__file__).resolve().parents[1]


def test_extras_are_skipped_in_one_line_where_their_environment_cannot_be_made(capsys):
    stage = testing._extras(Failure("uv could not."), [], True)
    assert (stage.verdict, stage.skipped, stage.remarks) == ("SKIPPED", 1, ["uv could not."])
    assert capsys.readouterr().out.count("\n") == 2  # an empty line before it


def test_windows_are_skipped_with_the_reason_where_there_is_no_blender(monkeypatch, tmp_path):
    def none():
        raise Failure("no blender in $BLENDER")

    monkeypatch.setattr(real_blender_tests, "find_blender", none)
    stages = real_blender_tests.window_stages(tmp_path / "extension.zip")
    assert [stage.name for stage in stages] == [
        f"real blender, {name}" for name in ("window", "panels", "import", "dialogs", "live", "cut", "look", "presets")
    ]
    assert {(stage.verdict, *stage.remarks) for stage in stages} == {("SKIPPED", "no blender in $BLENDER")}


@pytest.fixture
def stages(monkeypatch, tmp_path):
    """``stages(quick)`` -> (what each run of pytest was given: name -> (python, words), the table's stages); nothing is
    run.  Blender's environments are made ready only when another stage has begun meanwhile."""

    def everything(quick):
        runs, begun, made = {}, Event(), Event()

        def run(name, python, words, seconds, environ, aside=False):
            assert name not in runs and aside
            runs[name] = (python, [str(word) for word in words])
            if not name.startswith("core, ") or name.removeprefix("core, ") in testing.WANT_BLENDER:
                assert made.is_set(), f"{name} does not wait for what it needs"
            else:
                begun.set()
            return Stage(name, passed=1)

        def make_ready(quick):
            assert begun.wait(60), "nothing else runs meanwhile"
            made.set()
            pythons = {name: Path(name) for name in testing.OTHERS}
            return testing.Ready(Stage("extension zip", passed=1), Path("the.zip"), pythons)

        monkeypatch.setattr(testing, "_pytest", run)
        monkeypatch.setattr(testing, "_make_ready", make_ready)
        monkeypatch.setattr(testing, "ensure", lambda environment: environment.name)
        monkeypatch.setattr(testing, "ensure_bpy", lambda version: version)
        monkeypatch.setattr(testing, "find_python", lambda version: version)
        monkeypatch.setattr(testing, "_catalogue", lambda: Stage("catalogue", passed=1))
        monkeypatch.setattr(testing, "_real_blender", lambda path: [Stage("real blender", passed=1)])
        monkeypatch.setattr(testing, "BUILD", tmp_path)  # the tests that run now use the other one
        monkeypatch.setattr(testing, "FIGURES", tmp_path / "figures.json")
        return runs, testing._everything(["-x"], quick)

    return everything


def test_each_test_runs_in_one_stage(stages):
    """What the core leaves out, the extras take, in the environment that has what they want."""
    runs, table = stages(False)
    folders = {file.relative_to(TESTS).parts[0] for file in TESTS.rglob("test_*.py")}
    core = {name.removeprefix("core, "): words for name, (_, words) in runs.items() if name.startswith("core, ")}
    assert set(core) == folders - {"blender", "stability"}
    for folder, words in core.items():
        assert str(TESTS / folder) in words and words[words.index("-m") + 1] == "not extras"
    python, words = runs[testing.EXTRAS_STAGE]
    assert python == Path("bench") and words[0] == "tests" and words[words.index("-m") + 1] == "extras"
    python, words = runs[testing.CLUSTER_STAGE]
    assert python == Path("cluster") and words[0] == str(testing.CLUSTER_TESTS)
    assert f"--ignore={words[0]}" in core["cli"]
    assert "-m" not in runs["hard cases"][1] and str(TESTS / "stability") in runs["hard cases"][1]
    versions = [f"bpy {version}" for version in testing.BPY]
    assert all(str(TESTS / "blender") in runs[name][1] for name in versions)
    assert len(runs) == len(core) + len(versions) + 3
    assert {stage.name for stage in table} == {*runs, "extension zip", "real blender"}


def test_quick_says_what_it_leaves_out(stages):
    runs, table = stages(True)
    assert [name for name in runs if name.startswith("bpy")] == ["bpy 5.0"] and testing.EXTRAS_STAGE not in runs
    left_out = {stage.name for stage in table if stage.verdict == "SKIPPED"}
    assert left_out == {testing.EXTRAS_STAGE, testing.CLUSTER_STAGE, "real blender", "bpy 4.5", "bpy 5.2"}
    assert all("not slow" in words[words.index("-m") + 1] for name, (_, words) in runs.items() if "bpy" not in name)


def test_marks_are_left_out_in_pytests_own_words():
    assert testing._leave_out() == [] and testing._leave_out("slow", "extras") == ["-m", "not slow and not extras"]


def test_each_part_runs_alone_and_makes_only_what_it_needs(monkeypatch, capsys):
    """A part of the core needs nothing made; one of Blender needs the zip, and is not run without it."""
    made, run = [], []

    def zip_stage(path):
        made.append("zip")
        return testing.Ready(Stage("extension zip", passed=bool(path), failed=not path), path)

    def other(name):
        made.append(name)
        return Path(name)

    def part(needs):
        return testing.Part(lambda ready, aside: run.append((needs, aside)) or [Stage(needs, passed=1)], needs)

    monkeypatch.setattr(testing, "_other", other)
    monkeypatch.setattr(testing, "parts", lambda options: {name: part(name) for name in ("", "zip", "bench")})
    for path, code in ((Path("the.zip"), 0), (None, 1)):
        monkeypatch.setattr(testing, "_zip", lambda path=path: zip_stage(path))
        assert testing.test_part("zip", []) == code
    assert testing.test_part("", []) == testing.test_part("bench", []) == 0
    assert made == ["zip", "zip", "bench"] and run == [("zip", False), ("", False), ("bench", False)]
    assert capsys.readouterr().out.splitlines()[-1] == "1 passed, 0 failed, 0 skipped"


def test_the_whole_catalogue_is_checked_for_gaps_and_a_part_of_it_is_not(monkeypatch, tmp_path):
    monkeypatch.setattr(testing, "FIGURES", tmp_path / "figures.json")
    monkeypatch.setattr(testing, "_core", lambda words, name, aside, **variables: Stage(name, passed=1))
    monkeypatch.setattr(testing, "_catalogue", lambda: Stage("catalogue", passed=1))
    names = {
        arguments: [stage.name for stage in testing.parts(*arguments)["hard-cases"].run(testing.Ready(), True)]
        for arguments in (((), False), ((), True), (("-x",), False))
    }
    assert list(names.values()) == [["hard cases", "catalogue"], ["hard cases"], ["hard cases"]]
