"""A page as pixels, scene-linear, with anti-aliasing."""

import numpy as np

from ..scene import RleSplatError
from .lettering import outlines_of
from .page import Fill, Page, Stroke, Text, Tile

ANCHOR_SHARES = {"start": 0.0, "middle": 0.5, "end": 1.0}
HALO = 0.1  # width of a halo on each side, in font sizes
BOLD = 0.035  # width of the line around letters that makes them bold, in font sizes
TINY = 1e-24  # square of a length in pixels that counts as none
REACH = 1.0  # pixels beyond an edge that its anti-aliasing may touch


def draw(page: Page) -> np.ndarray:
    """Draw a page; RleSplatError if a tile reaches beyond the page.

    Returns
    -------
    (height, width, 4) ndarray of float32
        Scene-linear, premultiplied, row 0 at the top.
    """
    canvas = np.zeros((page.height, page.width, 4), dtype=np.float32)
    if page.background is not None:
        canvas[...] = (*page.background, 1.0)
    for item in page.items:
        if isinstance(item, Tile):
            _put(canvas, item, page)
        elif isinstance(item, Text):
            _write(canvas, item, page)
        elif isinstance(item, Stroke):
            _ink(canvas, _line_cover(canvas.shape, [_pixels(item.points, page)], item.width, page), item.color)
        elif isinstance(item, Fill):
            _ink(canvas, _area_cover(canvas.shape, [_pixels(item.points, page)]), item.color)
    return canvas


def _pixels(points, page: Page) -> np.ndarray:
    """(n, 2) float64: points in mm as columns and rows; pixel (c, r) covers [c, c + 1) x [r, r + 1)."""
    return np.asarray(points, dtype=np.float64) * page.pixels_per_mm


def _put(canvas: np.ndarray, tile: Tile, page: Page) -> None:
    """Lay a premultiplied picture over the canvas."""
    left, top = (round(place * page.pixels_per_mm) for place in (tile.x, tile.y))
    height, width = tile.rgba.shape[:2]
    if left < 0 or top < 0 or left + width > page.width or top + height > page.height:
        raise RleSplatError("A picture reaches beyond the page; make the figure wider, or its text smaller.")
    part = canvas[top : top + height, left : left + width]
    part *= 1.0 - tile.rgba[..., 3:]
    part += tile.rgba


def _write(canvas: np.ndarray, text: Text, page: Page) -> None:
    outlines, width = outlines_of(text.text, text.size)
    left = text.x - ANCHOR_SHARES[text.anchor] * width
    lines = [_pixels(outline * (1.0, -1.0) + (left, text.y), page) for outline in outlines]
    borders = [np.concatenate((line, line[:1])) for line in lines]
    if text.halo is not None:
        _ink(canvas, _line_cover(canvas.shape, borders, 2.0 * HALO * text.size, page), text.halo)
    if text.bold:
        _ink(canvas, _line_cover(canvas.shape, borders, BOLD * text.size, page), text.color)
    _ink(canvas, _area_cover(canvas.shape, lines), text.color)


def _ink(canvas: np.ndarray, covered, color) -> None:
    """Paint a color where it covers pixels: ``covered`` is (rows, columns, cover), or None for nothing."""
    if covered is None:
        return
    rows, columns, cover = covered
    part = canvas[rows, columns]
    part *= 1.0 - cover[..., None]
    part += cover[..., None] * np.array((*color, 1.0), np.float32)


def _bounds(shape, points: np.ndarray, reach: float):
    """Slices of rows and of columns around points, within a canvas; None where that is empty."""
    low = np.maximum(np.floor(points.min(axis=0) - reach).astype(int), 0)
    high = np.minimum(np.ceil(points.max(axis=0) + reach).astype(int), (shape[1], shape[0]))
    return (slice(low[1], high[1]), slice(low[0], high[0])) if (low < high).all() else None


def _middles(rows: slice, columns: slice):
    """Columns (1, n) and rows (m, 1) of the middles of the pixels of two slices."""
    across = np.arange(columns.start, columns.stop)[None, :] + 0.5
    return across, np.arange(rows.start, rows.stop)[:, None] + 0.5


