"""``dev.py test --fuzz SECONDS``: the property-based tests again and again with other seeds, until the time is up."""

from __future__ import annotations

import os
import secrets
import subprocess
import time

from .environments import CORE, ensure
from .places import BUILD, ROOT, clean_environ, say

FUZZ_VARIABLE = "RLE_SPLAT_FUZZ"
TESTS = ROOT / "tests" / "stability"


def asked_for() -> bool:
    """Whether this process is to search longer than the suite does."""
    return bool(os.environ.get(FUZZ_VARIABLE))


def fuzz(seconds: float, arguments=()) -> int:
    """Run the fuzzing tests with a new seed each time; stops at the first failure and says how to see it again."""
    files = [str(path) for path in sorted(TESTS.glob("test_*fuzz*.py"))]
    python, end, rounds = ensure(CORE), time.monotonic() + seconds, 0
    environ = clean_environ(**{FUZZ_VARIABLE: "1", "NUMBA_CACHE_DIR": str(BUILD / "numba-cache")})
    while time.monotonic() < end:
        seed = secrets.randbelow(1 << 32)
        say(f"\n=== fuzzing, seed {seed}")
        command = [str(python), "-m", "pytest", "-q", "-x", f"--hypothesis-seed={seed}", *files, *arguments]
        try:
            code = subprocess.run(command, cwd=ROOT, env=environ, timeout=max(end - time.monotonic(), 60.0)).returncode
        except subprocess.TimeoutExpired:
            break  # the time is up in the middle of a round
        if code != 0:
            say(f"Seed {seed} found a failure; add the example above as a case of its own.")
            return 1
        rounds += 1
    say(f"\n{rounds} rounds of fuzzing were finished, and nothing failed.")
    return 0
