"""Pictures of this tree and of an earlier commit's, drawn in turns by one thread: processor time and memory.

    git worktree add --detach ../old COMMIT
    .venv/bin/python -m benchmarks.turns ../old

Milliseconds of whole calls, the least and the median of the turns, mean over views: of a camera that moves, of a sun
that moves, of opacities that change, and of the first picture of a volume in memory, with its tables.  Bytes are what
the stage cache holds after a picture, for each kept voxel.  ``same`` gives the earlier tree the plan of this one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import mean, median

from benchmarks.data_sets import PAPER
from benchmarks.frames import MOVED, view_scene
from benchmarks.scenes import shells
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Light, Quality
from rle_splat.view.turntable import turntable

SIZE, TREES = 512, ("earlier", "this")
VOLUMES = "shells", *(data.name for data in PAPER)
CASES = ("unlit", "camera"), ("headlight", "camera"), ("headlight", "opacities"), ("headlight", "first"), ("sun", "sun")
KNOBS = "depth_rule", "sheet_density", "warp_filter", "termination", "rays"


def scene_of(volume, function, light: str, change: str, view, turn: int):
    """The scene of one turn, in which the camera, the opacities or the sun are a little different."""
    if change == "opacities":
        faded = tuple((value, alpha * (1.0 - 1e-3 * turn)) for value, alpha in function.opacity)
        function = replace(function, opacity=faded)
    moved = view[0] + (MOVED * turn if change == "camera" else 0.0)
    scene = view_scene(volume, function, (moved, view[1]), SIZE, False, light == "headlight")
    if light != "sun":
        return scene
    matrix = turntable(volume, view[0] - 40.0 - turn, 45.0)[0].matrix_world
    return replace(scene, lights=(Light("SUN", energy=3.0, matrix_world=matrix),), volume_shadows=True)


def answer() -> None:
    """Draw what each line of the standard input asks for, with the modules of the folder it runs in."""
    loaded, cache = {"shells": shells}, StageCache()
    for line in sys.stdin:
        asked = json.loads(line)
        name, change = asked["volume"], asked["change"]
        if name not in loaded or callable(loaded[name]):
            loaded = {name: shells() if name == "shells" else next(d for d in PAPER if d.name == name).load()[1:]}
        scene = scene_of(*loaded[name], asked["light"], change, asked["view"], asked["turn"])
        if change == "first" or not asked["turn"]:
            cache.clear()
        quality = replace(Quality.preset(asked["quality"], threads=1), **asked["knobs"])
        began = time.process_time()
        report = render(scene, quality, cache=cache).report
        spent = 1e3 * (time.process_time() - began)
        print(json.dumps({
            "ms": spent, "bytes": cache.nbytes / max(report["volume"]["visible_voxels"], 1),
            "plan": {knob: report["plan"][knob] for knob in KNOBS},
        }), flush=True)  # fmt: skip


class Tree:
    """A process that draws with the modules of one checkout."""

    def __init__(self, root: Path):
        own = {"PYTHONPATH": str(root), "RLE_SPLAT_CACHE": str(root / "build" / "kernels"), "NUMBA_NUM_THREADS": "1"}
        command = [sys.executable, "-P", __file__, "answer"]
        self._process = subprocess.Popen(
            command, cwd=root, env={**os.environ, **own}, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def draw(self, **asked) -> dict:
        """What ``answer`` prints."""
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())


def measure(trees: dict[str, Tree], turns: int, views, same: bool, **case) -> dict:
    """JSON-ready: of each tree ``least`` and ``median`` milliseconds, the means over views, ``bytes`` and ``plan``."""
    found = {name: {"least": [], "median": [], "bytes": []} for name in trees}
    for view in views:
        spent, knobs = {name: [] for name in trees}, {}
        for turn in range(turns + 1):  # the first makes the tables
            for name in sorted(trees, reverse=True):
                drawn = trees[name].draw(view=view, turn=turn, knobs=knobs if name == "earlier" else {}, **case)
                if name == "this" and same:
                    knobs = drawn["plan"]
                if turn:
                    spent[name].append(drawn["ms"])
                else:
                    found[name]["bytes"].append(drawn["bytes"])
                found[name]["plan"] = drawn["plan"]
        for name, ms in spent.items():
            found[name]["least"].append(min(ms))
            found[name]["median"].append(median(ms))
    return {
        name: {key: mean(value) if isinstance(value, list) else value for key, value in one.items()}
        for name, one in found.items()
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("earlier", type=Path, help="a checkout of the earlier commit")
    parser.add_argument("--volume", nargs="*", choices=VOLUMES, default=VOLUMES)
    parser.add_argument("--quality", nargs="*", default=("draft", "standard", "fine"))
    parser.add_argument("--case", nargs="*", default=[" ".join(case) for case in CASES], help="light and change")
    parser.add_argument("--turns", type=int, default=9)
    parser.add_argument("--same", action="store_true", help="give the earlier tree the plan of this one")
    parser.add_argument("--keep", type=Path, help="a file for the rows, JSON")
    given = parser.parse_args()
    views, rows = [(35, 25), (130, -20), (-60, 75)], []
    roots = given.earlier.resolve(), Path(__file__).resolve().parents[1]
    trees = {name: Tree(root) for name, root in zip(TREES, roots)}
    print(
        f"{'volume':<12}{'quality':<10}{'light':<11}{'change':<11}{'earlier':>16}{'this':>16}{'ratio':>14}{'bytes':>14}"
    )
    for volume, quality, case in product(given.volume, given.quality, given.case):
        light, change = case.split()
        seen = views if change == "camera" else views[:1]
        found = measure(
            trees, given.turns, seen, given.same, volume=volume, quality=quality, light=light, change=change
        )
        before, now = found["earlier"], found["this"]
        rows.append({"volume": volume, "quality": quality, "light": light, "change": change, **found})
        times = "".join(f"{one['least']:8.2f}{one['median']:8.2f}" for one in (before, now))
        ratio = "".join(f"{now[key] / before[key]:7.2f}" for key in ("least", "median"))
        stored = f"{before['bytes']:7.1f}{now['bytes']:7.1f}"
        print(f"{volume:<12}{quality:<10}{light:<11}{change:<11}{times}{ratio}{stored}", flush=True)
    for quality, case in product(given.quality, given.case):
        chosen = [row for row in rows if [row["quality"], row["light"], row["change"]] == [quality, *case.split()]]
        ratios = [row["this"]["least"] / row["earlier"]["least"] for row in chosen]
        print(f"{quality:<10}{case:<22} {median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")
    if given.keep:
        given.keep.write_text(json.dumps(rows), encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["answer"]:
        answer()
    else:
        main()
