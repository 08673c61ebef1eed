"""Ray intervals that end at the box of the voxel centers, for sheets that do not end there by themselves."""

from __future__ import annotations

from ..view.base_plane import BasePlane
from ..view.ray_intervals import within_box
from .ray_pass import RayEffect, RayPass


class BoxIntervals(RayEffect):
    """Ends rays where they enter and leave the box of the voxel centers.

    Parameters
    ----------
    shape_xyz : (nx, ny, nz)
        Number of voxels.
    """

    moves_depth = False

    def __init__(self, shape_xyz):
        self._shape_xyz = shape_xyz

    @classmethod
    def of(cls, scene, view, quality, ends_at_box: bool) -> BoxIntervals | None:
        """The effect, None where rays need not end at the box; parameters as of ``RayEffects``."""
        return cls(scene.volume.shape_xyz) if ends_at_box else None

    def shortened(self, ray_pass: RayPass, number: int, plane: BasePlane, intervals):
        """See ``RayEffect.shortened``."""
        return plane, within_box(plane, self._shape_xyz, intervals)
