"""Checks of what a file's header says, before any voxel is read; shared by the readers of medical formats."""

import operator
from importlib import import_module
from pathlib import Path

import numpy as np

from ..scene import RleSplatError
from ..volume.volume import STORED_TYPES
from .layout import EDGE_LIMIT

LEAST_DETERMINANT = 1e-6  # of the unit vectors of the voxel axes; below, the axes lie in a plane
LARGEST_LENGTH = 1e9  # of a coordinate or a spacing; beyond, a header is damaged
CONVERTED_TYPES = ("int64", "uint64", "float16", "bool")  # streaming.storable_steps makes stored types of them
MILLIMETERS = {
    "mm": 1.0, "millimeter": 1.0, "millimeters": 1.0, "m": 1e3, "meter": 1e3, "meters": 1e3, "cm": 10.0,
    "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "micron": 1e-3, "microns": 1e-3, "micrometer": 1e-3, "nm": 1e-6,
}  # fmt: skip
MM_ASSUMED = "The file states no unit of length; mm is assumed."  # a remark
CT_ASSUMED = "Taken as a CT in HU."  # a remark


def library(name: str, package: str, formats: str):
    """Import a module that reads a format; RleSplatError if this Python lacks it.

    ``package``: its name in the package index. ``formats``: what needs it, as the subject of a sentence.
    """
    try:
        return import_module(name)
    except ImportError:
        raise lacking(package, formats) from None


def lacking(package: str, formats: str) -> RleSplatError:
    """The error for a Python without a package; parameters as of ``library``."""
    return RleSplatError(
        f"{formats} files need the package {package}, which this Python lacks; install it, or use the extension in "
        "Blender, which includes it."
    )


def damage_error(path, what: str) -> RleSplatError:
    """The error for a header that says something impossible; ``what``: a clause, such as "it says 0 x 3 voxels"."""
    return RleSplatError(f"The header of {Path(path).name} is damaged: {what}; copy or export it again.")


def check_grid(path, shape) -> tuple:
    """Check a shape (nx, ny, nz) in a header; return it as ints. A single picture is refused."""
    try:
        shape = tuple(operator.index(n) for n in shape)
    except TypeError:
        raise damage_error(path, "its numbers of voxels are not whole") from None
    text = " x ".join(map(str, shape))
    if len(shape) != 3 or not all(1 <= n <= EDGE_LIMIT for n in shape):
        raise damage_error(path, f"it says {text} voxels")
    if sum(n > 1 for n in shape) < 3:
        raise RleSplatError(
            f"{Path(path).name} is a single picture ({text} voxels); a volume needs at least two slices."
        )
    return shape


def check_frame(path, frame: int | None, frames: int) -> int:
    """Check the number of a frame, from 1; None is the first."""
    if frame is None:
        return 1
    if not 1 <= frame <= frames:
        there = "one volume only" if frames == 1 else f"{frames} volumes; choose one from 1 to {frames}"
        raise RleSplatError(f"There is no volume {frame}: {Path(path).name} has {there}.")
    return int(frame)


def put_time_first(axes) -> list:
    """The further axes of a file in the order of ``place_of_frame``, whatever order they have in the file."""
    return sorted(axes, key=lambda axis: axis.lower() != "t")


def place_of_frame(frame: int, lengths: dict) -> dict:
    """Index along each further axis of a file, such as time and channel, of a frame.

    Parameters
    ----------
    frame : int
        From 1. The last axis is counted first: frame 2 is the second channel of the first time.
    lengths : dict of str to int
        Axis -> its length, in the order of ``put_time_first``.
    """
    return dict(zip(lengths, map(int, np.unravel_index(frame - 1, tuple(lengths.values())))))


def frame_remark(frame: int, frames: int, axis: str = "time") -> tuple:
    """The remark on a source of several frames; ``axis``: what they differ in."""
    if frames == 1:
        return ()
    if axis == "time":
        return (f"There are {frames} time points; time point {frame} was read.",)
    axis += "" if "time" in axis.split(" and ") else ", not in time"
    return (f"There are {frames} volumes that differ in {axis}; number {frame} was read.",)


def check_affine(path, affine) -> np.ndarray:
    """Check an affine in a header: finite, of sensible size, and invertible; return it as (4, 4) float64."""
    affine = np.asarray(affine, dtype=np.float64)
    if not np.isfinite(affine).all() or np.abs(affine).max() > LARGEST_LENGTH:
        raise damage_error(path, "its directions or spacings are not sensible numbers")
    lengths = np.linalg.norm(affine[:3, :3], axis=0)
    if not (lengths > 0.0).all() or abs(np.linalg.det(affine[:3, :3] / lengths)) < LEAST_DETERMINANT:
        raise RleSplatError(
            f"The directions in the header of {Path(path).name} are singular (two voxel axes coincide, or one has no "
            "length), so it has no shape in space; correct the header."
        )
    return affine


def check_kind(path, dtype: np.dtype) -> np.dtype:
    """Check the number type of a voxel; complex numbers, colors and types of 128 bits are refused."""
    if dtype.newbyteorder("=").name in (*STORED_TYPES, *CONVERTED_TYPES):
        return dtype
    if dtype.kind == "c":
        what, remedy = "complex numbers", "export their magnitude"
    elif dtype.names:
        what, remedy = "colors", "export one number for each voxel"
    elif dtype.itemsize > 8 or dtype.kind == "V":  # a void is nibabel's for what numpy lacks
        what, remedy = "numbers of 128 bits", "export it as float32"
    else:
        what, remedy = f"numbers of type {dtype.name}", "export it as float32"
    raise RleSplatError(f"The voxels of {Path(path).name} are {what}, which cannot be read; {remedy}.")


def sensible_spacing(spacing) -> tuple[tuple, tuple]:
    """Replace spacings that are not positive numbers by 1.

    Parameters
    ----------
    spacing : sequence of float

    Returns
    -------
    spacing : tuple of float
    remarks : tuple of str
        A sentence if one was replaced.
    """
    spacing = tuple(abs(float(s)) for s in spacing)
    good = tuple(s if np.isfinite(s) and 0.0 < s < LARGEST_LENGTH else 1.0 for s in spacing)
    return good, () if good == spacing else ("The file states no spacing for some axes; 1 is assumed.",)
