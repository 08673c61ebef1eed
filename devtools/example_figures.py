"""dev.py figures: the figure of the documentation, made by the command line with options of users.

Runs in an environment with numpy and pydicom: ``python -m devtools.example_figures``.  The scan is the skull of the
data folder (``RLE_SPLAT_DATA``); without it, the practice scan.
"""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path

from .places import OUT, ROOT

FOLDER = OUT / "figures"
SKULL = "dicom_ct_skull_phantom_512x512x140"
VIEWS = ((0, 0), (90, 0), (0, 90))  # azimuth and elevation
# Two boxes leave the head holder out: their middle and half their sides in mm, the second turned by 45 degrees.
MIDDLE, STRAIGHT, TURNED, HEIGHT = (-2.7, 103.0, 764.0), (74.0, 98.0), 88.0, 90.0


def data_folder() -> Path:
    return Path(os.environ.get("RLE_SPLAT_DATA") or ROOT.parent / "shared" / "data")


def boxes() -> list[dict]:
    """Clip objects around the skull, as in the file that ``--clip`` takes."""
    half = TURNED * math.sqrt(0.5)
    axes = (((STRAIGHT[0], 0.0), (0.0, STRAIGHT[1])), ((half, -half), (half, half)))
    return [
        {"kind": "box", "keep": "inside", "matrix_world": [
            [x[0], x[1], 0.0, MIDDLE[0]], [y[0], y[1], 0.0, MIDDLE[1]], [0.0, 0.0, HEIGHT, MIDDLE[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]} for x, y in axes
    ]  # fmt: skip


def skull_words(folder: Path) -> list[str]:
    """The command line of the figure, without its output."""
    series, clip = data_folder() / SKULL, []
    if series.is_dir():
        path = folder / "boxes.json"
        path.write_text(json.dumps(boxes()), encoding="utf-8")
        clip = ["--clip", str(path)]
    else:
        from .practice_ct import write_series

        series = folder / "practice-ct"
        write_series(series)
    views = [word for view in VIEWS for word in ("--view", *map(str, view))]
    return ["figure", str(series), "--preset", "ct-bone", *clip, *views, "--columns", "3", "--fit", "1.02"]


def main(words) -> int:
    """Make the figure in out/figures; further words go to ``rle-splat figure``."""
    from rle_splat.cli.main import main as rle_splat

    FOLDER.mkdir(parents=True, exist_ok=True)
    outputs = ["-o", str(FOLDER / "skull.svg"), "-o", str(FOLDER / "skull.png")]
    usual = [] if "--quality" in words else ["--quality", "fine"]
    return rle_splat([*skull_words(FOLDER), *usual, *outputs, *words])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
