"""Every test that this machine can run: the core, the installed zip in each bpy, a real Blender; and one summary.

nox runs one session after the other, and its report names no skipped test.  So one session of nox runs all stages
here, three at a time, and prints a table that says what was skipped, and why.  Each part of the run is a session of its
own as well.
"""

from __future__ import annotations

import shutil
import time
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import Callable

from . import stage_times
from .build import build_here
from .catalogue import FIGURES_VARIABLE, PAGE, table
from .environments import BPY, CLUSTER, CORE, ensure, ensure_bench, ensure_bpy, without_python
from .kernels import make_kernels
from .places import BPY_KERNELS, BPY_PYTHON, BUILD, KERNELS, PYTHONS, ROOT, Failure, clean_environ, pixels, say
from .real_blender import ensure_blender
from .real_blender_tests import WHOLE, real_blender_stages, window_stage
from .stages import REPORTS, Stage, broken, file_name, measured, skipped, summary, untested
from .uv import find_python
from .windows import windows_stages

TESTS_FOLDER = ROOT / "tests"
BLENDER_TESTS = TESTS_FOLDER / "blender"
STABILITY_TESTS = TESTS_FOLDER / "stability"
CLUSTER_TESTS = TESTS_FOLDER / "cli" / "cluster"
FIGURES = REPORTS / "catalogue.json"

AT_ONCE = 3  # stages: with two, a sixth of two cores was idle, while stages waited for processes and windows
WANT_BLENDER = ("unit",)  # folders with tests that use its tool for packages where it is at hand
NOTHING, MADE_KERNELS, EVERYTHING = "nothing", "kernels", "everything"  # what a part waits for
# What the core's folders wait for; others wait for kernels.
AFTER = {"read": NOTHING, "project": NOTHING} | dict.fromkeys(WANT_BLENDER, EVERYTHING)

# Files that call no kernel of a package: they run while those are compiled.
WITHOUT_KERNELS = tuple(
    TESTS_FOLDER / folder / f"test_{name}.py"
    for folder, names in {
        "unit": "body buffer_pool contrast gallery guess_byte_order kernel_cache larger_voxels lookup_table"
        " presets read_raw segment_masks shipped_kernels view",
        "cli": "bad_medical_files frames light_options",
        "truths": "metrics oracle several truths",
        "benchmarks": "data_sets help history",
        "effects": "ray_ends",
        "planner": "choosing",
    }.items()
    for name in names.split()
)
WITHOUT_KERNELS_STAGE = "core, without kernels"

# Threads of small pictures and matrices, which most tests make, wait for each other longer than they work.  Those of
# the first layer sleep meanwhile: 360 pictures of 32 x 32 pixels took 2.3 s of processor time, and 20.6 s with TBB,
# beside other stages.  BLAS with more than one took 1.6 times the processor time and no less time.
IDLE_THREADS = {
    "NUMBA_THREADING_LAYER_PRIORITY": "omp tbb workqueue", "OMP_WAIT_POLICY": "passive", "OPENBLAS_NUM_THREADS": "1",
}  # fmt: skip

SLOW, DEEP, EXTRAS = "slow", "deep", "extras"  # marks of tests
EVERY_BLENDER = f"every_blender and not {DEEP}"
OLDEST_BLENDER = f"(every_blender or oldest_blender) and not {DEEP}"
EXTRAS_STAGE = "VTK, VolPack, plots, DICOM"
CLUSTER_STAGE = "Dask"
REAL_BLENDER = "real-blender"
OLDEST, *_, NEWEST = BPY  # the newest Blender runs all of tests/blender
QUICK = ("project", "unit", "effects", "figure", "read", "cli")  # the core's folders that --quick runs

# The longest parts, which begin first; the others take a minute or less.
LONGEST = (
    REAL_BLENDER, "core-unit", f"bpy-{NEWEST}", "hard-cases", "core-truths", "core-effects", "bpy-5.0", "bpy-4.5",
    "bpy-5.2", "core-read", "core-without-kernels", "core-cli", "extras", "core-planner",
)  # fmt: skip

OTHERS = {"bench": ensure_bench, "cluster": lambda: ensure(CLUSTER)}  # make the environments that some tests want


@dataclass
class Ready:
    """What several stages need: the zip of each Python, with the stage of their making, and Pythons by name, or why
    there is none."""

    zip_stage: Stage | None = None
    zips: dict[str, Path] = field(default_factory=dict)
    pythons: dict[str, Path | Failure] = field(default_factory=dict)


