"""dev.py figures: figures of the documentation, made by the command line with options of users.

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
TURN = tuple((20 + 60 * n, 15) for n in range(6))
CLOSE = ("--azimuth", "30", "--elevation", "20", "--fit", "0.42", "--size", "400")
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
    """What each command line takes of the scan."""
    series, clip = data_folder() / SKULL, []
    if series.is_dir():
        path = folder / "boxes.json"
        path.write_text(json.dumps(boxes()), encoding="utf-8")
        clip = ["--clip", str(path)]
    else:
        from .practice_ct import write_series

        series = folder / "practice-ct"
        write_series(series)
    return [str(series), "--preset", "ct-bone", *clip]


def command_lines(folder: Path) -> list[list[str]]:
    """The figure, a turntable, and a part of the skull in two qualities."""
    skull, views, turn = skull_words(folder), *([w for v in views for w in ("--view", *map(str, v))]
                                                for views in (VIEWS, TURN))  # fmt: skip
    page = ["figure", *skull, "--columns", "3", "--fit", "1.02", "--quality", "fine"]
    return [
        [*page, *views, "-o", str(folder / "figure-skull.svg"), "-o", str(folder / "figure-skull.png")],
        [*page, *turn, "--sides", "off", "--scale-bar", "off", "--caption", "", "--dpi", "200",
         "-o", str(folder / "how-to-turn.png")],
        *(["render", *skull, *CLOSE, "--quality", quality, "-o", str(folder / f"how-to-{quality}.png")]
          for quality in ("draft", "fine")),
    ]  # fmt: skip


def main() -> int:
    """Make the pictures in out/figures."""
    from rle_splat.cli.main import main as rle_splat

    FOLDER.mkdir(parents=True, exist_ok=True)
    return max(map(rle_splat, command_lines(FOLDER)))


if __name__ == "__main__":
    sys.exit(main())
