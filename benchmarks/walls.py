"""Light before and behind thin walls: of plates, and of a vessel behind one.

Percent: of the lit face of a plate, and of a vessel's half that faces the sun, the light with shadows over that
without; of a plate's dark face, its light over that of the lit face without shadows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.render import render
from rle_splat.scene import Light, Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .lamps import shining
from .light import true_colors
from .run import Run, make_parser

SIDE, SIZE, PROBES, THICKNESS = 64, 256, 80, (1, 2, 4)
TOP = 40  # the first slice above all walls
SUN = np.array((0.5, 0.0, 0.75**0.5))  # where it is: 30 degrees from the normal of the walls
OPAQUE, SEEN = {"plate": 0.95, "vessel": 0.9}, 0.5


def walls(thickness: int, vessel: bool) -> Volume:
    """A wall across z; with a vessel of radius 2 along x, its surface two voxels below."""
    field = np.zeros((SIDE,) * 3, np.float32)
    field[TOP - thickness : TOP] = 1.0
    if vessel:
        z, y, _ = np.indices(field.shape)
        across = np.hypot(z - (TOP - thickness - 4.5), y - 0.5 * (SIDE - 1))
        field = np.maximum(field, np.clip(2.5 - across, 0.0, 1.0).astype(np.float32))
    return Volume(field, np.eye(4))


def wall_scene(what: str, thickness: int, sun=SUN, **more) -> Scene:
    """A plate seen from above, 20 degrees from its normal, or a vessel seen from beside, matt and white."""
    volume, elevation = walls(thickness, what == "vessel"), {"plate": 70.0, "vessel": 0.0}[what]
    matt = Shade(0.0, 1.0, 0.0, 1.0)
    opacity = ((0.3, 0.0), (0.7, OPAQUE[what]))
    function = TransferFunction(what, None, opacity, ((0.0, 1.0, 1.0, 1.0),), 1.0, matt)
    camera, matrix = turntable(volume, 0.0, elevation, perspective=False)
    lamp = Light("SUN", energy=3.0, matrix_world=shining(-sun))
    return Scene(volume, function, camera, SIZE, SIZE, matrix, headlight=False, lights=(lamp,), **more)


def pixels_of(scene: Scene, what: str, thickness: int):
    """Columns and rows: the middle of a plate, or the upper half of a vessel."""
    columns, rows = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    high = (SIZE / 2 - rows - 0.5) * scene.camera.ortho_scale / SIZE / np.linalg.norm(scene.index_to_world[:3, 2])
    if what == "vessel":
        high = high + 0.5 * (SIDE - 1) - (TOP - thickness - 4.5)
        inside = (np.abs(columns - SIZE / 2) < SIZE / 8) & (high > 0.3) & (high < 1.7)
    else:
        inside = np.hypot(columns - SIZE / 2, rows - SIZE / 2) < SIZE / 8
    found = np.argwhere(inside)
    found = found[np.random.default_rng(1).choice(len(found), PROBES, replace=False)]
    return found[:, 1], found[:, 0]


def brightness(scene: Scene, quality: str, places) -> float:
    """The mean over pixels of color over alpha, of a quality or of "reference"."""
    if quality == "reference":
        rgba = true_colors(scene, places)
    else:
        rgba = render(scene, Quality.preset(quality)).rgba[places[1], places[0]]
    assert (rgba[:, 3] > SEEN).all()
    return float(np.mean(rgba[:, 0] / rgba[:, 3]))


def measure(thickness: int, quality: str) -> dict[str, float]:
    """JSON-ready percent of "lit face", "dark face" and "vessel"."""
    lit, found = {}, {}
    for what in OPAQUE:
        scene = wall_scene(what, thickness, volume_shadows=False)
        places = pixels_of(scene, what, thickness)
        lit[what] = brightness(scene, quality, places)
        found[what] = 100.0 * brightness(replace(scene, volume_shadows=True), quality, places) / lit[what]
    behind = wall_scene("plate", thickness, SUN * (1.0, 1.0, -1.0), volume_shadows=True)
    dark = brightness(behind, quality, pixels_of(behind, "plate", thickness))
    return {"lit face": found["plate"], "dark face": 100.0 * dark / lit["plate"], "vessel": found["vessel"]}


def main(arguments) -> int:
    qualities = {"choices": None, "default": ("reference", "draft", "standard", "fine", "strict")}
    parser = make_parser("dev.py bench walls", __doc__, quality=qualities)
    options, run = parser.parse_args(arguments), Run("walls", arguments)
    print(f"{'quality':<12}{'voxels':>7}{'lit face':>11}{'dark face':>11}{'vessel':>11}")
    for quality in options.quality:
        for thickness in THICKNESS:
            found = measure(thickness, quality)
            run.rows.append({"quality": quality, "thickness": thickness, **found})
            print(f"{quality:<12}{thickness:>7}" + "".join(f"{one:11.2f}" for one in found.values()), flush=True)
    run.keep()
    return 0
