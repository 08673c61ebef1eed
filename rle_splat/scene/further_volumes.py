"""Further volumes on the grid of the scene's volume: labels and channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from reprlib import repr as short
from typing import TYPE_CHECKING

import numpy as np

from .errors import RleSplatError

if TYPE_CHECKING:
    from ..classify.transfer_function import TransferFunction
    from ..volume.volume import Volume

TOLERANCE = 0.05  # voxels; grids that differ by less anywhere are the same
CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.float64)


def move_corners(one, other) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a volume's grid as voxel indices of itself and of another volume.

    Parameters
    ----------
    one, other : Volume

    Returns
    -------
    own, others : (8, 3) ndarray of float64
        Indices (x, y, z) of ``one``'s corners in ``one``, and the same places in ``other``.
    """
    matrix = np.linalg.inv(other.affine) @ one.affine
    own = CORNERS * (np.array(one.shape_xyz) - 1.0)
    return own, own @ matrix[:3, :3].T + matrix[:3, 3]


def is_same_grid(one, other) -> bool:
    """Whether two volumes have voxels of the same places, in number and by their affines."""
    own, others = move_corners(one, other)
    return one.shape_xyz == other.shape_xyz and bool(np.abs(others - own).max() <= TOLERANCE)


@dataclass(frozen=True, eq=False)
class Labels:
    """Label of each voxel, and a transfer function per label.

    Parameters
    ----------
    volume : Volume
        Labels as integers, on the same grid as the scene's volume.
    functions : dict of int to TransferFunction or None
        Transfer function of a label; None hides the label. Labels without an entry use the scene's transfer function.
    names : dict of int to str
        Names of labels, for display.
    smooth : bool
        Whether edges are smooth; else an edge shows the steps of the voxels. Under the classification ``post`` a sample
        then belongs to the label whose smoothed indicator is largest there. Under ``pre`` voxels beside an edge are
        shared by the transfer functions on both sides.

    Raises
    ------
    RleSplatError
        If the voxels or a key are not integers.
    """

    volume: Volume
    functions: dict[int, TransferFunction | None] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)
    smooth: bool = True

    def __post_init__(self):
        if not hasattr(self.volume, "voxels"):
            raise RleSplatError(f"Labels need a Volume of whole numbers, not a {type(self.volume).__name__}.")
        if self.volume.voxels.dtype.kind not in "iu":
            raise RleSplatError(
                f"Labels must be whole numbers, not {self.volume.voxels.dtype.name}; give a volume of integers."
            )
        for label in (*self.functions, *self.names):
            if isinstance(label, bool) or not isinstance(label, (int, np.integer)):
                raise RleSplatError(f"A label must be a whole number, not {short(label)}.")


@dataclass(frozen=True, eq=False)
class Channel:
    """A further volume on the same grid, rendered together with the first one.

    Parameters
    ----------
    volume : Volume
        On the same grid as the scene's volume.
    transfer_function : TransferFunction
        Transfer function of this volume.
    """

    volume: Volume
    transfer_function: TransferFunction
