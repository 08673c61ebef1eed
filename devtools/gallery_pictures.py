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
from PIL import Image, ImageDraw, ImageFont

MOST_BYTES = 450_000  # of a JPEG
AFTER = "-after"  # ends the name of the second of a pair
TITLE = 28  # pixels above each
GAP = 4  # pixels between two in a row
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


def in_pairs(pictures: dict[str, Image.Image]) -> Image.Image:
    """Four pictures in a row, half as large, each with its name above it, the first of a pair with that of its light.
    Without pairs, a plus says that one adds to those before."""
    paired, across = any(name.endswith(AFTER) for name in pictures), 4
    width, height = (round(0.5 * side) for side in next(iter(pictures.values())).size)
    sheet = Image.new("RGB", (across * width, (height + TITLE) * -(-len(pictures) // across)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(18)
    for number, (name, picture) in enumerate(pictures.items()):
        left, top = width * (number % across), (height + TITLE) * (number // across)
        sheet.paste(picture.resize((width, height), Image.Resampling.LANCZOS), (left, top + TITLE))
        of, _, when = name.partition("-")
        title = ("" if paired or number < 2 else "+ ") + ("Headlight" if when == "before" else of.title())
        pen.text((left + 2, top + 3), title, fill="black", font=font)
    return sheet


def in_a_row(pictures: dict[str, Image.Image]) -> Image.Image:
    """Pictures side by side, each with its name in the corner; a picture alone has none."""
    width, height = next(iter(pictures.values())).size
    sheet, font = Image.new("RGB", ((width + GAP) * len(pictures) - GAP, height), EDGE), ImageFont.load_default(20)
    for number, (name, picture) in enumerate(pictures.items()):
        sheet.paste(picture, ((width + GAP) * number, 0))
        if len(pictures) > 1:
            ImageDraw.Draw(sheet).text(((width + GAP) * number + 12, 8), name, fill="white", font=font)
    return sheet


def main(folder: Path, path: Path, finer: int) -> None:
    names = json.loads((folder / "parts.json").read_text())
    pictures = {name: on_backdrop(Image.open(folder / f"{name}.png").reduce(finer)) for name in names}
    save_jpeg((in_pairs if len(names) > 3 else in_a_row)(pictures), path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
