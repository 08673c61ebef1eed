"""Kernels that are compiled ahead by a process of their own.

In the module bpy, which is always in the background, no timer runs: these tests call what the timer calls.
tests/blender/window.py has the timer.
"""

import os
import sys
import time

import bpy
import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the tests look at a process as Unix shows it")


def until(condition):
    while not (found := condition()):
        time.sleep(0.1)
    return found


@pytest.fixture
def ahead(bridge, core, monkeypatch, tmp_path):
    """The module, with an empty folder for kernels, and no process left at the end."""
    if not core("runtime.jit").compiled():
        pytest.skip("nothing is compiled without numba")
    monkeypatch.setenv("RLE_SPLAT_CACHE", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    module = bridge("kernel_preparation")
    monkeypatch.setattr(module, "is_needed", lambda: True)
    yield module
    module.end()


@pytest.fixture
def lock(bridge, core, tmp_path):
    """``with lock() as free``: the lock of the folder, as another Blender's process holds it."""
    return lambda: core("runtime.file_lock").only_one(tmp_path / bridge("prepare_process").LOCK)


def is_alive(process) -> bool:
    return process is not None and process.poll() is None


def test_nothing_is_prepared_in_background_mode(ahead):
    assert bpy.app.background
    ahead.begin()
    assert not bpy.app.timers.is_registered(ahead._tick)
    assert ahead._Preparing.process is None and ahead.text() == ""


def test_the_process_compiles_what_this_blender_will_look_for(ahead, core, tmp_path):
    """In a folder of this name, under the name that the renderer has here, at low priority; it ends when asked."""
    prepare, jit = core("pipeline.prepare"), core("runtime.jit")
    for _ in prepare._picture_steps(prepare.PICTURES[0], prepare.STORED_TYPES[0]):
        pass
    ours = {path.relative_to(jit.KERNELS) for path in jit.KERNELS.rglob("*.nbi")}
    assert ahead.advance() == ahead.POLL
    process = ahead._Preparing.process
    assert is_alive(process) and ahead.text() == ahead.describe(None)
    theirs = tmp_path / jit.KERNELS.name
    until(lambda: not is_alive(process) or len(list(theirs.rglob("*.nbi"))) > 1)
    assert {path.relative_to(theirs) for path in theirs.rglob("*.nbi")} <= ours
    ours_nice = os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, process.pid) == min(ours_nice + 10, 19)
    assert ahead.advance() == ahead.POLL and ahead._Preparing.process is process
    ahead.unregister()
    assert not is_alive(process) and ahead.text() == ""
    ahead.register()


def test_the_process_says_how_long_it_will_take(bridge, core, monkeypatch, tmp_path, capfd):
    """As soon as a tenth of the work is done; before, its first seconds say little about the rest."""
    module, progress = bridge("prepare_process"), core("runtime.steps").Progress
    clock = iter(range(100))
    monkeypatch.setattr(module.time, "monotonic", lambda: float(next(clock)))
    state = tmp_path / module.STATE
    told = []

    def work():
        for fraction in (0.02, 0.1, 0.2, 0.5):
            yield progress(fraction, "")
            told.append(state.read_text() if state.exists() else "")

    assert module.follow(work(), state) == 0
    assert told == ["", "", "12", "4"]  # begun at 0; the third comes at 3 with four times as much left, the fourth at 4
    assert capfd.readouterr().out == "...."


def test_there_is_one_process_for_all_blenders_that_share_the_folder(ahead, bridge, lock, tmp_path):
    """Others show its state, and take over when it has ended."""
    with lock() as free:
        assert free
        with lock() as again:
            assert not again
        process = ahead.start()
        assert process.wait() == bridge("prepare_process").BUSY
        process.stdout.close()
        (tmp_path / "preparing.txt").write_text("42")
        assert ahead.advance() == ahead.POLL
        assert ahead._Preparing.process is None and ahead.text() == ahead.describe(42.0)
    ahead.advance()
    assert is_alive(ahead._Preparing.process) and ahead.text() == ahead.describe(None)


def test_one_that_finds_another_at_work_waits_for_it(ahead, lock):
    """Both looked whether the lock is free at the same time."""
    with lock():
        ahead._Preparing.process = ahead.start()
        ahead._Preparing.process.wait()
        assert ahead.advance() == ahead.POLL and ahead._Preparing.process is None


def test_the_process_ends_itself_when_nobody_holds_its_pipe(ahead, bridge):
    """As after a crash of Blender."""
    process = ahead.start()
    process.stdout.close()
    assert process.wait() == bridge("prepare_process").GONE


def test_a_lock_goes_with_the_process_that_held_it(ahead, lock):
    process = ahead.start()
    assert process.stdout.read(1) == b"."  # it is at work
    with lock() as free:
        assert not free
    process.kill()
    process.wait()
    process.stdout.close()
    with lock() as free:
        assert free


def test_a_process_that_fails_is_told_of_once(ahead, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(ahead, "command", lambda folder: [sys.executable, "-c", "raise SystemExit(7)"])
    until(lambda: ahead.advance() is None)
    said = capsys.readouterr().out
    assert said.count("RLE Splat:") == 1 and "exit code 7" in said and str(tmp_path / "preparing.log") in said
    assert ahead._Preparing.process is None and ahead.text() == ""


def test_a_process_that_cannot_be_started_is_told_of(ahead, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(ahead, "command", lambda folder: [str(tmp_path / "no program")])
    assert ahead.advance() is None and "no program" in capsys.readouterr().out


def test_a_process_that_is_done_leaves_nothing_to_do(ahead, monkeypatch):
    """Even where its kernels are not those that this Blender looks for."""
    monkeypatch.setattr(ahead, "command", lambda folder: [sys.executable, "-c", ""])
    until(lambda: ahead.advance() is None)
    assert ahead._Preparing.process is None and ahead.text() == ""


def test_where_all_is_there_no_process_is_started(ahead, monkeypatch):
    monkeypatch.setattr(ahead, "is_needed", lambda: False)
    assert ahead.advance() is None and ahead._Preparing.process is None


def test_switched_off_in_the_preferences_the_process_ends(ahead, addon):
    preferences = bpy.context.preferences.addons[addon.__name__].preferences
    assert preferences.prepare_kernels
    ahead.advance()
    process = ahead._Preparing.process
    preferences.prepare_kernels = False
    try:
        assert ahead.advance() is None and not is_alive(process)
    finally:
        preferences.prepare_kernels = True


@pytest.mark.parametrize(("program", "known"), [
    ("/opt/blender/5.0/python/bin/python3.11", True), ("C:/Blender/5.0/python/bin/python.exe", True),
    ("/usr/bin/blender", False), ("", False)])
def test_only_a_python_is_started(ahead, program, known):
    """Where Blender has none of its own, ``sys.executable`` may be anything."""
    assert ahead.child_python.is_python(program) == known


@pytest.mark.parametrize(("seconds", "words"), [
    (None, "kernels:"), (0.4, "10 s"), (38.0, "40 s"), (94.0, "90 s"), (130.0, "2 min")])
def test_what_is_left_is_said_in_round_numbers(ahead, seconds, words):
    assert words in ahead.describe(seconds)
