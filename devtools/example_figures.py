"""dev.py figures: the figures of the documentation, made by the command line from scans or what stands in for them.

Runs in an environment with numpy: ``python -m devtools.example_figures``.  Scans come from the data folder
(``RLE_SPLAT_DATA``).  Without it, the head is computed.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np

from .places import OUT, ROOT

sys.path.append(str(ROOT / "devtools"))  # where gallery_data finds what it imports

import gallery_data

FOLDER = OUT / "figures"
COMPARED = ("ct-skin", "ct-skin-and-bone", "ct-bone", "ct-muscle")
ASPECT = 1.1
# Of the scan, in mm of its own axes: x across, y to the back, z from the crown down.
SCAN_VIEW = {"azimuth": 215.0, "elevation": 193.0, "fit": 0.76}
SCAN_MOVED = 8.0, 36.0  # mm to the right and up, from the scan's middle to that of the part that is shown
MADE_VIEW = {"azimuth": 145.0, "elevation": 15.0, "fit": 1.05}  # of the computed head, whose y points to the front
MOUTH = 137.0  # mm below the first slice: metal in the teeth streaks what is further down
# What a head lies on is behind these planes: (a point, the direction that is cut away).
CUTS = (
    ((128.0, 235.0, 0.0), (0.0, 1.0, 0.0)), ((185.5, 185.5, 0.0), (1.0, 1.0, 0.0)),
    ((189.5, 189.5, 64.0), (1.0, 1.0, -0.9)), ((42.0, 216.0, 0.0), (-1.0, 1.0, 0.0)),
    ((128.0, 196.0, 0.0), (0.0, 1.0, -0.9)), ((0.0, 0.0, MOUTH), (0.0, 0.0, 1.0)),
)  # fmt: skip
# To the right, up and toward the viewer: where the lights are; their strength and color.  They cast no
# shadows, which would show the steps between the slices.
LIGHTS = (
    ((-0.7, 0.7, 1.0), 2.3, (1.0, 0.97, 0.93)), ((0.3, 0.0, 1.0), 1.3, (0.95, 0.97, 1.0)),
)  # fmt: skip


def turned_to(z) -> np.ndarray:
    """(3, 3) float64: a rotation whose z axis has a direction."""
    z = np.array(z, np.float64) / math.hypot(*z)
    x = np.cross((0.0, 0.0, 1.0) if abs(z[2]) < 0.5 else (1.0, 0.0, 0.0), z)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(z, x), z), axis=1)


def placed(rotation, point=(0.0, 0.0, 0.0)) -> list:
    """A 4x4 matrix of a rotation and a place, as in JSON files."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, point
    return matrix.tolist()


def volume_options(options: dict) -> dict:
    """The options of ``read_volume`` for those with which ``gallery_data`` has a file imported in Blender."""
    names = ("shape", "spacing", "dtype", "byte_order", "header_bytes", "intercept", "value_unit", "modality")
    return {name: options[name] for name in names if name in options}


def words_of(options: dict) -> list[str]:
    """Options as words of a command line."""
    words = []
    for name, value in options.items():
        values = value if isinstance(value, tuple) else (value,)
        words += [f"--{name.replace('_', '-')}", *map(str, values)]
    return words


def write(folder: Path, name: str, content) -> str:
    """Write a JSON file; return its path."""
    path = folder / name
    path.write_text(json.dumps(content), encoding="utf-8")
    return str(path)


def scene_words(folder: Path, volume, view: dict, moved=(0.0, 0.0)) -> list[str]:
    """Camera and lights: a view of the turntable, moved to the right and up, and lights beside the camera."""
    from rle_splat import turntable

    camera, _ = turntable(volume, **view)
    axes = camera.matrix_world[:3, :3]
    place = camera.matrix_world[:3, 3] + axes[:, :2] @ moved
    content = {
        "type": "ORTHO", "sensor_fit": "VERTICAL", "ortho_scale": camera.ortho_scale, "clip_start": camera.clip_start,
        "clip_end": camera.clip_end, "matrix_world": placed(axes, place),
    }  # fmt: skip
    lights = [
        {"type": "SUN", "energy": energy, "color": color, "matrix_world": placed(turned_to(axes @ way))}
        for way, energy, color in LIGHTS
    ]
    return ["--camera", write(folder, "camera.json", content), "--lights", write(folder, "lights.json", lights)]


def head_words(folder: Path) -> list[str]:
    """The command line of the four-up figure of a head, without its output."""
    from rle_splat import read_volume

    path, options, source = gallery_data.head(folder)
    options = volume_options(options)
    words = ["figure", str(path), *words_of(options), "--aspect", str(ASPECT)]
    for name in COMPARED:
        words += ["--compare", name]
    volume = read_volume(path, **options)
    if source == gallery_data.MADE:
        return [*words, *scene_words(folder, volume, MADE_VIEW)]
    cuts = [{"kind": "plane", "matrix_world": placed(turned_to(away), point)} for point, away in CUTS]
    clip = ["--clip", write(folder, "cuts.json", cuts)]
    return [*words, *scene_words(folder, volume, SCAN_VIEW, SCAN_MOVED), *clip]


def main(words) -> int:
    """Make the figures in out/figures; further words go to ``rle-splat figure``."""
    from rle_splat.cli.main import main as rle_splat

    FOLDER.mkdir(parents=True, exist_ok=True)
    outputs = ["-o", str(FOLDER / "head.svg"), "-o", str(FOLDER / "head.png")]
    usual = [] if "--quality" in words else ["--quality", "fine"]
    return rle_splat([*head_words(FOLDER), "--sides", "off", *usual, *outputs, *words])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
