"""The subcommands of dev.py."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from .places import ROOT, Failure, clean_environ, say


def _demo(known, rest) -> int:
    from .demo import demo

    return demo([*known.volumes, *rest])


def _gallery(known, rest) -> int:
    from .gallery import gallery

    return gallery(known.scenes, known.size)


def _test(known, rest) -> int:
    from .testing import test, test_catalogue

    if known.mutations is not None:
        from .mutations import mutations

        return mutations(known.mutations)
    if known.fuzz is not None:
        from .fuzzing import fuzz

        return fuzz(known.fuzz, rest)
    if known.catalogue:
        return test_catalogue()
    return test(rest, quick=known.quick)


def _bench(*first: str):
    """A subcommand that runs the benchmarks in their own environment, with VTK and matplotlib; where that cannot be
    made, without them.  ``first``: arguments before the user's."""

    def command(known, rest) -> int:
        from .environments import CORE, ensure, ensure_bench

        try:
            python = ensure_bench()
        except Failure as problem:
            say(f"{problem} Going on without VTK and without plots.")
            python = ensure(CORE)
        call = [str(python), "-m", "benchmarks", *first, *rest]
        return subprocess.run(call, cwd=ROOT, env=clean_environ()).returncode

    return command


def _reference(known, rest) -> int:
    from .environments import CORE, ensure

    call = [str(ensure(CORE)), "-m", "devtools.reference_pictures", *rest]
    return subprocess.run(call, cwd=ROOT, env=clean_environ()).returncode


def _build(known, rest) -> int:
    from .build import build
    from .wheels import TAG_PATTERNS

    build(tuple(known.platform or TAG_PATTERNS))
    return 0


def _docs(known, rest) -> int:
    from .docs import docs

    return docs()


def _lint(known, rest) -> int:
    from .checks import lint

    return lint(rest)


def _blender(known, rest) -> int:
    from .real_blender import set_up

    set_up()
    from .testing import photograph, test_real_blender

    if known.photograph:
        return photograph(known.photograph, known.size)
    return test_real_blender() if known.test else 0


def _lock(known, rest) -> int:
    from .lock import lock

    lock(rest)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="dev.py", description="Set up, show, test and package RLE Splat.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name, function, text, open_ended=False, add_help=True):
        command = commands.add_parser(name, help=text, description=text, add_help=add_help)
        command.set_defaults(function=function, open_ended=open_ended)
        return command

    demo = add("demo", _demo, "splat a scan into a Blender scene, headless, and write the pictures to out/")
    demo.add_argument("volumes", nargs="*", metavar="VOLUME", help="files to show in place of the sample")
    show = add("gallery", _gallery, "make five scenes in Blender, headless, and their priced effects in out/gallery/")
    show.add_argument("scenes", nargs="*", metavar="SCENE", help="only these")
    show.add_argument("--size", default="960x720", metavar="WxH", help="pixels")
    test = add("test", _test, "run every test this machine can run; other arguments go to pytest", open_ended=True)
    test.add_argument("--quick", action="store_true", help="without slow tests and with one Blender only")
    test.add_argument("--catalogue", action="store_true", help="the hard cases alone, and write their page")
    test.add_argument(
        "--mutations", nargs="?", const="", metavar="NAME",
        help="put naive forms in place of stable ones, all or those named so, and see that the tests notice",
    )
    test.add_argument("--fuzz", type=float, metavar="SECONDS", help="property-based tests with new seeds, that long")
    add("bench", _bench(), "measure; arguments go to the benchmarks", open_ended=True, add_help=False)
    add(
        "accuracy", _bench("accuracy"), "measure what accuracy costs in time: docs/explanation/accuracy.md",
        open_ended=True, add_help=False,
    )
    add(
        "calibrate", _bench("calibrate"), "make the planner's constants anew, from scenes of formulas", open_ended=True,
        add_help=False,
    )
    add(
        "reference", _reference, "make reference pictures in a folder, or compare today's with them", open_ended=True,
        add_help=False,
    )
    build = add("build", _build, "make the extension zips in dist/")
    build.add_argument("--platform", action="append", help="only this one (linux-x64, windows-x64, macos-arm64)")
    add("docs", _docs, "build the documentation site in build/docs")
    add("lint", _lint, "ruff and the house's own gates; other arguments go to ruff", open_ended=True)
    blender = add("blender", _blender, "set up a real Blender executable for the tests (Debian, as root)")
    blender.add_argument("--test", action="store_true", help="and run the whole of tests/blender inside it")
    blender.add_argument(
        "--photograph", type=Path, metavar="SCENARIO",
        help="and photograph its window as a scenario of tests/blender/window_driver.py says",
    )
    blender.add_argument("--size", default="1280x1600", metavar="WxH", help="of the photographed screen, in pixels")
    add("lock", _lock, "resolve the requirements anew (maintainers); arguments name the sets", open_ended=True)
    return parser


def main(arguments) -> int:
    parser = _parser()
    known, rest = parser.parse_known_args(arguments)
    if rest and not known.open_ended:
        parser.error(f"{known.command} does not know {' '.join(rest)}")
    try:
        return known.function(known, rest)
    except Failure as problem:
        sys.stderr.write(f"{problem}\n")
        return 1
    except KeyboardInterrupt:
        say("Stopped; run the same command again to go on.")
        return 130
