"""The volume: a grid of stored scalars, where it lies, and what its numbers mean."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..scene import RleSplatError, as_matrix
from .counts import count_values, counts_values, stored_values

# Physical values beyond stand for infinity, and are taken as this; a quarter, so that differences are finite.
LARGEST_VALUE = float(np.finfo(np.float64).max) / 4.0
STORED_TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")


@dataclass(frozen=True, eq=False)
class Volume:
    """A scalar volume.

    ``voxels``: (nz, ny, nx), x fastest, one of STORED_TYPES in native byte order; may be memory-mapped.
    ``affine``: (4, 4) float64, voxel index (x, y, z, 1) to the volume's own space in ``unit``.
    A physical value is ``slope * stored + intercept``, in ``value_unit`` ("HU" or None for arbitrary).
    ``modality`` is "CT", "MR", "XA", "SMOKE" or None.  ``background`` is the stored value outside the grid.
    ``remarks`` are sentences on what is odd about the data.
    """

    voxels: np.ndarray
    affine: np.ndarray
    unit: str = "mm"
    slope: float = 1.0
    intercept: float = 0.0
    value_unit: str | None = None
    modality: str | None = None
    background: float = 0.0
    name: str = ""
    remarks: tuple = field(default=())

    def __post_init__(self):
        if self.voxels.ndim != 3 or 0 in self.voxels.shape:
            raise RleSplatError(
                f"A volume needs three dimensions of at least one voxel each, not {tuple(self.voxels.shape)}."
            )
        if self.voxels.dtype.name not in STORED_TYPES or not self.voxels.dtype.isnative:
            raise RleSplatError(
                f"Voxels of type {self.voxels.dtype} are not supported; use one of {', '.join(STORED_TYPES)}."
            )
        if not self.voxels.flags.c_contiguous:
            object.__setattr__(self, "voxels", np.ascontiguousarray(self.voxels))
        object.__setattr__(self, "affine", as_matrix(self.affine, "The volume's affine"))
        if not (np.isfinite(self.slope) and np.isfinite(self.intercept) and self.slope != 0.0):
            raise RleSplatError("The volume's slope must be finite and not zero, and its intercept finite.")

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        nz, ny, nx = self.voxels.shape
        return nx, ny, nz

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: distance between neighbouring voxel centres along x, y, z, in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @cached_property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest finite physical value; (0, 0) when no voxel is finite."""
        if counts_values(self.voxels.dtype):
            seen = stored_values(self.voxels.dtype)[self.value_counts > 0]
            return self._range(seen[0], seen[-1])
        low, high = np.inf, -np.inf
        for stored in self.voxels:  # slice by slice: no second copy of a large volume
            if stored.dtype.kind == "f":
                stored = stored[np.isfinite(stored)]
                if stored.size == 0:
                    continue
            low, high = min(low, stored.min()), max(high, stored.max())
        if low > high:
            return 0.0, 0.0
        return self._range(low, high)

    def _range(self, low, high) -> tuple[float, float]:
        ends = sorted((float(low) * self.slope + self.intercept, float(high) * self.slope + self.intercept))
        return max(ends[0], -LARGEST_VALUE), min(ends[1], LARGEST_VALUE)

    @cached_property
    def value_counts(self) -> np.ndarray:
        """(256 or 65536,) int64: how often each stored value of an 8- or 16-bit volume occurs, ascending."""
        return count_values(self.voxels)

    @cached_property
    def voxel_key(self) -> str:
        """A hash of the stored voxels and their arrangement, whatever they mean.  Reads the whole volume, once."""
        digest = hashlib.blake2b(f"{self.voxels.dtype.str}{self.voxels.shape}".encode(), digest_size=16)
        for plane in self.voxels:
            digest.update(plane)
        return digest.hexdigest()

    @cached_property
    def key(self) -> str:
        """A hash of the voxels and of everything that gives them meaning, for content-keyed stages."""
        meaning = repr((self.voxel_key, self.slope, self.intercept)).encode() + self.affine.tobytes()
        return hashlib.blake2b(meaning, digest_size=16).hexdigest()

    def physical(self, stored) -> np.ndarray:
        """Stored values to physical values, float64."""
        return np.asarray(stored, dtype=np.float64) * self.slope + self.intercept
