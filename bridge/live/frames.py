"""The pictures of one view: a scene for each volume as the viewport sees it, rendered in steps."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...rle_splat.classify.transfer_function import TransferFunction
from ...rle_splat.pipeline.fitting import fitting_steps
from ...rle_splat.pipeline.several import MOST_SPANS, several_steps
from ...rle_splat.runtime.steps import Progress
from ...rle_splat.scene import Quality, Scene
from ...rle_splat.view.box_order import near_to_far
from ...rle_splat.view.projection import depth_row
from ..pictures.drafts import draft_of
from .floor import READING, without_floor_steps
from .view import Matrices, ViewportView, furthest_of_blocks, pixels_of, resized, view_of, with_margin

DRAFT_SPANS = 4  # in which a draft mixes volumes that overlap


@dataclass(frozen=True, eq=False)
class Contents:
    """What one volume shows in any view.

    Attributes
    ----------
    plain : Scene
        Its camera and its size are replaced in every picture.
    quality : Quality
        Of the refined picture.
    digest : str
        Hash of both.
    corners : (8, 3) ndarray of float64
        World coordinates of a box that holds everything that is shown of the volume.
    """

    plain: Scene
    quality: Quality
    digest: str
    corners: np.ndarray


@dataclass(eq=False)
class Ends:
    """Where the rays of a view end by a viewport's depth.

    Attributes
    ----------
    drawn : (height, width) ndarray of float32
        Depths as ``view.ray_ends`` returns them.
    part : (left, top, right, bottom)
        The region's pixels that hold depths.
    has_floor : bool
        Whether the lines of the floor may be among them, at which no ray ends.
    """

    drawn: np.ndarray
    view: ViewportView
    part: tuple[int, int, int, int]
    has_floor: bool = False
    _found: np.ndarray | None = None

    def steps(self):
        """Generator: the depths at which rays end, (height, width) float32; yields Progress the first time."""
        if self._found is None:
            if not self.has_floor:
                return self.drawn
            self._found = yield from without_floor_steps(self.view, self.drawn, self.part)
        return self._found


@dataclass(frozen=True, eq=False)
class RegionPicture:
    """A picture of a part of a region.

    Attributes
    ----------
    rgba : (H, W, 4) ndarray of float32
        Premultiplied scene-linear colors, row 0 at the top.
    place : (left, top, right, bottom)
        Where it lies, as shares of the region's width and height, from the top left.
    halvings : int
        How often the number of voxels along each side of the volume was halved for it.
    """

    rgba: np.ndarray
    place: tuple[float, float, float, float]
    halvings: int = 0


@dataclass(frozen=True, eq=False)
class Shot:
    """One view of all visible volumes.

    Attributes
    ----------
    view : ViewportView
        In the region's own size.
    contents : tuple of Contents
        Those that the view shows, the furthest first.
    pixels : dict
        Number in ``contents`` -> the region's pixels that show it.
    groups : tuple of tuple of int
        Numbers in ``pixels`` of those that overlap, the furthest group first.
    """

    matrices: Matrices
    view: ViewportView
    contents: tuple[Contents, ...]
    pixels: dict
    groups: tuple = ()

    @cached_property
    def part(self) -> tuple[int, int, int, int] | None:
        """The region's pixels whose depth the pictures depend on; None where no volume is in the view."""
        if not self.pixels:
            return None
        parts = np.array([with_margin(one, self.view.width, self.view.height) for one in self.pixels.values()])
        return *(int(n) for n in parts[:, :2].min(axis=0)), *(int(n) for n in parts[:, 2:].max(axis=0))


def shot_of(matrices: Matrices, contents) -> Shot:
    """A view of volumes, the furthest first; RleSplatError as of ``view_of``."""
    view = view_of(matrices, 0.0)
    row = depth_row(view.camera)
    depths = [one.corners @ row[:3] + row[3] - view.set_back for one in contents]
    if view.camera.type == "ORTHO":  # the only one that may be set back
        view = view_of(matrices, min((float(depth.min()) for depth in depths), default=0.0))
    groups = near_to_far([one.corners for one in contents], view.camera)[::-1]
    groups = [sorted(group, key=lambda n: -float(depths[n].mean())) for group in groups]
    order = [n for group in groups for n in group]
    ordered = tuple(contents[n] for n in order)
    found = {n: pixels_of(view, one.corners) for n, one in enumerate(ordered)}
    pixels = {n: one for n, one in found.items() if one is not None}
    seen = [tuple(order.index(n) for n in group if order.index(n) in pixels) for group in groups]
    return Shot(matrices, view, ordered, pixels, tuple(group for group in seen if group))


def picture_steps(shot: Shot, drawn: Ends | None, cache, coarseness: int | None):
    """Generator: make the pictures of a view; yields Progress, returns a list of RegionPicture, the furthest first.

    Parameters
    ----------
    drawn : Ends or None
        Depths at which rays end, of the whole region; None where none is known.
    coarseness : int or None
        Of a draft: 0 for every pixel of the region, 1 for every second one, and above that also a volume with half as
        many voxels along each side, so often. None for refined pictures, which are coarser only where memory runs out.
    """
    width, height, block = shot.view.width, shot.view.height, 2 if coarseness else 1
    halvings = max(coarseness - 1, 0) if coarseness else 0
    view = shot.view
    ends = None if drawn is None else (yield from drawn.steps())
    if block > 1:
        view = resized(view, -(-width // block), -(-height // block))
    if coarseness is not None and ends is not None:
        yield Progress(0.0, READING)
        ends = furthest_of_blocks(ends, block)
        yield Progress(0.0, READING)
    made = []
    for group in shot.groups:
        sides = np.array([shot.pixels[n] for n in group])
        (left, top), (right, bottom) = sides[:, :2].min(axis=0), sides[:, 2:].max(axis=0)
        crop = tuple(int(side) for side in (left // block, top // block, -(-right // block), -(-bottom // block)))
        seen_by = {"camera": view.camera, "width": view.width, "height": view.height, "crop": crop, "ray_ends": ends}
        scenes = [replace(shot.contents[n].plain, **seen_by) for n in group]
        halved: list[int] = []

        def make(plain, number, group=group, halved=halved):
            quality = shot.contents[group[number]].quality
            is_draft, times = coarseness is not None, 0
            if is_draft:
                quality = draft_of(quality)
                plain, times = in_larger_voxels(plain)
            rendering, more = yield from fitting_steps(plain, quality, cache, halvings, is_draft=is_draft)
            halved.append(times + more)
            return rendering

        steps = make(scenes[0], 0)
        if len(scenes) > 1:
            steps = several_steps(scenes, make, MOST_SPANS if coarseness is None else DRAFT_SPANS)
        rendering = yield from steps
        place = tuple(edge / whole for edge, whole in zip(crop, 2 * (view.width, view.height)))
        made.append(RegionPicture(np.ascontiguousarray(rendering.rgba, np.float32), place, max(halved)))
    return made


def in_larger_voxels(plain: Scene) -> tuple[Scene, int]:
    """A scene with the larger voxels that a folder of tables also holds, and how often their number is halved along
    each side; the same scene and 0 where there are none."""
    coarse = getattr(plain.volume, "coarse", None)
    if coarse is None:
        return plain, 0
    function = TransferFunction.from_json(coarse.transfer_function)
    times = round(np.log2((coarse.spacing / plain.volume.spacing).max()))  # a side that is odd is rounded up
    return replace(plain, volume=coarse, transfer_function=function), times