@dataclass(frozen=True)
class Part:
    """A part of the whole run.

    ``run(ready, aside)`` returns its stages.  ``needs``: what it takes of Ready, "zip" or one of OTHERS.  ``after``: in
    the whole run it begins when nothing, the kernels or everything is made ready.
    """

    run: Callable[[Ready, bool], list[Stage]]
    needs: str = ""
    after: str = EVERYTHING


def _pytest(name: str, python: Path, arguments, environ, aside: bool = False) -> Stage:
    """One pytest run in an environment; ``aside``: beside another, so that its output is shown when it has ended."""
    report = REPORTS / f"{file_name(name)}.jsonl"
    report.unlink(missing_ok=True)
    say(f"\n=== {name}" + (" begins" if aside else ""))
    words = [python, "-m", "pytest", "-q", f"--report-log={report}", *arguments]
    return measured(name, words, {**environ, **IDLE_THREADS}, report, aside)


def _leave_out(*marks: str) -> list[str]:
    """pytest's words for a run without the tests that have one of these marks."""
    return ["-m", " and ".join(f"not {mark}" for mark in marks)] if marks else []


def _core(arguments, name: str = "core", aside: bool = False, **variables: str) -> Stage:
    environ = clean_environ(RLE_SPLAT_CACHE=str(KERNELS), **variables)
    return _pytest(name, ensure(CORE), ["--ignore=tests/blender", *arguments], environ, aside)


def core_folders() -> list[str]:
    """The folders of the core's tests but for the catalogue of hard cases."""
    others = (BLENDER_TESTS, STABILITY_TESTS)
    folders = [folder for folder in TESTS_FOLDER.iterdir() if any(folder.glob("test_*.py"))]
    return sorted(folder.name for folder in folders if folder not in others)


def _in_other(name: str, environment: Path | Failure, words, aside: bool) -> Stage:
    """Tests in an environment other than the core's; ``environment``: its Python, or why there is none."""
    if isinstance(environment, Failure):
        return untested(name, str(environment))
    environ = clean_environ(RLE_SPLAT_CACHE=str(KERNELS), LIBGL_ALWAYS_SOFTWARE="1")
    return _pytest(name, environment, words, environ, aside)


def _extras(environment: Path | Failure, options, aside: bool) -> Stage:
    """The tests of what the benchmarks' environment alone has."""
    # The folders left out want bpy, hypothesis and Dask to be read at all.
    ignored = [f"--ignore={folder}" for folder in (BLENDER_TESTS, STABILITY_TESTS, CLUSTER_TESTS)]
    words = ["tests", *ignored, "-m", EXTRAS, *options]
    return _in_other(EXTRAS_STAGE, environment, words, aside)


def _hard_cases(options, aside: bool, whole: bool) -> list[Stage]:
    """The catalogue of hard cases with the figures it measures; ``whole``: no test of it is left out."""
    FIGURES.unlink(missing_ok=True)
    stage = _core([STABILITY_TESTS, *options], "hard cases", aside, **{FIGURES_VARIABLE: str(FIGURES)})
    return [stage, _catalogue()] if whole else [stage]


def _catalogue() -> Stage:
    """Whether every case of the catalogue was measured, in the run just before."""
    try:
        table(FIGURES)
    except Failure as problem:
        return broken("catalogue", str(problem))
    return Stage("catalogue", passed=1)


def _zips(pythons=PYTHONS) -> Ready:
    """The extension's zips for this machine."""
    started = time.monotonic()
    try:
        zips = {python: build_here(python, BUILD / "zip-test") for python in pythons}
    except Failure as problem:
        return Ready(broken("extension zips", str(problem)))
    return Ready(Stage("extension zips", passed=1, seconds=time.monotonic() - started), zips)


def _make_ready(quick: bool, kernels: Future) -> Ready:
    """The real Blender and every environment, one after the other, so that no two of them install what the system
    lacks; then the zips, with the kernels."""
    if not quick:
        with suppress(Failure):  # the stages of each say what is wrong
            ensure_blender()
    for version in _versions(quick):
        if find_python(BPY[version].pythons[0]) is not None:
            with suppress(Failure):
                ensure_bpy(version)
    pythons = {} if quick else {name: _other(name) for name in OTHERS}
    kernels.result()
    ready = _zips(_pythons(_versions(quick)))
    ready.pythons = pythons
    return ready


def _make_kernels(quick: bool) -> None:
    """Make the kernels that zips and tests use, so that no test compiles them."""
    with suppress(Failure):  # the stages of the zips say what is wrong
        make_kernels([*_pythons(_versions(quick)), CORE.version])


