"""The kernels that travel with the extension: compiled for each Python of a Blender and each level of processors.

They are files of the package, so that a clone uses them as well.  What an earlier run compiled and still fits is not
compiled again.
"""

from __future__ import annotations

import hashlib
import os
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from .environments import CORE, Environment, ensure
from .places import BUILD, ENVIRONMENTS, PYTHONS, REQUIREMENTS, ROOT, Failure, clean_environ, run_quietly, say
from .wheels import packages, this_platform

PACKAGE = ROOT / "rle_splat"
FOLDER = PACKAGE / "kernels"
COMPILED = BUILD / "kernels-shipped"
BASELINE = "x86-64-v3"
X64 = (BASELINE, "x86-64-v4")  # as in rle_splat/runtime/shipped_kernels.py
LEVELS = {"linux-x64": X64, "windows-x64": X64}


def core_of(version: str) -> Environment:
    """An environment with this version of Python and what the renderer needs."""
    if CORE.version == version:
        return CORE
    return Environment(f"Python {version}", ENVIRONMENTS / f"core-{version}", (version,), ("core.txt",))


def source_digest(pictures=()) -> bytes:
    """A hash of what the kernels are made from: the sources, the pinned packages and the pictures; () for all."""
    total = hashlib.sha256((REQUIREMENTS / "core.txt").read_bytes())
    total.update(repr(tuple(pictures)).encode() if pictures else b"")
    for path in sorted(PACKAGE.rglob("*.py")):
        total.update(path.relative_to(PACKAGE).as_posix().encode())
        total.update(path.read_bytes())
    return total.hexdigest().encode()


def is_made(path: Path, pictures=()) -> bool:
    """Whether a file holds the kernels of these sources for these pictures, () for all: its comment says so."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.comment == source_digest(pictures)
    except (OSError, zipfile.BadZipFile):
        return False


def _make(version: str, level: str, path: Path) -> None:
    """Compile the kernels for a Python and a level, and pack them into a file."""
    environ = clean_environ(RLE_SPLAT_CACHE=str(COMPILED), PYTHONPATH=str(ROOT))
    make_file(path, path, level, [core_of(version).python], environ)


def make_file(path: Path, seen_as: str | Path, level: str, python: list, environ: dict[str, str], pictures=()) -> None:
    """Compile the kernels for a level by any Python, and pack them into a file.

    ``python``: the command that runs it where ``rle_splat`` and ``devtools`` can be imported; it knows the file as
    ``seen_as``.  ``pictures``: names of those of rle_splat/pipeline/prepare.py whose kernels it holds; () for all.
    """
    began = time.monotonic()
    path.parent.mkdir(parents=True, exist_ok=True)
    said = run_quietly(
        [*python, "-m", "devtools.pack_kernels", seen_as, source_digest(pictures).decode(), *pictures],
        f"The kernels of {path.name} could not be compiled; the words above say why.", cwd=ROOT,
        env={**environ, "NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""},
    )  # fmt: skip
    size, seconds = path.stat().st_size / 1e6, time.monotonic() - began
    say(f"{path.relative_to(ROOT)}: {said.strip()} kernels, {size:.1f} MB, {seconds:.0f} s")


def _is_ready(version: str) -> bool:
    """Make the environment of a Python where it is missing; whether it is there."""
    try:
        ensure(core_of(version))
    except Failure as problem:
        say(f"No kernels for Python {version}. {problem}")
        return False
    return True


def kernel_file(version: str, level: str = BASELINE) -> str:
    """The name of the file for a Python and a level, as rle_splat/runtime/shipped_kernels.py has it."""
    return f"python{version}-numba{packages()['numba']}-{level}.zip"


def _files(pythons) -> dict[Path, tuple[str, str]]:
    """The files for these Pythons and this platform, whether they are made or not, with Python and level."""
    return {
        FOLDER / kernel_file(version, level): (version, level)
        for version in pythons for level in LEVELS.get(this_platform(), ())
    }  # fmt: skip


def make_baseline(pythons=PYTHONS) -> list[Path]:
    """``make_kernels`` without those of better processors, which trials and tests can do without."""
    return make_kernels(pythons, baseline_only=True)


def made_kernels(pythons=PYTHONS) -> list[Path]:
    """Those of the files that hold the kernels of these sources."""
    return [path for path in _files(pythons) if is_made(path)]


def make_kernels(pythons=PYTHONS, baseline_only: bool = False) -> list[Path]:
    """The files for these Pythons and this platform, made side by side where they are missing or of other sources.

    A Python that this machine does not have, and cannot get, has none.  ``baseline_only``: without those of better
    processors, which tests can do without.
    """
    wanted = {
        path: (version, level) for path, (version, level) in _files(pythons).items()
        if (level == BASELINE or not baseline_only) and (is_made(path) or _is_ready(version))
    }  # fmt: skip
    due = {path: of for path, of in wanted.items() if not is_made(path)}
    with ThreadPoolExecutor(os.cpu_count()) as workers:
        list(workers.map(lambda path: _make(*due[path], path), due))
    for path in FOLDER.glob("*.zip"):
        if f"-numba{packages()['numba']}-" not in path.name:
            path.unlink()
    return list(wanted)
