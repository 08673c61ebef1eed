"""Decode run-length tables to a dense grid; decode(encode(v)) is v."""

import numpy as np

from ..encode.tables import RunLengthVolume


def decode(encoded: RunLengthVolume) -> np.ndarray:
    """Decode to a dense grid.

    Returns
    -------
    (n_slices, n_scanlines, width, 4) ndarray of float32
        Voxel records; zero where transparent.
    """
    shape = encoded.n_slices, encoded.n_scanlines, encoded.width
    pointers, runs = encoded.scanline_pointers.reshape(-1).astype(np.int64), encoded.runs
    lines = np.flatnonzero(pointers >= 0)
    lines = lines[np.argsort(pointers[lines])]  # in the order of their runs
    starts = pointers[lines]
    in_line = np.arange(len(runs)) - np.repeat(starts, np.diff(np.append(starts, len(runs))))
    visible = np.zeros((len(pointers), encoded.width), dtype=bool)
    visible[lines] = np.repeat(in_line % 2 == 1, runs).reshape(-1, encoded.width)
    counts = np.count_nonzero(visible, axis=1)
    before = np.cumsum(counts) - counts
    records = np.repeat(encoded.scanline_data_pointers.reshape(-1) - before, counts) + np.arange(counts.sum())
    dense = np.zeros((*visible.shape, 4), dtype=np.float32)
    dense[visible] = encoded.decoded()[records]
    return dense.reshape(*shape, 4)
