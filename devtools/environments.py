"""Virtual environments of this clone, from pinned and hashed requirements; made once, checked in a blink."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from .places import BPY_PYTHON, ENVIRONMENTS, PYTHONS, REQUIREMENTS, ROOT, Failure, clean_environ, executable, say
from .pythons import find_python, works_as
from .system_libraries import apt_install, can_apt, ensure_bpy_libraries, try_peer_libraries

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

    def digest(self, version: str) -> str:
        """What the stamp holds: the Python version and every byte of the requirements."""
        total = hashlib.sha256(version.encode())
        for name in self.files:
            total.update((REQUIREMENTS / name).read_bytes())
        return total.hexdigest()


CORE = Environment("core", ROOT / ".venv", PYTHONS, ("core.txt", "test.txt", "tbb.txt"))
BENCH = Environment("the benchmarks", ENVIRONMENTS / "bench", PYTHONS, ("bench.txt",))
SAMPLE = Environment("sample", ENVIRONMENTS / "sample", PYTHONS, ("sample.txt",))
BPY = {
    version: Environment(f"bpy {version}", ENVIRONMENTS / f"bpy-{version}", (python,), (f"bpy-{version}.txt",))
    for version, python in BPY_PYTHON.items()
}


def _version_in_place(environment: Environment) -> str | None:
    """The version of the environment's Python if it still works and is one that will do."""
    if not environment.python.exists() or not next(environment.folder.glob("[lL]ib*/**/site-packages/pip"), None):
        return None  # absent, or left half made
    return next((version for version in environment.pythons if works_as(environment.python, version)), None)


def _is_ready(environment: Environment) -> bool:
    stamp = environment.folder / STAMP
    if not (stamp.is_file() and environment.python.exists()):
        return False
    return stamp.read_text() in [environment.digest(version) for version in environment.pythons]


def _create(environment: Environment) -> str:
    """A new, empty environment; returns the version of its Python."""
    found = None
    for attempt in range(2):
        found = next(((v, p) for v in environment.pythons if (p := find_python(v))), None)
        if found or attempt or not can_apt():
            break
        apt_install(["python3-venv"])  # Debian's python3 comes without ensurepip, which venv needs
    if not found:
        raise Failure(
            f"The environment for {environment.name} needs Python {' or '.join(environment.pythons)} with its venv "
            "module, and none was found on PATH or under pyenv; install it and run this again."
        )
    version, python = found
    if environment.folder.exists():
        shutil.rmtree(environment.folder)
    environment.folder.parent.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        [python, "-m", "venv", str(environment.folder)], env=clean_environ(), capture_output=True, text=True
    )
    if done.returncode != 0:
        say(done.stdout + done.stderr)
        raise Failure(f"{python} could not make the virtual environment {environment.folder}; its words are above.")
    return version


def pip(python: Path, arguments, sentence: str) -> None:
    """Run an environment's pip quietly; its output is shown only when it fails."""
    command = [str(python), "-m", "pip", "--disable-pip-version-check", "--no-input", *map(str, arguments)]
    done = subprocess.run(command, env=clean_environ(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        say(done.stdout[-3000:])
        raise Failure(f"{sentence} Check the network and the disk, then run the same command again: it goes on.")


def ensure(environment: Environment) -> Path:
    """The environment's Python, after making or completing the environment where needed.

    The stamp is written last, so an interrupted set-up is taken up again at the next run.
    """
    if _is_ready(environment):
        return environment.python
    version = _version_in_place(environment) or _create(environment)
    (environment.folder / STAMP).unlink(missing_ok=True)
    say(f"Setting up {environment.folder.relative_to(ROOT)} (Python {version}) from {', '.join(environment.files)}")
    wanted = [part for name in environment.files for part in ("-r", REQUIREMENTS / name)]
    pip(
        environment.python,
        ["install", "--quiet", "--progress-bar", "off", "--require-hashes", "--only-binary=:all:", *wanted],
        f"pip could not install the pinned packages for {environment.name}.",
    )
    (environment.folder / STAMP).write_text(environment.digest(version))
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
    """A version of bpy that this machine can set up: an environment already there, else one with a Python."""
    ready = [version for version, environment in BPY.items() if _is_ready(environment)]
    possible = ready or [version for version, python in BPY_PYTHON.items() if find_python(python)]
    if not possible:
        raise Failure("Blender's Python module needs Python 3.11 or 3.13 with its venv module; install one of them.")
    return "5.0" if "5.0" in possible else possible[-1]
