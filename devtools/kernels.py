"""The kernels that travel with the extension, for one level of processors: compiled by one Python, packed for each.

They are files of the package, so that a clone uses them as well.  What an earlier run compiled and still fits is not
compiled again.
"""

from __future__ import annotations

import hashlib
import time
import zipfile
from pathlib import Path

from .environments import CORE, Environment, ensure
from .places import BUILD, ENVIRONMENTS, PYTHONS, REQUIREMENTS, ROOT, Failure, clean_environ, run_quietly, say
from .wheels import packages, this_platform

PACKAGE = ROOT / "rle_splat"
FOLDER = PACKAGE / "kernels"
COMPILED = BUILD / "kernels-shipped"
# A platform -> its level of processors, as in rle_splat/runtime/shipped_kernels.py.
LEVELS = {"linux-x64": "x86-64-v3", "windows-x64": "x86-64-v3", "macos-arm64": "apple-m1"}


def core_of(version: str) -> Environment:
    """An environment with this version of Python and what the renderer needs."""
    if CORE.version == version:
        return CORE
    return Environment(f"Python {version}", ENVIRONMENTS / f"core-{version}", (version,), ("core.txt",))


def source_digest() -> bytes:
    """A hash of what the kernels are made from: the sources and the pinned packages."""
    total = hashlib.sha256((REQUIREMENTS / "core.txt").read_bytes())
    for path in sorted(PACKAGE.rglob("*.py")):
        total.update(path.relative_to(PACKAGE).as_posix().encode())
        total.update(path.read_bytes())
    return total.hexdigest().encode()


def is_made(path: Path) -> bool:
    """Whether a file holds the kernels of these sources: its comment says so."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.comment == source_digest()
    except (OSError, zipfile.BadZipFile):
        return False


def _make(version: str, path: Path, made: str | Path = "") -> None:
    """Make the file for a Python: compile the kernels, or take those of the file ``made`` for another Python."""
    make_file(path, path, [core_of(version).python], _compiling(), made)


def make_file(path: Path, seen_as: str | Path, python: list, environ: dict[str, str], made: str | Path = "") -> None:
    """Make a file of kernels by any Python: compile them, or take those of the file ``made``.

    ``path``: its name ends with the level of processors.  ``python``: the command that runs it where ``rle_splat`` and
    ``devtools`` can be imported; it knows the file as ``seen_as``.
    """
    level = next(level for level in LEVELS.values() if path.stem.endswith(level))
    began = time.monotonic()
    path.parent.mkdir(parents=True, exist_ok=True)

    words = seen_as, source_digest().decode(), *[made] * bool(made)
    environ = {**environ, "NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": ""}
    sentence = f"The kernels of {path.name} could not be made; the words above say why."
    said = run_quietly([*python, "-m", "devtools.pack_kernels", *words], sentence, cwd=ROOT, env=environ)
    size, seconds = path.stat().st_size / 1e6, time.monotonic() - began
    say(f"{path.relative_to(ROOT)}: {said.strip()} kernels, {size:.1f} MB, {seconds:.0f} s")


def _compiling() -> dict[str, str]:
    """The environment of processes that compile kernels into one cache."""
    return clean_environ(RLE_SPLAT_CACHE=str(COMPILED), PYTHONPATH=str(ROOT))


def _is_ready(version: str) -> bool:
    """Make the environment of a Python where it is missing; whether it is there."""
    try:
        ensure(core_of(version))
    except Failure as problem:
        say(f"No kernels for Python {version}. {problem}")
        return False
    return True


def kernel_file(version: str, platform: str = "") -> str:
    """The name of the file for a Python and a platform, or this one, as rle_splat/runtime/shipped_kernels.py has it."""
    return f"python{version}-numba{packages()['numba']}-{LEVELS[platform or this_platform()]}.zip"


def made_under_wine(version: str) -> Path:
    """The file for a Python on Windows, that its Python under Wine makes here, whether it is made or not."""
    return BUILD / "kernels-windows" / kernel_file(version, "windows-x64")


def _files(pythons) -> dict[Path, str]:
    """The files for these Pythons and this platform, whether they are made or not, with the Python of each."""
    return {FOLDER / kernel_file(version): version for version in pythons}


def made_kernels(pythons=PYTHONS) -> list[Path]:
    """Those of the files that hold the kernels of these sources."""
    return [path for path in _files(pythons) if is_made(path)]


def make_kernels(pythons=PYTHONS) -> list[Path]:
    """The files for these Pythons and this platform, made where they are missing or of other sources.

    The core's Python compiles; the others take its kernels.  A Python that this machine does not have, and cannot get,
    has none.
    """
    files, compiled = _files(pythons), FOLDER / kernel_file(CORE.version)
    made = {path for path in files if is_made(path)}
    wanted = {path: version for path, version in files.items() if path in made or _is_ready(version)}
    due = {path: version for path, version in wanted.items() if path not in made}
    if due and not is_made(compiled):
        _make(CORE.version, compiled)
    for path, version in due.items():
        if path != compiled:
            _make(version, path, compiled)
    for path in FOLDER.glob("*.zip"):
        if not path.name.endswith(kernel_file("").removeprefix("python")):
            path.unlink()
    return list(wanted)
