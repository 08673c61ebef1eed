"""Mesh depth: the planar depth at which each ray meets the first mesh.

Triangles are rasterized in homogeneous pixel coordinates (Olano and Greer 1997), which needs no clipping: the
inverse of a triangle's 3x3 matrix of homogeneous vertices gives its edge functions, and wherever all three are
positive the ray meets the triangle in front of the camera.
"""

from __future__ import annotations

import math

import numpy as np

from ..runtime.jit import kernel, prange, run_either
from ..runtime.work_sizes import MESH_SAMPLES as SAMPLES
from ..scene import Camera, RleSplatError
from ..view.projection import depth_row, world_to_pixel
from . import reference
from .reference import CRACK

# Sixteen rays a pixel, one in each sixteenth of its width and of its height, so that an edge along either axis
# is seen in sixteen steps.
_ORDER = np.array((5, 12, 2, 9, 15, 6, 0, 11, 3, 8, 13, 1, 10, 4, 14, 7))
SAMPLE_COLUMNS = (np.arange(SAMPLES) + 0.5) / SAMPLES
SAMPLE_ROWS = (_ORDER + 0.5) / SAMPLES
BAND = 16  # picture rows that one worker rasterizes at a time


def edge_functions(triangles: np.ndarray, camera: Camera, width: int, height: int):
    """Set up the triangles of a scene for rasterization.

    Parameters
    ----------
    triangles : (m, 3, 3) array_like
        World coordinates of the vertices.
    width, height : int
        Pixels of the picture.

    Returns
    -------
    edges : (n, 3, 3) ndarray of float64
        ``edges[t, i] @ (column, row, 1)`` is barycentric coordinate i over homogeneous depth.  Triangles seen edge-on
        or behind the camera are left out.
    depths : (n, 3) ndarray of float64
        Planar depth of the vertices, world units.
    bounds : (n, 4) ndarray of float64
        First column and row, last column and row (inclusive); infinite for triangles that reach behind the camera.
    kept : (m,) ndarray of bool
        Which of the triangles these are.

    Raises
    ------
    RleSplatError
        If the triangles have another shape, or are not finite.
    """
    triangles = np.asarray(triangles, dtype=np.float64)
    if triangles.ndim != 3 or triangles.shape[1:] != (3, 3) or not np.isfinite(triangles).all():
        raise RleSplatError("The scene's triangles must be finite numbers of shape (n, 3, 3).")
    corners = np.concatenate((triangles, np.ones((*triangles.shape[:2], 1))), axis=2)
    return edges_of(corners @ world_to_pixel(camera, width, height).T, corners @ depth_row(camera))


