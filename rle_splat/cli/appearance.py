"""The transfer function from the options, with the reason for it."""

from dataclasses import replace

import numpy as np

from ..classify.default import default_transfer_function
from ..classify.presets import fit_preset, preset
from ..classify.transfer_files import choose_function, fit_function, read_transfer_functions
from ..scene import RleSplatError

NAMING = "--transfer-name"


def read_transfer_function(args):
    """Read and check the options that need no volume.

    Parameters
    ----------
    args : argparse.Namespace
        With ``transfer_function``, ``transfer_name`` and ``preset``.

    Returns
    -------
    Found or None
        The transfer function of a file; None without one.

    Raises
    ------
    RleSplatError
        For a bad file, a name that is not in it, or an unknown preset.
    """
    if args.transfer_function is not None:
        found = read_transfer_functions(args.transfer_function)
        return choose_function(found, args.transfer_name, args.transfer_function, NAMING)
    if args.transfer_name is not None:
        raise RleSplatError(f"{NAMING} needs --transfer-function; give both.")
    if args.preset is not None:
        preset(args.preset)
    return None


def choose_transfer_function(args, volume, given):
    """Choose the transfer function of a volume.

    Parameters
    ----------
    args : argparse.Namespace
        With ``transfer_function``, ``transfer_name``, ``preset`` and, where there is one, ``smoothness``.
    given : Found or None
        The result of ``read_transfer_function``.

    Returns
    -------
    transfer_function : TransferFunction
        In the values of the volume.
    reason : str
        Why it was chosen, for the report.
    """
    function, reason = _choose(args, volume, given)
    function = set_smoothness(function, getattr(args, "smoothness", None))
    if volume.levels and function.opacity_unit_distance is None:  # or a coarser level would be less dense
        finer = np.array(volume.shape_xyz) / volume.levels[0]
        function = replace(function, opacity_unit_distance=float((volume.spacing * finer).min()))
    return function, reason


def set_smoothness(function, smoothness: float | None):
    """The transfer function with the smoothness of its surfaces in mm; None for its own."""
    if smoothness is None:
        return function
    if function.shade is None:
        raise RleSplatError("--smoothness has no effect on a transfer function without shading; remove it.")
    return replace(function, shade=replace(function.shade, smoothness=smoothness))


def _choose(args, volume, given):
    """``choose_transfer_function`` for the level that the volume is."""
    if given is not None:
        return fit_function(given.function, volume), " ".join((f"read from {args.transfer_function}", *given.remarks))
    if args.preset is not None:
        function, remark = fit_preset(args.preset, volume)
        return function, remark or f"the preset {args.preset}"
    return default_transfer_function(volume)
