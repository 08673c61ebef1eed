"""Whether plans for tolerances and presets repeat, run after run, while the machine is idle and busy.

Half of the runs have two processes a core beside them that do nothing but compute.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from contextlib import contextmanager

from rle_splat.accuracy.planner.session import session_steps
from rle_splat.pipeline.choose_source import choose_source
from rle_splat.pipeline.preset_plan import choose_plan
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import drain
from rle_splat.scene import PRESET_KNOBS, QUALITY_PRESETS, Quality, Scene

from .planning_scenes import measured_scenes
from .run import Run, make_parser

TOLERANCES = (8.0, 2.0, 0.5)
RUNS = 10
SPIN = "while True: sum(range(10000))"


@contextmanager
def neighbors(count: int):
    """So many processes that compute meanwhile."""
    running = [subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(count)]
    try:
        yield
    finally:
        for one in running:
            one.kill()
            one.wait()


def plans_of(scene: Scene) -> dict[str, tuple]:
    """The plan of each choice, by its name: knobs, and single rays for tolerances."""
    found = {}
    for classification in ("post", "pre"):
        quality = Quality(classification=classification)
        session = drain(session_steps(scene, quality, StageCache(), 0.2))
        for tolerance in TOLERANCES:
            choice = session.choose(tolerance)
            knobs = tuple(getattr(choice.plan, knob) for knob in PRESET_KNOBS)
            found[f"{classification}, {tolerance:g} levels"] = *knobs, choice.rays, choice.slabs
    for name in QUALITY_PRESETS:
        planned = choose_plan(choose_source(scene, Quality.preset(name)), StageCache()).quality
        found[name] = tuple(getattr(planned, knob) for knob in PRESET_KNOBS)
    return found


def main(arguments) -> int:
    parser = make_parser("dev.py bench repeats", __doc__, scene=None)
    parser.add_argument("--runs", type=int, default=RUNS)
    options = parser.parse_args(arguments)
    run, seen = Run("repeats", arguments), defaultdict(set)
    for name, scene in measured_scenes(options.scene):
        for number in range(options.runs):
            with neighbors(2 * (os.cpu_count() or 1) if number % 2 else 0):
                for choice, plan in plans_of(scene).items():
                    seen[f"{name}: {choice}"].add(plan)
        differ = sum(len(plans) > 1 for case, plans in seen.items() if case.startswith(f"{name}: "))
        print(f"{name}: {differ} differ", flush=True)
    different = {case: sorted(map(str, plans)) for case, plans in seen.items() if len(plans) > 1}
    print(f"{len(seen)} choices, {options.runs} runs each, every second one busy: {len(different)} have several plans.")
    for case, plans in different.items():
        print(f"  {case}: {'; '.join(plans)}")
    run.keep(choices=len(seen), different=different)
    return 1 if different else 0
