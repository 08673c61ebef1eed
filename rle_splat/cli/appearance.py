"""The transfer function from the options, with the reason for it."""

from __future__ import annotations

from ..classify.default import default_transfer_function
from ..classify.presets import fit_preset, preset
from ..classify.transfer_function import TransferFunction


def read_transfer_function(args):
    """Read and check the options that need no volume.

    Parameters
    ----------
    args : argparse.Namespace
        With ``transfer_function`` and ``preset``.

    Returns
    -------
    TransferFunction or None
        The transfer function of a file; None without one.

    Raises
    ------
    RleSplatError
        For a bad file, or an unknown preset.
    """
    if args.transfer_function is not None:
        return TransferFunction.from_json(args.transfer_function)
    if args.preset is not None:
        preset(args.preset)
    return None


def choose_transfer_function(args, volume, given):
    """Choose the transfer function of a volume.

    Parameters
    ----------
    args : argparse.Namespace
        With ``transfer_function`` and ``preset``.
    volume : Volume
        The volume.
    given : TransferFunction or None
        The result of ``read_transfer_function``.

    Returns
    -------
    transfer_function : TransferFunction
        In the values of the volume.
    reason : str
        Why it was chosen, for the report.
    """
    if given is not None:
        return given, f"read from {args.transfer_function}"
    if args.preset is not None:
        function, remark = fit_preset(args.preset, volume)
        return function, remark or f"the preset {args.preset}"
    return default_transfer_function(volume)
