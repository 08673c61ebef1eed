"""The kernels of this folder once more in numpy, to be read, to run where numba is missing, and to test against.

Extremes of blocks, and gradients (algorithm.md 1.13).
"""

import numpy as np

CHUNK = 1 << 18  # voxels that the reference implementation processes at once
SMOOTHING = 16.0  # sum of the smoothing weights; a difference spans 2 voxels, or 1 at a face


def find_extremes(voxels, most, least, low, high, nan_voxels, sizes):
    """Extremes of blocks of ``sizes`` (z, y, x) voxels, and how many are NaN: as ``blocks._extremes``."""
    starts = [np.arange(0, n, size) for n, size in zip(voxels.shape, sizes)]
    nan = np.isnan(voxels) if voxels.dtype.kind == "f" else None
    for reduce, filling, out in ((np.minimum, most, low), (np.maximum, least, high)):
        reduced = voxels if nan is None else np.where(nan, filling, voxels)
        for axis in (2, 1, 0):
            reduced = reduce.reduceat(reduced, starts[axis], axis=axis)
        out[...] = reduced
    if nan is None:
        nan_voxels[...] = 0
    else:
        per_row = nan.sum(axis=2)
        nan_voxels[...] = np.add.reduceat(np.add.reduceat(per_row, starts[1], axis=1), starts[0], axis=0)


def find_normals(voxels, lists, covector, floor, is_integer, normals):
    """Unit normals of listed voxels, as ``gradient._sobel`` and ``gradient._central``."""
    for wanted, index in _in_chunks(voxels.shape, *lists):
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            gradient, largest = (differ_by_sobel if is_integer else differ_centrally)(voxels, index)
            world = np.einsum("ni,ji->nj", gradient, covector)  # its sums do not depend on how many there are
            length = np.sqrt((world**2).sum(axis=1))
            keep = ((gradient**2).sum(axis=1) > (floor * largest) ** 2) & (length > 0.0) & (length < np.inf)
            normals[:, wanted] = np.where(keep, world.T / length, 0.0)


def measure_gradients(voxels, row_start, column, covector, sizes):
    """Magnitudes of central differences, those of ``gradient_size._measure``; ``covector``: (3, 3)."""
    for wanted, index in _in_chunks(voxels.shape, row_start, column):
        with np.errstate(invalid="ignore", over="ignore"):
            gradient, _ = differ_centrally(voxels, index)
            sizes[wanted] = np.sqrt(((gradient @ covector.T) ** 2).sum(axis=1))
    np.nan_to_num(sizes, copy=False, nan=0.0)


def _in_chunks(shape, row_start, column):
    """Yield the numbers of voxels of a list, and their z, y and x, CHUNK of them at a time."""
    for begin in range(0, len(column), CHUNK):
        wanted = np.arange(begin, min(begin + CHUNK, len(column)))
        row = np.searchsorted(row_start, wanted, side="right") - 1
        yield wanted, (row // shape[1], row % shape[1], column[wanted].astype(np.int64))


def differ_centrally(voxels, index):
    """Gradient by central differences at selected voxels.

    Parameters
    ----------
    voxels : (nz, ny, nx) ndarray
    index : tuple of three (m,) ndarrays of int64
        z, y, x of the selected voxels.

    Returns
    -------
    gradient : (m, 3) ndarray of float64
        x, y, z components, in stored values per voxel step.
    largest : (m,) ndarray of float64
        Largest absolute value among the neighbors.
    """
    here = voxels[index].astype(np.float64)
    gradient, largest = np.empty((len(here), 3)), np.zeros(len(here))
    for axis, component in ((2, 0), (1, 1), (0, 2)):
        before, after, span = _neighbors(index, voxels.shape, axis)
        a, b = (voxels[neighbor].astype(np.float64) for neighbor in (before, after))
        a, b = np.where(np.isfinite(a), a, here), np.where(np.isfinite(b), b, here)
        gradient[:, component] = (b - a) / span
        largest = np.maximum(largest, np.maximum(np.abs(a), np.abs(b)))
    return gradient, largest


def differ_by_sobel(voxels, index):
    """As ``differ_centrally``, by Sobel's operator; the largest value is 1, since the floor is in stored steps."""
    gradient = np.zeros((len(index[0]), 3))
    steps = [_neighbors(index, voxels.shape, axis) for axis in range(3)]
    for c in (-1, 0, 1):
        for b in (-1, 0, 1):
            for a in (-1, 0, 1):
                at = tuple(
                    steps[axis][0 if d < 0 else 1][axis] if d else index[axis] for axis, d in enumerate((c, b, a))
                )
                value = voxels[at].astype(np.float64)
                wa, wb, wc = 2 - abs(a), 2 - abs(b), 2 - abs(c)
                gradient += value[:, None] * (a * wb * wc, b * wa * wc, c * wa * wb)
    for axis, component in ((2, 0), (1, 1), (0, 2)):
        gradient[:, component] /= SMOOTHING * steps[axis][2]
    return gradient, 1.0


def _neighbors(index, shape, axis):
    """Index arrays of the neighbors before and after along array ``axis``, and the (m,) distance between them."""
    before, after = list(index), list(index)
    before[axis] = np.maximum(index[axis] - 1, 0)
    after[axis] = np.minimum(index[axis] + 1, shape[axis] - 1)
    return tuple(before), tuple(after), np.maximum(after[axis] - before[axis], 1)
