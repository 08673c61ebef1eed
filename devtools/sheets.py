"""Sheets of pictures with captions: one look for all pictures of the documentation.

The letters are those of figures: ``rle_splat.figure.lettering``.  Runs with numpy alone, so in Blender, too.
"""

from __future__ import annotations

import numpy as np

from rle_splat.figure.lettering import text_width
from rle_splat.figure.page import MM_PER_INCH, Page, Text
from rle_splat.figure.raster import draw
from rle_splat.scene.color import linear
from rle_splat.scene.display import to_bytes

GROUND, INK = linear((0.16, 0.16, 0.16)), (1.0, 1.0, 1.0)
GAP = 4  # pixels between two pictures
LETTERS, BAR = 60, 1.8  # a sheet's width at least, and the height of the bar with a caption, in font sizes


def sheet(pictures, across: int | None = None) -> np.ndarray:
    """Pictures beside each other, each below its caption.

    Parameters
    ----------
    pictures : sequence of (str, (H, W, 3) ndarray of uint8)
        Captions and pictures; those of a row are equally high.
    across : int, optional
        How many are in a row; all without it.

    Returns
    -------
    (H, W, 3) ndarray of uint8
    """
    across = across or len(pictures)
    rows = [pictures[first : first + across] for first in range(0, len(pictures), across)]
    width = max(sum(picture.shape[1] + GAP for _, picture in row) for row in rows) - GAP
    room = min(picture.shape[1] / (1.0 + text_width(caption, 1.0)) for caption, picture in pictures)
    size = min(width / LETTERS, room)
    bar, top, texts, places = round(BAR * size), 0, [], []
    for row in rows:
        left = 0
        for caption, picture in row:
            texts.append(Text(left + 0.5 * size, top + 0.5 * bar + 0.36 * size, caption, size, INK))
            places.append((slice(top + bar, top + bar + len(picture)), slice(left, left + picture.shape[1]), picture))
            left += picture.shape[1] + GAP
        top += bar + len(row[0][1]) + GAP
    made = to_bytes(draw(Page(width, top - GAP, MM_PER_INCH, GROUND, tuple(texts))), GROUND)  # a pixel is a millimeter
    for down, along, picture in places:
        made[down, along] = picture
    return made
