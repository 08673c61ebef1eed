"""The volume: a grid of stored scalars, its position in space and the meaning of its values."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.steps import drain
from ..scene import RleSplatError, as_matrix
from .counts import count_steps, counts_values, list_stored_values

# Larger physical values count as infinite and are clamped; a quarter of the largest float64 keeps differences finite.
LARGEST_VALUE = float(np.finfo(np.float64).max) / 4.0
PATIENT = "patient"  # space of a volume whose own space is LPS: +x patient's left, +y back, +z head
STORED_TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")


@dataclass(frozen=True)
class NamedLabel:
    """What a label file says about one label.

    Attributes
    ----------
    label : int
        Value of the label's voxels.
    name : str
        Such as "Liver".
    color : (3,) tuple of float or None
        Scene-linear RGB.
    """

    label: int
    name: str
    color: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Volume:
    """A scalar volume.

    Parameters
    ----------
    voxels : (nz, ny, nx) ndarray
        x is contiguous. Integers of 8, 16 or 32 bits, float32 or float64, in native byte order; may be memory-mapped.
    affine : (4, 4) array_like
        Voxel index (x, y, z, 1) to the volume's own space, in ``unit``.
    unit : str
        Unit of length of the volume's own space.
    slope, intercept : float
        A physical value is ``slope * stored + intercept``.
    value_unit : str or None
        Unit of physical values, "HU" for CT, "SUVbw" or "Bq/ml" for PET, "Gy" for a dose; None for arbitrary units.
    modality : str or None
        "CT", "MR", "PT", "RTDOSE", "XA", "SMOKE" or None.
    background : float
        Stored value outside the grid.
    name : str
        For messages, captions and ``default_transfer_function``, such as the name of the file.
    remarks : tuple of str
        Sentences about anything unusual in the data.
    space : {"patient"} or None
        "patient" if the volume's own space is that of a patient: millimeters along the patient's left, back and head
        (LPS), which are the world's axes. None if the file does not say where the axes point: pictures then follow the
        voxel axes, and left and right may be swapped.
    frames : int
        How many volumes the source holds; this one is one of them.
    frame_axis : str
        What the volumes of the source differ in: "time", or another word for the reader, such as "echo time".
    color : (3,) tuple of float or None
        Scene-linear RGB in which the file, or a convention, shows this channel of several.
    named_labels : tuple of NamedLabel
        Names and colors of the labels of a label map; empty for other volumes.

    Attributes
    ----------
    series : str
        Hash of the identifier of the DICOM series that it was read from, by which the series is found again; "" for
        other volumes. This and the following are set by ``read_volume``.
    place_key : str
        Hash of the identifier of the DICOM frame of reference, which volumes and contours of one place share; "" for
        other volumes.
    levels : tuple of (nx, ny, nz)
        Shape of each level of the pyramid that this is one level of, the finest first; empty for other volumes.
    data_files : tuple of Path
        The files of the voxels beside a header that names them; empty for other volumes.

    Raises
    ------
    RleSplatError
        If the array is not three-dimensional, its type is not supported, or the mapping is not finite.
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
    remarks: tuple[str, ...] = ()
    space: str | None = None
    frames: int = 1
    frame_axis: str = "time"
    color: tuple[float, float, float] | None = None
    named_labels: tuple[NamedLabel, ...] = ()
    series: str = ""
    place_key: str = ""
    levels: tuple[tuple[int, int, int], ...] = ()
    data_files: tuple[Path, ...] = ()
    # value_range, value_counts and voxel_key by name, each of which reads all voxels once
    measured: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    holds_values: ClassVar[bool] = True  # values, not voxels that are classified already

    def __post_init__(self):
        if not isinstance(self.voxels, np.ndarray):
            raise RleSplatError(
                f"Voxels must be a numpy array, not a {type(self.voxels).__name__}; convert them by numpy.asarray."
            )
        if self.voxels.ndim != 3 or 0 in self.voxels.shape:
            raise RleSplatError(
                f"A volume must have three dimensions of at least one voxel each, not {tuple(self.voxels.shape)}."
            )
        if self.voxels.dtype.name not in STORED_TYPES or not self.voxels.dtype.isnative:
            raise RleSplatError(
                f"Voxels of type {self.voxels.dtype} are not supported; use one of {', '.join(STORED_TYPES)}."
            )
        if not self.voxels.flags.c_contiguous:
            object.__setattr__(self, "voxels", np.ascontiguousarray(self.voxels))
        object.__setattr__(self, "affine", as_matrix(self.affine, "The volume's affine"))
        if self.space not in (None, PATIENT):
            raise RleSplatError(f"The space of a volume must be {PATIENT!r} or None, not {self.space!r}.")
        if not (np.isfinite(self.slope) and np.isfinite(self.intercept) and self.slope != 0.0):
            raise RleSplatError(
                f"The volume's slope must be finite and not zero, and its intercept finite, not {self.slope!r} and "
                f"{self.intercept!r}."
            )

    def __repr__(self) -> str:
        voxels, lengths = " x ".join(map(str, self.shape_xyz)), " x ".join(f"{n:.4g}" for n in self.spacing)
        facts = f"{self.modality or ''} {self.name!r}, {voxels} {self.voxels.dtype}, {lengths} {self.unit}".strip()
        return f"<Volume {facts}{f', {self.value_unit}' if self.value_unit else ''}>"

    @property
    def shape_xyz(self) -> tuple[int, int, int]:
        """Number of voxels along x, y, z."""
        nz, ny, nx = self.voxels.shape
        return nx, ny, nz

    @property
    def spacing(self) -> np.ndarray:
        """(3,) float64: distance between the centers of neighboring voxels along x, y, z, in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest finite physical value; (0, 0) if no voxel is finite."""
        return self._measure("value_range", lambda: drain(range_steps(self)))

    def _range(self, low, high) -> tuple[float, float]:
        """Physical (smallest, largest) of a stored range; a negative slope swaps the ends."""
        ends = sorted((float(low) * self.slope + self.intercept, float(high) * self.slope + self.intercept))
        return max(ends[0], -LARGEST_VALUE), min(ends[1], LARGEST_VALUE)

    @property
    def value_counts(self) -> np.ndarray:
        """How often each stored value of an 8- or 16-bit volume occurs, ascending; (256,) or (65536,) int64."""
        return self._measure("value_counts", lambda: drain(count_steps(self.voxels)))

    @property
    def voxel_key(self) -> str:
        """Hash of the stored voxels, their type and shape. The first use reads the whole volume."""
        return self._measure("voxel_key", lambda: drain(key_steps(self)))

    @cached_property
    def key(self) -> str:
        """Hash of the voxels, slope, intercept and affine; cached stages use it as their key."""
        meaning = repr((self.voxel_key, self.slope, self.intercept)).encode() + self.affine.tobytes()
        return hashlib.blake2b(meaning, digest_size=16).hexdigest()

    def _measure(self, name: str, make: Callable):
        """What is known by the name; else ``make()``, which is known from now on."""
        if name not in self.measured:
            self.measured[name] = make()
        return self.measured[name]

    def physical(self, stored: ArrayLike) -> np.ndarray:
        """Convert stored values to physical values, float64."""
        return np.asarray(stored, dtype=np.float64) * self.slope + self.intercept


def range_steps(volume: Volume):
    """Generator of fractions done: ``Volume.value_range``."""
    if counts_values(volume.voxels.dtype):
        seen = list_stored_values(volume.voxels.dtype)[volume.value_counts > 0]
        return volume._range(seen[0], seen[-1])
    low, high = np.inf, -np.inf
    for z, stored in enumerate(volume.voxels):  # slice by slice, so that a large volume is not copied
        yield z / len(volume.voxels)
        if stored.dtype.kind == "f":
            stored = stored[np.isfinite(stored)]
            if stored.size == 0:
                continue
        low, high = min(low, stored.min()), max(high, stored.max())
    return (0.0, 0.0) if low > high else volume._range(low, high)


def key_steps(volume: Volume):
    """Generator of fractions done: ``Volume.voxel_key``, which takes no time from then on."""
    if "voxel_key" in volume.measured:
        return volume.voxel_key
    digest = hashlib.blake2b(f"{volume.voxels.dtype.str}{volume.voxels.shape}".encode(), digest_size=16)
    for z, plane in enumerate(volume.voxels):
        digest.update(plane)
        yield (z + 1) / len(volume.voxels)
    return volume.measured.setdefault("voxel_key", digest.hexdigest())
