"""The transfer function presets as enum items, and the transfer function of an item."""

from ...rle_splat.classify.default import default_channel_function_steps, default_transfer_function_steps
from ...rle_splat.classify.presets import PRESETS, fit_preset_steps
from ...rle_splat.runtime.steps import announce, drain

SUGGESTED = "AUTO"
CHOOSING = "choosing a transfer function"
IMPORT_ITEMS = [(SUGGESTED, "Suggested", "Choose from the values and the modality; the picture is never blank")] + [
    (row.name, row.label, row.description[0].upper() + row.description[1:]) for row in PRESETS.values()
]


def chosen_transfer(item: str, volume):
    """``chosen_transfer_steps`` without the steps."""
    return drain(chosen_transfer_steps(item, volume))


def chosen_transfer_steps(item: str, volume, is_channel: bool = False):
    """Generator of Progress: the transfer function of an enum item, in the values of a volume.

    Parameters
    ----------
    item : str
        Identifier in IMPORT_ITEMS.
    is_channel : bool
        Whether it is added to the picture of another one.

    Returns
    -------
    transfer_function : TransferFunction
        The preset, fitted to the volume's values if it has another unit.
    reason : str
        Why it was chosen or how it was fitted, or "".
    """
    if item == SUGGESTED:
        suggest = default_channel_function_steps if is_channel else default_transfer_function_steps
        return (yield from announce(suggest(volume), 0.0, 1.0, CHOOSING))
    function, remark = yield from announce(fit_preset_steps(item, volume), 0.0, 1.0, CHOOSING)
    return function, remark or ""
