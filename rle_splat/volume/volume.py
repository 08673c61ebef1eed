"""The volume: a grid of stored scalars, where it lies, and what its numbers mean."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..scene import RleSplatError, as_matrix

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
        low, high = np.inf, -np.inf
        for stored in self.voxels:  # slice by slice: no second copy of a large volume
            if stored.dtype.kind == "f":
                stored = stored[np.isfinite(stored)]
                if stored.size == 0:
                    continue
            low, high = min(low, stored.min()), max(high, stored.max())
        if low > high:
            return 0.0, 0.0
        ends = sorted((float(low) * self.slope + self.intercept, float(high) * self.slope + self.intercept))
        return ends[0], ends[1]

    @cached_property
    def key(self) -> str:
        """A hash of the voxels and of everything that gives them meaning, for content-keyed stages."""
        digest = hashlib.blake2b(digest_size=16)
        digest.update(repr((self.voxels.shape, self.voxels.dtype.str, self.slope, self.intercept)).encode())
        digest.update(self.affine.tobytes())
        for plane in self.voxels:
            digest.update(plane)
        return digest.hexdigest()

    def physical(self, stored) -> np.ndarray:
        """Stored values to physical values, float64."""
        return np.asarray(stored, dtype=np.float64) * self.slope + self.intercept