def edges_of(pixels: np.ndarray, depths: np.ndarray):
    """As ``edge_functions``, from projected vertices.

    Parameters
    ----------
    pixels : (m, 3, 3) ndarray of float64
        Homogeneous pixel coordinates of the vertices of each triangle.
    depths : (m, 3) ndarray of float64
        A number of each vertex that is affine in the world, such as planar depth.

    Returns
    -------
    edges, depths, bounds, kept
    """
    size = np.abs(pixels).max(axis=(1, 2))
    size[size == 0.0] = 1.0
    scaled = pixels / size[:, None, None]
    # Inverse matrices by Cramer's rule: LAPACK is called for each of them, and has threads that wait for each other.
    across = np.cross(scaled[:, [1, 2, 0]], scaled[:, [2, 0, 1]])
    determinant = (scaled[:, 0] * across[:, 0]).sum(axis=1)
    in_front = (pixels[..., 2] > 0.0).any(axis=1)
    kept = (np.abs(determinant) > 1e-14) & in_front
    pixels, depths = pixels[kept], depths[kept]
    edges = across[kept] / (determinant * size)[kept, None, None]
    bounds = np.empty((len(pixels), 4))
    whole = (pixels[..., 2] > 1e-9 * np.abs(pixels[..., 2]).max(axis=1, keepdims=True)).all(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        position = pixels[..., :2] / pixels[..., 2:]
    bounds[:, :2] = np.where(whole[:, None], position.min(axis=1), -np.inf)
    bounds[:, 2:] = np.where(whole[:, None], position.max(axis=1), np.inf)
    return np.ascontiguousarray(edges), np.ascontiguousarray(depths), bounds, kept


@kernel(inline="always")
def depth_at(edges, depths, t, x, y, crack):
    """Planar depth of triangle ``t`` on the ray through a point of the picture; NaN where it misses the triangle by
    more than ``crack`` parts of it."""
    a = edges[t, 0, 0] * x + edges[t, 0, 1] * y + edges[t, 0, 2]
    b = edges[t, 1, 0] * x + edges[t, 1, 1] * y + edges[t, 1, 2]
    c = edges[t, 2, 0] * x + edges[t, 2, 1] * y + edges[t, 2, 2]
    total = a + b + c
    slack = -crack * total
    if total <= 0.0 or a < slack or b < slack or c < slack:
        return np.nan
    return (a * depths[t, 0] + b * depths[t, 1] + c * depths[t, 2]) / total


@kernel(inline="always")
def _cover(edges, depths, t, column, row, nearest, furthest, sample_columns, sample_rows, pixel):
    """Put the planar depth of triangle ``t`` into those samples (SAMPLES,) of a pixel that it covers and is nearer to
    than what is there."""
    for s in range(sample_columns.size):
        depth = depth_at(edges, depths, t, column + sample_columns[s], row + sample_rows[s], CRACK)
        if nearest <= depth <= furthest and depth < pixel[s]:
            pixel[s] = depth


@kernel(parallel=True)
def rasterize(edges, depths, bounds, nearest, furthest, sample_columns, sample_rows, left, above, out):
    """Find the first triangle on each ray of a part of the picture.

    Parameters
    ----------
    edges, depths, bounds
        Of ``edge_functions``.
    nearest, furthest : float
        Depths between which triangles count.
    sample_columns, sample_rows : (SAMPLES,) ndarray of float64
        Positions of a pixel's rays in it, 0 to 1.
    left, above : int
        Column and row in the picture of the first pixel of ``out``.
    out : (H, W, SAMPLES) ndarray of float32
        Depths so far; changed in place.
    """
    right, below = left + out.shape[1], above + out.shape[0]
    bands = (out.shape[0] + BAND - 1) // BAND
    for band in prange(bands):
        top = above + band * BAND
        bottom = min(top + BAND, below)
        for t in range(edges.shape[0]):
            if bounds[t, 3] < top or bounds[t, 1] > bottom or bounds[t, 2] < left or bounds[t, 0] > right:
                continue
            first_row = int(max(float(top), math.floor(bounds[t, 1])))
            last_row = int(min(float(bottom), math.floor(bounds[t, 3]) + 1.0))
            first_column = int(max(float(left), math.floor(bounds[t, 0])))
            last_column = int(min(float(right), math.floor(bounds[t, 2]) + 1.0))
            for row in range(first_row, last_row):
                for column in range(first_column, last_column):
                    pixel = out[row - above, column - left]
                    _cover(edges, depths, t, column, row, nearest, furthest, sample_columns, sample_rows, pixel)


def mesh_depth(triangles, camera: Camera, width: int, height: int, *, region=None, threads=0) -> np.ndarray:
    """The depth of the first mesh on SAMPLES rays of each pixel.

    Parameters
    ----------
    triangles : (n, 3, 3) array_like
        World coordinates; seen from both sides.
    width, height : int
        Pixels of the picture.
    region : (left, top, right, bottom), optional
        The pixels wanted; by default all.
    threads : int
        0 for one per core.

    Returns
    -------
    (H, W, SAMPLES) ndarray of float32
        Planar depth in world units; inf where no mesh is between the camera's clip distances.

    Raises
    ------
    RleSplatError
        If the triangles have another shape, or are not finite.
    """
    edges, depths, bounds, _ = edge_functions(triangles, camera, width, height)
    left, top, right, bottom = region or (0, 0, width, height)
    out = np.full((bottom - top, right - left, SAMPLES), np.inf, np.float32)
    _rasterize(edges, depths, bounds, (camera.clip_start, camera.clip_end), left, top, out, threads)
    return out


def sheet_depth(pixels, depths, clips, width: int, height: int, *, threads=0) -> np.ndarray:
    """The depth of the first triangle on each ray of a sheet, from projected vertices.

    Parameters
    ----------
    pixels, depths
        Of ``edges_of``.
    clips : (nearest, furthest)
        Depths between which triangles count.
    width, height : int
        Pixels of the sheet.
    threads : int
        0 for one per core.

    Returns
    -------
    (height, width, SAMPLES) ndarray of float32
        Inf where there is none.
    """
    out = np.full((height, width, SAMPLES), np.inf, np.float32)
    edges, depths, bounds, _ = edges_of(pixels, depths)
    _rasterize(edges, depths, bounds, clips, 0, 0, out, threads)
    return out


def _rasterize(edges, depths, bounds, clips, left: int, top: int, out, threads) -> None:
    arguments = (edges, depths, bounds, *clips, SAMPLE_COLUMNS, SAMPLE_ROWS, left, top, out)
    run_either(threads, rasterize, reference.rasterize, *arguments)