def _line_cover(shape, lines: list, width_mm: float, page: Page):
    """How much of each pixel lines cover that are ``width_mm`` wide and have round ends; lines are (n, 2) pixels."""
    if not lines:
        return None
    half = 0.5 * width_mm * page.pixels_per_mm
    thin = min(2.0 * half, 1.0)  # a line thinner than a pixel is drawn one pixel wide and fainter
    half = max(half, 0.5)
    window = _bounds(shape, np.concatenate(lines), half + REACH)
    if window is None:
        return None
    rows, columns = window
    cover = np.zeros((rows.stop - rows.start, columns.stop - columns.start), dtype=np.float32)
    for line in lines:
        inner = _bounds(shape, line, half + REACH)
        if inner is None:
            continue
        place = tuple(slice(i.start - w.start, i.stop - w.start) for i, w in zip(inner, window))
        found = np.clip(half + 0.5 - _distance(*_middles(*inner), line), 0.0, 1.0)
        np.maximum(cover[place], thin * found, out=cover[place], casting="same_kind")
    return rows, columns, cover


def _distance(across, down, line: np.ndarray) -> np.ndarray:
    """Distance of pixels from a line of segments, in pixels."""
    begin, along = line[:-1, :, None, None], np.diff(line, axis=0)[..., None, None]
    length = np.maximum(np.sum(along * along, axis=1), TINY)
    x, y = across - begin[:, 0], down - begin[:, 1]
    share = np.clip((x * along[:, 0] + y * along[:, 1]) / length, 0.0, 1.0)
    x, y = x - share * along[:, 0], y - share * along[:, 1]
    return np.sqrt((x * x + y * y).min(axis=0))


def _area_cover(shape, polygons: list):
    """How much of each pixel is inside closed polygons, (n, 2) pixels; those within others, turned around, are holes.

    Exact: each edge is cut where it leaves a pixel. A piece covers what is right of it, down its height.
    """
    window = _bounds(shape, np.concatenate(polygons), REACH) if polygons else None
    if window is None:
        return None
    rows, columns = window
    height, width = rows.stop - rows.start, columns.stop - columns.start
    begin = np.concatenate(polygons) - (columns.start, rows.start)
    along = np.concatenate([np.roll(polygon, -1, axis=0) - polygon for polygon in polygons])
    edges, places = [np.repeat(np.arange(len(begin)), 2)], [np.tile([0.0, 1.0], len(begin))]
    for axis in range(2):
        ends = np.stack((begin[:, axis], begin[:, axis] + along[:, axis]))
        first = np.floor(ends.min(axis=0)) + 1.0
        counts = np.maximum(np.ceil(ends.max(axis=0)) - first, 0.0).astype(int)
        edge = np.repeat(np.arange(len(begin)), counts)
        line = first[edge] + np.arange(edge.size) - np.repeat(np.cumsum(counts) - counts, counts)
        edges.append(edge)
        places.append((line - begin[edge, axis]) / along[edge, axis])
    edge, place = np.concatenate(edges), np.concatenate(places)
    order = np.lexsort((place, edge))
    edge, place = edge[order], place[order]
    same = edge[1:] == edge[:-1]
    middle = begin[edge[1:]] + 0.5 * (place[1:] + place[:-1])[:, None] * along[edge[1:]]
    down = (place[1:] - place[:-1]) * along[edge[1:], 1]
    row = np.floor(middle[:, 1]).astype(int)
    kept = same & (row >= 0) & (row < height)
    x = np.clip(middle[kept, 0], 0.0, width)
    column = np.minimum(x.astype(int), width - 1)
    covers = np.zeros((height, width + 1))
    np.add.at(covers, (row[kept], column), down[kept] * (column + 1.0 - x))
    np.add.at(covers, (row[kept], column + 1), down[kept] * (x - column))
    return rows, columns, np.minimum(np.abs(np.cumsum(covers[:, :-1], axis=1)), 1.0).astype(np.float32)
