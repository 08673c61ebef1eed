"""Ihm and Lee's indexed splatting: the voxels of each slice sorted by density, so that a window is a range.

I. Ihm and R. K. Lee, On enhancing the speed of splatting with indexing, Visualization 1995: the paper's [10].
When the transfer function changes, bisection finds the voxels that are not transparent, without a look at the others.
They are encoded and rendered by this package.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from ..classify.classification import ClassifiedVolume, classify
from ..classify.points import LARGEST, pieces, positive_intervals
from ..classify.visible import row_offsets
from ..encode.encode import encode
from ..scene import Quality
from ..volume.volume import Volume
from . import ours
from .medium import ShadedScene
from .system import ReadySystem

ROW = 4096  # visible voxels are classified in rows of this length
RECORD = 16  # bytes of a run-length voxel record, for the comparison of memory


@dataclass(frozen=True, eq=False)
class DensityIndex:
    """The voxels of each slice sorted by stored value.

    Attributes
    ----------
    order : (nz, ny * nx) uint16 or uint32
        Positions ``y * nx + x`` in a slice, by ascending stored value.
    values : (nz, ny * nx)
        The stored values in that order, NaN last.
    numbers : (nz,) int64
        The number of values that are not NaN.
    """

    order: np.ndarray
    values: np.ndarray
    numbers: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of all three."""
        return self.order.nbytes + self.values.nbytes + self.numbers.nbytes


def index_volume(volume: Volume) -> DensityIndex:
    """Sort each slice of a volume by stored value, once for all transfer functions."""
    slices = volume.voxels.reshape(volume.voxels.shape[0], -1)
    order = np.empty(slices.shape, np.uint16 if slices.shape[1] <= 65536 else np.uint32)
    values = np.empty_like(slices)
    for k, stored in enumerate(slices):  # slice by slice, because argsort returns 8 bytes a voxel
        order[k] = np.argsort(stored, kind="stable")
        values[k] = stored[order[k]]
    missing = np.isnan(values).sum(axis=1) if values.dtype.kind == "f" else np.zeros(len(values), np.int64)
    return DensityIndex(order, values, slices.shape[1] - missing)


def _first(index: DensityIndex, volume: Volume, reached) -> np.ndarray:
    """(nz,) int64: the first position in each sorted slice whose physical value is ``reached``, a predicate that is
    false and then true; bisection of all slices at once."""
    low, high = np.zeros_like(index.numbers), index.numbers.copy()
    slices = np.arange(len(low))
    while (low < high).any():
        middle = (low + high) // 2
        open_ = low < high
        stored = index.values[slices, np.minimum(middle, index.values.shape[1] - 1)]
        there = reached(np.clip(volume.physical(stored), -LARGEST, LARGEST))
        high = np.where(open_ & there, middle, high)
        low = np.where(open_ & ~there, middle + 1, low)
    return low


def shown_indices(index: DensityIndex, volume: Volume, transfer_function) -> list[np.ndarray]:
    """For each slice the ascending positions ``y * nx + x`` of the voxels whose values are not transparent."""
    ranges = []
    for low, high in positive_intervals(pieces(transfer_function.opacity)):
        ends = [_first(index, volume, (lambda v, e=end: v >= e) if volume.slope > 0.0 else (lambda v, e=end: v < e))
                for end in (low, high)]  # fmt: skip
        ranges.append(ends if volume.slope > 0.0 else ends[::-1])
    shown = []
    marks = np.zeros(index.order.shape[1], bool)
    for k in range(len(index.order)):
        for begin, end in ranges:
            marks[index.order[k, begin[k] : end[k]]] = True
        shown.append(np.flatnonzero(marks))
        marks[shown[-1]] = False
    return shown


def classify_shown(
    index: DensityIndex, volume: Volume, transfer_function, index_to_world, threads: int = 0
) -> ClassifiedVolume:
    """As ``classify``, with the visible voxels found by the index."""
    nx, ny, nz = volume.shape_xyz
    shown = shown_indices(index, volume, transfer_function)
    counts = [len(indices) for indices in shown]
    total = sum(counts)
    # Classify the visible voxels alone, as a volume with rows of ROW voxels; the last one is filled up.
    stored = np.zeros(max(-(-total // ROW), 1) * ROW, volume.voxels.dtype)
    slices = volume.voxels.reshape(nz, -1)
    for begin, indices, voxels in zip(row_offsets(np.array(counts)), shown, slices):
        stored[begin : begin + len(indices)] = voxels[indices]
    packed = replace(volume, voxels=stored.reshape(1, -1, ROW))
    found = classify(packed, transfer_function, index_to_world, threads=threads)
    row = np.repeat(np.arange(len(found.row_start) - 1), np.diff(found.row_start))
    seen = row * ROW + found.column
    kept = slice(0, int(np.searchsorted(seen, total)))  # without the filling of the last row
    flat = np.concatenate([k * (ny * nx) + indices for k, indices in enumerate(shown)])[seen[kept]]
    per_row = np.bincount(flat // nx, minlength=nz * ny)
    lists = (found.extinction[kept], found.opacity[kept], found.color[kept])
    return ClassifiedVolume.from_lists(
        (nx, ny, nz), row_offsets(per_row), (flat % nx).astype(np.uint16 if nx <= 65536 else np.int32), *lists,
        int(nz * ny * nx - index.numbers.sum()), found.unit_length, found.opacity_distance,
    )  # fmt: skip


def prepare(medium: ShadedScene, quality: Quality) -> ReadySystem:
    """Index the volume, find the visible voxels by the index, encode them and render them at ``quality``."""
    scene = medium.scene
    began = time.perf_counter()
    index = index_volume(scene.volume)
    indexed = time.perf_counter()
    shown = classify_shown(index, scene.volume, scene.transfer_function, scene.index_to_world, quality.threads)
    found = time.perf_counter()
    axes = {
        axis: encode(shown, medium.colors, axis, quality.model, threads=quality.threads)
        for axis in medium.principal_axes
    }
    notes = {
        "index_ms": 1e3 * (indexed - began), "window_ms": 1e3 * (found - indexed),
        "classify_ms": medium.stages_ms["classify"], "index_bytes": index.nbytes,
        "three_axes_of_records_bytes": 3 * RECORD * shown.visible_voxels,
    }  # fmt: skip
    prepared = ours.prepare_tables(medium, quality, axes, **notes)
    return replace(prepared, memory_bytes={"index": index.nbytes, **prepared.memory_bytes})
