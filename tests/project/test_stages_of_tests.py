"""The stages of dev.py test: what runs where, what waits for what, and what is said of what cannot run."""

import ast
import json
import os
import re
import sys
import time
from concurrent.futures import Future
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import pytest

from devtools import real_blender_tests, stage_times, testing
from devtools import stages as stages_module
from devtools.places import Failure
from devtools.stages import Stage

TESTS = Path(__file__).resolve().parents[1]


def test_extras_are_skipped_in_one_line_where_their_environment_cannot_be_made(capsys):
    stage = testing._extras(Failure("uv could not."), [], True)
    assert (stage.verdict, stage.skipped, stage.missing) == ("SKIPPED", 1, "uv could not.")
    assert capsys.readouterr().out.count("\n") == 2  # an empty line before it


def test_windows_are_skipped_with_the_reason_where_there_is_no_blender(monkeypatch):
    def none():
        raise Failure("no blender in $BLENDER")

    monkeypatch.setattr(real_blender_tests, "ensure_blender", none)
    (stage,) = real_blender_tests.real_blender_stages({})
    assert (stage.verdict, stage.missing) == ("SKIPPED", "no blender in $BLENDER")


@pytest.mark.parametrize(("version", "backend", "code"), [((5, 2), None, 1), ((5, 3), None, 0), ((5, 2), "vulkan", 0)])
def test_photographs_are_compared_last_where_those_approved_are_of_this_blender(monkeypatch, version, backend, code):
    """A window whose photograph has changed, or is missing, fails the run.  Each knows the one that is compared."""
    compared = {}

    def run(blender, zips, scripts, *_):
        return Stage(scripts[0].stem, passed=1)

    def show(zips, scripts, label, size, *_, RLE_SPLAT_GOLDEN="{}"):
        assert size == real_blender_tests.WINDOW_SCRIPTS[scripts[-1].name], "a window has one size"
        compared.update({script.stem: json.loads(RLE_SPLAT_GOLDEN).get(script.stem) for script in scripts})
        return Stage(label, passed=1)

    def compare(name, command, environ, log):
        assert command[1:] == ["-m", "devtools.golden", "--windows"]
        return Stage(name, passed=9, failed=1)

    monkeypatch.setattr(real_blender_tests, "ensure_blender", lambda: None)
    monkeypatch.setattr(real_blender_tests, "find_blender", lambda: SimpleNamespace(version=version))
    monkeypatch.setattr(real_blender_tests, "_run", run)
    monkeypatch.setattr(real_blender_tests, "window_stage", show)
    monkeypatch.setattr(real_blender_tests, "counted", compare)
    found = real_blender_tests.real_blender_stages({}, backend=backend)
    assert set(compared) == {Path(script).stem for script in real_blender_tests.WINDOW_SCRIPTS}
    assert len(found) == len(real_blender_tests.windows()) + 2 and found[-1].name == "photographs"
    assert (found[-1].failed, found[-1].verdict == "SKIPPED") == (code, not code)
    with_floor = {Path(script).stem for script in real_blender_tests.WITH_FLOOR}
    expected = {script: name for script, name in real_blender_tests.PHOTOGRAPHS.items() if script not in with_floor}
    assert {script: name for script, name in compared.items() if name} == expected


def test_each_script_that_drives_a_window_is_a_stage():
    own_jobs = ("long_", "record_")
    scripts = (path for path in (TESTS / "blender").glob("*.py") if not path.name.startswith(own_jobs))
    drivers = {path.name for path in scripts if "\ndrive(" in path.read_text(encoding="utf-8")}
    assert drivers | {"window.py"} == set(real_blender_tests.WINDOW_SCRIPTS)


