"""Every test that this machine can run: the core, the installed zip in each bpy, a real Blender; and one summary."""

from __future__ import annotations

import shutil
import time
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from .build import build
from .catalogue import FIGURES_VARIABLE, PAGE, table
from .environments import BPY, CORE, ensure, ensure_bench, ensure_bpy
from .places import BUILD, KERNELS, OUT, ROOT, Failure, clean_environ, say
from .pythons import find_python
from .real_blender_tests import WHOLE, real_blender_stage, window_stage
from .stages import Stage, broken, judged, skipped, summary
from .wheels import this_platform

BLENDER_TESTS = ROOT / "tests" / "blender"
STABILITY_TESTS = ROOT / "tests" / "stability"
REPORTS = OUT / "test"
FIGURES = REPORTS / "catalogue.json"

# A stage that takes longer hangs: bpy 4.5 can deadlock when the interpreter ends.
CORE_SECONDS = 1500
BPY_SECONDS = 600
EXTRAS_SECONDS = 600

SLOW, EXTRAS = "slow", "extras"  # marks of tests
EXTRAS_STAGE = "VTK, VolPack, plots"


def _pytest(name: str, python: Path, arguments, seconds: float, environ, aside: bool = False) -> Stage:
    """One pytest run in an environment; ``aside``: beside another, so that its output is shown when it has ended."""
    report = REPORTS / f"{name.replace(' ', '-')}.xml"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    log = report.with_suffix(".txt") if aside else None
    if not aside:
        say(f"\n=== {name}")
    words = [python, "-m", "pytest", "-q", f"--junit-xml={report}", *arguments]
    return judged(name, words, seconds, environ, report, log)


def _leave_out(*marks: str) -> list[str]:
    """pytest's words for a run without the tests that have one of these marks."""
    return ["-m", " and ".join(f"not {mark}" for mark in marks)] if marks else []


def _core(arguments, name: str = "core", aside: bool = False) -> Stage:
    environ = clean_environ(RLE_SPLAT_CACHE=str(KERNELS), **{FIGURES_VARIABLE: str(FIGURES)})
    return _pytest(name, ensure(CORE), ["--ignore=tests/blender", *arguments], CORE_SECONDS, environ, aside)


def _without_hard_cases(options) -> Stage:
    """The core's tests but for the catalogue of hard cases."""
    others = ["--ignore=tests/blender", "--ignore=tests/stability", *options]
    return _pytest("core", ensure(CORE), others, CORE_SECONDS, clean_environ(RLE_SPLAT_CACHE=str(KERNELS)))


def _extras(environment: Future, options) -> Stage:
    """The tests of what the benchmarks' environment alone has, beside others; ``environment``: its Python to be."""
    try:
        python = environment.result()
    except Failure as problem:
        return skipped(EXTRAS_STAGE, str(problem))
    # Of the folders left out, the one wants bpy and the other hypothesis to be read at all.
    words = ["tests", "--ignore=tests/blender", "--ignore=tests/stability", "-m", EXTRAS, *options]
    environ = clean_environ(RLE_SPLAT_CACHE=str(KERNELS), LIBGL_ALWAYS_SOFTWARE="1")
    return _pytest(EXTRAS_STAGE, python, words, EXTRAS_SECONDS, environ, aside=True)


def _hard_cases(options, whole: bool) -> list[Stage]:
    """The catalogue of hard cases, beside others; ``whole``: every case of it is to have been measured."""
    stages = [_core([STABILITY_TESTS, *options], "hard cases", aside=True)]
    return [*stages, _catalogue()] if whole else stages


def _catalogue() -> Stage:
    """Whether every case of the catalogue was measured, in the run just before."""
    try:
        table(FIGURES)
    except Failure as problem:
        return broken("catalogue", str(problem))
    return Stage("catalogue", passed=1)


def _make_ready(quick: bool) -> None:
    """Blender's environments, before the hard cases that hold their pictures beside the core's look for them."""
    for version in _versions(quick):
        if find_python(BPY[version].pythons[0]) is not None:
            with suppress(Failure):  # its own stage says what is wrong
                ensure_bpy(version)


def _versions(quick: bool) -> list[str]:
    return ["5.0"] if quick else list(BPY)


def _bpy(version: str, zip_path: Path, arguments) -> Stage:
    name = f"bpy {version}"
    wanted = BPY[version].pythons[0]
    if find_python(wanted) is None:
        return skipped(name, f"it needs Python {wanted}, which is neither on PATH nor under pyenv")
    try:
        python = ensure_bpy(version)
    except Failure as problem:
        return broken(name, str(problem))
    user = BUILD / "test-user" / version
    shutil.rmtree(user, ignore_errors=True)
    user.mkdir(parents=True)
    environ = clean_environ(
        RLE_SPLAT_EXTENSION_ZIP=str(zip_path), BLENDER_USER_RESOURCES=str(user), LIBGL_ALWAYS_SOFTWARE="1"
    )
    stage = _pytest(name, python, arguments, BPY_SECONDS, environ)
    shutil.rmtree(user, ignore_errors=True)
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


def _blender_stages(zip_path: Path, paths, options, quick: bool, everything: bool) -> list[Stage]:
    """The installed zip in each bpy and, with ``everything``, in a real Blender."""
    stages = []
    for version in BPY:
        if version not in _versions(quick):
            stages.append(skipped(f"bpy {version}", "left out by --quick"))
        else:
            stages.append(_bpy(version, zip_path, [*(paths or [BLENDER_TESTS]), *options]))
    if everything and quick:
        stages.append(skipped("real blender", "left out by --quick"))
    elif everything:
        stages += [real_blender_stage(zip_path), window_stage(zip_path)]
    return stages


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
            stages.append(broken("extension zip", str(problem)))
    with ThreadPoolExecutor(1) as beside:
        hard = extras = None
        if everything or core:
            FIGURES.unlink(missing_ok=True)
            unwanted = [SLOW] if quick else []
            if core:
                stages.append(_core([*core, *_leave_out(*unwanted), *options]))
            else:
                ensure(CORE)  # before the other one is made, so that they do not both install what the system lacks
                bench = None if quick else beside.submit(ensure_bench)
                stages.append(_without_hard_cases([*_leave_out(*unwanted, EXTRAS), *options]))
                _make_ready(quick)
                # After the core, which has compiled most of their kernels, and beside Blender's.
                hard = beside.submit(_hard_cases, [*_leave_out(*unwanted), *options], not (quick or options))
                extras = beside.submit(_extras, bench, options) if bench else None
        blenders = _blender_stages(zip_path, blender, options, quick, everything) if zip_path else []
        stages += [*(hard.result() if hard else ()), *([extras.result()] if extras else ()), *blenders]
        if everything and quick:
            stages.append(skipped(EXTRAS_STAGE, "left out by --quick"))
    return summary(stages)


def test_catalogue() -> int:
    """The catalogue of hard cases alone; when all of it holds, docs/stability.md is written from its figures."""
    FIGURES.unlink(missing_ok=True)
    stages = [_core([STABILITY_TESTS])]
    if not stages[0].failed:
        stages.append(_catalogue())
    failed = summary(stages)
    if not failed:
        PAGE.write_text(table(FIGURES), encoding="utf-8")
        say(f"Wrote {PAGE.relative_to(ROOT)}")
    return failed


def test_real_blender() -> int:
    """The whole of tests/blender inside the real Blender, and what needs its window."""
    zip_path = build((this_platform(),), output=BUILD / "zip-test")[this_platform()]
    return summary([real_blender_stage(zip_path, WHOLE), window_stage(zip_path)])
