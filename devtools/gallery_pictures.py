"""Put a picture of the gallery, or several side by side, on its backdrop and compress it (runs in an environment with
Pillow).

Arguments: the folder with the pictures and their names in ``parts.json``; the file to write; by how much they are
scaled down.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from .sheets import sheet

MOST_BYTES = 450_000  # of a JPEG
WALL, PAGE = ((17, 19, 23), (66, 74, 86)), ((236, 237, 239),) * 2  # colors of backdrops, at the edge and in the middle
ON_PAGE = "Cut-Out"  # the picture that is shown on a page, which shows its shadow


def on_backdrop(part: Image.Image, backdrop=WALL) -> Image.Image:
    """A picture over a dark wall that is lit from the middle; one without transparency hides it."""
    edge, center = map(np.array, backdrop)
    width, height = part.size
    x, y = np.linspace(-1.0, 1.0, width)[None, :], np.linspace(-1.0, 1.0, height)[:, None]
    light = np.exp(-1.1 * (x**2 + (y + 0.1) ** 2))[..., None]
    wall = edge + light * (center - edge)
    grain = np.random.default_rng(0).uniform(-0.5, 0.5, (height, width, 1))  # so that 8 bits show no bands
    behind = Image.fromarray(np.clip(np.rint(wall + grain), 0, 255).astype(np.uint8)).convert("RGBA")
    return Image.alpha_composite(behind, part.convert("RGBA")).convert("RGB")


def save_jpeg(picture: Image.Image, path: Path, most: int = MOST_BYTES) -> int:
    """Save with the best quality that keeps to a number of bytes; returns that quality."""
    for quality in range(92, 30, -4):
        picture.save(path, quality=quality, optimize=True, progressive=True, subsampling="4:2:0")
        if path.stat().st_size <= most:
            break
    return quality


def main(folder: Path, path: Path, finer: int) -> None:
    names = json.loads((folder / "parts.json").read_text())
    pictures = {
        name: on_backdrop(Image.open(folder / f"{name}.png").reduce(finer), PAGE if name == ON_PAGE else WALL)
        for name in names
    }
    if len(names) > 1:
        parts = [(name.partition(" of ")[0], np.asarray(one)) for name, one in pictures.items()]
        made = Image.fromarray(sheet(parts, 2 if len(names) > 3 else None))
    else:
        made = pictures[names[0]]
    save_jpeg(made, path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