@pytest.fixture
def stages(monkeypatch, tmp_path):
    """``stages(quick)`` -> (what each run of pytest was given: name -> (python, words), the table's stages); nothing is
    run.  Kernels are made only when reading has begun, and Blender's environments when another stage has."""

    def everything(quick, everywhere=False):
        runs, reads, compiled, begun, made = {}, Event(), Event(), Event(), Event()

        def run(name, python, words, environ, aside=False):
            assert name not in runs and aside
            runs[name] = (python, [str(word) for word in words])
            if not name.startswith("core, ") or name.removeprefix("core, ") in testing.WANT_BLENDER:
                assert made.is_set(), f"{name} does not wait for what it needs"
            elif name in ("core, read", "core, project", testing.WITHOUT_KERNELS_STAGE):
                reads.set()
            else:
                assert compiled.is_set(), f"{name} does not wait for kernels"
                begun.set()
            return Stage(name, passed=1)

        def make_kernels(pythons):
            assert reads.wait(600), "nothing else runs meanwhile"
            assert sorted(set(pythons)) == ["3.13"] if quick else ["3.11", "3.13"]
            compiled.set()

        def make_ready(quick, kernels):
            assert begun.wait(600), "nothing else runs meanwhile"
            made.set()
            pythons = {name: Path(name) for name in testing.OTHERS}
            zips = dict.fromkeys(testing.PYTHONS, Path("the.zip"))
            return testing.Ready(Stage("extension zips", passed=1), zips, pythons)

        monkeypatch.setattr(testing, "_pytest", run)
        monkeypatch.setattr(testing, "_make_ready", make_ready)
        monkeypatch.setattr(testing, "make_kernels", make_kernels)
        monkeypatch.setattr(testing, "real_blender_stages", lambda zips: [Stage("real blender", passed=1)])
        monkeypatch.setattr(testing, "ensure", lambda environment: environment.name)
        monkeypatch.setattr(testing, "ensure_bpy", lambda version: version)
        monkeypatch.setattr(testing, "find_python", lambda version: version)
        monkeypatch.setattr(testing, "_catalogue", lambda: Stage("catalogue", passed=1))
        monkeypatch.setattr(testing, "BUILD", tmp_path)  # the tests that run now use the other one
        monkeypatch.setattr(testing, "FIGURES", tmp_path / "figures.json")
        return runs, testing._everything(["-x"], quick, everywhere)

    return everything


def test_what_needs_a_package_of_the_extras_has_their_mark():
    """Without it no stage runs the test, which is a failure in CI."""
    checked = 0
    for file in TESTS.rglob("test_*.py"):
        functions = (node for node in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(node, ast.FunctionDef))
        for function in functions:
            if re.search(r"importorskip\('(matplotlib|highdicom)", ast.unparse(function.body)):
                checked += 1
                assert "pytest.mark.extras" in map(ast.unparse, function.decorator_list), f"{file}: {function.name}"
    assert checked


def test_each_test_runs_in_one_stage(stages):
    """What the core leaves out, the extras take, in the environment that has what they want."""
    runs, table = stages(False)
    folders = {file.relative_to(TESTS).parts[0] for file in TESTS.rglob("test_*.py")}
    core = {name.removeprefix("core, "): words for name, (_, words) in runs.items() if name.startswith("core, ")}
    assert set(core) == folders - {"blender", "stability"} | {"without kernels"}
    before = [str(path) for path in testing.WITHOUT_KERNELS]
    words = core.pop(testing.WITHOUT_KERNELS_STAGE.removeprefix("core, "))
    assert set(before) < set(words) and all(map(os.path.isfile, before))
    assert {f"--ignore={path}" for path in before} < set(core["unit"])
    for folder, words in core.items():
        assert str(TESTS / folder) in words and words[words.index("-m") + 1] == "not deep and not extras"
    python, words = runs[testing.EXTRAS_STAGE]
    assert python == Path("bench") and words[0] == "tests" and words[words.index("-m") + 1] == "extras"
    python, words = runs[testing.CLUSTER_STAGE]
    assert python == Path("cluster") and words[0] == str(testing.CLUSTER_TESTS)
    assert f"--ignore={words[0]}" in core["cli"]
    assert "not deep" in runs["hard cases"][1] and str(TESTS / "stability") in runs["hard cases"][1]
    versions = [f"bpy {version}" for version in testing.BPY]
    assert all(str(TESTS / "blender") in runs[name][1] for name in versions)
    marked = [words[words.index("-m") + 1] if "-m" in words else "" for words in (runs[name][1] for name in versions)]
    every = "every_blender and not deep"
    assert marked == ["(every_blender or oldest_blender) and not deep", every, every, ""]
    assert len(runs) == len(core) + len(versions) + 4
    assert {stage.name for stage in table} == {*runs, "extension zips", "real blender"}


def test_everything_runs_everywhere_on_demand(stages):
    runs, _ = stages(False, True)
    assert not any("every_blender" in words or "deep" in " ".join(words) for _, words in runs.values())


def test_zips_wait_for_kernels_and_the_real_blender_does_not(monkeypatch):
    """A Blender that cannot be had ends nothing."""
    kernels, done = Future(), []

    def ensure_blender():
        done.append("blender")
        raise Failure("none")

    def ensure_bpy(version):
        done.append(version)
        if len(done) > len(testing.BPY):
            kernels.set_result(None)

    monkeypatch.setattr(testing, "ensure_blender", ensure_blender)
    monkeypatch.setattr(testing, "ensure_bpy", ensure_bpy)
    monkeypatch.setattr(testing, "find_python", lambda version: version)
    monkeypatch.setattr(testing, "_other", Path)
    monkeypatch.setattr(testing, "_zips", lambda pythons: done.append(kernels.done()) or testing.Ready())
    ready = testing._make_ready(False, kernels)
    assert done == ["blender", *reversed(testing.BPY), True] and set(ready.pythons) == set(testing.OTHERS)


