"""The tests in a real Blender executable: the short scripts of every run, without and with a window, and the whole of
tests/blender on demand.  And photographs of its window, of any scenario."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from .build import build_here
from .environments import CORE, ensure
from .kernels import FOLDER, PACKAGE, is_made, kernel_file, make_file, make_kernels
from .places import BPY_KERNELS, BUILD, REQUIREMENTS, ROOT, Failure, clean_environ, say
from .real_blender import Blender, ensure_blender, environ_for, find_blender
from .stages import REPORTS, Stage, broken, counted, file_name, measured, skipped, untested
from .uv import uv
from .wheels import this_platform, wheels_for

SHORT = "real_blender.py"
WHOLE = "whole_suite.py"
REAL_EVENTS = ("window_escape.py",)  # with simulated events Blender hears no real key
TESTS = ROOT / "tests" / "blender"
PYTEST_PINS = REQUIREMENTS / "pytest.txt"
SHOTS = BUILD / "window-shots"  # photographs, in a folder for each script

PHOTOGRAPHED = (5, 2)  # the version of Blender whose photographs are approved
AT_ONCE = 2  # windows, which wait half of their time
SMALL_SCREEN = (1100, 640)  # where pictures are not the point: software draws each pixel
# The scripts that drive a window, with their screens in pixels.
WINDOW_SCRIPTS = {
    "window.py": SMALL_SCREEN,
    "window_panels.py": (800, 3600),  # every panel of the sidebar at once
    "window_import.py": SMALL_SCREEN,
    "window_segments.py": SMALL_SCREEN,
    "window_organs.py": SMALL_SCREEN,
    "window_dialogs.py": SMALL_SCREEN,
    "window_live.py": SMALL_SCREEN,
    "window_several.py": SMALL_SCREEN,
    "window_cut.py": SMALL_SCREEN,
    "window_slices.py": (1600, 1000),  # four views
    "window_hidden.py": SMALL_SCREEN,
    "window_look.py": SMALL_SCREEN,
    "window_presets.py": (1280, 1400),  # all pictures of the panel Presets
    "window_film.py": SMALL_SCREEN,
    "window_trust.py": SMALL_SCREEN,
    "window_encoded.py": SMALL_SCREEN,
    "window_figure.py": SMALL_SCREEN,
    "window_turntable.py": SMALL_SCREEN,
    "window_escape.py": SMALL_SCREEN,
    "window_shadows.py": SMALL_SCREEN,
    "window_world.py": SMALL_SCREEN,
    "window_after_render.py": SMALL_SCREEN,
    "window_tutorial.py": SMALL_SCREEN,
}

# Scripts that share a window, whose start takes 4 s of a processor: each leaves Blender as the next one wants it.
TOGETHER = (
    ("window_segments.py", "window_organs.py", "window_figure.py", "window_world.py", "window_turntable.py"),
    ("window_several.py", "window_encoded.py", "window_shadows.py", "window_trust.py", "window_film.py"),
)

# A photograph of each script of a window that is the same at every run; without what differs: seconds, progress.
PHOTOGRAPHS = {
    "window_after_render": "still, locked", "window_cut": "plane_dragged", "window_dialogs": "choose_series",
    "window_encoded": "2-refined", "window_figure": "viewport", "window_film": "08_slices",
    "window_hidden": "value under the mouse", "window_import": "framed_persp", "window_look": "histogram_default",
    "window_organs": "pet_in_ct", "window_panels": "labels", "window_presets": "thumbnails",
    "window_segments": "without_table", "window_several": "label_files", "window_shadows": "picture",
    "window_slices": "four_up", "window_trust": "12-file-found-again",
    "window_turntable": "ended", "window_world": "slot 1 after the edit",
}  # fmt: skip
# Scripts whose photographs show a view as users have it, that look at the lines in it, or that photograph by a command
# of their own.  Of the others that of PHOTOGRAPHS alone is kept, and has all lines of the view.
WITH_FLOOR = ("window_live.py", "window_tutorial.py", "window_after_render.py")


def _lent_pytest() -> Path:
    """A folder with pytest and nothing else, of pure Python, for a Blender whose own Python has none."""
    folder = BUILD / "pytest"
    uv(
        "uv could not fetch pytest.",
        "pip", "sync", "--quiet", "--python", ensure(CORE), "--target", folder, "--require-hashes", "--no-build",
        PYTEST_PINS,
    )  # fmt: skip
    return folder


@cache
def _zip_for(blender: Blender) -> Path:
    """The extension's zip for a Blender whose Python no bpy module has: Debian's runs on the system's."""
    find_kernels = make_kernels if blender.root is None else lambda _: [make_kernels_inside(blender)]
    return build_here(blender.python, BUILD / f"zip-{blender.python}", find_kernels)


