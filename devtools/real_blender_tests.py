"""The tests in a real Blender executable: the short scripts of every run, without and with a window, and the whole of
tests/blender on demand."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

from .build import build
from .environments import CORE, ensure, pip
from .places import BUILD, PYTHONS, REQUIREMENTS, ROOT, Failure, say
from .real_blender import Blender, environ_for, find_blender
from .stages import Stage, broken, counted, judged, skipped
from .wheels import this_platform

SHORT = "real_blender.py"
WINDOW = "window.py"
WHOLE = "whole_suite.py"
TESTS = ROOT / "tests" / "blender"
PYTEST_PINS = REQUIREMENTS / "pytest.txt"

# Longer means that it hangs; the whole suite takes some minutes on two cores.
SECONDS = {SHORT: 300, WINDOW: 300, WHOLE: 1200}


def _lent_pytest() -> Path:
    """A folder with pytest and nothing else, of pure Python, for a Blender whose own Python has none."""
    folder = BUILD / "pytest"
    wanted = hashlib.sha256(PYTEST_PINS.read_bytes()).hexdigest()
    stamp = folder / "ready.sha256"
    if not stamp.is_file() or stamp.read_text() != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        arguments = ["install", "--quiet", "--require-hashes", "--only-binary=:all:", "--target", folder]
        pip(ensure(CORE), [*arguments, "-r", PYTEST_PINS], "pip could not fetch pytest.")
        stamp.write_text(wanted)
    return folder


def _workplace(blender: Blender, zip_path: Path, with_pytest: bool) -> Path:
    """A folder that the Blender can see, with the tests and the zip that fits its Python."""
    if blender.python not in PYTHONS:  # Debian's Blender runs on the system's Python
        zip_path = build((this_platform(),), (blender.python,), BUILD / f"zip-{blender.python}")[this_platform()]
    folder = (blender.root or BUILD) / "rle_splat_test"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(TESTS, folder / "tests/blender", ignore=shutil.ignore_patterns("__pycache__"))
    if with_pytest:
        shutil.copytree(_lent_pytest(), folder / "pytest")
    shutil.copy(ROOT / "pyproject.toml", folder)
    shutil.copy(TESTS.parent / "conftest.py", folder / "tests")
    shutil.copy(zip_path, folder / "extension.zip")
    (folder / "user").mkdir()
    return folder


@contextmanager
def _virtual_screen(blender: Blender):
    """An X server without a screen, on a number that is free; yields what DISPLAY has to be."""
    command = [*blender.command[:-1], "Xvfb", "-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    try:
        server = subprocess.Popen(
            command, env=environ_for(blender), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
    except FileNotFoundError:
        raise Failure("a window needs the program Xvfb, which is not on PATH; install the package xvfb") from None
    try:
        number = server.stdout.readline().strip()
        if not number:
            raise Failure("Xvfb, the virtual screen for a window, did not start")
        yield f":{number}"
    finally:
        server.terminate()
        server.wait()


def window_stage(zip_path: Path) -> Stage:
    """What only a window does (F12 off the main thread, work from a timer, Esc), on a virtual screen."""
    try:
        blender = find_blender()
        with _virtual_screen(blender) as display:
            return real_blender_stage(zip_path, WINDOW, display)
    except Failure as problem:
        return skipped("real blender, window", str(problem))


def real_blender_stage(zip_path: Path, script_name: str = SHORT, display: str = "") -> Stage:
    """A script of tests/blender in a real executable, with the extension's zip; in a window where there is a
    ``display`` for it, else in the background."""
    try:
        blender = find_blender()
    except Failure as problem:
        return skipped("real blender", str(problem))
    name = f"real blender {blender.version[0]}.{blender.version[1]}" + (", window" if display else "")
    try:
        folder = _workplace(blender, zip_path, script_name == WHOLE)
    except Failure as problem:
        return broken(name, str(problem))
    environ = environ_for(
        blender,
        RLE_SPLAT_EXTENSION_ZIP=blender.inside(folder / "extension.zip"),
        RLE_SPLAT_PYTEST=blender.inside(folder / "pytest"),
        RLE_SPLAT_JUNIT=blender.inside(folder / "report.xml"),
        BLENDER_USER_RESOURCES=blender.inside(folder / "user"),
        LIBGL_ALWAYS_SOFTWARE="1",
        **({"DISPLAY": display} if display else {}),
    )
    place = "--enable-event-simulate" if display else "--background"
    script = blender.inside(folder / "tests/blender" / script_name)
    command = [*blender.command, place, "--factory-startup", "--python-exit-code", "1", "--python", script]
    say(f"\n=== {name} ({blender.label}, Python {blender.python})")
    if script_name != WHOLE:
        stage = counted(name, command, SECONDS[script_name], environ)
    else:
        stage = judged(name, command, SECONDS[script_name], environ, folder / "report.xml")
    stage.remarks.insert(0, f"{blender.label}, Python {blender.python}")
    shutil.rmtree(folder, ignore_errors=True)
    return stage
