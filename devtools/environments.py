"""Virtual environments of this clone, made and completed by uv from pinned and hashed requirements.

nox can make environments too, but a session of nox has one environment and ends when that cannot be made.  A job here
uses up to seven.  It goes on without those that cannot be made, and reports them.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from .places import BPY_PYTHON, ENVIRONMENTS, PYTHONS, REQUIREMENTS, ROOT, Failure, executable, say
from .system_libraries import ensure_bpy_libraries, try_peer_libraries
from .uv import find_python, installed_python, uv

STAMP = "ready.sha256"


@dataclass(frozen=True)
class Environment:
    """``folder``: where it is; ``pythons``: versions that will do, best first; ``files``: of requirements/."""

    name: str
    folder: Path
    pythons: tuple[str, ...]
    files: tuple[str, ...]

    @property
    def python(self) -> Path:
        return executable(self.folder)

    @property
    def version(self) -> str | None:
        """The version of its Python, or None where there is no environment or its Python is gone."""
        facts = self.folder / "pyvenv.cfg"
        if not (facts.is_file() and self.python.exists()):
            return None
        found = re.search(r"^version(?:_info)? = (\d+\.\d+)", facts.read_text(encoding="utf-8"), re.MULTILINE)
        return found[1] if found else None

    @property
    def digest(self) -> str:
        """What the stamp holds: a hash of the Python version and of every byte of the requirements."""
        total = hashlib.sha256(str(self.version).encode())
        for name in self.files:
            total.update((REQUIREMENTS / name).read_bytes())
        return total.hexdigest()


NEWEST_FIRST = PYTHONS[::-1]  # most tests run on one Python, so that the kernels of one serve them all
CORE = Environment("core", ROOT / ".venv", NEWEST_FIRST, ("core.txt", "test.txt"))
BENCH = Environment("the benchmarks", ENVIRONMENTS / "bench", NEWEST_FIRST, ("bench.txt",))
CLUSTER = Environment("clusters", ENVIRONMENTS / "cluster", NEWEST_FIRST, ("cluster.txt",))
JUDGES = Environment("other readers of DICOM", ENVIRONMENTS / "judges", PYTHONS, ("judges.txt",))
BPY = {
    version: Environment(f"bpy {version}", ENVIRONMENTS / f"bpy-{version}", (python,), (f"bpy-{version}.txt",))
    for version, python in BPY_PYTHON.items()
}


def is_made(environment: Environment) -> bool:
    """Whether the environment is there with a Python that will do; its packages may still be incomplete."""
    return environment.version in environment.pythons


def without_python(*versions: str) -> str:
    """Say that no interpreter of these versions was found, and what to do."""
    return (
        f"Python {' or '.join(versions)} is neither on PATH nor under pyenv, and uv could not download it: "
        "install it and run this again"
    )


def _create(environment: Environment) -> None:
    python = find_python(*environment.pythons)
    if python is None:
        raise Failure(f"The environment for {environment.name}: {without_python(*environment.pythons)}.")
    uv(
        f"uv could not make {environment.folder.relative_to(ROOT)}.",
        "venv", "--quiet", "--clear", "--no-project", "--python", python, environment.folder,
    )  # fmt: skip


def ensure(environment: Environment) -> Path:
    """The environment's Python, after making or completing the environment where needed.

    The stamp is written last, so the next run takes up an interrupted set-up.  uv alone could not tell that bpy 4.5 and
    5.0 are in place: their metadata name Python 3.9, and uv installs them again at each call.
    """
    stamp = environment.folder / STAMP
    if not is_made(environment):
        _create(environment)
    if stamp.is_file() and stamp.read_text() == environment.digest:
        return environment.python
    stamp.unlink(missing_ok=True)
    where = environment.folder.relative_to(ROOT)
    say(f"Setting up {where} (Python {environment.version}) from {', '.join(environment.files)}")
    uv(
        f"uv could not install the pinned packages for {environment.name}.",
        "pip", "sync", "--quiet", "--python", environment.python, "--require-hashes", "--no-build",
        *(REQUIREMENTS / name for name in environment.files),
    )  # fmt: skip
    stamp.write_text(environment.digest)
    return environment.python


def ensure_bpy(version: str) -> Path:
    """The Python of the environment that holds Blender's module of this version."""
    ensure_bpy_libraries()
    return ensure(BPY[version])


def ensure_bench() -> Path:
    """The Python of the benchmarks' environment; what they compare us with is on the system too where it can be."""
    python = ensure(BENCH)
    try_peer_libraries()
    return python


def any_bpy() -> str:
    """A version of bpy that this machine can set up: one whose environment is there, else one with a Python."""
    ways = (
        lambda version: is_made(BPY[version]),
        lambda version: installed_python(BPY_PYTHON[version]),
        lambda version: find_python(BPY_PYTHON[version]),  # downloads it
    )
    found = next((version for way in ways for version in ("5.0", *reversed(BPY)) if way(version)), None)
    if found is None:
        raise Failure(f"Blender's Python module: {without_python(*PYTHONS)}.")
    return found
