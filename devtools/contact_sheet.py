"""A sheet of photographs of Blender's window: parts of them, numbered and named.

    python3 dev.py blender --photograph tests/blender/window_trust.py --size 1280x1400
    .venv/bin/python -m devtools.contact_sheet build/window-shots/window_trust docs/images/messages.jpg

makes that of docs/how-to/troubleshoot.md.
"""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

WIDTH, ROOM = 1260, 14  # pixels of the sheet, and between photographs
LINES, LINE, LETTER = 2, 13, 6.5  # lines of a name, their height, and the width of a letter
TEXT = LINES * LINE + 4
SIDEBAR = 0.478, 0.683  # of the window's width
VIEW, EDITOR = (0.13, 0.36, 0.45, 0.7), (0.7, 0.36, 1.0, 0.66)

# Photograph -> its name on the sheet, and the part of it (left, top, right, bottom) in shares of the window.
PARTS = {
    "01-identity": ("1 beside a user's image of the same name", VIEW),
    "06-before-a-scripts-edit": ("6 before a script's edit", VIEW),
    "06-after-a-scripts-edit": ("6 after it", VIEW),
    "02-deletion": ("2 the volume was deleted", (SIDEBAR[0], 0.28, SIDEBAR[1], 0.54)),
    "03-view-layer": ("3 excluded from the view layer", (SIDEBAR[0], 0.61, SIDEBAR[1], 0.92)),
    "09-undone-settings": ("9 undone settings", (SIDEBAR[0], 0.61, SIDEBAR[1], 0.87)),
    "11-maximum-error": ("11 a maximum error takes the place of Quality", (SIDEBAR[0], 0.61, SIDEBAR[1], 0.84)),
    "05-linked": ("5 linked: nothing is edited in vain", (SIDEBAR[0], 0.06, SIDEBAR[1], 0.36)),
    "08-guessing": ("8 big_head, little-endian all the same", (SIDEBAR[0], 0.82, SIDEBAR[1], 0.98)),
    "10-transfer-function-without-a-node": (
        "10 a node of the transfer function is gone", (SIDEBAR[0], 0.06, SIDEBAR[1], 0.26)),
    "09-preferences": ("9 where pictures are kept", (0.7, 0.1, 1.0, 0.5)),
    "04-failed-frame": ("4 the placeholder of a failed frame", EDITOR),
    "07-meshes-occlude": ("7 Save Picture beside a mesh", EDITOR),
}  # fmt: skip


def sheet(folder: Path):
    """Make the sheet.

    Parameters
    ----------
    folder : Path
        Of the photographs, PNG files named as in PARTS.

    Returns
    -------
    PIL.Image.Image
    """
    from PIL import Image, ImageDraw

    rows, across = [[]], 0
    for name, (text, (left, top, right, bottom)) in PARTS.items():
        with Image.open(folder / f"{name}.png") as whole:
            wide, high = whole.size
            part = whole.convert("RGB").crop((int(left * wide), int(top * high), int(right * wide), int(bottom * high)))
        if rows[-1] and across + part.width > WIDTH:
            rows.append([])
            across = 0
        rows[-1].append((text, part))
        across += part.width + ROOM
    heights = [TEXT + ROOM + max(part.height for _, part in row) for row in rows]
    found = Image.new("RGB", (WIDTH, sum(heights)), "white")
    draw, top = ImageDraw.Draw(found), 0
    for row, height in zip(rows, heights):
        left = 0
        for text, part in row:
            for line, words in enumerate(textwrap.wrap(text, int(part.width / LETTER))[:LINES]):
                draw.text((left, top + line * LINE), words, fill="black")
            found.paste(part, (left, top + TEXT))
            left += part.width + ROOM
        top += height
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("picture", type=Path)
    given = parser.parse_args()
    sheet(given.folder).save(given.picture, quality=75)


if __name__ == "__main__":
    main()
