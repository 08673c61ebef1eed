"""Find a Python of a wanted version: the running one, one on PATH, one of pyenv, one of the py launcher."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from .places import clean_environ, running_python

_PROBE = "import ensurepip, venv, sys; print('%d.%d' % sys.version_info[:2])"


def works_as(python: str | Path, version: str) -> bool:
    """Whether ``python`` runs, is of ``version`` and can make virtual environments.

    It is run because pyenv puts a python3.13 on PATH that may only say that it is not installed.
    """
    try:
        answer = subprocess.run(
            [str(python), "-c", _PROBE], capture_output=True, text=True, timeout=60, env=clean_environ()
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return answer.returncode == 0 and answer.stdout.strip() == version


def _pyenv_roots() -> list[Path]:
    roots = [os.environ.get("PYENV_ROOT"), str(Path.home() / ".pyenv")]
    if shutil.which("pyenv"):
        roots.append(subprocess.run(["pyenv", "root"], capture_output=True, text=True).stdout.strip())
    return [Path(root) for root in dict.fromkeys(roots) if root and Path(root, "versions").is_dir()]


def find_python(version: str) -> str | None:
    """Path of a Python ``version`` ("3.13"), or None."""
    candidates = []
    if running_python() == version:
        candidates.append(getattr(sys, "_base_executable", None) or sys.executable)
    candidates.append(shutil.which(f"python{version}"))
    for root in _pyenv_roots():
        names = sorted(
            (root / "versions").glob(f"{version}.*"),
            key=lambda folder: [int(part) for part in folder.name.split(".")[2:] if part.isdigit()],
        )
        candidates += [str(folder / "bin" / "python") for folder in reversed(names)]
    if os.name == "nt" and shutil.which("py"):
        asked = subprocess.run(
            ["py", f"-{version}", "-c", "import sys; print(sys.executable)"], capture_output=True, text=True
        )
        candidates.append(asked.stdout.strip())
    for candidate in candidates:
        if candidate and works_as(candidate, version):
            return candidate
    return None
