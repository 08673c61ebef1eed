"""The seconds of the last whole run, stage by stage, and their table in docs/explanation/run-the-tests.md:

python3 -m devtools.stage_times
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import asdict

from .environments import BPY
from .places import ROOT
from .stages import REPORTS, Stage

TIMES = REPORTS / "stages.json"
PAGE = ROOT / "docs" / "explanation" / "run-the-tests.md"
NEWEST = f"bpy {list(BPY)[-1]}"
# The table's rows, with the stages of each; the last one takes the others.
ROWS = {
    "windows of a real Blender": r"real blender.*|photographs", "the newest Blender's module": re.escape(NEWEST),
    "older ones": "bpy .*", "`unit`": "core, unit", "`truths`": "core, truths",
    "`stability`": "hard cases|catalogue", "`effects`": "core, effects", "all others": "core, .*|VTK.*|Dask",
}  # fmt: skip
MAKING, WHOLE = "kernels, environments, Blender, zips", "the whole command"


def save(stages: list[Stage], seconds: float) -> None:
    """Write what a whole run took; all that its child processes used and no stage counts was used to make things."""
    used = os.times()
    whole = Stage(WHOLE, sum(stage.passed for stage in stages), seconds=seconds)
    whole.processor = used.children_user + used.children_system
    rest = Stage(MAKING, processor=whole.processor - sum(stage.processor for stage in stages))
    TIMES.parent.mkdir(parents=True, exist_ok=True)
    TIMES.write_text(json.dumps([asdict(stage) | {"tests": {}} for stage in (*stages, rest, whole)]), encoding="utf-8")


def rows(stages: list[Stage]) -> dict[str, str]:
    """The last two cells of each row: seconds by the clock with the number of tests, and processor seconds."""
    found, left = {}, list(stages)
    for row, names in (ROWS | {MAKING: MAKING, WHOLE: WHOLE}).items():
        mine = [stage for stage in left if re.fullmatch(names, stage.name)]
        left = [stage for stage in left if stage not in mine]
        seconds, processor = (sum(getattr(stage, key) for stage in mine) for key in ("seconds", "processor"))
        tests = sum(stage.passed for stage in mine)
        clock = f"{seconds:.0f}" + f" ({tests})" * bool(tests)
        found[row] = f"{clock if seconds else ''} | {processor:.0f}"
    return found


def filled(page: str, stages: list[Stage]) -> str:
    """The page with today's cells; those before them, of earlier runs, stay."""
    for row, cells in rows(stages).items():
        page, count = re.subn(
            rf"^(\| {re.escape(row)} \| [^|]* \|).*$", lambda found, cells=cells: f"{found[1]} {cells} |", page,
            flags=re.MULTILINE,
        )  # fmt: skip
        if count != 1:
            raise ValueError(f"{PAGE.name} has {count} rows {row!r}.")
    return page


if __name__ == "__main__":
    last = [Stage(**stage) for stage in json.loads(TIMES.read_text(encoding="utf-8"))]
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), last), encoding="utf-8")
