"""Volumes on the grid of the first: labels of its voxels, further channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from reprlib import repr as short

import numpy as np

from .errors import RleSplatError


@dataclass(frozen=True, eq=False)
class Labels:
    """What each voxel of a volume belongs to.

    ``volume``: a Volume of whole numbers, the labels, on the same grid.  ``functions``: label -> its TransferFunction,
    or None where what has the label is hidden; other labels have the scene's own.  ``names``: label -> text, for
    people.
    """

    volume: object
    functions: dict = field(default_factory=dict)
    names: dict = field(default_factory=dict)

    def __post_init__(self):
        if self.volume.voxels.dtype.kind not in "iu":
            raise RleSplatError(
                f"Labels must be whole numbers, not {self.volume.voxels.dtype.name}; give the volume of the labels."
            )
        for label in (*self.functions, *self.names):
            if isinstance(label, bool) or not isinstance(label, (int, np.integer)):
                raise RleSplatError(f"A label must be a whole number, not {short(label)}.")


@dataclass(frozen=True, eq=False)
class Channel:
    """A further volume on the same grid, and the transfer function that it is added by."""

    volume: object
    transfer_function: object