def _other(name: str) -> Path | Failure:
    """The Python of one of OTHERS, or why there is none."""
    try:
        return OTHERS[name]()
    except Failure as problem:
        return problem


def _versions(quick: bool) -> list[str]:
    """The versions of bpy to test, the newest first: it runs the most tests."""
    return [NEWEST] if quick else list(reversed(BPY))


def _pythons(versions) -> list[str]:
    """The Pythons of these versions of bpy, each once."""
    return list(dict.fromkeys(BPY_PYTHON[version] for version in versions))


def _bpy(version: str, zips: dict[str, Path], arguments, aside: bool) -> Stage:
    name = f"bpy {version}"
    wanted = BPY[version].pythons[0]
    if find_python(wanted) is None:
        return untested(name, without_python(wanted))
    try:
        python = ensure_bpy(version)
    except Failure as problem:
        return broken(name, str(problem))
    user = BUILD / "test-user" / version
    shutil.rmtree(user, ignore_errors=True)
    user.mkdir(parents=True)
    environ = clean_environ(
        RLE_SPLAT_EXTENSION_ZIP=str(zips[BPY_PYTHON[version]]), BLENDER_USER_RESOURCES=str(user),
        LIBGL_ALWAYS_SOFTWARE="1", RLE_SPLAT_CACHE=str(BPY_KERNELS),
    )  # fmt: skip
    stage = _pytest(name, python, arguments, environ, aside)
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


def parts(options=(), quick: bool = False, everywhere: bool = False) -> dict[str, Part]:
    """The parts of the whole run by name, in their order; ``options``: pytest's.

    ``everywhere``: older versions of bpy run all of tests/blender, not only the tests marked for them; and the deep
    tests run.  ``quick``: only QUICK, and of the newest bpy those marked for every version.
    """
    slow = [*[SLOW] * quick, *[DEEP] * (not everywhere)]
    whole = not options

    def core(folder: str) -> Part:
        ignored = [f"--ignore={path}" for path in (CLUSTER_TESTS, *WITHOUT_KERNELS)]
        words = [TESTS_FOLDER / folder, *ignored, *_leave_out(*slow, EXTRAS), *options]
        return Part(
            lambda ready, aside: [_core(words, f"core, {folder}", aside)], after=AFTER.get(folder, MADE_KERNELS)
        )

    found = {}
    if not quick:
        found[REAL_BLENDER] = Part(lambda ready, aside: real_blender_stages(ready.zips), needs="zip")
        # It waits because it compares its pictures with those of Blender's Pythons.
        found["hard-cases"] = Part(lambda ready, aside: _hard_cases([*_leave_out(*slow), *options], aside, whole))
    found |= {f"core-{folder}": core(folder) for folder in core_folders() if folder in QUICK or not quick}
    files = [path for path in WITHOUT_KERNELS if path.parent.name in QUICK or not quick]
    words = [*files, *_leave_out(*slow, EXTRAS), *options]
    found["core-without-kernels"] = Part(
        lambda ready, aside, words=words: [_core(words, WITHOUT_KERNELS_STAGE, aside)], after=NOTHING
    )
    for version in _versions(quick):
        marks = OLDEST_BLENDER if version == OLDEST else EVERY_BLENDER
        whole_of_it = everywhere or (version == NEWEST and not quick)
        words = [BLENDER_TESTS, *(() if whole_of_it else ("-m", marks)), *options]
        found[f"bpy-{version}"] = Part(
            lambda ready, aside, version=version, words=words: [_bpy(version, ready.zips, words, aside)], needs="zip"
        )
    if not quick:
        found["extras"] = Part(lambda ready, aside: [_extras(ready.pythons["bench"], options, aside)], needs="bench")
        words = [CLUSTER_TESTS, *options]
        found["clusters"] = Part(
            lambda ready, aside: [_in_other(CLUSTER_STAGE, ready.pythons["cluster"], words, aside)], needs="cluster"
        )
    return {name: found[name] for name in dict.fromkeys((*LONGEST, *found)) if name in found}


