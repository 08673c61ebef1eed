"""The error of light alone: what lamps make of a picture, compared with what they make of the truth.

A picture's light is its color over that of the same picture without lamps.  Times the color of the truth without lamps,
it is compared with the truth, in levels, at random pixels in which something is seen.  So colors and coverage that are
wrong without lamps, too, do not count.  Beside it stands the error of the whole picture.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np

from rle_splat.accuracy.lighting import shading_of
from rle_splat.accuracy.probes import LIT_TOLERANCE, draw_pixels
from rle_splat.accuracy.truths import truth
from rle_splat.classify.presets import fit_preset
from rle_splat.classify.roughness import LEVELS
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.read.formats import read_volume
from rle_splat.scene import Quality, Scene

from .frames import view_scene
from .lamps import LIGHTS, under
from .run import Run, make_parser
from .scenes import DATA, REAL

VIEW, SIZE, PROBES = (30, 15), 400, 4000
NAMES = "headlight", "sun", "three lamps"
QUALITIES = "standard", "fine", "strict"
SKIN = "CT head, skin"
SCANS = ("CT head", SKIN, "X-ray foot", "MRI head", "CT engine", "CT lobster")
FAINTEST = 0.25  # levels: a picture's color without lamps below which its light is not known
SEEN = 1.0  # level of alpha from which a pixel counts


def scan(name: str) -> Scene | None:
    """A scan without lamps, None if its file is missing."""
    file, options, preset = REAL["CT head"][:2] + ("ct-skin",) if name == SKIN else REAL[name]
    if not (DATA / file).exists():
        return None
    volume = read_volume(DATA / file, **options)
    return view_scene(volume, fit_preset(preset, volume)[0], VIEW, SIZE, shaded=False)


def levels(wrong) -> dict:
    """JSON-ready: what 999 and 99 of 100 pixels err less than, and the root of the mean square, of (N, C) differences
    in levels."""
    worst = np.abs(wrong).max(axis=1)
    return {
        "p999": float(np.quantile(worst, 0.999)), "p99": float(np.quantile(worst, 0.99)),
        "rmse": float(np.sqrt(np.mean(wrong**2))),
    }  # fmt: skip


def true_colors(scene: Scene, places) -> np.ndarray:
    """(N, 4) float64 of the truth T2 at pixels."""
    centers = tuple(place + 0.5 for place in places)
    return truth(scene, "T2", pixels=centers, tolerance=LIT_TOLERANCE, **shading_of(scene, "T2"))[0]


def errors_of_light(scene: Scene, lights, qualities, count: int) -> list[dict]:
    """JSON-ready rows: the error of light and of all, under each of the lamps and by each of the qualities.

    The scene has no lamps.  Of ``count`` pixels that are drawn, those in which nothing is seen are left out.
    """
    cache, columns_rows = StageCache(), draw_pixels(scene.width, scene.height, count)
    own = {name: render(scene, quality, cache=cache).rgba for name, quality in qualities.items()}
    alpha = next(reversed(own.values()))[columns_rows[1], columns_rows[0], 3]
    columns, rows = (place[alpha > SEEN / LEVELS] for place in columns_rows)
    unlit, found = true_colors(scene, (columns, rows))[:, :3], []
    for light in lights:
        lit = under(scene, light)
        expected = true_colors(lit, (columns, rows))
        for name, quality in qualities.items():
            got, before = render(lit, quality, cache=cache).rgba[rows, columns], own[name][rows, columns, :3]
            known = before > FAINTEST / LEVELS
            share = np.divide(got[:, :3], before, out=np.zeros_like(before), where=known)
            alone = np.where(known, share * unlit - expected[:, :3], 0.0)
            found.append({
                "light": light, "quality": name, "pixels": len(rows), "own": levels(LEVELS * alone),
                "all": levels(LEVELS * (got - expected)),
            })  # fmt: skip
    return found


def main(arguments) -> int:
    parser = make_parser("dev.py bench light", __doc__, quality={"choices": None, "default": QUALITIES}, probes=PROBES)
    parser.add_argument("--scan", nargs="*", choices=SCANS, default=SCANS)
    parser.add_argument("--light", nargs="*", choices=list(LIGHTS), default=NAMES)
    parser.add_argument("--knob", nargs="*", default=(), help="of all qualities, such as sheet_density=4")
    options = parser.parse_args(arguments)
    knobs = {name: json.loads(value) for name, value in (knob.split("=") for knob in options.knob)}
    qualities = {name: replace(Quality.preset(name), **knobs) for name in options.quality}
    run, left_out = Run("light", arguments), []
    errors = "".join(f"{what + ': 99.9 %':>14}{'99 %':>7}{'RMSE':>7}" for what in ("light", "all"))
    print(f"{'scan':<16}{'light':<16}{'quality':<10}{errors}")
    for name in options.scan:
        scene = scan(name)
        if scene is None:
            left_out.append(name)
            continue
        for row in errors_of_light(scene, options.light, qualities, options.probes):
            run.rows.append({"scan": name, **row})
            own, whole = row["own"], row["all"]
            print(
                f"{name:<16}{row['light']:<16}{row['quality']:<10}{own['p999']:14.1f}{own['p99']:7.1f}{own['rmse']:7.2f}"
                f"{whole['p999']:14.1f}{whole['p99']:7.1f}{whole['rmse']:7.2f}", flush=True,
            )  # fmt: skip
    if left_out:
        print(f"Missing in {DATA.name}: {', '.join(left_out)}.")
    run.keep()
    return 0
