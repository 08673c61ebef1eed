"""Time from an edit to the new picture: milliseconds of the whole call, measured from outside, and of every stage;
medians over several edits.

One stage cache is used for all edits, as in a window, and is filled before the measurement; no edit is repeated.
"first picture" starts with an empty cache and loaded kernels.  The edit "camera" turns the camera under a sun without
highlights, so that no color depends on the view; "camera, headlight" is the command line's default, with highlights;
"camera, unshaded" has no light.
"""

from __future__ import annotations

from dataclasses import replace
from statistics import median

import numpy as np

from rle_splat.classify.transfer_function import Shade
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import MOST_RESULTS, StageCache
from rle_splat.scene import DEFAULT_CLASSIFICATION, POST_ONLY, RECORDS, Light, Quality, Scene
from rle_splat.view.turntable import turntable

from .frames import whole_call
from .run import Run, make_parser
from .scenes import REAL, scenes, shells

VIEW = (35.0, 25.0)  # azimuth and elevation in degrees, oblique to all principal axes
TURN = 0.5  # degrees that a camera or a light moves with every edit
WIDENING = 1.14  # 1/255 of the values' range per edit; more than one, so that 8-bit data gets new visible values
BRIGHTENING = 1.05
MATT = Shade(ambient=0.2, diffuse=0.8, specular=0.0)
SUN_STRENGTH = 3.0  # W/m^2
THICKER = 2.0  # factor on the thickness of the shells; 256^3 voxels then have 1.6 million visible ones
EDITS = 7
STAGES = ("whole", "setup", "classify", "shade", "encode", "splat", "warp", "report")
VOLUMES = ("shells", "X-ray foot", "CT bonsai")


def sun(turned: float) -> Light:
    """A sun from above, ``turned`` degrees about z."""
    angle = np.radians(turned)
    matrix = np.eye(4)
    matrix[:3, 2] = np.array((0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.8))
    matrix[:3, 0] = np.array((-np.sin(angle), np.cos(angle), 0.0))
    matrix[:3, 1] = np.cross(matrix[:3, 2], matrix[:3, 0])
    return Light("SUN", energy=SUN_STRENGTH, matrix_world=matrix)


def turned(scene: Scene, number: int) -> Scene:
    """The scene with the camera turned by ``number`` steps."""
    camera, _ = turntable(scene.volume, VIEW[0] + TURN * number, VIEW[1])
    return replace(scene, camera=camera)


def relit(scene: Scene, number: int) -> Scene:
    """The scene with the sun turned by ``number`` steps."""
    return replace(scene, lights=(sun(TURN * number),))


def recolored(scene: Scene, number: int) -> Scene:
    """The scene with slightly redder colors."""
    tf = scene.transfer_function
    color = tuple((value, red * BRIGHTENING**-number, *rest) for value, red, *rest in tf.color)
    return replace(scene, transfer_function=replace(tf, color=color))


def thinned(scene: Scene, number: int) -> Scene:
    """The scene with slightly lower opacities; the same values are visible."""
    tf = scene.transfer_function
    opacity = tuple((value, alpha * BRIGHTENING**-number) for value, alpha in tf.opacity)
    return replace(scene, transfer_function=replace(tf, opacity=opacity))


def widened(scene: Scene, number: int) -> Scene:
    """The scene with every range of visible values starting slightly lower, but not below the point before it."""
    tf = scene.transfer_function
    step = WIDENING * number * max((tf.span[1] - tf.span[0]) / 255.0, 1.0)
    opacity = list(tf.opacity)
    for n in range(len(opacity) - 1):
        value, alpha = opacity[n]
        if alpha == 0.0 and opacity[n + 1][1] > 0.0:
            before = opacity[n - 1][0] if n > 0 else value - step
            opacity[n] = (max(value - step, before), alpha)
    return replace(scene, transfer_function=replace(tf, opacity=tuple(opacity)))


def lit(scene: Scene) -> Scene:
    """The scene with a fixed sun and without highlights."""
    tf = replace(scene.transfer_function, shade=MATT)
    return replace(scene, transfer_function=tf, lights=(sun(0.0),), headlight=False)


# Name -> (function that makes the initial scene, function that edits it); every edit gives a new scene.
KINDS = {
    "camera": (lit, turned),
    "camera, unshaded": (lambda scene: replace(scene, headlight=False), turned),
    "camera, headlight": (lambda scene: scene, turned),
    "light": (lit, relit),
    "colors": (lit, recolored),
    "opacities": (lit, thinned),
    "wider range": (lit, widened),
}
FIRST = "first picture"