def test_parts_begin_in_their_order():
    """The longest first: see testing.LONGEST."""
    names = list(testing.parts())
    assert tuple(names[: len(testing.LONGEST)]) == testing.LONGEST and len(names) > len(testing.LONGEST)


def test_quick_says_what_it_leaves_out(stages):
    runs, table = stages(True)
    assert [name for name in runs if name.startswith("bpy")] == ["bpy 5.3"] and testing.EXTRAS_STAGE not in runs
    left_out = {stage.name for stage in table if stage.verdict == "SKIPPED"}
    assert left_out | set(runs) == set(stages(False)[0]) | {"real blender"}
    assert {"hard cases", "core, truths"} < left_out
    assert "every_blender and not deep" in runs.pop("bpy 5.3")[1]
    assert all("not slow" in words[words.index("-m") + 1] for _, words in runs.values())


def test_marks_are_left_out_in_pytests_own_words():
    assert testing._leave_out() == [] and testing._leave_out("slow", "extras") == ["-m", "not slow and not extras"]


def test_each_part_runs_alone_and_makes_only_what_it_needs(monkeypatch, capsys):
    """A part of the core needs nothing made; one of Blender needs the zip, and is not run without it."""
    made, run = [], []

    def zip_stage(zips):
        made.append("zip")
        return testing.Ready(Stage("extension zips", passed=bool(zips), failed=not zips), zips)

    def other(name):
        made.append(name)
        return Path(name)

    def part(needs):
        return testing.Part(lambda ready, aside: run.append((needs, aside)) or [Stage(needs, passed=1)], needs)

    monkeypatch.setattr(testing, "_other", other)
    monkeypatch.setattr(testing, "parts", lambda *options, **more: {name: part(name) for name in ("", "zip", "bench")})
    for zips, code in (({"3.13": Path("the.zip")}, 0), ({}, 1)):
        monkeypatch.setattr(testing, "_zips", lambda pythons, zips=zips: zip_stage(zips))
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
        for arguments in (((), False), (("-x",), False))
    }
    assert list(names.values()) == [["hard cases", "catalogue"], ["hard cases"]]


THREE_TESTS = """
import os, time, pytest
def test_good(): pass
def test_bad(): assert 0
def test_skipped(): pytest.importorskip("no_such_package")
@pytest.mark.xfail
def test_expected(): assert 0
def test_last(): {last}
def test_never_reached(): pass
"""


# A window whose first check prints a traceback as it should, and whose second fails.
WINDOW = """
import traceback
def a_check(): raise AssertionError("two\\nlines")
try: raise ValueError("foreseen")
except ValueError: traceback.print_exc()
print("first passed, 0.1 s")
try: a_check()
except AssertionError: traceback.print_exc()
print("1 passed, 1 failed, 0 skipped")
raise SystemExit(1)
"""


def test_times_of_a_whole_run_fill_the_pages_table(monkeypatch, tmp_path):
    """Each stage counts in one row, and what no stage used is that of making things."""
    monkeypatch.setattr(stage_times, "TIMES", tmp_path / "test" / "stages.json")
    names = ("core, unit", "bpy 4.5", "bpy 5.3", "real blender 5.2, panels", "photographs", "core, cli", "Dask")
    stage_times.save([Stage(name, passed=2, seconds=3.0, processor=-1e6) for name in names], 60.0)
    stages = [Stage(**stage) for stage in json.loads(stage_times.TIMES.read_text())]
    page = stage_times.filled(stage_times.PAGE.read_text(encoding="utf-8"), stages)
    found = {row[1].strip(): row[3:5] for line in page.splitlines() if len(row := line.split("|")) == 6}
    assert found["windows of a real Blender"] == [" 6 (4) ", " -2000000 "]
    assert found["older ones"] == found["the newest Blender's module"] == [" 3 (2) ", " -1000000 "]
    assert found["all others"] == [" 6 (4) ", " -2000000 "] and found["`truths`"] == ["  ", " 0 "]
    assert found["the whole command"][0] == " 60 (14) " and float(found[stage_times.MAKING][1]) >= 7e6


@pytest.fixture
def run_tests(tmp_path, monkeypatch):
    """``run_tests(last)``: the stage of a real run of THREE_TESTS whose last test does this."""

    def run(last):
        (tmp_path / "test_file.py").write_text(THREE_TESTS.format(last=last))
        report = tmp_path / "report.jsonl"
        words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", tmp_path, tmp_path]
        return stages_module.measured("some", [*words, f"--report-log={report}"], dict(os.environ), report, True)

    return run


def test_a_run_is_counted(run_tests):
    stage = run_tests("pass")
    assert (stage.passed, stage.failed, stage.skipped) == (3, 1, 2) and 0.1 < stage.processor
    assert any("no_such_package" in remark for remark in stage.remarks)


