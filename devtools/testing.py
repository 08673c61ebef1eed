"""Every test that this machine can run: the core, the installed zip in each bpy, a real Blender; and one summary."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import time
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

from .build import build
from .environments import BPY, CORE, ensure, ensure_bpy, pip
from .places import BUILD, OUT, PYTHONS, REQUIREMENTS, ROOT, Failure, clean_environ, say
from .pythons import find_python
from .real_blender import Blender, environ_for, find_blender
from .wheels import this_platform

BLENDER_TESTS = ROOT / "tests" / "blender"
REAL_BLENDER_SCRIPT = BLENDER_TESTS / "real_blender.py"
PYTEST_PINS = REQUIREMENTS / "pytest.txt"
REPORTS = OUT / "test"

# A stage that takes longer hangs: bpy 4.5 can deadlock when the interpreter ends.
CORE_SECONDS = 900
BPY_SECONDS = 420
REAL_BLENDER_SECONDS = 420


@dataclass
class Stage:
    """The outcome of one stage; ``remarks`` say why something was skipped or what broke."""

    name: str
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    seconds: float = 0.0
    remarks: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        return "FAILED" if self.failed else "passed" if self.passed else "SKIPPED"


def _skipped(name: str, why: str) -> Stage:
    say(f"\n!!! {name} goes UNTESTED: {why}")
    return Stage(name, skipped=1, remarks=[why])


def _broken(name: str, why: str) -> Stage:
    say(f"\n!!! {name}: {why}")
    return Stage(name, failed=1, remarks=[why])


def _read_junit(stage: Stage, path: Path) -> None:
    """Add the counts and the distinct reasons for skips of one pytest run."""
    for case in ElementTree.parse(path).getroot().iter("testcase"):
        outcomes = {child.tag: child for child in case if child.tag in ("failure", "error", "skipped")}
        if "failure" in outcomes or "error" in outcomes:
            stage.failed += 1
        elif "skipped" in outcomes:
            stage.skipped += 1
            reason = (outcomes["skipped"].get("message") or "no reason given").splitlines()[0][:160]
            if reason not in stage.remarks:
                stage.remarks.append(reason)
        else:
            stage.passed += 1


def _run_limited(command, seconds: float, environ) -> int | None:
    """Run a command with its output shown; its exit code, or None when the time ran out."""
    try:
        return subprocess.run([str(part) for part in command], cwd=ROOT, env=environ, timeout=seconds).returncode
    except subprocess.TimeoutExpired:
        return None


def _judged(name: str, command, seconds: float, environ, report: Path) -> Stage:
    """Run a command that ends with pytest's exit code and writes ``report`` (JUnit's XML)."""
    stage = Stage(name)
    started = time.monotonic()
    code = _run_limited(command, seconds, environ)
    stage.seconds = time.monotonic() - started
    if report.is_file():
        _read_junit(stage, report)
    if code is None:
        stage.failed += 1
        stage.remarks.append(f"stopped after {seconds:.0f} s: it hung")
    elif code == 5:
        stage.skipped += 1
        stage.remarks.append("no tests were collected")
    elif (code != 0 or not report.is_file()) and not stage.failed:
        stage.failed += 1
        stage.remarks.append(f"it ended with code {code}" + ("" if report.is_file() else " before it reported"))
    return stage


def _pytest(name: str, python: Path, arguments, seconds: float, environ) -> Stage:
    """One pytest run in an environment."""
    report = REPORTS / f"{name.replace(' ', '-')}.xml"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    say(f"\n=== {name}")
    return _judged(name, [python, "-m", "pytest", "-q", f"--junit-xml={report}", *arguments], seconds, environ, report)


def _core(arguments) -> Stage:
    environ = clean_environ(NUMBA_CACHE_DIR=str(BUILD / "numba-cache"))
    return _pytest("core", ensure(CORE), ["--ignore=tests/blender", *arguments], CORE_SECONDS, environ)


def _bpy(version: str, zip_path: Path, arguments) -> Stage:
    name = f"bpy {version}"
    wanted = BPY[version].pythons[0]
    if find_python(wanted) is None:
        return _skipped(name, f"it needs Python {wanted}, which is neither on PATH nor under pyenv")
    try:
        python = ensure_bpy(version)
    except Failure as problem:
        return _broken(name, str(problem))
    user = BUILD / "test-user" / version
    shutil.rmtree(user, ignore_errors=True)
    user.mkdir(parents=True)
    environ = clean_environ(
        RLE_SPLAT_EXTENSION_ZIP=str(zip_path), BLENDER_USER_RESOURCES=str(user), LIBGL_ALWAYS_SOFTWARE="1"
    )
    stage = _pytest(name, python, arguments, BPY_SECONDS, environ)
    shutil.rmtree(user, ignore_errors=True)
    return stage


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


def _workplace(blender: Blender, zip_path: Path) -> Path:
    """A folder that the Blender can see, with the tests, pytest and the zip that fits its Python."""
    if blender.python not in PYTHONS:  # Debian's Blender runs on the system's Python
        zip_path = build((this_platform(),), (blender.python,), BUILD / f"zip-{blender.python}")[this_platform()]
    folder = (blender.root or BUILD) / "rle_splat_test"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(BLENDER_TESTS, folder / "tests/blender", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(_lent_pytest(), folder / "pytest")
    shutil.copy(ROOT / "pyproject.toml", folder)
    shutil.copy(BLENDER_TESTS.parent / "conftest.py", folder / "tests")
    shutil.copy(zip_path, folder / "extension.zip")
    (folder / "user").mkdir()
    return folder


def _real_blender(zip_path: Path) -> Stage:
    """tests/blender in a real executable."""
    try:
        blender = find_blender()
    except Failure as problem:
        return _skipped("real blender", str(problem))
    name = f"real blender {blender.version[0]}.{blender.version[1]}"
    try:
        folder = _workplace(blender, zip_path)
    except Failure as problem:
        return _broken(name, str(problem))
    environ = environ_for(
        blender,
        RLE_SPLAT_EXTENSION_ZIP=blender.inside(folder / "extension.zip"),
        RLE_SPLAT_PYTEST=blender.inside(folder / "pytest"),
        RLE_SPLAT_JUNIT=blender.inside(folder / "report.xml"),
        BLENDER_USER_RESOURCES=blender.inside(folder / "user"),
        LIBGL_ALWAYS_SOFTWARE="1",
    )
    script = blender.inside(folder / "tests/blender" / REAL_BLENDER_SCRIPT.name)
    command = [*blender.command, "--background", "--factory-startup", "--python-exit-code", "1", "--python", script]
    say(f"\n=== {name} ({blender.label}, Python {blender.python})")
    stage = _judged(name, command, REAL_BLENDER_SECONDS, environ, folder / "report.xml")
    stage.remarks.insert(0, f"{blender.label}, Python {blender.python}")
    shutil.rmtree(folder, ignore_errors=True)
    return stage


def _split(arguments) -> tuple[list[str], list[str], list[str]]:
    """pytest's arguments as (paths for the core, paths for bpy, everything else)."""
    core, blender, options = [], [], []
    for argument in arguments:
        path = Path(argument.split("::")[0])
        if argument.startswith("-") or not path.exists():
            options.append(argument)
        elif BLENDER_TESTS in (path.resolve(), *path.resolve().parents):
            blender.append(argument)
        else:
            core.append(argument)
    return core, blender, options


