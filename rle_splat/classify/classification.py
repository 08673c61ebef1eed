"""Pre-classification: scalar -> opacity, extinction and color of each visible voxel (paper, section 2.1).

There are two steps: find the visible voxels (``visible.py``), and compute their optical properties. A transfer function
that shows the same values in another way needs only the second step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ..runtime.jit import compiled, parallel_call
from ..runtime.steps import drain
from ..scene import RleSplatError
from ..volume.blocks import block_steps
from ..volume.gradient_size import gradient_sizes
from . import classify_kernels as passes
from . import reference
from .limits import LEAST_DISTANCE
from .points import pieces
from .relevant import count_kept, gather_kept
from .visible import Visibility, VisibleVoxels, mark_steps

# Opacity 1 would be an infinite extinction. 1 - 2^-24 is the largest float32 below 1; its optical depth is 24 ln 2.
ALPHA_CAP = 1.0 - 2.0**-24
# A matrix whose smallest singular value is below this fraction of its largest flattens the volume.
FLAT = 1e-12
# Columns of ``properties``, the optical properties of voxels; PROPERTIES is their number.
EXTINCTION, OPACITY, RED, PROPERTIES = 0, 1, 2, 5


@dataclass(frozen=True, eq=False)
class ClassifiedVolume:
    """The visible voxels of a volume and their optical properties.

    Attributes
    ----------
    properties : (n, 5) ndarray of float32
        Optical properties: extinction in 1 / world length, opacity (alpha per ``opacity_distance``), and unassociated,
        unshaded scene-linear red, green, blue. With ``by_value`` one row per bit pattern of a stored value, else one
        row per visible voxel.
    by_value : bool
        Whether ``properties`` is a lookup table over the values of an 8- or 16-bit volume; ``voxels.stored`` then has
        their bit patterns.
    unit_length : float
        World length of one of the volume's units.
    opacity_distance : float
        World length to which alpha refers.
    """

    voxels: VisibleVoxels
    properties: np.ndarray
    by_value: bool
    unit_length: float
    opacity_distance: float

    def __post_init__(self):
        self.properties.setflags(write=False)

    @classmethod
    def from_lists(
        cls, shape_xyz, row_start, column, extinction, opacity, color, nan_voxels=0, unit_length=1.0,
        opacity_distance=1.0,
    ) -> ClassifiedVolume:  # fmt: skip
        """Make a ClassifiedVolume from one array per property of its m voxels.

        Parameters
        ----------
        shape_xyz : (nx, ny, nz)
        row_start, column
            As in VisibleVoxels.
        extinction, opacity : (m,) array_like
        color : (m, 3) array_like
        nan_voxels : int
        unit_length, opacity_distance : float
            As in the attributes of the class.
        """
        row = np.repeat(np.arange(len(row_start) - 1), np.diff(row_start))
        opens = np.ones(len(column), bool)
        opens[1:] = (np.diff(row) != 0) | (np.diff(column.astype(np.int64)) != 1)
        row_pieces = np.bincount(row[opens], minlength=len(row_start) - 1).astype(np.int32)
        stored = np.zeros(len(column), np.uint8)  # not used, since every voxel has its own row of properties
        properties = np.column_stack((extinction, opacity, color)).astype(np.float32).reshape(-1, PROPERTIES)
        voxels = VisibleVoxels(shape_xyz, row_start, row_pieces, column, stored, nan_voxels)
        return cls(voxels, properties, False, unit_length, opacity_distance)

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Number of voxels of the volume along x, y, z."""
        return self.voxels.shape_xyz

    @property
    def row_start(self) -> np.ndarray:
        """See VisibleVoxels."""
        return self.voxels.row_start

    @property
    def column(self) -> np.ndarray:
        """See VisibleVoxels."""
        return self.voxels.column

    @property
    def nan_voxels(self) -> int:
        """Number of NaN voxels, which are transparent."""
        return self.voxels.nan_voxels

    @property
    def row_of(self) -> np.ndarray | None:
        """(m,) row of ``properties`` of each voxel; None if voxel i has row i."""
        return self.voxels.stored if self.by_value else None

    def _each(self, columns) -> np.ndarray:
        """Columns of ``properties`` for each voxel, read-only."""
        each = self.properties[self.voxels.stored, columns] if self.by_value else self.properties[:, columns]
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
        return self._each(slice(RED, PROPERTIES))

    @property
    def visible_voxels(self) -> int:
        """Number of visible voxels."""
        return len(self.voxels)

    @property
    def visible_fraction(self) -> float:
        """Visible voxels as a fraction of all voxels."""
        nx, ny, nz = self.shape_xyz
        return self.visible_voxels / (nx * ny * nz)


def unit_length(volume, index_to_world) -> float:
    """World length of one of the volume's units; RleSplatError if a matrix flattens the volume.

    This is the cube root of the ratio of the two matrices' determinants. Scaling an object therefore thins the medium,
    and the picture of an evenly scaled volume keeps its opacity; under an uneven scale the geometric mean of the three
    axes counts.

    Parameters
    ----------
    volume : Volume
    index_to_world : (4, 4) ndarray of float64
    """
    return _unit_length(volume.affine.tobytes(), index_to_world.tobytes())


