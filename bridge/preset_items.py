"""The presets as the items of an enum, and the transfer function that an item stands for."""

from ..rle_splat.classify.default import default_transfer_function
from ..rle_splat.classify.presets import PRESETS, fit_preset

SUGGESTED = "AUTO"
IMPORT_ITEMS = [(SUGGESTED, "Suggested", "Chosen from the values and the modality, never blank")] + [
    (row.name, row.label, row.description.capitalize()) for row in PRESETS.values()
]


def chosen_transfer(item: str, volume):
    """(TransferFunction in the volume's values, sentence on why or how it was fitted, may be "")."""
    if item == SUGGESTED:
        return default_transfer_function(volume)
    return fit_preset(item, volume)
