"""dev.py lint: ruff, and the gates of this house that ruff does not know."""

from __future__ import annotations

import subprocess

from .environments import CORE, ensure
from .places import ROOT, clean_environ, say


def lint(arguments) -> int:
    """ruff check and the house's own gates (tests/unit/test_house.py); 0 when both are content."""
    python = ensure(CORE)
    ruff = subprocess.run([str(python), "-m", "ruff", "check", *arguments, "."], cwd=ROOT, env=clean_environ())
    say("The gates of the house:")
    house = subprocess.run(
        [str(python), "-m", "pytest", "-q", "tests/unit/test_house.py"], cwd=ROOT, env=clean_environ()
    )
    return max(ruff.returncode, house.returncode)
