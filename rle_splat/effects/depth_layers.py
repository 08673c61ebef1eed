"""Depth layers, by which a mesh's silhouette is antialiased against the volume.

A pixel on a silhouette sees two depths: some of its rays end at the mesh, the others go past it.  Integrating to the
mean depth would be wrong for both.  Such a pixel therefore mixes two pictures by the part of it that the mesh covers.
The warp reads neighbors, so each layer is continued a few pixels past the silhouette.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..runtime.jit import compiled, inner_loop, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from . import reference
from .reference import REACH, SIDES

HALO = 2 * REACH + 1  # pixels on either side that the layers of a pixel depend on
UNKNOWN = 255
PIXELS_A_STEP = 1 << 18  # 6 ms by one thread
_ZERO, _ONE, _TWO, _INFINITE = (np.float32(n) for n in (0.0, 1.0, 2.0, np.inf))


@dataclass(frozen=True, eq=False)
class DepthLayers:
    """Two depths per pixel and the share of the nearer one.

    Attributes
    ----------
    near, far : (H, W) ndarray of float32
        Planar depths in world units, inf for no mesh.
    coverage : (H, W) ndarray of float32 or None
        The share of each pixel that ends at ``near``; 1 away from silhouettes, where both layers are the same. None
        where there are no silhouettes.
    first_pixel : (column, row)
        Of the first pixel in the picture.
    """

    near: np.ndarray
    far: np.ndarray
    coverage: np.ndarray | None
    first_pixel: tuple[int, int] = (0, 0)

    def coverage_of(self, region) -> np.ndarray:
        """The coverage of a part of the picture.

        Parameters
        ----------
        region : (left, top, right, bottom)
            Pixels of the picture.

        Returns
        -------
        (height, width) ndarray of float32
        """
        (left, top), (across, down) = region[:2], self.first_pixel
        return self.coverage[top - down : region[3] - down, left - across : region[2] - across]


def depth_layers_steps(samples: np.ndarray, step: float, first_pixel=(0, 0), *, threads: int = 0):
    """Generator of fractions done: make the layers of a picture or of a part of it, in bands of rows.

    Within HALO pixels of a border that is not the picture's own, layers differ from those of the whole picture.

    Parameters
    ----------
    samples : (H, W, S) ndarray of float32
        Planar depths of the meshes on S rays of each pixel, in world units; inf for none.
    step : float
        World units; depths further apart belong to two surfaces.
    first_pixel : (column, row)
        Of the first pixel in the picture.
    threads : int
        0 for one per core.

    Returns
    -------
    DepthLayers
    """
    rows, width = samples.shape[:2]
    layers = np.empty((3, rows, width), np.float32)  # near, far, coverage
    band = max(PIXELS_A_STEP // width, 4 * HALO)
    for begin in range(0, rows, band):
        end, first = min(begin + band, rows), max(begin - HALO, 0)
        found = _layers_of(samples[first : min(end + HALO, rows)], step, threads)
        layers[:, begin:end] = found[:, begin - first : end - first]
        yield end / rows
    return DepthLayers(*layers, first_pixel)


def _layers_of(samples: np.ndarray, step: float, threads: int) -> np.ndarray:
    """(3, H, W) float32: near, far and coverage of ``samples`` (H, W, S)."""
    shape = samples.shape[:2]
    layers, spread = np.empty((3, *shape), np.float32), np.empty(shape, np.float32)
    if not compiled():
        reference.find_layers(samples, step, layers, spread)
        return layers
    samples = read_only(np.ascontiguousarray(samples, np.float32))
    levels = np.full(shape, UNKNOWN, np.uint8), np.full(shape[0], UNKNOWN, np.uint8)
    with parallel_call(threads):
        find_layers(samples, np.float32(step), layers, spread, np.empty_like(spread), *levels)
    return layers


# --- kernels: rows of pixels, each pixel by itself -------------------------------------------------------------
#
# ``layers`` (3, H, W) float32: near, far, coverage.  ``level`` (H, W) uint8: 0 where a pixel holds two surfaces, else
# the number of pixels by which it lies past one that does, UNKNOWN so far.  ``row_level`` (H,): the least of each row.


@kernel
def find_layers(samples, step, layers, spread, own, level, row_level):
    """``depth_layers``; ``spread`` and ``own`` (H, W) float32: scratch."""
    rows = len(row_level)
    share_out(_surfaces, rows, (samples, step, layers, spread, level, row_level))
    own[:] = layers[0]
    share_out(_between_pixels, rows, (own, spread, step, layers, level, row_level))
    for number in range(2 * REACH):
        share_out(_carry, rows, (number, layers, level, row_level))


@kernel(inner=True)
def _surfaces(begin, end, samples, step, layers, spread, level, row_level):
    """See ``reference._find_surfaces``."""
    count = samples.shape[2]
    ordered = np.empty(count, np.float32)
    for v in range(begin, end):
        for u in range(samples.shape[1]):
            least = most = samples[v, u, 0]
            total = np.float64(least)
            for s in range(1, count):
                depth = samples[v, u, s]
                least, most = min(least, depth), max(most, depth)
                total += depth
            near = far = np.float32(total / count)
            coverage = _ONE
            spread[v, u] = _ZERO if least == _INFINITE else most - least
            if spread[v, u] > step:
                for s in range(count):
                    ordered[s] = samples[v, u, s]
                in_front = _in_front(ordered)
                near, far = _mean(ordered[:in_front]), _mean(ordered[in_front:])
                coverage, spread[v, u] = np.float32(in_front / count), _INFINITE
                level[v, u] = row_level[v] = 0
            layers[0, v, u], layers[1, v, u], layers[2, v, u] = near, far, coverage


@kernel(inner=True)
def _in_front(ordered):
    """Sort a few numbers; how many of them lie before the widest gap."""
    for s in range(1, ordered.size):
        depth, at = ordered[s], s
        while at > 0 and ordered[at - 1] > depth:
            ordered[at] = ordered[at - 1]
            at -= 1
        ordered[at] = depth
    widest, in_front = -_ONE, 1
    for s in range(1, ordered.size):
        gap = ordered[s] - ordered[s - 1] if ordered[s - 1] < _INFINITE else _ZERO
        if gap > widest:
            widest, in_front = gap, s
    return in_front


@kernel(inner=True)
def _mean(depths):
    total = 0.0
    for depth in depths:
        total += depth
    return np.float32(total / depths.size)


@inner_loop
def _between_pixels(begin, end, own, spread, step, layers, level, row_level):
    """See ``reference._find_silhouettes``; ``own`` (H, W): the near layer as it was."""
    height, width = own.shape
    for v in range(begin, end):
        for u in range(width):
            here, slack = own[v, u], step + _TWO * spread[v, u]
            for down, right in SIDES:
                row, column = v - down, u - right
                if 0 <= row < height and 0 <= column < width:
                    if here - own[row, column] > slack + _TWO * spread[row, column]:
                        layers[0, v, u], layers[2, v, u] = own[row, column], _ZERO
                        level[v, u] = row_level[v] = 0
                row, column = v + down, u + right
                if 0 <= row < height and 0 <= column < width:
                    if own[row, column] - here > slack + _TWO * spread[row, column]:
                        layers[1, v, u] = own[row, column]
                        level[v, u] = row_level[v] = 0
            if layers[2, v, u] == _ZERO and layers[1, v, u] != here:
                layers[0, v, u], layers[2, v, u] = here, _ONE


@inner_loop
def _carry(begin, end, number, layers, level, row_level):
    """Pass ``number`` of ``reference._carry_past_silhouettes``: pixels beside those up to it get the next level."""
    height, width = level.shape
    for v in range(begin, end):
        if min(row_level[max(v - 1, 0)], min(row_level[v], row_level[min(v + 1, height - 1)])) > number:
            continue
        for u in range(width):
            if level[v, u] != UNKNOWN:
                continue
            for down, right in SIDES:
                row, column = v - down, u - right
                if not (0 <= row < height and 0 <= column < width) or level[row, column] > number:
                    continue
                level[v, u] = number + 1
                row_level[v] = min(row_level[v], np.uint8(number + 1))
                if number >= REACH:
                    layers[2, v, u] = layers[2, row, column]
                    break
                own, near, far = layers[0, v, u], layers[0, row, column], layers[1, row, column]
                to_near = _ZERO if own == near else abs(own - near)  # infinite both: no mesh, the same surface
                to_far = _ZERO if own == far else abs(own - far)
                if to_near <= to_far:
                    layers[1, v, u], layers[2, v, u] = far, _ONE
                else:
                    layers[0, v, u], layers[1, v, u], layers[2, v, u] = near, own, _ZERO
                break
