"""``dev.py test --fuzz SECONDS``: the property-based tests again and again with other seeds, until the time is up."""

from __future__ import annotations

import os
import secrets
import subprocess
import time
from itertools import count

from .environments import CORE, ensure
from .places import KERNELS, ROOT, clean_environ, say

FUZZ_VARIABLE = "RLE_SPLAT_FUZZ"
TESTS = ROOT / "tests" / "stability"
LEAST_SECONDS = 20.0  # for a file: to load it and to get somewhere


def asked_for() -> bool:
    """Whether this process is to search longer than the suite does."""
    return bool(os.environ.get(FUZZ_VARIABLE))


def fuzz(seconds: float, arguments=()) -> int:
    """Run each file of fuzzing tests in turn with a new seed each time, every one for its share of the time at least
    once; stops at the first failure and says how to see it again."""
    files = sorted({*TESTS.glob("test_*fuzz*.py"), *TESTS.glob("test_*search*.py")})
    python, end, finished, cut_short = ensure(CORE), time.monotonic() + seconds, 0, 0
    environ = clean_environ(**{FUZZ_VARIABLE: "1", "RLE_SPLAT_CACHE": str(KERNELS)})
    share = max(seconds / len(files), LEAST_SECONDS)
    for turn in count():
        if turn >= len(files) and time.monotonic() >= end:
            break
        file, seed = files[turn % len(files)], secrets.randbelow(1 << 32)
        say(f"\n=== fuzzing, {file.stem}, seed {seed}")
        command = [str(python), "-m", "pytest", "-q", "-x", f"--hypothesis-seed={seed}", str(file), *arguments]
        try:
            code = subprocess.run(command, cwd=ROOT, env=environ, timeout=share).returncode
        except subprocess.TimeoutExpired:
            cut_short += 1  # a failure would have ended it before
            continue
        if code != 0:
            say(f"Seed {seed} found a failure; add the example above as a case of its own.")
            return 1
        finished += 1
    say(f"\n{finished} rounds of fuzzing were finished, {cut_short} were cut short, and nothing failed.")
    return 0
