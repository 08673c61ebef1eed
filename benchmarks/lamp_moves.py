"""Time of a whole draft after a lamp has moved: shadows and the picture, 800 x 600, in perspective.

Milliseconds of the clock, least and median; of one thread, those of the processor.
"""

from __future__ import annotations

import time
from dataclasses import replace
from statistics import median

from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import Light, Quality, Scene
from rle_splat.view.turntable import turntable

from .frames import VIEWS
from .lamps import area_lamp
from .run import Run, make_parser
from .scenes import REAL, scenes

VOLUMES = "X-ray foot", "CT bonsai"
WIDTH, HEIGHT, TURNED, ABOVE = 800, 600, 3.0, 45.0  # pixels; degrees between two pictures, and of the lamp
KINDS = "SUN", "POINT"


def lit_scene(volume, function, kind: str, turned: float) -> Scene:
    """The volume under one lamp, so many degrees on its way around it."""
    camera, matrix = turntable(volume, *VIEWS[1], perspective=True)
    scene = Scene(volume, function, camera, WIDTH, HEIGHT, matrix, headlight=False, volume_shadows=True)
    seen = turntable(volume, VIEWS[1][0] - 40.0 + turned, ABOVE)[0].matrix_world
    lamp = Light("SUN", energy=3.0, matrix_world=seen)
    if kind == "POINT":
        lamp = replace(lamp, type=kind, energy=area_lamp(scene).energy)
    return replace(scene, lights=(lamp,))


def measure(volume, function, kind: str, threads: int, repeats: int) -> list[float]:
    """Milliseconds of each draft after the lamp has moved."""
    quality, cache, clock = Quality.preset("draft", threads=threads), StageCache(), time.perf_counter
    if threads == 1:
        clock = time.process_time
    spent = []
    for number in range(repeats + 1):  # the first makes the tables
        scene = lit_scene(volume, function, kind, TURNED * number)
        began = clock()
        render(scene, quality, cache=cache)
        spent.append(1e3 * (clock() - began))
    return spent[1:]


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench lamp-moves", __doc__, volume={"choices": list(REAL), "default": VOLUMES}, repeats=10,
        threads={"nargs": "*", "default": [2, 1]},
    )  # fmt: skip
    options = parser.parse_args(arguments)
    run = Run("lamp-moves", arguments, max(options.threads), key=("volume", "lamp", "threads"), time="least_ms")
    print(f"{'volume':<12}{'lamp':<8}{'threads':>8}{'least':>8}{'median':>8}")
    for name, volume, function in scenes(options.volume):
        for kind in KINDS:
            for threads in options.threads:
                spent = measure(volume, function, kind, threads, options.repeats)
                row = {"volume": name, "lamp": kind, "threads": threads, "least_ms": min(spent)}
                run.rows.append({**row, "median_ms": median(spent)})
                print(f"{name:<12}{kind:<8}{threads:>8}{min(spent):8.0f}{median(spent):8.0f}", flush=True)
    run.keep()
    return 0