def test_results_are_kept_when_a_run_ends_early(run_tests):
    stage = run_tests("os._exit(9)")
    assert (stage.passed, stage.failed, stage.skipped) == (1, 2, 2)
    assert "it ended with code 9 in test_file.py::test_last" in stage.remarks


def test_a_run_that_never_begins_is_a_failure(tmp_path):
    words = [sys.executable, "-c", ""]
    stage = stages_module.measured("some", words, dict(os.environ), tmp_path / "report.jsonl", True)
    assert stage.verdict == "FAILED" and stage.remarks == ["it ended with code 0 before it reported"]


def test_the_end_of_a_run_shows_what_failed(run_tests, tmp_path, capsys):
    """Of a long log often only the end is at hand."""
    of_pytest = run_tests("pass")
    script = tmp_path / "window.py"
    script.write_text(WINDOW)
    of_window = stages_module.counted("panels", [sys.executable, script], dict(os.environ), tmp_path / "window.txt")
    broken = stages_module.broken("zips", "no compiler")
    capsys.readouterr()
    stages_module.summary([of_pytest, Stage("good", passed=1, clues=["unseen"]), of_window, broken])
    _, end = capsys.readouterr().out.split("FAILED: some\n")
    assert "    E   assert 0\n" in end and "test_file.py::test_bad" in end
    window = end.partition("FAILED: panels\n")[2]
    assert "in a_check" in window and "    AssertionError: two\n" in window and "foreseen" not in window
    assert "FAILED: zips\n    no compiler\n" in window and "unseen" not in end
    assert "\n5 passed, 3 failed, 2 skipped\n" in window


CRASH = """
import faulthandler
print(20 * "words\\n", flush=True)
faulthandler.enable()
def crash(): faulthandler._sigsegv()
crash()
"""


def test_a_crash_is_shown_with_what_python_did(tmp_path):
    words = [sys.executable, "-c", CRASH]
    stage = stages_module.counted("some", words, dict(os.environ), tmp_path / "log.txt")
    assert stage.remarks == ["it ended with code -11 and without its counts"]
    assert stage.clues[0] == "Fatal Python error: Segmentation fault" and "in crash" in stage.clues[2]


def test_a_traceback_before_a_check_that_passed_is_no_clue(tmp_path):
    lines = ["Traceback (most recent call last):", "first passed, 0.1 s", *["words"] * 9, "compiled"]
    words = [sys.executable, "-c", f"print(*{lines}, sep='\\n'); exit(1)"]
    stage = stages_module.counted("some", words, dict(os.environ), tmp_path / "log.txt")
    assert stage.clues[-1] == "compiled"


def test_each_test_has_a_limit_that_comes_first(pytestconfig):
    """Then the test fails by its name, and the stage goes on."""
    assert pytestconfig.pluginmanager.hasplugin("timeout")
    assert 0.0 < float(pytestconfig.getini("timeout")) < stages_module.SILENT_SECONDS


def test_a_test_that_no_signal_reaches_is_named_and_the_results_are_kept(run_tests, monkeypatch, tmp_path):
    report, now = tmp_path / "report.jsonl", [0.0]

    def pass_hours():
        """Time passes only while the last test runs, so a slow start of pytest is no hang."""
        now[0] += 3600.0 * (report.is_file() and "test_last" in report.read_text())
        return now[0]

    monkeypatch.setattr(stages_module, "time", SimpleNamespace(monotonic=pass_hours, sleep=time.sleep))
    stage = run_tests("time.sleep(10_000)")
    assert (stage.passed, stage.failed, stage.skipped) == (1, 2, 2)
    assert "stopped in test_file.py::test_last: nothing happened for 2700 s" in stage.remarks


@pytest.mark.parametrize("ci, code", (("", 0), ("true", 1)))
def test_what_the_machine_lacks_is_said_last_and_fails_in_ci(monkeypatch, capsys, ci, code):
    monkeypatch.setenv("CI", ci)
    tests = {"one": "could not import 'a': no", "two": "could not import 'a': no", "three": "needs a scan"}
    ran = Stage("core", passed=1, tests=tests)
    elsewhere = Stage("other", passed=1, tests={"two": "", "file.py::four": ""})
    ran.tests["file.py"] = "could not import 'a': no"
    lacking = Stage("real blender", skipped=1, missing="no blender")
    assert stages_module.summary([ran, elsewhere, lacking]) == code
    *_, counts, last = capsys.readouterr().out.splitlines()
    assert counts == "2 passed, 0 failed, 1 skipped"
    assert last == "NOT TESTED on this machine: real blender (no blender); 1 tests (could not import 'a': no)."
    elsewhere.tests["one"] = ""
    assert stages_module.summary([ran, elsewhere]) == 0
