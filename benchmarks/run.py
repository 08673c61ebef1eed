"""One run of a benchmark: its options, the machine that it runs on, its rows, and the file that keeps them.

A run adds a line to ``out/benchmarks/NAME.jsonl``, so that `dev.py bench history` can compare it with a run of an
earlier commit.  The line has the time of a yardstick, the same work in every run: how fast the machine was.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from pathlib import Path

import numpy as np

from rle_splat.scene import CLASSIFICATIONS, DEFAULT_CLASSIFICATION, QUALITY_PRESETS

from .frames import VIEWS, Neighbors, circumstances, describe

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "out" / "benchmarks"
YARDSTICK_NUMBERS, YARDSTICK_REPEATS = 1 << 20, 5

# Options that several benchmarks have, by their names.
SHARED = {
    "volume": {"nargs": "*", "help": "only these"},
    "scene": {"nargs": "*", "help": "only these scenes"},
    "quality": {"nargs": "*", "choices": list(QUALITY_PRESETS)},
    "classification": {"choices": CLASSIFICATIONS, "default": DEFAULT_CLASSIFICATION},
    "size": {"type": int, "default": 512, "help": "pixels a side"},
    "side": {"type": int, "default": 256, "help": "voxels a side"},
    "threads": {"type": int, "default": 0, "help": "0 for one per core"},
    "views": {"type": int, "default": len(VIEWS), "help": "number of views"},
    "repeats": {"type": int, "default": 3, "help": "frames, of which the fastest counts"},
    "probes": {"type": int, "help": "probe pixels a view"},
}


def make_parser(prog: str, doc: str, **shared) -> argparse.ArgumentParser:
    """A parser with some of the SHARED options: name -> its default, or a dict of what differs from SHARED."""
    parser = argparse.ArgumentParser(prog=prog, description=doc)
    for name, own in shared.items():
        own = own if isinstance(own, dict) else {"default": own}
        parser.add_argument(f"--{name}", **{**SHARED[name], **own})
    return parser


class Run:
    """A run of a benchmark; it prints what the machine is.

    Runs with the same words on the command line, ``arguments``, can be compared.  ``key``: the entries of a row that
    tell which it is.  ``time``: the entry with its milliseconds; "" where nothing is timed.
    """

    def __init__(self, name: str, arguments, threads: int = 0, *, key=(), time: str = ""):
        self.rows: list[dict] = []
        self._name, self._arguments, self._key, self._time = name, list(map(str, arguments)), list(key), time
        self.where, self._neighbors = circumstances(threads), Neighbors()
        self._yardstick_ms = measure_yardstick()
        print(describe(self.where), flush=True)

    def describe_load(self) -> str:
        """A sentence on the load by other programs until now."""
        return self._neighbors.describe()

    def keep(self, **more) -> None:
        """Print the load by other programs, and keep the rows and ``more``, all JSON-ready."""
        print(self.describe_load())
        self.where["others_busy_cores"] = self._neighbors.cores()
        kept = {
            "commit": name_commit(), "arguments": self._arguments, "key": self._key, "time": self._time,
            "yardstick_ms": min(self._yardstick_ms, measure_yardstick()), "circumstances": self.where, **more,
            "rows": self.rows,
        }  # fmt: skip
        RESULTS.mkdir(parents=True, exist_ok=True)
        path = RESULTS / f"{self._name}.jsonl"
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(kept) + "\n")
        print(f"Added to {path.name} in {RESULTS.name}/; dev.py bench history {self._name} compares runs.")


def measure_yardstick() -> float:
    """Milliseconds of the processor for the same work in every run: a sort, the least of a few."""
    numbers, least = np.random.default_rng(0).random(YARDSTICK_NUMBERS), np.inf
    for _ in range(YARDSTICK_REPEATS):
        began = time.thread_time()
        np.sort(numbers)
        least = min(least, time.thread_time() - began)
    return 1e3 * least


def name_commit() -> str:
    """The commit of the checkout, with "+" where files differ from it; "" where git does not say."""
    try:
        words = ["git", "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty=+"]
        return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
