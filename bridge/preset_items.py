"""The transfer function presets as enum items, and the transfer function of an item."""

from ..rle_splat.classify.default import default_transfer_function
from ..rle_splat.classify.presets import PRESETS, fit_preset

SUGGESTED = "AUTO"
IMPORT_ITEMS = [(SUGGESTED, "Suggested", "Choose from the values and the modality; the picture is never blank")] + [
    (row.name, row.label, row.description.capitalize()) for row in PRESETS.values()
]


def chosen_transfer(item: str, volume):
    """The transfer function of an enum item, in the values of a volume.

    Parameters
    ----------
    item : str
        Identifier in IMPORT_ITEMS.
    volume : Volume
        The volume.

    Returns
    -------
    transfer_function : TransferFunction
        The preset, fitted to the volume's values if it has another unit.
    reason : str
        Why it was chosen or how it was fitted, or "".
    """
    if item == SUGGESTED:
        return default_transfer_function(volume)
    return fit_preset(item, volume)
