"""Depth layers: what lets a mesh's silhouette be antialiased against the volume.

Along a silhouette one pixel sees two depths: part of it ends at the mesh, the rest goes on to what lies behind.
Integrating to their mean would be wrong for both, so such a pixel gets both pictures, mixed by the part of it
that the mesh covers.  The warp reads neighbours, so each layer is carried a few pixels past the silhouette.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

REACH = 4  # pixels past a silhouette that the warp's filter may read
HALO = 2 * REACH + 1  # pixels on either side that the layers of a pixel depend on


@dataclass(frozen=True, eq=False)
class DepthLayers:
    """``near`` and ``far``: (H, W) float32 planar depths, inf for no mesh.  ``coverage``: (H, W) float32, the
    part of each pixel that ends at ``near``; 1 away from silhouettes, where both layers are the same.
    ``first_pixel``: column and row in the picture of their first."""

    near: np.ndarray
    far: np.ndarray
    coverage: np.ndarray
    first_pixel: tuple[int, int] = (0, 0)

    @property
    def has_silhouettes(self) -> bool:
        return bool((self.near != self.far).any())

    def coverage_of(self, region) -> np.ndarray:
        """The coverage of the pixels (left, top, right, bottom) of the picture."""
        (left, top), (across, down) = region[:2], self.first_pixel
        return self.coverage[top - down : region[3] - down, left - across : region[2] - across]


def depth_layers(samples: np.ndarray, step: float, first_pixel=(0, 0)) -> DepthLayers:
    """Layers from (H, W, S) sample depths; depths further apart than ``step`` (world units) are two surfaces.

    ``first_pixel``: column and row in the picture of the first.  Within HALO pixels of a side that is none of the
    picture's, layers are not what they are in the whole picture.
    """
    count = samples.shape[-1]
    least, most = samples.min(axis=-1), samples.max(axis=-1)
    with np.errstate(invalid="ignore"):
        spread = np.nan_to_num(most - least, nan=0.0, posinf=np.inf)  # inf - inf is nan: no mesh at all
    split = spread > step
    near = np.where(np.isinf(most), most, samples.mean(axis=-1, dtype=np.float64))
    far, coverage = near.copy(), np.ones(near.shape)
    # Few pixels hold two surfaces; only those are sorted, and cut at their widest gap.
    ordered = np.sort(samples[split].astype(np.float64), axis=-1)
    with np.errstate(invalid="ignore"):
        gaps = np.nan_to_num(np.diff(ordered, axis=-1), nan=0.0, posinf=np.inf)
    in_front = gaps.argmax(axis=-1) + 1
    is_near = np.arange(count) < in_front[:, None]
    near[split] = np.where(is_near, ordered, 0.0).sum(axis=-1) / in_front
    far[split] = np.where(is_near, 0.0, ordered).sum(axis=-1) / (count - in_front)
    coverage[split] = in_front / count
    known = split | _silhouettes_between_pixels(near, far, coverage, split, spread, step)
    layers = _carried_past_silhouettes(near, far, coverage, known)
    return DepthLayers(*(layer.astype(np.float32) for layer in layers), first_pixel)


def _neighbours(shape):
    """Pairs of slices, ``to`` and ``of``: each pixel beside its neighbour on the left, right, top and bottom."""
    height, width = shape
    for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        yield (
            (slice(max(down, 0), height + min(down, 0)), slice(max(right, 0), width + min(right, 0))),
            (slice(max(-down, 0), height + min(-down, 0)), slice(max(-right, 0), width + min(-right, 0))),
        )


def _silhouettes_between_pixels(near, far, coverage, split, spread, step: float) -> np.ndarray:
    """Give both depths to two pixels between which a silhouette runs exactly; returns which pixels got them.

    A steep surface is no silhouette: its neighbours are no further apart than it falls within a pixel.
    """
    own, found = near.copy(), np.zeros(near.shape, dtype=bool)
    for to, of in _neighbours(near.shape):
        with np.errstate(invalid="ignore"):
            behind = own[to] - own[of] > step + 2.0 * (spread[to] + spread[of])
        behind &= ~(split[to] | split[of])
        near[to][behind], far[of][behind] = own[of][behind], own[to][behind]
        coverage[to][behind] = 0.0
        found[to] |= behind
        found[of] |= behind
    return found


def _carried_past_silhouettes(near, far, coverage, known) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give pixels near a silhouette both of its depths; the one that is not their own gets no weight.

    The carried depths end somewhere too, and there the filter reads across that end: pixels as far again keep to
    the layer that is their own surface all the way.
    """
    near, far, coverage, known = near.copy(), far.copy(), coverage.copy(), known.copy()
    if known.any():
        for _ in range(REACH):
            reached = known.copy()
            for to, of in _neighbours(near.shape):
                new = known[of] & ~reached[to]
                if not new.any():
                    continue
                own, near_there, far_there = near[to][new], near[of][new], far[of][new]
                with np.errstate(invalid="ignore"):
                    to_near, to_far = np.abs(own - near_there), np.abs(own - far_there)
                # inf - inf is nan: both see no mesh, the same surface.
                on_near = np.where(np.isnan(to_near), 0.0, to_near) <= np.where(np.isnan(to_far), 0.0, to_far)
                near[to][new] = np.where(on_near, own, near_there)
                far[to][new] = np.where(on_near, far_there, own)
                coverage[to][new] = np.where(on_near, 1.0, 0.0)
                reached[to][new] = True
            known = reached
        for _ in range(REACH):
            reached = known.copy()
            for to, of in _neighbours(near.shape):
                new = known[of] & ~reached[to]
                coverage[to][new] = coverage[of][new]
                reached[to][new] = True
            known = reached
    return near, far, coverage
