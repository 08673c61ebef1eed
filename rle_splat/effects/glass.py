"""Glass: the volume is seen straight through it, tinted (algorithm.md 4.2).

A pane lets through a share of what lies behind it.  What counts for a pixel is the depth of its picture, where half of
the light is gone: all panes before that depth tint it.  So haze in front of a pane is tinted with what is behind it.
Refraction would bend the rays, and reflections are the mesh renderer's: they are behind the volume in a picture that
lies over the render.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call, prange
from ..scene import NO_DEPTH, Quality, Scene
from ..scene.changed import change
from ..view.eye import index_view
from ..view.projection import depth_row
from . import reference
from .camera_clip import slab_depths
from .kind import Kind
from .mesh_depth import BAND, SAMPLE_COLUMNS, SAMPLE_ROWS, edge_functions

BEHIND = "all glass is behind the volume"


@kernel(parallel=True, exact=True)
def pass_through(edges, depths, bounds, shares, nearest, ends, sample_columns, sample_rows, left, above, rgba):
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
    left, above : int
        Column and row in the picture of the first pixel of ``rgba``.
    rgba : (H, W, 4) ndarray of float32
        Premultiplied; changed in place.
    """
    height, width, _ = rgba.shape
    samples = sample_columns.size
    for band in prange((height + BAND - 1) // BAND):
        top = band * BAND
        bottom = min(top + BAND, height)
        passed = np.ones((bottom - top, width, samples, 4), np.float32)
        met = np.zeros((bottom - top, width), np.bool_)
        for t in range(edges.shape[0]):
            first_row = int(max(float(top), math.floor(bounds[t, 1]) - above))
            last_row = int(min(float(bottom), math.floor(bounds[t, 3]) + 1.0 - above))
            first_column = int(max(0.0, math.floor(bounds[t, 0]) - left))
            last_column = int(min(float(width), math.floor(bounds[t, 2]) + 1.0 - left))
            for row in range(first_row, last_row):
                for column in range(first_column, last_column):
                    for s in range(samples):
                        x, y = left + column + sample_columns[s], above + row + sample_rows[s]
                        a = edges[t, 0, 0] * x + edges[t, 0, 1] * y + edges[t, 0, 2]
                        b = edges[t, 1, 0] * x + edges[t, 1, 1] * y + edges[t, 1, 2]
                        c = edges[t, 2, 0] * x + edges[t, 2, 1] * y + edges[t, 2, 2]
                        total = a + b + c
                        if total <= 0.0 or a < 0.0 or b < 0.0 or c < 0.0:
                            continue
                        depth = (a * depths[t, 0] + b * depths[t, 1] + c * depths[t, 2]) / total
                        if nearest <= depth < ends[row, column]:
                            met[row - top, column] = True
                            for channel in range(4):
                                passed[row - top, column, s, channel] *= shares[t, channel]
        for row in range(top, bottom):
            for column in range(width):
                if met[row - top, column]:
                    for channel in range(4):
                        mean = np.float32(0.0)
                        for s in range(samples):
                            mean += passed[row - top, column, s, channel]
                        rgba[row, column, channel] *= mean / np.float32(samples)


def tint(scene: Scene, quality: Quality, rgba: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Tint a picture by the panes of its scene; the picture itself where there are none.

    Parameters
    ----------
    scene : Scene
    quality : Quality
    rgba : (H, W, 4) ndarray of float32
        The pixels of the scene's region, premultiplied.
    depth : (H, W) ndarray of float32
        As Rendering has it.

    Returns
    -------
    (H, W, 4) ndarray of float32
    """
    if scene.panes is None:
        return rgba
    left, top, _, _ = scene.region
    edges, depths, bounds, kept = edge_functions(scene.panes, scene.camera, scene.width, scene.height)
    shares = scene.pane_shares[kept].astype(np.float32)
    # A ray that never loses half of its light counts by the middle of the volume.
    ends = np.where(depth < NO_DEPTH, depth, np.float32(sum(_depths(scene, quality)) / 2.0)).astype(np.float32)
    tinted = np.array(rgba, order="C")
    samples = SAMPLE_COLUMNS, SAMPLE_ROWS
    arguments = (edges, depths, bounds, shares, scene.camera.clip_start, ends, *samples, left, top, tinted)
    if compiled():
        with parallel_call(quality.threads):
            pass_through(*arguments)
    else:
        reference.pass_through(*arguments)
    return tinted


def _depths(scene: Scene, quality: Quality) -> tuple[float, float]:
    """Planar depths between which the volume lies."""
    return slab_depths(scene, index_view(scene.camera, scene.index_to_world, scene.width, scene.height), quality)


def _judge(scene: Scene, quality: Quality) -> tuple[bool, str]:
    if scene.panes is None or len(scene.panes) == 0:
        return False, "the scene has no glass"
    row = depth_row(scene.camera)
    nearest = float((np.asarray(scene.panes, np.float64) @ row[:3]).min() + row[3])
    if nearest > _depths(scene, quality)[1]:
        return False, BEHIND
    return True, "glass is in or in front of the volume"


GLASS = Kind(
    "tints what is seen through glass, by its transmission and color", _judge,
    lambda scene: change(scene, panes=None, pane_shares=None), stage="glass",
)
