"""The interface of an effect on rays, and one pass over the base planes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..splat.intermediate_image import IntermediateImage
from ..view.base_plane import BasePlane


@dataclass(eq=False)
class RayPass:
    """One drawing of a picture's base planes.

    Attributes
    ----------
    region : (left, top, right, bottom)
        The pixels that it is drawn for.
    planes : list of (int, BasePlane)
        Number and base plane of each that shows any of them.
    surface : (rows, columns) float32 ndarray or None
        Planar depth at which each pixel's ray meets a mesh, inf for none, of the pixels from ``first_pixel`` on.
    first_pixel : (column, row)
    before : RayPass or None
        A pass whose blocks of pixels this one takes over where rays end alike.
    intervals : dict
        Number of a plane -> the plane and its intervals, before clip objects.
    images : dict
        Number of a plane -> its intermediate image; none where no ray is left.
    alike : dict
        Number of a plane -> (H, W) bool: pixels that are taken over.
    """

    region: tuple[int, int, int, int]
    planes: list[tuple[int, BasePlane]]
    surface: np.ndarray | None = None
    first_pixel: tuple[int, int] = (0, 0)
    before: RayPass | None = None
    intervals: dict = field(default_factory=dict)
    images: dict = field(default_factory=dict)
    alike: dict = field(default_factory=dict)


class RayEffect:
    """What an effect does to the rays of base planes; by itself, nothing.

    Attributes
    ----------
    name : str or None
        Name in the table of effects, of an effect that ``inspect_steps`` may find idle.
    stage : str
        The stage that its work is timed as.
    shortens_rays : bool
        Whether it may shorten any ray.
    moves_depth : bool
        Whether depths must be held to the camera's clip distances afterwards.
    nothing_left : str
        A sentence on a picture that is empty because of it; "" for none.
    """

    name: str | None = None
    stage = "clipping"
    shortens_rays = True
    moves_depth = True
    nothing_left = ""

    def stage_of(self, ray_pass: RayPass) -> str:
        """The stage that shortening the rays of a pass is timed as."""
        return self.stage

    def inspect_steps(self, planes: list[BasePlane]):
        """Generator of fractions done: find out whether the effect does anything to the rays of some base planes.

        Returns
        -------
        str or None
            Why it does nothing; None where it does something.
        """
        yield from ()
        return None

    def passes(self, passes: list[RayPass], reach: int) -> list[RayPass]:
        """The passes over the base planes.

        Parameters
        ----------
        passes : list of RayPass
            The passes without this effect.
        reach : int
            Sheet pixels on either side of a ray that its pixel depends on.
        """
        return passes

    def shorten(self, ray_pass: RayPass, number: int, plane: BasePlane, intervals):
        """Shorten the rays of a base plane.

        Parameters
        ----------
        number : int
            Number of the plane.
        intervals : (2 + 2 holes, H, W) ndarray of float32 or None
            Ray intervals so far, in voxels along the viewing direction; None for whole rays.

        Returns
        -------
        (BasePlane, ndarray or None) or None
            The plane, or the window of it that has rays, and the intervals; None where no ray is left.
        """
        return plane, intervals

    def complete(self, ray_pass: RayPass, number: int, image: IntermediateImage) -> None:
        """Fill in the pixels of a plane's image that were left out for this effect.

        Parameters
        ----------
        number : int
            Number of the plane.
        image : IntermediateImage
            Changed in place.
        """

    def mix(self, ray_pass: RayPass, picture, found):
        """The picture with the result of a further pass.

        Parameters
        ----------
        picture, found : (rgba, depth)
            The picture so far, and the result of the pass.

        Returns
        -------
        (rgba, depth)
        """
        return picture

    def trace(self, trace, *pixels):
        """Trace single rays through pixels of the picture.

        Parameters
        ----------
        trace : callable
            ``trace(columns, rows, ends)`` returns color (n, 4) and depth (n,) float32 of pixels, and the work that each
            took (n, 2) int32; ``ends``: planar depths at which meshes end their rays, none without it.
        *pixels : (n,) ndarray
            The first of these, from the left and the top of the picture, or all.

        Returns
        -------
        rgba, depth, work : as ``trace`` returns them
        """
        return trace(*pixels)

    def tint(self, rgba: np.ndarray, depth: np.ndarray, corner: tuple[int, int]) -> np.ndarray:
        """The finished picture as the effect colors it.

        Parameters
        ----------
        rgba : (H, W, 4) ndarray of float32
            Premultiplied, scene-linear.
        depth : (H, W) ndarray of float32
            As Rendering has it.
        corner : (int, int)
            Column and row in the frame of the first pixel.

        Returns
        -------
        (H, W, 4) ndarray of float32
        """
        return rgba
