"""Glass: the volume is seen straight through it, tinted (algorithm.md 4.2).

A pane lets through a share of what lies behind it.  What counts for a pixel is the depth of its picture, where half of
the light is gone: all panes before that depth tint it.  So haze in front of a pane is tinted with what is behind it.
Refraction would bend the rays, and reflections are the mesh renderer's: they are behind the volume in a picture that
lies over the render.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import kernel, prange, run_either
from ..scene import NO_DEPTH, Quality, Scene
from ..scene.changed import change
from ..view.eye import IndexView, index_view
from ..view.projection import depth_row
from . import reference
from .camera_clip import find_volume_depths
from .kind import Kind
from .mesh_depth import BAND, SAMPLE_COLUMNS, SAMPLE_ROWS, depth_at, edge_functions
from .ray_pass import RayEffect

BEHIND = "all glass is behind the volume"


@kernel(inline="always")
def _pass_pane(edges, depths, shares, t, column, row, nearest, end, sample_columns, sample_rows, passed):
    """Multiply what passes on the rays of a pixel (SAMPLES, 4) by the share of pane ``t``; whether any ray meets it."""
    met = False
    for s in range(sample_columns.size):
        depth = depth_at(edges, depths, t, column + sample_columns[s], row + sample_rows[s], 0.0)
        if nearest <= depth < end:
            met = True
            for channel in range(4):
                passed[s, channel] *= shares[t, channel]
    return met


@kernel(inline="always")
def _tint_pixel(passed, pixel):
    """Multiply a pixel (4,) by the mean of what passes on its rays (SAMPLES, 4)."""
    for channel in range(4):
        mean = np.float32(0.0)
        for s in range(passed.shape[0]):
            mean += passed[s, channel]
        pixel[channel] *= mean / np.float32(passed.shape[0])


@kernel(parallel=True, exact=True)
def pass_through(edges, depths, bounds, shares, nearest, ends, sample_columns, sample_rows, corner, rgba):
    """Multiply the pixels of a part of the picture by what the panes before them let through.

    Parameters
    ----------
    edges, depths, bounds
        Of ``mesh_depth.edge_functions``.
    shares : (n, 4) ndarray of float32
        See Scene.
    nearest : float
        Planar depth from which on panes count.
    ends : (H, W) ndarray of float32
        Planar depth up to which panes count for a pixel.
    sample_columns, sample_rows : (SAMPLES,) ndarray of float64
        Positions of a pixel's rays in it, 0 to 1.
    corner : (int, int)
        Column and row in the picture of the first pixel of ``rgba``.
    rgba : (H, W, 4) ndarray of float32
        Premultiplied; changed in place.
    """
    height, width, _ = rgba.shape
    left, above = corner
    for band in prange((height + BAND - 1) // BAND):
        top = band * BAND
        bottom = min(top + BAND, height)
        passed = np.ones((bottom - top, width, sample_columns.size, 4), np.float32)
        met = np.zeros((bottom - top, width), np.bool_)
        for t in range(edges.shape[0]):
            first_row = int(max(float(top), math.floor(bounds[t, 1]) - above))
            last_row = int(min(float(bottom), math.floor(bounds[t, 3]) + 1.0 - above))
            first_column = int(max(0.0, math.floor(bounds[t, 0]) - left))
            last_column = int(min(float(width), math.floor(bounds[t, 2]) + 1.0 - left))
            for row in range(first_row, last_row):
                for column in range(first_column, last_column):
                    met[row - top, column] |= _pass_pane(
                        edges, depths, shares, t, left + column, above + row, nearest, ends[row, column],
                        sample_columns, sample_rows, passed[row - top, column],
                    )  # fmt: skip
        for row in range(top, bottom):
            for column in range(width):
                if met[row - top, column]:
                    _tint_pixel(passed[row - top, column], rgba[row, column])


class Glass(RayEffect):
    """Tints a picture by the panes that lie before the volume.

    Parameters
    ----------
    scene : Scene
        With panes.
    """

    stage, shortens_rays, moves_depth = "glass", False, False

    def __init__(self, scene: Scene, view: IndexView, quality: Quality):
        *self._edges, kept = edge_functions(scene.panes, scene.camera, scene.width, scene.height)
        self._shares = scene.pane_shares[kept].astype(np.float32)
        self._nearest, self._threads = scene.camera.clip_start, quality.threads
        # A ray that never loses half of its light counts by the middle of the volume.
        self._middle = np.float32(sum(find_volume_depths(scene, view, quality)) / 2.0)

    @classmethod
    def of(cls, scene: Scene, view: IndexView, quality: Quality) -> Glass | None:
        """The effect, None where the scene has no panes; parameters as of ``RayEffects``."""
        return None if scene.panes is None else cls(scene, view, quality)

    def tint(self, rgba: np.ndarray, depth: np.ndarray, corner: tuple[int, int]) -> np.ndarray:
        """See ``RayEffect.tint``."""
        ends = np.where(depth < NO_DEPTH, depth, self._middle).astype(np.float32)
        tinted = np.array(rgba, order="C")
        run_either(
            self._threads, pass_through, reference.pass_through, *self._edges, self._shares, self._nearest, ends,
            SAMPLE_COLUMNS, SAMPLE_ROWS, corner, tinted,
        )  # fmt: skip
        return tinted


def _judge(scene: Scene, quality: Quality) -> tuple[bool, str]:
    if scene.panes is None or len(scene.panes) == 0:
        return False, "the scene has no glass"
    row, view = depth_row(scene.camera), index_view(scene.camera, scene.index_to_world, scene.width, scene.height)
    nearest = float((np.asarray(scene.panes, np.float64) @ row[:3]).min() + row[3])
    if nearest > find_volume_depths(scene, view, quality)[1]:
        return False, BEHIND
    return True, "glass is in or in front of the volume"


GLASS = Kind(
    "Tint what is seen through glass, by its transmission and color", _judge,
    lambda scene: change(scene, panes=None, pane_shares=None), stage="glass",
)  # fmt: skip
