"""The transfer function from the options, and the reason for it."""

from __future__ import annotations

import numpy as np

from ..classify.default import default_transfer_function
from ..classify.presets import fit_preset, preset
from ..classify.transfer_function import TransferFunction
from ..scene import RleSplatError


def read_transfer_function(args):
    """What can be refused before the volume is read: the function of a file, or None; a preset's name is checked."""
    if args.transfer_function is not None:
        return TransferFunction.from_json(args.transfer_function)
    if args.preset is not None:
        preset(args.preset)
    return None


def choose_transfer_function(args, volume, given):
    """(TransferFunction in the volume's values, one sentence that says why this one)."""
    if given is not None:
        return given, f"read from {args.transfer_function}"
    if args.preset is not None:
        function, remark = fit_preset(args.preset, volume)
        return function, remark or f"the preset {args.preset}"
    return default_transfer_function(volume)


def check_values(volume) -> None:
    """Refuse a volume in which no voxel holds a number: whatever the transfer function, nothing could be seen."""
    if volume.voxels.dtype.kind == "f" and not any(np.isfinite(plane).any() for plane in volume.voxels):
        raise RleSplatError(
            "No voxel of the volume holds a finite number, all are NaN or infinite; check --dtype and --byte-order."
        )
