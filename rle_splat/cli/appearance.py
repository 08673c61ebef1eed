"""The transfer function from the options, and the reason for it."""

from __future__ import annotations

from ..classify.default import default_transfer_function
from ..classify.presets import fit_preset, preset
from ..classify.transfer_function import TransferFunction


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