def make_kernels_inside(blender: Blender) -> Path:
    """The file of kernels for the Python of a small system, made in there: this machine may have no such Python."""
    path = FOLDER / kernel_file(blender.python)
    if is_made(path):
        return path
    (compiled,) = make_kernels([CORE.version])
    folder = Path(tempfile.mkdtemp(prefix="packs_kernels_", dir=blender.root))
    for wheel in wheels_for([this_platform()], [blender.python]):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
    for source in (PACKAGE, ROOT / "devtools"):
        shutil.copytree(source, folder / source.name, ignore=shutil.ignore_patterns("__pycache__", FOLDER.name))
    shutil.copy(compiled, folder)
    environ = environ_for(blender, PYTHONPATH=blender.inside(folder), RLE_SPLAT_CACHE=blender.inside(folder / "cache"))
    made, python = folder / path.name, [*blender.command[:-1], "python3"]
    make_file(made, blender.inside(made), python, environ, blender.inside(folder / compiled.name))
    shutil.move(made, path)
    shutil.rmtree(folder)
    return path


def _workplace(blender: Blender, zips: dict[str, Path], with_pytest: bool, installed: Path | None) -> Path:
    """A folder that the Blender can see, with the tests and the zip for its Python, which is built if not given.

    ``installed``: its user's folder to begin with, if it is there.
    """
    zip_path = zips.get(blender.python) or _zip_for(blender)
    folder = Path(tempfile.mkdtemp(prefix="rle_splat_test_", dir=blender.root or BUILD))
    # With the files, phantoms and scripts that tests show.
    for part in ("tests/blender", "tests/read", "benchmarks", "docs/how-to", "devtools"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
    if with_pytest:
        shutil.copytree(_lent_pytest(), folder / "pytest")
    shutil.copy(ROOT / "pyproject.toml", folder)
    shutil.copy(TESTS.parent / "conftest.py", folder / "tests")
    if installed and installed.is_dir():
        shutil.copytree(installed, folder / "user", copy_function=os.link)
    else:
        shutil.copy(zip_path, folder / "extension.zip")
    for name in ("user", "shots", "tmp"):
        (folder / name).mkdir(exist_ok=True)
    return folder


@contextmanager
def _virtual_screen(blender: Blender, size: tuple[int, int]):
    """An X server without a screen, on a number that is free; yields what DISPLAY has to be."""
    command = [
        *blender.command[:-1], "Xvfb", "-displayfd", "1", "-screen", "0", f"{size[0]}x{size[1]}x24", "-nolisten", "tcp",
    ]  # fmt: skip
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


def label_of(scripts: tuple[str, ...]) -> str:
    """What the scripts of a window are called in the table of stages."""
    return " + ".join(Path(script).stem.removeprefix("window_") for script in scripts)


def windows() -> list[tuple[str, ...]]:
    """The scripts of each window."""
    shared = {script: together for together in TOGETHER for script in together}
    return list(dict.fromkeys(shared.get(script, (script,)) for script in WINDOW_SCRIPTS))


def window_stage(
    zips: dict[str, Path], scripts: list[Path], label: str, size: tuple[int, int], backend: str | None = None,
    installed: Path | None = None, **environ: str,
) -> Stage:  # fmt: skip
    """Scripts that need a window, one after the other, on a virtual screen of this size.

    ``zips``: those that are built, by Python.
    ``backend``: what Blender draws with, "opengl" or "vulkan"; None for its own choice.  ``installed``: a user's folder
    with the extension; without one it is installed.
    """
    try:
        blender = find_blender()
        with _virtual_screen(blender, size) as display:
            simulates = () if scripts[0].name in REAL_EVENTS else ("--enable-event-simulate",)
            place = [*simulates, "--window-geometry", "0", "0", *map(str, size)]
            place += ["--gpu-backend", backend] if backend else []
            label += f", {backend}" if backend else ""
            return _run(blender, zips, scripts, f", {label}", place, installed, DISPLAY=display, **environ)
    except Failure as problem:
        return untested(f"real blender, {label}", str(problem))


def real_blender_stages(zips: dict[str, Path], script: str = SHORT, backend: str | None = None) -> list[Stage]:
    """A script of tests/blender in the background, then those of windows, two at a time, with the zip for its Python.

    They show what Blender's module cannot: F12 off the main thread, work from a timer, keys, mouse, panels, viewports.
    Windows find the extension installed, as the short script has left it: unpacking 93 MB and compiling their Python
    takes longer than many a scenario.
    """
    BUILD.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="installed_", dir=BUILD) as name:
        installed = Path(name) / "user" if script == SHORT else None
        try:
            background = _run(ensure_blender(), zips, [TESTS / script], "", ["--background"], installed)
        except Failure as problem:
            return [untested("real blender and its windows", str(problem))]

        def run(names: tuple[str, ...]) -> Stage:
            size, scripts = WINDOW_SCRIPTS[names[0]], [TESTS / name for name in names]
            environ = {} if names[0] in WITH_FLOOR else {"RLE_SPLAT_GOLDEN": json.dumps(PHOTOGRAPHS)}
            return window_stage(zips, scripts, label_of(names), size, backend, installed, **environ)

        with ThreadPoolExecutor(AT_ONCE) as workers:  # after the first run, which makes the zip
            stages = [background, *workers.map(run, windows())]
    return [*stages, _compare_photographs(backend)] if script == SHORT else stages