def _everything(options, quick: bool, everywhere: bool = False) -> list[Stage]:
    """All stages, a few at a time: most of each is work for one core, or waiting.

    Each part begins as soon as it can: what draws nothing while kernels are compiled, and the windows, which take
    longest, as soon as their Blender is there.
    """
    ensure(CORE)
    found = list(parts(options, quick, everywhere).values())
    pending, stages, lock = list(found), {}, Lock()

    with ThreadPoolExecutor(AT_ONCE + 1) as workers:  # kernels and making take the places of two parts meanwhile
        kernels = workers.submit(_make_kernels, quick)
        making = workers.submit(_make_ready, quick, kernels)
        begun = {MADE_KERNELS: kernels, EVERYTHING: making}

        def take() -> Part | None:
            """The next part that can begin; None when every part has begun."""
            while pending:
                waited = {name: future for name, future in begun.items() if not future.done()}
                with lock:
                    part = next((part for part in pending if part.after not in waited), None)
                    if part:
                        pending.remove(part)
                        return part
                wait(waited.values(), return_when=FIRST_COMPLETED)
            return None

        def work() -> None:
            while part := take():
                ready = making.result() if part.after == EVERYTHING else Ready()
                can_run = part.needs != "zip" or ready.zips
                stages[part] = part.run(ready, True) if can_run else []

        for worker in [workers.submit(work) for _ in range(AT_ONCE)]:
            worker.result()
    made = [making.result().zip_stage, *(stage for part in found for stage in stages[part])]
    folders = [f"core, {folder}" for folder in core_folders() if folder not in QUICK]
    return made + (_not_quick("hard cases", *folders, EXTRAS_STAGE, CLUSTER_STAGE, "real blender") if quick else [])


def test_part(name: str, options, everywhere: bool = False) -> int:
    """Run one of the parts alone, its output as it comes; returns the exit code."""
    if options and name == REAL_BLENDER:
        raise Failure(f"The scripts of {name} are not run by pytest and take no arguments; leave out {options[0]}.")
    part = parts(options, everywhere=everywhere)[name]
    pythons = [BPY_PYTHON[name.removeprefix("bpy-")]] if name.startswith("bpy-") else PYTHONS
    ready = _zips(pythons) if part.needs == "zip" else Ready()
    if part.needs in OTHERS:
        ready.pythons[part.needs] = _other(part.needs)
    stages = [ready.zip_stage] if ready.zip_stage else []
    if part.needs != "zip" or ready.zips:
        stages += part.run(ready, False)
    return summary(stages)


def _not_quick(*more: str) -> list[Stage]:
    """Every stage that --quick leaves out: the other versions of bpy, and ``more``."""
    others = [f"bpy {version}" for version in BPY if version not in _versions(quick=True)]
    return [skipped(name, "left out by --quick") for name in (*others, *more)]


def _some(core, blender, options, quick: bool) -> list[Stage]:
    """The tests of these paths, one stage after the other, with their output as it comes."""
    stages = []
    if core:
        stages.append(_core([*core, *_leave_out(*([SLOW] if quick else [])), *options]))
    if blender:
        versions = _versions(quick)
        made = _zips(_pythons(versions))
        stages.append(made.zip_stage)
        if made.zips:
            stages += [_bpy(version, made.zips, [*blender, *options], False) for version in versions]
        stages += _not_quick() if quick else []
    return stages


def test(arguments, quick: bool = False, everywhere: bool = False) -> int:
    """Run everything, or the paths among the arguments; print the summary; the exit code is 0 when nothing failed.

    The tests of a path run in every version of bpy.
    """
    core, blender, options = _split(arguments)
    if core or blender:
        return summary(_some(core, blender, options, quick))
    started = time.monotonic()
    stages = _everything(options, quick, everywhere)
    if not (quick or options):
        stage_times.save(stages, time.monotonic() - started)
    return summary(stages)


def test_windows(arguments) -> int:
    """Run tests of the core and of the extension in Windows' Pythons, under Wine."""
    return summary(windows_stages(*_split(arguments)))


def test_catalogue() -> int:
    """Run the catalogue of hard cases alone; where all hold, write its page from the figures."""
    failed = test_part("hard-cases", [], everywhere=True)
    if not failed:
        PAGE.write_text(table(FIGURES), encoding="utf-8")
        say(f"Wrote {PAGE.relative_to(ROOT)}")
    return failed


def test_real_blender(backend: str | None = None) -> int:
    """The whole of tests/blender inside the real Blender, and what needs its window, drawn with ``backend``."""
    return summary(real_blender_stages({}, WHOLE, backend))


def photograph(scenario: Path, size: str, backend: str | None = None) -> int:
    """Run a scenario of tests/blender/window_driver.py in a window; its photographs are kept in build/window-shots/."""
    if not scenario.is_file():
        raise Failure(f"There is no scenario {scenario}.")
    return summary([window_stage({}, [scenario], scenario.stem, pixels(size), backend)])
