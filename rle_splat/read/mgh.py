"""MGH and MGZ, the volumes of FreeSurfer: a header of fixed fields, big-endian, then the voxels."""

import math
import struct
from pathlib import Path

import numpy as np

from ..runtime.steps import Progress
from ..scene import RleSplatError
from ..volume.orientation import lps_from_ras
from ..volume.volume import PATIENT, Volume
from .format import Head, head_of
from .header import check_affine, check_frame, check_grid, damage_error, frame_remark, sensible_spacing
from .streaming import Part, plain_name, voxel_steps

# Version, three sizes, frames, type, degrees of freedom, whether directions are given; spacing, directions, center.
FIELDS = struct.Struct(">7ih15f")
DATA_OFFSET = 284  # bytes
VERSION = 1
TYPES = {0: ">u1", 1: ">i4", 3: ">f4", 4: ">i2", 10: ">u2"}


def recognizes_mgh(head: Head) -> bool:
    """Whether a file begins with a plausible MGH header."""
    if len(head.content) < FIELDS.size:
        return False
    version, *sizes, kind, _, given = FIELDS.unpack_from(head.content)[:8]
    return version == VERSION and kind in TYPES and given in (0, 1) and all(0 < n < 1 << 16 for n in sizes)


def read_mgh_steps(path: str | Path, frame=None):
    """Generator of Progress: read an MGH or MGZ file; return the Volume.

    The header gives the place of voxel (nx/2, ny/2, nz/2), the center, in RAS (FreeSurfer's description of the format).

    Parameters
    ----------
    frame : int or None
        The volume of a file with several frames, from 1; None for the first.

    Returns
    -------
    Volume
        In patient space if the header gives directions.

    Raises
    ------
    RleSplatError
        If the file is damaged, cut short, or of another kind.
    """
    path = Path(path)
    yield Progress(0.0, f"reading {path.name}")
    head = head_of(path)
    if len(head.content) < FIELDS.size:
        raise RleSplatError(f"{path.name} is not an MGH file, or its header is cut short; copy it again.")
    version, nx, ny, nz, frames, kind, _, given, *numbers = FIELDS.unpack_from(head.content)
    if version != VERSION or kind not in TYPES or not 1 <= frames <= 1 << 20:
        raise damage_error(path, f"it says version {version}, type {kind} and {frames} frames")
    shape = check_grid(path, (nx, ny, nz))
    frame = check_frame(path, frame, frames)
    dtype = np.dtype(TYPES[kind])
    if given == 1:
        axes = np.array(numbers[3:12]).reshape(3, 3).T * numbers[:3]
        affine = np.eye(4)
        affine[:3, :3] = axes
        affine[:3, 3] = np.array(numbers[12:15]) - axes @ (0.5 * np.array(shape))
        affine, space, remarks = lps_from_ras(check_affine(path, affine)), PATIENT, ()
    else:
        spacing, remarks = sensible_spacing(numbers[:3])
        affine, space = np.diag((*spacing, 1.0)), None
        remarks += ("The file does not say how it lies in the patient, so left and right are not known.",)
    part = Part(path, packing="gzip" if head.is_gzip else None, skip=DATA_OFFSET)
    begin = (frame - 1) * math.prod(shape) * dtype.itemsize
    voxels = yield from voxel_steps(path, shape, dtype, [part], begin)
    return Volume(
        voxels=voxels, affine=affine, name=plain_name(path), space=space, frames=frames,
        remarks=remarks + frame_remark(frame, frames),
    )  # fmt: skip