def _summary(stages: list[Stage]) -> int:
    passed, failed, skipped = (sum(getattr(s, key) for s in stages) for key in ("passed", "failed", "skipped"))
    say("\n" + "stage".ljust(20) + "result    passed  failed  skipped   seconds")
    for stage in stages:
        counts = f"{stage.passed:6d}  {stage.failed:6d}  {stage.skipped:7d}  {stage.seconds:8.1f}"
        say(f"{stage.name:<20}{stage.verdict:<8}  {counts}")
        for remark in stage.remarks:
            say(f"    {remark}")
    say()
    say(f"{passed} passed, {failed} failed, {skipped} skipped")
    return 1 if failed or not passed else 0


def test(arguments, quick: bool = False) -> int:
    """Run everything and print the summary; the exit code is 0 when nothing failed."""
    core, blender, options = _split(arguments)
    everything = not (core or blender)
    stages: list[Stage] = []
    zip_path = None
    if everything or blender:  # first, because the core's tests of the package want Blender's packaging tool
        started = time.monotonic()
        try:
            zip_path = build((this_platform(),), output=BUILD / "zip-test")[this_platform()]
            stages.append(Stage("extension zip", passed=1, seconds=time.monotonic() - started))
        except Failure as problem:
            stages.append(_broken("extension zip", str(problem)))
    if everything or core:
        stages.append(_core([*core, *(["-m", "not slow"] if quick else []), *options]))
    for version in BPY if zip_path else ():
        if quick and version != "5.0":
            stages.append(_skipped(f"bpy {version}", "left out by --quick"))
        else:
            stages.append(_bpy(version, zip_path, [*(blender or [BLENDER_TESTS]), *options]))
    if zip_path and everything:
        stages.append(_skipped("real blender", "left out by --quick") if quick else _real_blender(zip_path))
    return _summary(stages)
