"""Put the parts of a gallery picture together and compress them (runs in an environment with Pillow).

Arguments: the folder with the parts and their list, ``parts.json``; a layout; the file to write.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

MOST_BYTES = 480_000  # of a JPEG
COLUMNS = {"single": 1, "row": 2, "grid": 2}
GAP = 8  # pixels between parts
FRAME_MS = 90
# Part -> what is written below it, where parts stand side by side.
CAPTIONS = {
    "skin": "Skin", "glass": "Bone under clear skin", "bone": "Bone", "xray": "X-ray",
    "shaded": "Shaded", "mip": "Maximum intensity projection",
}  # fmt: skip
INK = (214, 218, 224)
EDGE, CENTER = (17, 19, 23), (66, 74, 86)  # colors of the backdrop


def put_together(parts: list[Image.Image], columns: int, gap: int = GAP) -> Image.Image:
    """Pictures of one size side by side in rows, with black between them."""
    width, height = parts[0].size
    rows = -(-len(parts) // columns)
    whole = Image.new("RGB", (columns * width + (columns - 1) * gap, rows * height + (rows - 1) * gap))
    for k, part in enumerate(parts):
        whole.paste(part, (k % columns * (width + gap), k // columns * (height + gap)))
    return whole


def on_backdrop(part: Image.Image) -> Image.Image:
    """A picture over a dark wall that is lit from the middle; one without transparency hides it."""
    width, height = part.size
    x, y = np.linspace(-1.0, 1.0, width)[None, :], np.linspace(-1.0, 1.0, height)[:, None]
    light = np.exp(-1.1 * (x**2 + (y + 0.1) ** 2))[..., None]
    wall = np.array(EDGE) + light * (np.array(CENTER) - np.array(EDGE))
    grain = np.random.default_rng(0).uniform(-0.5, 0.5, (height, width, 1))  # so that 8 bits show no bands
    backdrop = Image.fromarray(np.clip(np.rint(wall + grain), 0, 255).astype(np.uint8)).convert("RGBA")
    return Image.alpha_composite(backdrop, part.convert("RGBA")).convert("RGB")


def captioned(part: Image.Image, text: str) -> Image.Image:
    """A picture with a line of text in its lower left corner."""
    found, margin = part.copy(), part.height // 30
    font = ImageFont.load_default(size=max(part.height // 28, 6))
    ImageDraw.Draw(found).text((margin, part.height - margin), text, fill=INK, font=font, anchor="ls")
    return found


def save_jpeg(picture: Image.Image, path: Path, most: int = MOST_BYTES) -> int:
    """Save with the best quality that keeps to a number of bytes; returns that quality."""
    for quality in range(92, 30, -4):
        picture.save(path, quality=quality, optimize=True, progressive=True, subsampling="4:2:0")
        if path.stat().st_size <= most:
            break
    return quality


def save_turn(frames: list[Image.Image], path: Path) -> None:
    """Save a GIF that repeats; one palette for all frames, so that what stands still does not flicker."""
    strip = put_together(frames[:: max(len(frames) // 6, 1)], 1, gap=0)
    palette = strip.quantize(256, method=Image.Quantize.MEDIANCUT)
    flat = [frame.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for frame in frames]
    flat[0].save(path, save_all=True, append_images=flat[1:], duration=FRAME_MS, loop=0, optimize=False, disposal=1)


def main(folder: Path, layout: str, path: Path) -> None:
    names = json.loads((folder / "parts.json").read_text())
    parts = [on_backdrop(Image.open(folder / f"{name}.png")) for name in names]
    if layout == "turn":
        save_turn(parts, path)
        return
    if len(parts) > 1:
        parts = [captioned(part, CAPTIONS[name]) for part, name in zip(parts, names)]
    save_jpeg(put_together(parts, COLUMNS[layout]), path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
