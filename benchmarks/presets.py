"""Error and time of the post-classified quality presets on volumes of 256^3 voxels, and the sources of the error.

Errors are against T2, unshaded, at random pixels of a few views.  Besides the presets it measures ``standard`` with
very dense sheets, which leaves the depth error, and with many slabs per voxel, which leaves the resampling error.  It
also gives the share of the squared error in the worst pixels.
"""

from __future__ import annotations

from dataclasses import replace
from statistics import median

import numpy as np

from rle_splat.accuracy.probes import draw_pixels
from rle_splat.accuracy.truths import truth
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.scene import QUALITY_PRESETS, Quality

from .data_sets import PAPER
from .frames import best_frame, frame_ms, view_scene
from .run import Run, make_parser
from .scenes import scenes

SIZE, PROBES, REPEATS, TOLERANCE = 512, 4096, 5, 1e-6
VIEWS = ((35, 25), (130, -20), (-60, 75))  # azimuth and elevation, degrees
LARGE = ("X-ray foot", "CT bonsai")
WORST = 0.003  # fraction of all pixels
# Changes to standard that remove one of its two errors.
ALONE = {"depth alone": dict(sheet_density=4.0), "resampling alone": dict(depth_rule="midpoint-8", termination=1e-6)}


def subjects(names):
    """Yield name, volume and transfer function: with presets, and with the transfer functions of bench paper."""
    yield from scenes(("shells", *LARGE) if not names else names)
    for data in PAPER:
        if data.name in (names or LARGE):
            name, volume, function = data.load()
            yield f"{name}, bench", volume, function


def measure(scenes_of_views, quality: Quality, cache: StageCache, true, places, repeats: int) -> dict:
    """JSON-ready: median milliseconds, RMSE (1 is full scale), share of the squared error in the worst pixels."""
    spent, squares = [], []
    for scene, expected in zip(scenes_of_views, true, strict=True):
        rendering, _ = best_frame(scene, quality, repeats, cache)
        spent.append(frame_ms(rendering.report))
        squares.append(((rendering.rgba[places[1], places[0]] - expected) ** 2).mean(axis=-1))
    every = np.sort(np.concatenate(squares))[::-1]
    worst = every[: max(round(WORST * len(every)), 1)].sum() / max(every.sum(), 1e-30)
    return {"ms": median(spent), "rmse": float(np.sqrt(every.mean())), "worst": float(worst)}


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench presets", __doc__, scene={"help": f"only these of shells, {', '.join(LARGE)}"}, threads=0
    )
    options = parser.parse_args(arguments)
    run = Run("presets", arguments, options.threads, key=("volume", "projection", "quality"), time="ms")
    print(f"\n{'volume':<20}{'projection':<14}{'quality':<18}{'ms':>7}{'RMSE':>9}  share of the worst {WORST:.1%}")
    qualities = {name: Quality.preset(name, threads=options.threads) for name in QUALITY_PRESETS}
    alone = {name: replace(qualities["standard"], **knobs) for name, knobs in ALONE.items()}
    places = draw_pixels(SIZE, SIZE, PROBES)
    for name, volume, function in subjects(options.scene):
        for perspective in (False, True):
            views = [view_scene(volume, function, view, SIZE, perspective, shaded=False) for view in VIEWS]
            centers = tuple(place + 0.5 for place in places)
            true = [truth(scene, "T2", pixels=centers, tolerance=TOLERANCE)[0] for scene in views]
            cache, projection = StageCache(), "perspective" if perspective else "orthographic"
            for title, quality in (qualities | alone).items():
                row = measure(views, quality, cache, true, places, REPEATS if title in qualities else 1)
                run.rows.append({"volume": name, "projection": projection, "quality": title, **row})
                ms = f"{row['ms']:7.1f}" if title in qualities else f"{'':7}"
                print(f"{name:<20}{projection:<14}{title:<18}{ms}{row['rmse']:9.4f}{row['worst']:8.0%}", flush=True)
    print(f"\n{SIZE} x {SIZE} pixels, {len(VIEWS)} views, the best of {REPEATS} frames.")
    run.keep()
    return 0
