"""Decode run-length tables to a dense grid; decode(encode(v)) equals v."""

from __future__ import annotations

import numpy as np

from ..runtime.jit import compiled, kernel, parallel_call, read_only
from ..runtime.parallel import share_out
from ..volume.axes import AXES
from .tables import RunLengthVolume


def decode(encoded: RunLengthVolume, *, backend: str = "auto", threads: int = 0) -> np.ndarray:
    """Decode to a dense grid.

    Parameters
    ----------
    encoded : RunLengthVolume
    backend : {"auto", "numba", "numpy"}
    threads : int
        0 for one per core.

    Returns
    -------
    (n_slices, n_scanlines, width, 4) ndarray of float32
        Voxel records; zero where transparent.
    """
    dense = np.zeros((encoded.n_slices, encoded.n_scanlines, encoded.width, 4), dtype=np.float32)
    records = encoded.decoded()
    if compiled(backend):
        with parallel_call(threads):
            _decode_scanlines(
                encoded.scanline_pointers, encoded.scanline_data_pointers, encoded.runs, read_only(records), dense
            )
    else:
        dense[_visible_numpy(encoded)] = records
    return dense


def to_volume_order(dense: np.ndarray, axis: int) -> np.ndarray:
    """View a (n_slices, n_scanlines, width, ...) grid of principal ``axis`` as (nz, ny, nx, ...)."""
    along, across, principal = AXES[axis]
    array_axis = {principal: 0, across: 1, along: 2}  # volume axis (0 x, 1 y, 2 z) -> array axis
    return dense.transpose(array_axis[2], array_axis[1], array_axis[0], *range(3, dense.ndim))


@kernel
def _decode_scanlines(scanline_pointers, scanline_data_pointers, runs, voxel_data, dense):
    """Kernel of ``decode``: ``dense`` (n_slices, n_scanlines, width, 4), zero on entry; valid tables."""
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
    """Reference implementation: (n_slices, n_scanlines, width) bool, whether a voxel is stored, from the runs alone."""
    starts = encoded.scanline_pointers[encoded.scanline_pointers >= 0].astype(np.int64)
    bounds = np.append(starts, len(encoded.runs))
    in_line = np.arange(len(encoded.runs)) - np.repeat(starts, np.diff(bounds))
    visible = np.zeros((encoded.n_slices, encoded.n_scanlines, encoded.width), dtype=bool)
    visible[encoded.scanline_pointers >= 0] = np.repeat(in_line % 2 == 1, encoded.runs).reshape(-1, encoded.width)
    return visible
