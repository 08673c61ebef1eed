"""The jobs of this repository: "python3 dev.py JOB ARGUMENTS" runs "nox -s JOB -- ARGUMENTS" in .venvs/tools.

No session has an environment of nox's own: devtools/environments.py makes those that a job needs, and says why.
This file and what it imports run on any Python from 3.9 on.
"""

from __future__ import annotations

import argparse
import logging
import subprocess
import sys
from pathlib import Path

import nox

from devtools import demo as demonstration
from devtools import docs as documentation
from devtools import fuzzing, mutations, real_blender, shadow_pictures, testing, uv
from devtools import gallery as pictures
from devtools import release as releases
from devtools.build import build as build_zips
from devtools.environments import CORE, JUDGES, ensure, ensure_bench
from devtools.kernels import make_kernels
from devtools.places import OUT, PYTHONS, ROOT, Failure, clean_environ, say
from devtools.wheels import TAG_PATTERNS
from devtools.windows import make_windows_kernels

# nox reports each session after its end, but the last line of a test run is that of its totals.
logging.getLogger("nox").setLevel(logging.WARNING)


def job(function, name: str | None = None):
    """Make a session of a function that takes a parser and the words after the job's name, and returns an exit code.

    Its docstring is the line in the list of jobs.  A Failure ends it with its one sentence.
    """
    name = name or function.__name__

    def session_function(session: nox.Session) -> None:
        parser = argparse.ArgumentParser(prog=f"dev.py {name}", description=function.__doc__)
        try:
            code = function(parser, session.posargs)
        except Failure as problem:
            sys.exit(str(problem))
        except KeyboardInterrupt:
            say("Stopped; run the same command again to go on.")
            code = 130
        if code:
            sys.exit(code)  # past nox, which knows no other code than 1

    session_function.__doc__ = function.__doc__
    return nox.session(session_function, python=False, name=name, default=False)


def run(python: Path, *words: str) -> int:
    """Run an environment's Python in the root of the clone; returns its exit code."""
    return subprocess.run([str(python), *words], cwd=ROOT, env=clean_environ()).returncode


@job
def demo(parser, words) -> int:
    """Splat a scan into a Blender scene, headless, and write the pictures to out/."""
    parser.add_argument("volumes", nargs="*", metavar="VOLUME", help="files to show in place of the sample")
    return demonstration.demo(parser.parse_args(words).volumes)


@job
def practice(parser, words) -> int:
    """Write a generated CT head as a DICOM folder to out/practice-ct, for the tutorial."""
    parser.parse_args(words)
    say("Writing out/practice-ct")
    return run(ensure(CORE), "-m", "devtools.practice_ct", str(OUT / "practice-ct"))


@job
def docs(parser, words) -> int:
    """Build the documentation site in build/docs."""
    parser.parse_args(words)
    return documentation.docs()


@job
def gallery(parser, words) -> int:
    """Make the pictures of the gallery in Blender, headless, with the times of their effects, in out/gallery/."""
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="only these")
    parser.add_argument("--percent", type=float, default=100.0, help="of the full size in pixels")
    known = parser.parse_args(words)
    return pictures.gallery(known.scenes, known.percent)


@job
def figures(parser, words) -> int:
    """Make figures of the documentation in out/figures/."""
    parser.parse_args(words)
    return run(ensure(CORE), "-m", "devtools.example_figures")


@job
def shadows(parser, words) -> int:
    """Compare the volume's shadow and reflection with those of Cycles' own volume; write pictures and figures."""
    parser.add_argument("--size", default="400x300", metavar="WxH", help="pixels of each picture")
    parser.add_argument("--samples", type=int, default=40, help="of Cycles, for each pixel")
    known = parser.parse_args(words)
    return shadow_pictures.shadows(known.size, known.samples)


@job
def test(parser, words) -> int:
    """Run every test that this machine can run; other arguments go to pytest."""
    parser.add_argument("--quick", action="store_true", help="leave out what takes long, and all but one Blender")
    parser.add_argument("--all", action="store_true", help="run the deep tests, and all in older Blenders")
    parser.add_argument("--windows", action="store_true", help="run tests in Windows' Pythons instead, under Wine")
    parser.add_argument("--catalogue", action="store_true", help="run the hard cases alone; write their page")
    parser.add_argument(
        "--mutations", nargs="?", const="", metavar="NAME",
        help="put naive forms in place of stable ones, all or those named so, and see that the tests notice",
    )  # fmt: skip
    parser.add_argument("--fuzz", type=float, metavar="SECONDS", help="run property-based tests with new seeds")
    known, rest = parser.parse_known_args(words)
    if known.mutations is not None:
        return mutations.mutations(known.mutations)
    if known.fuzz is not None:
        return fuzzing.fuzz(known.fuzz, rest)
    if known.windows:
        return testing.test_windows(rest)
    return testing.test_catalogue() if known.catalogue else testing.test(rest, known.quick, known.all)


