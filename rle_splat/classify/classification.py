"""Pre-classification: scalar -> opacity, extinction and colour of each non-transparent voxel (paper 2.1).

Two passes over the rows, count and fill, so that nothing of the volume's size is ever allocated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..jit import compiled, parallel_call, read_only
from ..scene import RleSplatError
from . import classify_kernels as passes
from .points import LARGEST, Pieces, heights_at_numpy, pieces, positive_intervals

# alpha = 1 would be an infinite extinction; 1 - 2^-24 is the float32 number next to 1, an optical depth of 24 ln 2.
ALPHA_CAP = 1.0 - 2.0**-24
# A matrix whose smallest singular value is below this fraction of its largest squeezes the volume flat.
FLAT = 1e-12


@dataclass(frozen=True, eq=False)
class ClassifiedVolume:
    """The non-transparent voxels of a volume, in rows along x; row number ``z * ny + y``.

    ``row_start``: (nz * ny + 1,) int64, first voxel of each row in the lists below.
    ``column``: (m,) uint16 (int32 when nx > 65536), x of each voxel, ascending within a row.
    ``extinction``: (m,) float32, 1 / world length.  ``opacity``: (m,) float32, alpha per opacity unit distance.
    ``color``: (m, 3) float32, scene-linear, unassociated, unshaded.
    ``nan_voxels``: how many voxels were NaN and therefore transparent.
    ``unit_length``: world length of one of the volume's units.
    ``opacity_distance``: world length that alpha refers to.
    """

    shape_xyz: tuple[int, int, int]
    row_start: np.ndarray
    column: np.ndarray
    extinction: np.ndarray
    opacity: np.ndarray
    color: np.ndarray
    nan_voxels: int
    unit_length: float
    opacity_distance: float

    @property
    def visible_voxels(self) -> int:
        return int(self.row_start[-1])

    @property
    def visible_fraction(self) -> float:
        nx, ny, nz = self.shape_xyz
        return self.visible_voxels / (nx * ny * nz)


def unit_length(volume, index_to_world) -> float:
    """World length of one of the volume's units: the cube root of the ratio of the two matrices' determinants.

    An object's scale therefore thins the medium as it stretches it, and the picture of an evenly scaled volume
    keeps its opacity; under an uneven scale the mean of the three axes counts.  RleSplatError when flat.
    """
    for matrix in (volume.affine, index_to_world):
        singular = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if not singular[2] > FLAT * singular[0]:
            raise RleSplatError(
                "The volume's matrix squeezes it flat; give it a scale and a spacing other than zero on every axis."
            )
    world, own = (abs(np.linalg.det(matrix[:3, :3])) for matrix in (index_to_world, volume.affine))
    return float(np.cbrt(world / own))


def optical_depth(alpha) -> np.ndarray:
    """Optical depth of opacity ``alpha`` in [0, 1], float64; alpha = 1 is capped at 24 ln 2."""
    return -np.log1p(-np.minimum(alpha, ALPHA_CAP))


def classify(volume, tf, index_to_world, *, backend: str = "auto", threads: int = 0) -> ClassifiedVolume:
    """The voxels of ``volume`` to which the transfer function ``tf`` gives an opacity above 0.

    ``index_to_world``: (4, 4) float64.  NaN voxels are transparent and counted; infinite ones take the end
    values.  8- and 16-bit volumes go through a table of every stored value, others through the points themselves.
    Extinction is -log1p(-alpha) per opacity unit distance (the volume's smallest spacing unless tf states one).
    """
    length = unit_length(volume, np.asarray(index_to_world, dtype=np.float64))
    distance = length * float(tf.opacity_unit_distance or volume.spacing.min())
    nx, ny, nz = volume.shape_xyz
    rows = read_only(np.asarray(volume.voxels)).reshape(nz * ny, nx)
    by_table = volume.voxels.dtype.kind in "iu" and volume.voxels.dtype.itemsize <= 2
    if by_table:
        lists = _classify_by_table(rows, *_stored_value_table(volume, tf, distance), backend, threads)
    else:
        lists = _classify_by_points(rows, volume, pieces(tf.opacity), pieces(tf.color), distance, backend, threads)
    for array in lists[:5]:
        array.setflags(write=False)
    return ClassifiedVolume((nx, ny, nz), *lists, unit_length=length, opacity_distance=distance)


def row_offsets(counts: np.ndarray) -> np.ndarray:
    """(n + 1,) int64 running totals of n counts, starting with 0."""
    offsets = np.zeros(len(counts) + 1, dtype=np.int64)
    np.cumsum(counts, out=offsets[1:], dtype=np.int64)
    return offsets


def _stored_value_table(volume, tf, distance):
    """Per stored bit pattern of an 8- or 16-bit volume: visible (n,) bool, (n, 5) float32 extinction, alpha, RGB."""
    stored_type = volume.voxels.dtype
    patterns = np.arange(1 << (8 * stored_type.itemsize), dtype=f"u{stored_type.itemsize}").view(stored_type)
    values = volume.physical(patterns)
    alpha = np.asarray(tf.alpha_at(values), dtype=np.float64)
    records = np.empty((len(values), 5), dtype=np.float32)
    records[:, 0] = optical_depth(alpha) / distance
    records[:, 1] = alpha
    records[:, 2:] = tf.color_at(values)
    return alpha > 0.0, records


def _empty_lists(n_voxels: int, width: int):
    """Column, extinction, opacity and colour lists for ``n_voxels`` voxels of rows of ``width`` voxels."""
    return (
        np.empty(n_voxels, dtype=np.uint16 if width <= 65536 else np.int32),
        np.empty(n_voxels, dtype=np.float32),
        np.empty(n_voxels, dtype=np.float32),
        np.empty((n_voxels, 3), dtype=np.float32),
    )


def _classify_by_table(rows, visible, records, backend, threads):
    patterns = rows.view(f"u{rows.itemsize}")
    if not compiled(backend):
        return *_table_numpy(patterns, visible, records), 0
    counts = np.empty(len(rows), dtype=np.int64)
    with parallel_call(threads):
        passes.count_by_table(patterns, visible, counts)
        row_start = row_offsets(counts)
        lists = _empty_lists(row_start[-1], rows.shape[1])
        passes.fill_by_table(patterns, visible, records, row_start, *lists)
    return row_start, *lists, 0


def _table_numpy(patterns, visible, records):
    """Twin of the two table passes."""
    shown = visible[patterns]
    row_start = row_offsets(shown.sum(axis=1))
    column, extinction, opacity, color = _empty_lists(row_start[-1], patterns.shape[1])
    record = records[patterns[shown]]
    column[:] = np.nonzero(shown)[1]
    extinction[:], opacity[:], color[:] = record[:, 0], record[:, 1], record[:, 2:]
    return row_start, column, extinction, opacity, color


def _classify_by_points(rows, volume, opacity: Pieces, color: Pieces, distance, backend, threads):
    shown = positive_intervals(opacity)
    scaling = (float(volume.slope), float(volume.intercept))
    if not compiled(backend):
        return _points_numpy(rows, scaling, shown, opacity, color, distance)
    counts, nan_counts = np.empty((2, len(rows)), dtype=np.int64)
    with parallel_call(threads):
        passes.count_by_points(rows, *scaling, shown, counts, nan_counts)
        row_start = row_offsets(counts)
        lists = _empty_lists(row_start[-1], rows.shape[1])
        passes.fill_by_points(
            rows, *scaling, shown, opacity.values, opacity.heights, opacity.rates,
            color.values, color.heights, color.rates, ALPHA_CAP, distance, row_start, *lists,
        )
    return row_start, *lists, int(nan_counts.sum())


def _points_numpy(rows, scaling, intervals, opacity: Pieces, color: Pieces, distance):
    """Twin of the two passes over points; row by row, since float volumes are the large ones."""
    counts = np.zeros(len(rows), dtype=np.int64)
    columns, seen, nan_voxels = [], [], 0
    for row, stored in enumerate(rows):
        values = np.clip(stored.astype(np.float64) * scaling[0] + scaling[1], -LARGEST, LARGEST)
        nan_voxels += int(np.isnan(values).sum())
        shown = ((values[:, None] >= intervals[:, 0]) & (values[:, None] < intervals[:, 1])).any(axis=1)
        column = np.flatnonzero(shown)
        counts[row] = len(column)
        columns.append(column)
        seen.append(values[column])
    row_start = row_offsets(counts)
    column, extinction, alpha, rgb = _empty_lists(row_start[-1], rows.shape[1])
    values = np.concatenate(seen)
    exact_alpha = heights_at_numpy(opacity, values)[:, 0]
    column[:] = np.concatenate(columns)
    extinction[:], alpha[:] = optical_depth(exact_alpha) / distance, exact_alpha
    rgb[:] = heights_at_numpy(color, values)
    return row_start, column, extinction, alpha, rgb, nan_voxels
