"""Decode run-length tables to a dense grid; decode(encode(v)) is v."""

from __future__ import annotations

import numpy as np

from ..encode.tables import RunLengthVolume
from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out


def decode(encoded: RunLengthVolume, *, threads: int = 0) -> np.ndarray:
    """Decode to a dense grid.

    Parameters
    ----------
    encoded : RunLengthVolume
    threads : int
        0 for one per core.

    Returns
    -------
    (n_slices, n_scanlines, width, 4) ndarray of float32
        Voxel records; zero where transparent.
    """
    dense = np.zeros((encoded.n_slices, encoded.n_scanlines, encoded.width, 4), dtype=np.float32)
    records = encoded.decoded()
    if compiled():
        with parallel_call(threads):
            _decode_scanlines(
                encoded.scanline_pointers, encoded.scanline_data_pointers, encoded.runs, read_only(records), dense
            )
    else:
        dense[_visible_numpy(encoded)] = records
    return dense


@kernel
def _decode_scanlines(scanline_pointers, scanline_data_pointers, runs, voxel_data, dense):
    """Write ``dense`` (n_slices, n_scanlines, width, 4) float32, zero on entry, from valid tables."""
    share_out(_decode_slices, dense.shape[0], (scanline_pointers, scanline_data_pointers, runs, voxel_data, dense))


@kernel(inner=True)
def _decode_slices(begin, end, scanline_pointers, scanline_data_pointers, runs, voxel_data, dense):
    """``_decode_scanlines`` for slices [begin, end)."""
    width = dense.shape[2]
    for k in range(begin, end):
        for j in range(dense.shape[1]):
            run = np.int64(scanline_pointers[k, j])
            if run < 0:
                continue
            at = scanline_data_pointers[k, j]
            x = np.int64(runs[run])
            while x < width:
                for _ in range(np.int64(runs[run + 1])):
                    for channel in range(4):
                        dense[k, j, x, channel] = voxel_data[at, channel]
                    x += 1
                    at += 1
                run += 2
                if x < width:
                    x += np.int64(runs[run])


def _visible_numpy(encoded: RunLengthVolume) -> np.ndarray:
    """(n_slices, n_scanlines, width) bool: where a voxel is stored; part of the reference implementation."""
    starts = encoded.scanline_pointers[encoded.scanline_pointers >= 0].astype(np.int64)
    bounds = np.append(starts, len(encoded.runs))
    in_line = np.arange(len(encoded.runs)) - np.repeat(starts, np.diff(bounds))
    visible = np.zeros((encoded.n_slices, encoded.n_scanlines, encoded.width), dtype=bool)
    visible[encoded.scanline_pointers >= 0] = np.repeat(in_line % 2 == 1, encoded.runs).reshape(-1, encoded.width)
    return visible
