"""Milliseconds of every stage, per volume, quality and projection; medians over views around the volume."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from statistics import median

from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import FRAME, STAGES
from rle_splat.scene import CLASSIFICATIONS, DEFAULT_CLASSIFICATION, QUALITY_PRESETS, Quality, Scene
from rle_splat.view.turntable import turntable

from .frames import VIEWS, frame_ms
from .scenes import scenes

REPEATS = 3
SHOWN = ("classify", "shade", "encode", *FRAME, "frame")


def measure(volume, tf, quality: Quality, perspective: bool, size: int) -> dict:
    """Median milliseconds per stage over the views; for classify and encode the slowest run, which makes them."""
    cache = StageCache()
    first: dict = {}
    runs = []
    for azimuth, elevation in VIEWS:
        camera, matrix = turntable(volume, azimuth, elevation, perspective=perspective, width=size, height=size)
        scene = Scene(volume, tf, camera, size, size, matrix)
        best = None
        for _ in range(REPEATS):
            report = render(scene, quality, cache=cache).report
            for stage, spent in report["stages_ms"].items():
                first[stage] = max(first.get(stage, 0.0), spent)
            if best is None or frame_ms(report) < frame_ms(best):
                best = report
        runs.append(best["stages_ms"] | {"frame": frame_ms(best)})
    result = {stage: median(run[stage] for run in runs) for stage in (*STAGES, "total", "frame")}
    for stage in ("classify", "encode"):
        result[stage] = first[stage]
    result["visible_fraction"] = report["volume"]["visible_fraction"]
    return result


def main(arguments) -> int:
    parser = argparse.ArgumentParser(prog="dev.py bench stages", description=__doc__)
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--quality", nargs="*", choices=list(QUALITY_PRESETS), default=list(QUALITY_PRESETS))
    parser.add_argument("--classification", choices=CLASSIFICATIONS, default=DEFAULT_CLASSIFICATION)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    print(
        f"Milliseconds, best of {REPEATS} runs per view, median of {len(VIEWS)} views; classify and encode: the "
        f"slowest run.\n'frame' is {', '.join(FRAME)}; 'x' is that against the first quality of the volume here.\n"
    )
    print(f"{'volume':<11}{'p':>7}  {'projection':<12}{'quality':<10}", end="")
    print("".join(f"{name:>10}" for name in (*SHOWN, "x")))
    table = []
    for name, volume, tf in scenes():
        for perspective in (False, True):
            reference = None
            for preset in options.quality:
                quality = Quality.preset(preset, classification=options.classification, threads=options.threads)
                ms = measure(volume, tf, quality, perspective, options.size)
                reference = reference or ms["frame"]
                projection = "perspective" if perspective else "parallel"
                table.append(dict(volume=name, projection=projection, quality=preset, **ms))
                print(f"{name:<11}{100 * ms['visible_fraction']:6.1f}%  {projection:<12}{preset:<10}", end="")
                cells = "".join(f"{ms[stage]:10.1f}" for stage in SHOWN)
                print(cells + f"{ms['frame'] / reference:10.2f}", flush=True)
    if options.json:
        options.json.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    return 0
