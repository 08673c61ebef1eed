"""What dev.py does: make .venvs/tools with uv and nox, once, and hand the job over to nox and noxfile.py."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys

from .places import AGAIN, REQUIREMENTS, ROOT, TOOLS, Failure, clean_environ, executable, run_quietly, say
from .system_libraries import apt_install, apt_line, can_apt

PINS = REQUIREMENTS / "tools.txt"
STAMP = TOOLS / "ready.sha256"
VENV_PACKAGE = "python3-venv"


def _can_make_environments() -> bool:
    """Whether this Python has venv and ensurepip; Debian ships them in a package of their own."""
    importlib.invalidate_caches()
    return all(importlib.util.find_spec(name) for name in ("venv", "ensurepip"))


def _make_tools() -> None:
    """Create the environment of the tools anew, from requirements/tools.txt."""
    if not _can_make_environments() and can_apt():
        apt_install([VENV_PACKAGE])
    if not _can_make_environments():
        raise Failure(
            f"{sys.executable} cannot make virtual environments: install its venv and ensurepip modules "
            f"(on Debian and Ubuntu: sudo {apt_line([VENV_PACKAGE])}), or run dev.py with another Python."
        )
    say(f"Setting up {TOOLS.relative_to(ROOT)} (uv and nox)")
    shutil.rmtree(TOOLS, ignore_errors=True)
    make = [sys.executable, "-m", "venv", TOOLS]
    install = [executable(TOOLS), "-m", "pip", "--disable-pip-version-check", "--no-input", "install", "--quiet"]
    install += ["--progress-bar", "off", "--require-hashes", "--only-binary=:all:", "-r", PINS]
    for command in (make, install):
        run_quietly(command, f"{TOOLS.relative_to(ROOT)} could not be made; the reason is above. {AGAIN}")


def ensure_tools() -> None:
    """Make the environment of the tools unless it is there.

    The stamp is written last, so that an interrupted set-up starts again.
    """
    wanted = hashlib.sha256(PINS.read_bytes()).hexdigest()
    if not (executable(TOOLS).exists() and STAMP.is_file() and STAMP.read_text() == wanted):
        _make_tools()
        STAMP.write_text(wanted)


def nox_words(arguments: list[str]) -> list[str]:
    """The arguments of nox for those of dev.py: a job with its own arguments, or else the list of jobs."""
    words = ["-f", str(ROOT / "noxfile.py")]
    if not arguments or arguments[0].startswith("-"):
        return [*words, "--list"]
    return [*words, "-s", arguments[0], "--", *arguments[1:]]


def main(arguments: list[str]) -> int:
    try:
        ensure_tools()
        command = [str(executable(TOOLS)), "-m", "nox", *nox_words(arguments)]
        if os.name != "nt":
            os.execve(command[0], command, clean_environ())
        return subprocess.call(command, env=clean_environ())  # Windows has no exec that keeps the console
    except Failure as problem:
        sys.stderr.write(f"{problem}\n")
        return 1
    except KeyboardInterrupt:
        return 130
