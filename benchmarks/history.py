"""Compare the latest run of a benchmark with one of another commit: which rows have become slower.

Times are divided by that of a yardstick in the same run, since a machine is not equally fast every day.  What is slower
by a few hundredths here is to be measured again with both versions in one run.
"""

from __future__ import annotations

import argparse
import json
import sys
from statistics import median

from . import run

SLOWER = 1.1  # ratio of a row that is listed


def read_runs(name: str) -> list[dict]:
    """The kept runs of a benchmark, the oldest first."""
    path = run.RESULTS / f"{name}.jsonl"
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def find_earlier(runs: list[dict], before: str) -> dict | None:
    """The latest run with the options of the last one, of a commit that begins with ``before``, or any other."""
    *earlier, last = runs
    wanted = [
        one for one in earlier
        if one["arguments"] == last["arguments"]
        and (one["commit"].startswith(before) if before else one["commit"] != last["commit"])
    ]  # fmt: skip
    return wanted[-1] if wanted else None


def compare_rows(earlier: dict, last: dict) -> dict[tuple, float]:
    """Time of each row of a run over that of the same row of an earlier run, both by their yardsticks."""
    key, spent = last["key"], last["time"]
    before = {tuple(row[name] for name in key): row[spent] for row in earlier["rows"]}
    rows = {tuple(row[name] for name in key): row[spent] for row in last["rows"]}
    machine = earlier["yardstick_ms"] / last["yardstick_ms"]
    return {names: machine * rows[names] / before[names] for names in rows if before.get(names)}


def main(arguments) -> int:
    parser = argparse.ArgumentParser(prog="dev.py bench history", description=__doc__)
    parser.add_argument("name", help="of the benchmark")
    parser.add_argument("--before", default="", metavar="COMMIT", help="left out: the latest other one")
    options = parser.parse_args(arguments)
    runs = read_runs(options.name)
    earlier = find_earlier(runs, options.before) if runs and runs[-1]["time"] else None
    if earlier is None:
        print(f"No two timed runs of {options.name} with the same options can be compared.", file=sys.stderr)
        return 2
    last = runs[-1]
    ratios = compare_rows(earlier, last)
    if not ratios:
        print(f"The two runs of {options.name} have no row in common.", file=sys.stderr)
        return 2
    print(
        f"{last['commit']} against {earlier['commit']}, {len(ratios)} rows of {options.name}: "
        f"{median(ratios.values()):.2f} in the median; the machine, by its yardstick: "
        f"{last['yardstick_ms'] / earlier['yardstick_ms']:.2f}."
    )
    slower = {names: ratio for names, ratio in ratios.items() if ratio > SLOWER}
    for names, ratio in sorted(slower.items(), key=lambda one: -one[1]):
        print(f"{ratio:6.2f}  {', '.join(map(str, names))}")
    return 1 if slower else 0