def measure(scene: Scene, quality: Quality, edits: int = EDITS) -> list[dict]:
    """Measure all kinds of edits.

    One JSON-ready row per kind: median milliseconds of each of STAGES, the stages made per edit, and the number of
    visible voxels after the last edit.
    """
    render(scene, quality)  # compiles and loads kernels
    reports = [_reported(scene, quality, StageCache()) for _ in range(edits)]
    rows = [_row(FIRST, reports, {})]
    for name, (begin, edit) in KINDS.items():
        cache, start = StageCache(), begin(scene)
        render(start, quality, cache=cache)
        # Until the cache is full every edit allocates new memory, which the system has to clear first.
        filling = MOST_RESULTS["records"]
        for number in range(1, filling + 1):
            render(edit(start, number), quality, cache=cache)
        before = dict(cache.made)
        numbers = range(filling + 1, filling + edits + 1)
        reports = [_reported(edit(start, number), quality, cache) for number in numbers]
        made = {stage: (count - before.get(stage, 0)) / edits for stage, count in cache.made.items()}
        rows.append(_row(name, reports, {stage: count for stage, count in made.items() if count}))
    return rows


def _reported(scene: Scene, quality: Quality, cache: StageCache) -> dict:
    """The report of a picture, its stages with the ``whole`` call."""
    rendering, whole = whole_call(scene, quality, cache)
    return {**rendering.report, "stages_ms": {**rendering.report["stages_ms"], "whole": whole}}


def _row(name: str, reports: list[dict], made: dict) -> dict:
    stages = {stage: median(report["stages_ms"][stage] for report in reports) for stage in STAGES}
    return {"edit": name, **stages, "made": made, "visible_voxels": reports[-1]["volume"]["visible_voxels"]}


def volumes(names, size: int):
    """Yield name, volume and transfer function."""
    if not names or "shells" in names:
        volume, tf = shells(size)
        peaks = np.array(tf.opacity[1:]).reshape(-1, 3, 2)  # each peak: point, top, point
        peaks[:, :, 0] = peaks[:, 1:2, 0] + THICKER * (peaks[:, :, 0] - peaks[:, 1:2, 0])
        opacity = (tf.opacity[0], *map(tuple, peaks.reshape(-1, 2).tolist()))
        yield "shells", volume, replace(tf, opacity=opacity)
    others = [name for name in names or VOLUMES if name != "shells"]
    if others:
        yield from scenes(others)


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench editing", __doc__, size=512, quality=["draft", "standard"], classification=DEFAULT_CLASSIFICATION,
        volume={"choices": ("shells", *REAL), "help": f"instead of {', '.join(VOLUMES)}"}, threads=0,
        side={"help": "voxels along an edge of the shells"},
    )  # fmt: skip
    parser.add_argument("--record", type=int, nargs="*", choices=RECORDS, help="default 16 and 8 for pre")
    parser.add_argument("--edits", type=int, default=EDITS)
    options = parser.parse_args(arguments)
    records = options.record or ([POST_ONLY["record"]] if options.classification == "post" else [16, 8])
    run = Run("editing", arguments, options.threads, key=("volume", "quality", "record", "edit"), time="whole")
    print(
        f"{options.size} x {options.size}, classification {options.classification}; milliseconds, "
        f"medians of {options.edits} edits\n"
    )
    print(f"{'volume':<12}{'voxels':>9}  {'quality':<10}{'bytes':>5}  {'edit':<19}", end="")
    print("".join(f"{stage:>10}" for stage in STAGES))
    for name, volume, tf in volumes(options.volume, options.side):
        camera, matrix = turntable(volume, *VIEW)
        scene = Scene(volume, tf, camera, options.size, options.size, matrix, headlight=True)
        for preset in options.quality:
            for record in records:
                machine = dict(threads=options.threads, record=record)
                quality = Quality.preset(preset, classification=options.classification, **machine)
                for row in measure(scene, quality, options.edits):
                    run.rows.append({"volume": name, "quality": preset, "record": record, **row})
                    print(f"{name:<12}{row['visible_voxels']:9d}  {preset:<10}{record:5d}  {row['edit']:<19}", end="")
                    print("".join(f"{row[stage]:10.1f}" for stage in STAGES), flush=True)
    run.keep()
    return 0