@lru_cache(maxsize=8)
def _unit_length(*matrices: bytes) -> float:
    """As ``unit_length``; kept for the latest matrices, which most frames have in common."""
    affine, index_to_world = (np.frombuffer(matrix).reshape(4, 4) for matrix in matrices)
    for matrix in (affine, index_to_world):
        singular = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        if not singular[2] > FLAT * singular[0]:
            raise RleSplatError(
                "The volume's matrix is flat; give it a scale and a spacing other than zero on every axis."
            )
    world, own = (abs(np.linalg.det(matrix[:3, :3])) for matrix in (index_to_world, affine))
    return float(np.cbrt(world / own))


def opacity_distance(volume, tf, length: float) -> float:
    """World length to which the opacities of a transfer function refer.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
        Its ``opacity_unit_distance``; if None, the smallest voxel spacing of the volume.
    length : float
        World length of one of the volume's units.
    """
    return max(length * float(tf.opacity_unit_distance or volume.spacing.min()), LEAST_DISTANCE)


def optical_depth(alpha) -> np.ndarray:
    """Optical depth of opacity ``alpha`` in [0, 1], float64: -log(1 - alpha). Alpha = 1 is capped at 24 ln 2."""
    return -np.log1p(-np.minimum(alpha, ALPHA_CAP))


def classify(volume, tf, index_to_world, *, threads: int = 0) -> ClassifiedVolume:
    """Find the voxels with an opacity above 0 and their optical properties.

    Parameters
    ----------
    volume : Volume
    tf : TransferFunction
    index_to_world : (4, 4) array_like
    threads : int
        0 for one per core.

    Returns
    -------
    ClassifiedVolume
        NaN voxels are transparent and counted; infinite voxels take the end values of the transfer function.
    """
    length = unit_length(volume, np.asarray(index_to_world, dtype=np.float64))
    shown = Visibility(volume, tf)
    blocks = drain(block_steps(volume, threads=threads))
    bits = drain(mark_steps(shown, blocks, threads=threads))
    voxels = gather_kept(volume, bits, count_kept(bits, threads=threads), blocks, threads=threads)
    return classify_voxels(shown, voxels, length, threads=threads)


def classify_voxels(shown: Visibility, voxels: VisibleVoxels, length: float, *, threads: int = 0) -> ClassifiedVolume:
    """Optical properties of visible voxels.

    Extinction is -log(1 - alpha) per opacity unit distance. A gradient opacity multiplies the extinction.

    Parameters
    ----------
    length : float
        World length of one of the volume's units.
    threads : int
        0 for one per core.
    """
    volume, tf = shown.volume, shown.tf
    distance = opacity_distance(volume, tf, length)
    voxels = replace(voxels, stored=voxels.stored.view(shown.pattern_type))
    if shown.by_table:
        properties = _properties_by_table(shown, distance)
    else:
        properties = _properties_by_points(shown, voxels.stored, distance, threads)
    if tf.gradient_opacity is None:
        return ClassifiedVolume(voxels, properties, shown.by_table, length, distance)
    # Voxels of equal value differ in their gradient, so every voxel gets its own row.
    properties = properties[voxels.stored] if shown.by_table else properties
    sizes = gradient_sizes(volume, voxels.row_start, voxels.column, threads=threads)
    factor = tf.gradient_opacity.factor(sizes)
    properties[:, EXTINCTION] *= factor
    properties[:, OPACITY] = -np.expm1(factor * np.log1p(-np.minimum(properties[:, OPACITY], np.float32(ALPHA_CAP))))
    return ClassifiedVolume(voxels, properties, False, length, distance)


def _properties_by_table(shown: Visibility, distance) -> np.ndarray:
    """(256 or 65536, 5) float32 optical properties by bit pattern of the stored value."""
    properties = np.zeros((len(shown.table), PROPERTIES), dtype=np.float32)
    seen = shown.table > 0
    values = shown.pattern_values[seen]
    alpha = np.asarray(shown.tf.alpha_at(values), dtype=np.float64)
    properties[seen, EXTINCTION], properties[seen, OPACITY] = optical_depth(alpha) / distance, alpha
    properties[seen, RED:] = shown.tf.color_at(values)
    return properties


def _properties_by_points(shown: Visibility, stored, distance, threads) -> np.ndarray:
    """(n, 5) float32 optical properties of ``stored`` values (n,)."""
    opacity, color = pieces(shown.tf.opacity), pieces(shown.tf.color)
    scaling = (float(shown.volume.slope), float(shown.volume.intercept))
    properties = np.empty((len(stored), PROPERTIES), dtype=np.float32)
    if compiled():
        with parallel_call(threads):
            passes.properties_by_points(
                stored, *scaling, opacity.values, opacity.heights, opacity.rates, color.values, color.heights,
                color.rates, ALPHA_CAP, distance, properties,
            )  # fmt: skip
        return properties
    alpha, properties[:, RED:] = reference.look_up(stored, *scaling, opacity, color)
    properties[:, EXTINCTION], properties[:, OPACITY] = optical_depth(alpha) / distance, alpha
    return properties
