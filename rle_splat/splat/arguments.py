"""What the sheet-buffer loop is given, in named groups that kernels and their numpy twin read alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Tables(NamedTuple):
    """The tables of one principal axis (``encode.tables.RunLengthVolume``).

    ``pointers``: (slices, scanlines) into ``runs``, -1 for an empty scanline.  ``data_starts``: (slices,
    scanlines) into ``voxels``, flat float32, four channels a record, or codes that ``decoding`` turns into them (see
    ``encode.records``).  ``width``: voxels on a scanline.
    """

    pointers: np.ndarray
    data_starts: np.ndarray
    runs: np.ndarray
    voxels: np.ndarray
    decoding: np.ndarray | None
    width: int


class SheetList(NamedTuple):
    """Per sheet, front to back.

    ``first_slice``: the first slice whose footprint reaches it, ``slice_weights`` (n, taps) float32 the weights of
    that one and the next; ``thickness`` in voxels of depth; slab ``begin`` and ``end`` along the viewing direction,
    voxels; ``scale`` and ``offset`` (n, 2): sheet pixel = scale * voxel + offset, along the scanline [0] and across
    scanlines [1].
    """

    first_slice: np.ndarray
    slice_weights: np.ndarray
    thickness: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    scale: np.ndarray
    offset: np.ndarray


class Rays(NamedTuple):
    """Per sheet pixel.

    ``length``: (H, W) float32 length of the ray per voxel of depth, in world units (extinction) or reference
    distances (opacity).  ``limits``: (2, H, W) float32 where it begins and ends along the viewing direction,
    voxels, or None for no limits.
    """

    length: np.ndarray
    limits: np.ndarray | None


class Wide(NamedTuple):
    """A footprint other than the plain tent.

    ``kind`` and ``radius``: of ``view.footprints``.  ``widen``: whether it is widened where it is minified.
    """

    kind: int
    radius: float
    widen: bool
