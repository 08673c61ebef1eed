"""Validation of run-length tables before any kernel reads them, because kernels have no bounds checks.

Every check works on whole arrays. The first failed check gives the error message.
"""

from __future__ import annotations

import numpy as np

from ..scene import MODELS, RleSplatError
from ..volume.axes import AXES, AXIS_NAMES
from .records import TYPES, WORDS, decoding_size
from .tables import data_pointers_from_scanlines, pointers_from_counts, run_type

MOST = 1e37  # bound of any number in the voxel data: above the densest and brightest, and within float32
POINTER_TYPES = (np.dtype(np.int32), np.dtype(np.int64))


def _broken(axis, what: str) -> RleSplatError:
    """The error for a damaged table."""
    name = AXIS_NAMES[axis] if axis in AXES else repr(axis)
    return RleSplatError(
        f"The run-length tables of principal axis {name} are damaged: {what}; encode the volume again."
    )


def scanline_data_pointers(
    axis, shape_xyz, model, scanline_pointers, data_pointers, runs, voxel_data, decoding=None
) -> np.ndarray:
    """Derive the fifth table from the four stored ones, after checking them.

    Parameters
    ----------
    axis, shape_xyz, model, scanline_pointers, data_pointers, runs, voxel_data, decoding
        As in RunLengthVolume.

    Returns
    -------
    (n_slices, n_scanlines) ndarray of int64
        ``RunLengthVolume.scanline_data_pointers``.

    Raises
    ------
    RleSplatError
        If a table is not as RunLengthVolume describes it.
    """
    if model not in MODELS:
        raise _broken(axis, f"there is no model called {model!r}")
    _check_form(axis, shape_xyz, scanline_pointers, data_pointers, runs)
    check_records(axis, voxel_data, decoding)
    return scanline_starts(axis, shape_xyz, scanline_pointers, data_pointers, runs, len(voxel_data))


def scanline_starts(axis, shape_xyz, scanline_pointers, data_pointers, runs, stored: int) -> np.ndarray:
    """As ``scanline_data_pointers``, of tables whose ``stored`` voxels are checked elsewhere."""
    _check_form(axis, shape_xyz, scanline_pointers, data_pointers, runs)
    width = shape_xyz[AXES[axis][0]]
    starts = scanline_pointers[scanline_pointers >= 0].astype(np.int64)
    if scanline_pointers.size and scanline_pointers.min() < -1:
        raise _broken(axis, "a scanline pointer is below -1")
    if len(starts) == 0:
        if len(runs):
            raise _broken(axis, "there are runs to which no scanline points")
        voxel_counts = np.zeros(scanline_pointers.shape, dtype=np.int64)
    else:
        if starts[0] != 0 or (np.diff(starts) < 2).any() or starts[-1] > len(runs) - 2:
            raise _broken(axis, "the scanline pointers do not follow the order of the runs")
        voxel_counts = np.zeros(scanline_pointers.shape, dtype=np.int64)
        voxel_counts[scanline_pointers >= 0] = _visible_per_scanline(axis, starts, runs, width)
    pointers, n_voxels = pointers_from_counts(voxel_counts)
    if n_voxels != stored:
        raise _broken(axis, f"the runs hold {n_voxels} voxels, but {stored} are stored")
    if not np.array_equal(data_pointers_from_scanlines(pointers, n_voxels), data_pointers):
        raise _broken(axis, "the data pointers of the slices do not match the runs")
    return pointers


def _visible_per_scanline(axis, starts, runs, width) -> np.ndarray:
    """Visible voxels of each scanline that has any; ``starts`` (n,): ascending positions of their first runs."""
    counts = np.diff(np.append(starts, len(runs)))
    in_line = np.arange(len(runs), dtype=np.int64) - np.repeat(starts, counts)
    if (runs[in_line > 0] == 0).any():
        raise _broken(axis, "a run other than the first of a scanline has length zero")
    if (np.add.reduceat(runs, starts, dtype=np.int64) != width).any():
        raise _broken(axis, f"the runs of a scanline do not sum to its {width} voxels")
    return np.add.reduceat(np.where(in_line % 2 == 1, runs, 0), starts, dtype=np.int64)


def _check_form(axis, shape_xyz, scanline_pointers, data_pointers, runs) -> None:
    """Check types, dimensions and sizes of the tables that state where voxels are."""
    if axis not in AXES:
        raise _broken(axis, "there is no such axis")
    if len(shape_xyz) != 3 or min(shape_xyz) < 1:
        raise _broken(axis, f"a volume cannot have the shape {tuple(shape_xyz)}")
    _, n_scanlines, n_slices = (shape_xyz[i] for i in AXES[axis])
    if scanline_pointers.dtype not in POINTER_TYPES or scanline_pointers.shape != (n_slices, n_scanlines):
        raise _broken(axis, f"the scanline pointers are not {n_slices} x {n_scanlines} integers")
    if data_pointers.dtype != np.int64 or data_pointers.shape != (n_slices + 1,):
        raise _broken(axis, f"the data pointers are not {n_slices + 1} integers")
    if runs.dtype != run_type(shape_xyz) or runs.ndim != 1:
        raise _broken(axis, "the runs do not have the type that this shape needs")
    for table in (scanline_pointers, data_pointers, runs):
        if not table.flags.c_contiguous:
            raise _broken(axis, "a table is not contiguous in memory")


def check_records(axis, voxel_data, decoding) -> None:
    """Check type and size of the voxel data, and that they are finite and not negative."""
    kinds = {np.dtype(kind): (WORDS[record], record) for record, kind in TYPES.items()}
    words, record = kinds.get(voxel_data.dtype, (None, None))
    if words is None or voxel_data.shape[1:] != words or voxel_data.ndim != 1 + len(words):
        raise _broken(axis, "the voxel data are neither rows of four float32 numbers nor shorter records")
    if not voxel_data.flags.c_contiguous:
        raise _broken(axis, "a table is not contiguous in memory")
    if record == 16:
        numbers = voxel_data
    else:
        numbers = decoding
        if decoding is None or decoding.dtype != np.float32 or decoding.shape != (decoding_size(record),):
            raise _broken(axis, "the scales of the voxel data are missing or of the wrong type or size")
    # One pass each and no copy: NaN fails both comparisons. Codes are valid whatever their bits.
    if numbers.size and not (numbers.min() >= 0.0 and numbers.max() <= MOST):
        raise _broken(axis, "the voxel data hold a value that is negative, not finite or too large")
