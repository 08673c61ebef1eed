"""Pre-classification: scalar -> opacity, extinction and colour of each non-transparent voxel (paper 2.1).

In two halves: which voxels are visible (``visible.py``), and how they look.  A transfer function that shows the same
values in another way changes the second half alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..runtime.jit import compiled, parallel_call
from ..runtime.steps import drain
from ..scene import RleSplatError
from ..volume.blocks import block_steps
from ..volume.gradient_size import gradient_sizes
from . import classify_kernels as passes
from .limits import LEAST_DISTANCE
from .points import LARGEST, heights_at_numpy, pieces
from .visible import Visibility, VisibleVoxels, count_steps, fill_steps

# alpha = 1 would be an infinite extinction; 1 - 2^-24 is the float32 number next to 1, an optical depth of 24 ln 2.
ALPHA_CAP = 1.0 - 2.0**-24
# A matrix whose smallest singular value is below this fraction of its largest squeezes the volume flat.
FLAT = 1e-12
# Columns of the looks of a voxel.
EXTINCTION, OPACITY, RED, LOOKS = 0, 1, 2, 5


@dataclass(frozen=True, eq=False)
class ClassifiedVolume:
    """The non-transparent voxels of a volume and how they look.

    ``voxels``: which they are.  ``looks``: (n, 5) float32 extinction in 1 / world length, opacity (alpha per opacity
    unit distance), and scene-linear unassociated unshaded red, green, blue; one for every bit pattern of 8- and 16-bit
    volumes (``by_value``), else one for every visible voxel.
    ``unit_length``: world length of one of the volume's units.
    ``opacity_distance``: world length that alpha refers to.
    """

    voxels: VisibleVoxels
    looks: np.ndarray
    by_value: bool
    unit_length: float
    opacity_distance: float

    def __post_init__(self):
        self.looks.setflags(write=False)

    @classmethod
    def from_lists(
        cls, shape_xyz, row_start, column, extinction, opacity, color, nan_voxels=0, unit_length=1.0,
        opacity_distance=1.0,
    ) -> ClassifiedVolume:
        """From a list for each of the voxels' properties: ``row_start`` and ``column`` as in VisibleVoxels."""
        row = np.repeat(np.arange(len(row_start) - 1), np.diff(row_start))
        opens = np.ones(len(column), bool)
        opens[1:] = (np.diff(row) != 0) | (np.diff(column.astype(np.int64)) != 1)
        row_pieces = np.bincount(row[opens], minlength=len(row_start) - 1).astype(np.int32)
        stored = np.zeros(len(column), np.uint8)  # no value of the volume's own: the looks say it all
        looks = np.column_stack((extinction, opacity, color)).astype(np.float32).reshape(-1, LOOKS)
        voxels = VisibleVoxels(shape_xyz, row_start, row_pieces, column, stored, nan_voxels)
        return cls(voxels, looks, False, unit_length, opacity_distance)

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        return self.voxels.shape_xyz

    @property
    def row_start(self) -> np.ndarray:
        return self.voxels.row_start

    @property
    def column(self) -> np.ndarray:
        return self.voxels.column

    @property
    def nan_voxels(self) -> int:
        return self.voxels.nan_voxels

    @property
    def look_of(self) -> np.ndarray | None:
        """(m,) index into ``looks`` by voxel; None where voxel number i has look number i."""
        return self.voxels.stored if self.by_value else None

    def _each(self, columns) -> np.ndarray:
        each = self.looks[self.voxels.stored, columns] if self.by_value else self.looks[:, columns]
        each = np.ascontiguousarray(each)
        each.setflags(write=False)
        return each

    @cached_property
    def extinction(self) -> np.ndarray:
        """(m,) float32, 1 / world length."""
        return self._each(EXTINCTION)

    @cached_property
    def opacity(self) -> np.ndarray:
        """(m,) float32, alpha per opacity unit distance."""
        return self._each(OPACITY)

    @cached_property
    def color(self) -> np.ndarray:
        """(m, 3) float32, scene-linear, unassociated, unshaded."""
        return self._each(slice(RED, LOOKS))

    @property
    def visible_voxels(self) -> int:
        return len(self.voxels)

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


