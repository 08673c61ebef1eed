"""Volumes and scenes of which a known share is shown, and the most memory that work holds."""

import tracemalloc
from dataclasses import replace

import numpy as np

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

QUALITY = Quality.preset("draft", classification="pre")
FUNCTION = TransferFunction(opacity=((80, 0.0), (120, 0.3)), color=((80, 1.0, 0.3, 0.1), (250, 0.9, 0.9, 0.8)))
GIB = 1 << 30
# Of scalars: what is shown is a range of values, and most of what is in runs of several voxels.
POST = Quality(classification="post", depth_rule="slice", sheet_density=0.7, warp_filter="bilinear", rays=0.05)
BANDED = replace(FUNCTION, opacity=((80, 0.0), (120, 0.3), (150, 0.3), (170, 0.0)))


def noise(n=96, dtype=np.uint8, share=0.4):
    """Voxels of which about ``share`` are shown by FUNCTION, in runs of a few voxels."""
    values = np.random.default_rng(5).random((n, n, n // 4))
    return Volume(np.repeat(np.where(values < share, 200, 10), 4, axis=2).astype(dtype), np.eye(4))


def blobs(n=96, dtype=np.uint8):
    """Voxels of which BANDED shows blobs of 4 x 4 x 8, so that cells are kept in runs."""
    values = np.random.default_rng(5).random((n // 4, n // 4, n // 8)) < 0.04
    return Volume(np.kron(np.where(values, 130, 10), np.ones((4, 4, 8))).astype(dtype), np.eye(4))


def scene_of(volume, size=64, function=FUNCTION, headlight=True):
    camera, matrix = turntable(volume, 20, 10)
    return Scene(volume, function, camera, size, size, matrix, headlight=headlight)


def traced(work):
    """(what ``work`` returns, the most bytes it held at a time)."""
    tracemalloc.start()
    try:
        result = work()
        return result, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