def _compare_photographs(backend: str | None) -> Stage:
    """Whether the windows look as approved (``devtools/golden.py``)."""
    name = "photographs"
    if backend or find_blender().version != PHOTOGRAPHED:
        return skipped(name, f"those approved are of Blender {PHOTOGRAPHED[0]}.{PHOTOGRAPHED[1]} with OpenGL")
    command = [ensure(CORE), "-m", "devtools.golden", "--windows"]
    return counted(name, command, clean_environ(), REPORTS / f"{name}.txt")


def _run(
    blender: Blender, zips: dict[str, Path], scripts: list[Path], label: str, place: list[str],
    installed: Path | None = None, **environ: str,
) -> Stage:  # fmt: skip
    """Run scripts in a folder of their own with the tests of Blender beside them; keep their photographs.

    ``installed``: its user's folder to begin with; where there is none yet, its own is left there.
    """
    name = f"real blender {blender.version[0]}.{blender.version[1]}{label}"
    try:
        whole = scripts[0].name == WHOLE
        folder = _workplace(blender, zips, whole, installed)
    except Failure as problem:
        return broken(name, str(problem))
    importable = f"import sys; sys.path.insert(0, {blender.inside(folder)!r})"  # scripts import tests.blender
    copies = [Path(shutil.copy(script, folder / "tests/blender")) for script in scripts]  # of the tests, over itself
    shared = blender.root / "kernels-of-tests" if blender.root else BPY_KERNELS
    environ = environ_for(
        blender,
        RLE_SPLAT_EXTENSION_ZIP=blender.inside(folder / "extension.zip"),
        RLE_SPLAT_PYTEST=blender.inside(folder / "pytest"),
        RLE_SPLAT_REPORT=blender.inside(folder / "report.jsonl"),
        # The zip brings what a short script needs; the driver of windows looks here for what it does not bring.
        RLE_SPLAT_CACHE=blender.inside(shared if whole else folder / "cache"),
        RLE_SPLAT_SHOTS=blender.inside(folder / "shots"),
        BLENDER_USER_RESOURCES=blender.inside(folder / "user"),
        TMPDIR=blender.inside(folder / "tmp"),
        LIBGL_ALWAYS_SOFTWARE="1",
        **environ,
    )
    command = [*blender.command, *place, "--factory-startup", "--python-exit-code", "1"]
    command += ["--python-expr", importable]
    command += [word for copy in copies for word in ("--python", blender.inside(copy))]
    say(f"\n=== {name} ({blender.label}, Python {blender.python})")
    if not whole:
        stage = counted(name, command, environ, REPORTS / f"{file_name(name)}.txt")
    else:
        stage = measured(name, command, environ, folder / "report.jsonl")
    stage.remarks.insert(0, f"{blender.label}, Python {blender.python}")
    for script in scripts:
        shots, taken = SHOTS / script.stem, folder / "shots" / script.stem
        shutil.rmtree(shots, ignore_errors=True)
        if taken.is_dir() and any(taken.iterdir()):
            shutil.copytree(taken, shots)
            stage.remarks.append(f"photographs in {shots.relative_to(ROOT)}")
    if installed and not installed.is_dir() and not stage.failed:
        shutil.move(folder / "user", installed)
    shutil.rmtree(folder, ignore_errors=True)
    return stage
