"""A picture in tiles: parts that are rendered one after the other, and put together in rows.

A tile is a crop of the scene, which has the bits of the whole picture whatever is in the scene.  What does not depend
on the tile (classification, light, shadows, tables) is made once and kept in the stage cache.
"""

from dataclasses import replace

import numpy as np

from ..runtime.memory import available_bytes, bytes_text
from ..runtime.steps import Progress, rescale
from ..scene import Quality, Rendering, RleSplatError, Scene
from .choose_source import choose_source
from .memory_estimate import PICTURE_PIXEL, WRITTEN
from .render import render_steps
from .report import report_image
from .single_rays import add_neighbors, traces_steep_pixels
from .source import Source
from .stage_cache import StageCache
from .views import choose_view

SIDES = (1024, 512, 256, 128, 64)  # pixels; the first that fits
SHARE = 0.5  # of the free memory is for the picture; the other half is for what is made of the volume


def tiles_of(region, side: int) -> list[tuple[int, int, int, int]]:
    """The tiles of a picture, row by row from the top left.

    Parameters
    ----------
    region : (left, top, right, bottom)
        Pixels of the picture.
    side : int
        Width and height of a tile in pixels; the last ones of a row and of a column are smaller.

    Returns
    -------
    list of (left, top, right, bottom)
    """
    left, top, right, bottom = region
    return [
        (x, y, min(x + side, right), min(y + side, bottom))
        for y in range(top, bottom, side) for x in range(left, right, side)
    ]  # fmt: skip


def choose_tile_side(scene: Scene, quality: Quality) -> int | None:
    """The side of the largest tiles that fit into the free memory; None where the picture fits as a whole.

    Raises
    ------
    RleSplatError
        Where not even the smallest tiles fit.
    """
    source = choose_source(scene, quality)
    width = scene.region[2] - scene.region[0]
    free = SHARE * available_bytes()
    if _picture_bytes(source) <= free:
        return None
    needed = 0
    for side in SIDES:
        some = _some_of(tiles_of(scene.region, side), -(-width // side))
        needed = max(_picture_bytes(replace(source, scene=replace(source.scene, crop=tile))) for tile in some)
        needed += 2 * PICTURE_PIXEL * width * side
        if needed <= free:
            return side
    raise RleSplatError(
        f"Tiles of {SIDES[-1]} pixels of a picture that is {width} pixels wide need about {bytes_text(needed)} of "
        f"memory, and {bytes_text(free)} are free for them; make the picture narrower, or raise the limit."
    )


def _some_of(tiles: list, across: int) -> set:
    """A corner, the middle and the sides: tiles differ in how much of the sheets they need."""
    down = len(tiles) // across
    places = {(row, column) for row in (0, down // 2, down - 1) for column in (0, across // 2, across - 1)}
    return {tiles[row * across + column] for row, column in places}


def _picture_bytes(source: Source) -> int:
    """What the sheets and the pixels of the scene's crop take."""
    source = add_neighbors(source)
    view = choose_view(source, refuse_empty=False)
    left, top, right, bottom = source.scene.region
    pictured = source.picture_bytes(view.planes, shortened=True, traced=traces_steep_pixels(source))
    return WRITTEN * (right - left) * (bottom - top) + pictured


class Strip:
    """The tiles of one height, put together: full rows of the picture.

    Attributes
    ----------
    rgba : (H, W, 4) ndarray of float32
    depth : (H, W) ndarray of float32
    """

    def __init__(self, region, tile):
        self._left = region[0]
        shape = tile[3] - tile[1], region[2] - region[0]
        self.rgba, self.depth = np.empty((*shape, 4), np.float32), np.empty(shape, np.float32)

    def put(self, tile, rgba, depth) -> None:
        """Place the pixels of a tile."""
        columns = slice(tile[0] - self._left, tile[2] - self._left)
        self.rgba[:, columns], self.depth[:, columns] = rgba, depth


def render_tiles_steps(
    scene: Scene, quality: Quality, side: int, write, cache: StageCache | None = None, *, refuse_empty_view: bool = True
):  # fmt: skip
    """Generator of Progress: render a picture in tiles; returns its report.

    Parameters
    ----------
    side : int
        Of the tiles, in pixels.
    write : callable
        Called with (rgba, depth) of full rows of the picture, from the top on: as those of a Rendering.
    cache : StageCache, optional
        Left out, results of stages are kept for this picture alone.
    refuse_empty_view : bool
        Raise when the camera sees nothing of the volume, else the picture is transparent.

    Raises
    ------
    RleSplatError
        Where the scene cannot be rendered, or the camera sees nothing of the volume.
    """
    if refuse_empty_view:
        check_view(scene, quality)
    cache = StageCache(available_bytes()) if cache is None else cache
    tiles, total, strip = tiles_of(scene.region, side), Total(scene.crop, (scene.width, scene.height), side), None
    for number, tile in enumerate(tiles):
        steps = render_steps(replace(scene, crop=tile), quality, cache=cache, refuse_empty_view=False)
        # The first tile makes what all have in common.
        message = f"Tile {number + 1} of {len(tiles)}" if number else ""
        found = yield from rescale(steps, number / len(tiles), (number + 1) / len(tiles), message)
        if strip is None:
            strip = Strip(scene.region, tile)
        strip.put(tile, found.rgba, found.depth)
        total.add(found)
        if tile[2] == scene.region[2]:
            write(strip.rgba, strip.depth)
            strip = None
    yield Progress(1.0, "Done")
    return total.report()


def check_view(scene: Scene, quality: Quality) -> None:
    """RleSplatError where the camera sees nothing of the volume: a tile alone may be empty, the picture may not."""
    source = choose_source(scene, quality)
    if not source.scene.motion:
        choose_view(source, refuse_empty=True)


class Total:
    """The report of a picture, from the Renderings of its tiles: that of the fullest tile, with the times of all.

    ``tiles`` {side, count} is added; the plan has no ``base_planes``, since each tile has its own parts of them.
    """

    def __init__(self, crop, size, side: int):
        self._image, self._side, self._count = report_image(crop, *size), side, 0
        self._fullest, self._most, self._traced = {}, -1.0, 0
        self._stages: dict[str, float] = {}
        self._effects: dict[str, dict] = {}
        self._kernels: set[str] = set()

    def add(self, tile: Rendering) -> None:
        """Count a tile."""
        report, opaque = tile.report, float(tile.rgba[..., 3].sum(dtype=np.float64))
        if opaque > self._most:
            self._fullest, self._most = report, opaque
        self._count += 1
        self._traced += report["rays"]["pixels"]
        self._kernels.update(report["kernels"])
        for name, taken in report["stages_ms"].items():
            self._stages[name] = self._stages.get(name, 0.0) + taken
        for effect in report["effects"]:
            held = self._effects.get(effect["name"], effect)
            both = None if None in (held["ms"], effect["ms"]) else held["ms"] + effect["ms"] * (held is not effect)
            self._effects[effect["name"]] = {**(effect if effect["on"] else held), "ms": both}

    def report(self) -> dict:
        """Of all tiles that were added."""
        plan = {name: value for name, value in self._fullest["plan"].items() if name != "base_planes"}
        share = self._traced / (self._image["width"] * self._image["height"])
        return {
            **self._fullest, "image": self._image, "plan": plan, "effects": list(self._effects.values()),
            "rays": {**self._fullest["rays"], "pixels": self._traced, "share": share},
            "stages_ms": self._stages, "kernels": sorted(self._kernels),
            "tiles": {"side": self._side, "count": self._count},
        }  # fmt: skip
