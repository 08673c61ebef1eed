"""Milliseconds of the whole call and of every stage, per volume, projection, shading and quality; medians over views.

The camera moves before every picture. "whole" is measured from outside; the stages add up to it, but for the fraction
of a millisecond before and behind them. "setup" is what belongs to no other stage.
"""

from __future__ import annotations

from itertools import product
from statistics import median

from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.runtime.steps import FRAME, STAGES
from rle_splat.scene import DEFAULT_CLASSIFICATION, QUALITY_PRESETS, Quality

from .frames import VIEWS, frame_ms, moved_scenes, whole_call
from .run import Run, make_parser
from .scenes import REAL, scenes

PROJECTIONS, COLORS = ("orthographic", "perspective"), ("unshaded", "shaded")
REPEATS = 3
SHOWN = ("whole", "setup", "classify", "shade", "encode", *FRAME, "report", "frame")
MADE = ("classify", "encode")  # once: of these the slowest run counts, which makes them


def measure(volume, tf, quality: Quality, perspective: bool, shaded: bool, size: int, views=VIEWS) -> dict:
    """Median milliseconds of the whole call and of each stage over the views; of the stages MADE, the slowest."""
    cache, runs = StageCache(), []
    slowest = dict.fromkeys(MADE, 0.0)
    for view in views:
        scenes = moved_scenes(volume, tf, view, size, perspective, shaded, REPEATS + 1)
        calls = [whole_call(scene, quality, cache) for scene in scenes]
        for rendering, _ in calls:
            stages = rendering.report["stages_ms"]
            slowest = {stage: max(spent, stages[stage]) for stage, spent in slowest.items()}
        best, whole = min(calls[1:], key=lambda call: call[1])  # the first makes the tables
        runs.append({**best.report["stages_ms"], "frame": frame_ms(best.report), "whole": whole})
    result = {stage: median(run[stage] for run in runs) for stage in (*STAGES, "total", "frame", "whole")}
    return {**result, **slowest, "visible_fraction": best.report["volume"]["visible_fraction"]}


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench stages", __doc__, volume={"choices": ("shells", *REAL)}, views=len(VIEWS), size=512, threads=0,
        quality=list(QUALITY_PRESETS), classification=DEFAULT_CLASSIFICATION,
    )  # fmt: skip
    parser.add_argument("--projection", nargs="*", choices=PROJECTIONS, default=PROJECTIONS)
    parser.add_argument("--colors", nargs="*", choices=COLORS, default=COLORS)
    options = parser.parse_args(arguments)
    views = VIEWS[: max(options.views, 1)]
    run = Run("stages", arguments, options.threads, key=("volume", "projection", "colors", "quality"), time="whole")
    print(
        f"Milliseconds, best of {REPEATS} runs per view, median of {len(views)} views; {' and '.join(MADE)}: the "
        f"slowest run.\n'frame' is {', '.join(FRAME)}; 'x' is the whole against that of the first quality of the "
        "volume here.\n"
    )
    print(f"{'volume':<11}{'p':>7}  {'projection':<14}{'colors':<10}{'quality':<10}", end="")
    print("".join(f"{name:>10}" for name in (*SHOWN, "x")))
    for (name, volume, tf), projection, colors in product(
        scenes(options.volume), options.projection, options.colors
    ):  # fmt: skip
        reference = None
        for preset in options.quality:
            quality = Quality.preset(preset, classification=options.classification, threads=options.threads)
            seen = projection == PROJECTIONS[1], colors == COLORS[1]
            ms = measure(volume, tf, quality, *seen, options.size, views)
            reference = reference or ms["whole"]
            run.rows.append(dict(volume=name, projection=projection, colors=colors, quality=preset, **ms))
            print(f"{name:<11}{100 * ms['visible_fraction']:6.1f}%  {projection:<14}{colors:<10}{preset:<10}", end="")
            cells = "".join(f"{ms[stage]:10.1f}" for stage in SHOWN)
            print(cells + f"{ms['whole'] / reference:10.2f}", flush=True)
    run.keep()
    return 0
