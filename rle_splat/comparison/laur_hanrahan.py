"""Laur and Hanrahan's hierarchical splatting: a pyramid of averages, drawn at the nodes of a small enough error.

D. Laur and P. Hanrahan, Hierarchical splatting: a progressive refinement algorithm for volume rendering, SIGGRAPH
1991: the paper's [9].
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ..classify.visible import row_offsets
from ..runtime.jit import kernel, parallel_call, prange, read_only
from ..scene import Quality
from . import pyramid
from .footprint import composite_sample, first_pixel, footprint
from .medium import CHANNELS, ShadedScene, check_plain_view
from .system import ReadySystem, picture

TITLE = "Hierarchical splatting"
LEVELS = 3  # above the voxels: nodes of up to 8 voxels a side
THRESHOLD = 0.05  # the largest error of a node, in the optical depth of one voxel below it
BANDS_PER_THREAD = 4


def prepare(medium: ShadedScene, quality: Quality, threshold: float = THRESHOLD, levels: int = LEVELS) -> ReadySystem:
    """Splat the coarsest nodes whose error is at most a threshold, front to back, compositing every sample.

    Parameters
    ----------
    quality : Quality
        Only its threads count.
    threshold : float
        In the optical depth of one voxel.
    levels : int
        Of the pyramid, above the voxels.
    """
    check_plain_view(medium, TITLE)
    tree = pyramid.build(medium.field[1:-1, 1:-1, 1:-1], levels)
    voxel = float(np.linalg.norm(medium.view.to_world, axis=0).min())
    nodes = pyramid.cut(tree, threshold / voxel)
    splats = in_order(medium, tree, nodes)
    tables = [footprint(medium.view, float(2**level)) for level in range(len(tree))]
    memory = {
        "pyramid": sum(level.nbytes for level in tree),
        "splats": sum(array.nbytes for array in splats),
        "footprint_tables": sum(table.weights.nbytes for table in tables),
    }
    notes = {"threshold": threshold, "splats": len(splats[0]), "splats_per_level": [len(found) for found in nodes]}
    return ReadySystem(partial(draw, medium, quality, splats, tables), memory, notes)


def in_order(medium: ShadedScene, tree, nodes):
    """Pixels (m, 2) float64, level (m,) int64 and record (m, 4) float32 of the nodes, front to back.

    Octants whose corner is nearer along all axes come first: Morton order, with the axes directed away from the eye.
    """
    direction = -medium.view.eye[:3][::-1]  # z, y, x
    projection = medium.view.projection[:2]
    side = 2 ** (len(tree) - 1)
    size = side * np.array(tree[-1].means.shape[:3])
    pixels, level_of, records, keys = [], [], [], []
    for number, (level, found) in enumerate(zip(tree, nodes)):
        corner = found * 2**number
        center = corner + 0.5 * (2**number - 1)
        pixels.append(center[:, ::-1] @ projection[:, :3].T + projection[:, 3])
        level_of.append(np.full(len(found), number))
        records.append(level.means[tuple(found.T)])
        nearest = np.where(direction < 0.0, size - corner - 2**number, corner)
        keys.append(_morton(nearest))
    order = np.argsort(np.concatenate(keys), kind="stable")
    return tuple(np.ascontiguousarray(np.concatenate(part)[order]) for part in (pixels, level_of, records))


def _morton(indices: np.ndarray) -> np.ndarray:
    """(m,) int64: the interleaved bits of (m, 3) positions from 0 to 2^21."""
    key = np.zeros(len(indices), np.int64)
    for bit in range(int(indices.max(initial=0)).bit_length()):
        for axis in range(3):
            key |= ((indices[:, axis].astype(np.int64) >> bit) & 1) << (3 * bit + 2 - axis)
    return key


def draw(medium: ShadedScene, quality: Quality, splats, tables):
    """One frame."""
    view = medium.view
    image = np.zeros((view.height, view.width, CHANNELS), np.float32)
    image[..., 3] = 1.0
    starts = row_offsets(np.array([table.weights.size for table in tables]))
    weights = np.concatenate([table.weights for table in tables])
    shapes = np.array([table.shape for table in tables])
    reaches = np.array([table.reach for table in tables])
    with parallel_call(quality.threads) as workers:
        splat_nodes(workers, *(read_only(part) for part in splats), starts, weights, shapes, reaches, image)
    return picture(image)


@kernel(inline="always")
def _composite_row(image, row, first, last, weights, entry, records, n):
    """Columns [first, last) of one row of a footprint over the image; ``weights[entry + column]``: float32."""
    for c in range(first, last):
        if weights[entry + c] > 0.0:
            composite_sample(
                image, row, c, weights[entry + c], records[n, 0], records[n, 1], records[n, 2], records[n, 3]
            )


@kernel(parallel=True)
def splat_nodes(workers, pixels, level_of, records, starts, weights, shapes, reaches, image):
    """Splat m nodes front to back, each with the footprint table of its level.

    ``pixels``: (m, 2) float64, column and row of the centers.  ``level_of``: (m,) int64.  ``records``: (m, 4) float32.
    For each level: ``starts`` in the flat ``weights`` float32, ``shapes`` int64 (subpixels, height, width), ``reaches``
    float64 (half width, half height).  ``image``: (H, W, 4) float32 color and transmittance, updated.  Bands of rows
    are independent of each other.
    """
    rows, columns = image.shape[0], image.shape[1]
    bands = min(rows, BANDS_PER_THREAD * workers)
    for worker in prange(workers):
        for band in range(worker, bands, workers):
            top, bottom = rows * band // bands, rows * (band + 1) // bands
            for n in range(level_of.size):
                level = level_of[n]
                subpixels, height, width = shapes[level, 0], shapes[level, 1], shapes[level, 2]
                row, sub_row = first_pixel(pixels[n, 1], reaches[level, 1], subpixels)
                if row >= bottom or row + height <= top:
                    continue
                column, sub_column = first_pixel(pixels[n, 0], reaches[level, 0], subpixels)
                base = starts[level] + (sub_row * subpixels + sub_column) * height * width
                for r in range(max(row, top), min(row + height, bottom)):
                    entry = base + (r - row) * width - column
                    _composite_row(image, r, max(column, 0), min(column + width, columns), weights, entry, records, n)
