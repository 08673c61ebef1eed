"""Put a picture of the gallery on its backdrop and compress it (runs in an environment with Pillow).

Arguments: the folder with the picture and its name in ``parts.json``; the file to write.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

MOST_BYTES = 480_000  # of a JPEG
EDGE, CENTER = (17, 19, 23), (66, 74, 86)  # colors of the backdrop


def on_backdrop(part: Image.Image) -> Image.Image:
    """A picture over a dark wall that is lit from the middle; one without transparency hides it."""
    width, height = part.size
    x, y = np.linspace(-1.0, 1.0, width)[None, :], np.linspace(-1.0, 1.0, height)[:, None]
    light = np.exp(-1.1 * (x**2 + (y + 0.1) ** 2))[..., None]
    wall = np.array(EDGE) + light * (np.array(CENTER) - np.array(EDGE))
    grain = np.random.default_rng(0).uniform(-0.5, 0.5, (height, width, 1))  # so that 8 bits show no bands
    backdrop = Image.fromarray(np.clip(np.rint(wall + grain), 0, 255).astype(np.uint8)).convert("RGBA")
    return Image.alpha_composite(backdrop, part.convert("RGBA")).convert("RGB")


def save_jpeg(picture: Image.Image, path: Path, most: int = MOST_BYTES) -> int:
    """Save with the best quality that keeps to a number of bytes; returns that quality."""
    for quality in range(92, 30, -4):
        picture.save(path, quality=quality, optimize=True, progressive=True, subsampling="4:2:0")
        if path.stat().st_size <= most:
            break
    return quality


def main(folder: Path, path: Path) -> None:
    (name,) = json.loads((folder / "parts.json").read_text())
    save_jpeg(on_backdrop(Image.open(folder / f"{name}.png")), path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
