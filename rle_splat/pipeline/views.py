"""The view of a picture: the base planes that its rays belong to, and the principal axes that fade into each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..scene import Quality, RleSplatError, Scene
from ..view.base_plane import BasePlane, base_plane
from ..view.eye import IndexView, index_view
from ..view.footprints import FOOTPRINTS
from ..view.principal_axis import axis_shares, candidate_pyramids
from ..warp.warp import warp_reach
from .source import Source


@dataclass(frozen=True, eq=False)
class Fade:
    """Base planes that show all of the picture together, and their share of it: 1 but where principal axes fade."""

    planes: list[BasePlane]
    share: float = 1.0

    def window(self, scene: Scene, quality: Quality) -> Fade:
        """The parts of the planes that the wanted pixels need."""
        if scene.crop is None:
            return self
        windows = [plane.window(scene.crop, warp_reach(quality)) for plane in self.planes]
        return replace(self, planes=[window for window in windows if window is not None])

    def add_to(self, picture, found):
        """The picture, (rgba, depth) or None before the first part, with this part added; the first's depths count."""
        if self.share == 1.0:
            return found
        rgba, depth = found
        rgba *= np.float32(self.share)
        return (rgba, depth) if picture is None else (np.add(picture[0], rgba, out=picture[0]), picture[1])


@dataclass(frozen=True, eq=False)
class View:
    """How a source is seen.

    Attributes
    ----------
    index_view : IndexView
        Its voxels' indices from the eye.
    fades : list of Fade
        The parts that the picture is mixed from.
    furthest : float
        The largest planar depth of the volume, in world units.
    """

    index_view: IndexView
    fades: list[Fade]
    furthest: float

    @property
    def planes(self) -> list[BasePlane]:
        """The base planes of all parts."""
        return [plane for fade in self.fades for plane in fade.planes]

    @property
    def axes(self) -> tuple[int, ...]:
        """The principal axes that tables are needed of, in the order of their planes."""
        return tuple(dict.fromkeys(plane.axis for plane in self.planes))


def choose_view(source: Source, refuse_empty: bool) -> View:
    """Choose the base planes of a picture, and the parts of them that its pixels need.

    Raises
    ------
    RleSplatError
        Where ``refuse_empty`` is set and the camera sees nothing of the volume.
    """
    scene, quality, shape_xyz = source.scene, source.quality, source.scene.volume.shape_xyz
    view = index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    footprint = FOOTPRINTS[quality.kernel]
    nearest, furthest = view.box_depths(shape_xyz, 0.0 if source.scalar_sheets else footprint.radius)
    in_sight = furthest > scene.camera.clip_start and nearest < scene.camera.clip_end

    def planes_of(*pyramids):
        knobs = source.depth_rule, quality.sheet_density, footprint, source.scalar_sheets, warp_reach(quality)
        planes = [base_plane(view, shape_xyz, *pyramid, *knobs) for pyramid in pyramids if in_sight]
        return [plane for plane in planes if plane is not None]

    if view.is_parallel:
        (first, *others) = axis_shares(view, quality.axis_fade)
        shares = [first, *(other for other in others if other[0] in source.axes)]
        fades = [Fade(planes_of(pyramid), share) for *pyramid, share in shares]
        shown = sum(fade.share for fade in fades if fade.planes)
        fades = [replace(fade, share=fade.share / shown) for fade in fades if fade.planes] or [Fade([])]
    else:
        fades = [Fade(planes_of(*candidate_pyramids(view)))]
    # Nothing is between the voxels of a volume that is one voxel thick: the report says so, from wherever it is seen.
    is_thick = min(shape_xyz) > 1 or not source.scalar_sheets
    if not fades[0].planes and refuse_empty and is_thick:
        raise RleSplatError(
            "The camera does not see the volume; point it at the volume, or move the volume between its clip distances."
        )
    return View(view, [fade.window(scene, quality) for fade in fades], furthest)