def _part_of_test(name: str) -> None:
    """Make a session of one part of the whole test run."""

    def part(parser, words) -> int:
        parser.add_argument("--all", action="store_true", help="run the deep tests, and all of an older Blender")
        known, rest = parser.parse_known_args(words)
        return testing.test_part(name, rest, known.all)

    part.__doc__ = f"Run one part of the tests: {name}; arguments go to pytest."
    job(part, name=name)


for _name in testing.parts():
    _part_of_test(_name)


def _benchmarks(*words: str) -> int:
    """Run the benchmarks in their own environment; where that cannot be made, without VTK and matplotlib."""
    try:
        python = ensure_bench()
    except Failure as problem:
        say(f"{problem} Going on without VTK and without plots.")
        python = ensure(CORE)
    return run(python, "-m", "benchmarks", *words)


@job
def bench(parser, words) -> int:
    """Measure; arguments go to the benchmarks."""
    return _benchmarks(*words)


@job
def accuracy(parser, words) -> int:
    """Measure what accuracy costs in time, for its page; arguments go to the benchmark."""
    return _benchmarks("accuracy", *words)


@job
def judges(parser, words) -> int:
    """Compare DICOM readers on phantoms whose values say where they lie; arguments go to the comparison."""
    return run(ensure(JUDGES), "-m", "benchmarks.dicom_readers", *words)


@job
def calibrate(parser, words) -> int:
    """Measure the constants of all plans on scenes of formulas; arguments go to the benchmark."""
    return _benchmarks("calibrate", *words)


@job
def reference(parser, words) -> int:
    """Make reference pictures in a folder, or compare today's pictures with them."""
    return run(ensure(CORE), "-m", "devtools.reference_pictures", *words)


@job
def golden(parser, words) -> int:
    """Compare thumbnails of all presets with the approved ones; --approve puts today's in their place."""
    return run(ensure(CORE), "-m", "devtools.golden", *words)


@job
def build(parser, words) -> int:
    """Make the extension zips in dist/."""
    parser.add_argument("--platform", action="append", choices=list(TAG_PATTERNS), help="only this one")
    parser.add_argument(
        "--python", action="append", metavar="3.14", help="for a distribution's Blender with this Python, only"
    )
    known = parser.parse_args(words)
    build_zips(tuple(known.platform or TAG_PATTERNS), tuple(known.python or PYTHONS))
    return 0


@job
def kernels(parser, words) -> int:
    """Compile the kernels that travel with the extension, into rle_splat/kernels."""
    parser.add_argument("--windows", action="store_true", help="those for Windows under Wine, into build")
    known = parser.parse_args(words)
    if known.windows:
        make_windows_kernels()
    else:
        make_kernels()
    return 0


@job
def release(parser, words) -> int:
    """Make dist/release-VERSION: the zips, checksums, changes, and the text and pictures for the platform."""
    parser.parse_args(words)
    releases.release()
    return 0


@job
def lint(parser, words) -> int:
    """Run ruff, the type checker and the gates of the house; --fix lets ruff mend and format files first."""
    parser.add_argument("--fix", action="store_true", help="let ruff mend what it can, and format all files")
    python = ensure(CORE)
    if parser.parse_args(words).fix:
        run(python, "-m", "ruff", "check", "--fix", ".")
        run(python, "-m", "ruff", "format", ".")
    return run(python, "-m", "pytest", "-q", *(f"tests/project/test_{name}.py" for name in ("lint", "house", "types")))


@job
def blender(parser, words) -> int:
    """Set up a real Blender executable for the tests (Debian, as root)."""
    parser.add_argument("--test", action="store_true", help="run the whole of tests/blender inside it")
    parser.add_argument(
        "--photograph", type=Path, metavar="SCENARIO",
        help="photograph its window as a scenario of tests/blender/window_driver.py says",
    )  # fmt: skip
    parser.add_argument("--size", default="1280x1600", metavar="WxH", help="of the photographed screen, in pixels")
    parser.add_argument("--gpu-backend", choices=("opengl", "vulkan"), help="what its windows are drawn with")
    known = parser.parse_args(words)
    real_blender.set_up()
    if known.photograph:
        return testing.photograph(known.photograph, known.size, known.gpu_backend)
    return testing.test_real_blender(known.gpu_backend) if known.test else 0


@job
def lock(parser, words) -> int:
    """Resolve the pinned requirements anew (for maintainers)."""
    parser.add_argument("sets", nargs="*", metavar="SET", help="only requirements/SET.in")
    uv.lock(parser.parse_args(words).sets)
    return 0
