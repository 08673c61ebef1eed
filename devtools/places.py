"""Where things are, which versions are meant, and how a failure is said."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REQUIREMENTS = ROOT / "requirements"
ENVIRONMENTS = ROOT / ".venvs"
TOOLS = ENVIRONMENTS / "tools"  # uv and nox; dev.py runs in it after its first lines
OUT = ROOT / "out"
BUILD = ROOT / "build"
DIST = ROOT / "dist"
WHEELS = BUILD / "wheels"
# Kernels that tests compile.
KERNELS = BUILD / "kernels"
BPY_KERNELS = BUILD / "kernels-bpy"  # of the installed extension; its versions of one Python share them

# A Python that an extension zip is made for -> the oldest Blender with it, and the oldest without it any more, or "".
BLENDERS = {"3.11": ("4.5.0", "5.1.0"), "3.13": ("5.1.0", "")}
PYTHONS = tuple(BLENDERS)

# Blender's version -> the Python that its bpy module is built for.  The exact pins are in requirements/.
BPY_PYTHON = {"4.5": "3.11", "5.0": "3.11", "5.2": "3.13", "5.3": "3.13"}


AGAIN = "Check the network and the disk, then run the same command again: it goes on."


class Failure(Exception):
    """One sentence for whoever runs dev.py: what went wrong and what to do."""


def say(text: str = "") -> None:
    print(text, flush=True)


def running_python() -> str:
    """The version of the Python that runs now, as "3.11"."""
    return f"{sys.version_info[0]}.{sys.version_info[1]}"


def pixels(size: str) -> tuple[int, int]:
    """Width and height out of a "960x720"; a Failure for anything else."""
    width, _, height = size.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise Failure(f"--size takes pixels as 960x720, not {size!r}.")
    return int(width), int(height)


def executable(environment: Path, name: str = "python") -> Path:
    """A program of a virtual environment."""
    return environment / ("Scripts" if os.name == "nt" else "bin") / (name + (".exe" if os.name == "nt" else ""))


def clean_environ(**extra: str) -> dict[str, str]:
    """This process's environment without what would leak another Python into a child, plus ``extra``.

    Children keep the bytecode of what they import: a whole run starts hundreds of Pythons.
    """
    left_out = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "PYTHONDONTWRITEBYTECODE")
    environ = {k: v for k, v in os.environ.items() if k not in left_out}
    environ.update(extra)
    return environ


def run_quietly(command, sentence: str, **options) -> str:
    """Run a command and return its output; when it fails, show its output and raise a Failure with ``sentence``."""
    options.setdefault("env", clean_environ())
    done = subprocess.run(
        [str(part) for part in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options
    )
    if done.returncode != 0:
        say(done.stdout[-3000:])
        raise Failure(sentence)
    return done.stdout


def run(command, sentence: str, **options) -> None:
    """Run a command and turn its failure into a Failure that says ``sentence``."""
    options.setdefault("env", clean_environ())
    try:
        code = subprocess.run([str(part) for part in command], **options).returncode
    except FileNotFoundError:
        raise Failure(f"{sentence} ({command[0]} was not found.)") from None
    if code != 0:
        raise Failure(f"{sentence} (exit code {code}; its own words are above.)")