def opacity_distance(volume, tf, length: float) -> float:
    """World length that the opacities of ``tf`` refer to: the volume's smallest spacing unless it states one.

    ``length``: world length of one of the volume's units.
    """
    return max(length * float(tf.opacity_unit_distance or volume.spacing.min()), LEAST_DISTANCE)


def optical_depth(alpha) -> np.ndarray:
    """Optical depth of opacity ``alpha`` in [0, 1], float64; alpha = 1 is capped at 24 ln 2."""
    return -np.log1p(-np.minimum(alpha, ALPHA_CAP))


def classify(volume, tf, index_to_world, *, backend: str = "auto", threads: int = 0) -> ClassifiedVolume:
    """The voxels of ``volume`` to which the transfer function ``tf`` gives an opacity above 0, and their looks.

    ``index_to_world``: (4, 4) float64.  NaN voxels are transparent and counted; infinite ones take the end values.
    """
    machine = dict(backend=backend, threads=threads)
    length = unit_length(volume, np.asarray(index_to_world, dtype=np.float64))
    shown = Visibility(volume, tf)
    blocks = drain(block_steps(volume, **machine))
    voxels = drain(fill_steps(shown, blocks, drain(count_steps(shown, blocks, **machine)), **machine))
    return classified(shown, voxels, length, **machine)


def classified(
    shown: Visibility, voxels: VisibleVoxels, length: float, *, backend: str = "auto", threads: int = 0
) -> ClassifiedVolume:
    """The looks of visible voxels; ``length``: world length of one of the volume's units.

    Extinction is -log1p(-alpha) per opacity unit distance.
    """
    volume, tf = shown.volume, shown.tf
    distance = opacity_distance(volume, tf, length)
    if shown.by_table:
        looks = _looks_by_table(shown, distance)
    else:
        looks = _looks_by_points(shown, voxels.stored, distance, backend, threads)
    if tf.gradient_opacity is None:
        return ClassifiedVolume(voxels, looks, shown.by_table, length, distance)
    # Values that are alike no longer look alike: a look for every voxel.
    looks = looks[voxels.stored] if shown.by_table else looks
    sizes = gradient_sizes(volume, voxels.row_start, voxels.column, backend=backend, threads=threads)
    factor = tf.gradient_opacity.factor(sizes)
    looks[:, EXTINCTION] *= factor
    looks[:, OPACITY] = -np.expm1(factor * np.log1p(-np.minimum(looks[:, OPACITY], np.float32(ALPHA_CAP))))
    return ClassifiedVolume(voxels, looks, False, length, distance)


def _looks_by_table(shown: Visibility, distance) -> np.ndarray:
    looks = np.zeros((len(shown.table), LOOKS), dtype=np.float32)
    seen = shown.table > 0
    values = shown.pattern_values[seen]
    alpha = np.asarray(shown.tf.alpha_at(values), dtype=np.float64)
    looks[seen, EXTINCTION], looks[seen, OPACITY] = optical_depth(alpha) / distance, alpha
    looks[seen, RED:] = shown.tf.color_at(values)
    return looks


def _looks_by_points(shown: Visibility, stored, distance, backend, threads) -> np.ndarray:
    opacity, color = pieces(shown.tf.opacity), pieces(shown.tf.color)
    scaling = (float(shown.volume.slope), float(shown.volume.intercept))
    looks = np.empty((len(stored), LOOKS), dtype=np.float32)
    if compiled(backend):
        with parallel_call(threads):
            passes.looks_by_points(
                stored, *scaling, opacity.values, opacity.heights, opacity.rates, color.values, color.heights,
                color.rates, ALPHA_CAP, distance, looks,
            )
        return looks
    with np.errstate(over="ignore"):
        values = np.clip(stored.astype(np.float64) * scaling[0] + scaling[1], -LARGEST, LARGEST)
    alpha = heights_at_numpy(opacity, values)[:, 0]
    looks[:, EXTINCTION], looks[:, OPACITY] = optical_depth(alpha) / distance, alpha
    looks[:, RED:] = heights_at_numpy(color, values)
    return looks
