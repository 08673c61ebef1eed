"""What labels look like, from how people say it: hidden, in a colour, by a preset, or by a transfer function."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..scene import Labels, RleSplatError, as_float, from_mapping, read_json
from .presets import fit_preset, preset
from .transfer_function import TransferFunction


@dataclass(frozen=True)
class LabelLook:
    """One label: its ``name``; whether it is ``hidden``; else its ``color``, linear RGB in place of the transfer
    function's own colours, and its ``transfer_function``, or the ``preset`` that is fitted to the volume, in place of
    the volume's."""

    label: int
    name: str = ""
    hidden: bool = False
    color: tuple | None = None
    preset: str | None = None
    transfer_function: TransferFunction | None = None

    def __post_init__(self):
        what = f"Label {self.label!r}"
        if isinstance(self.label, bool) or not isinstance(self.label, int):
            raise RleSplatError(f"A label must be a whole number, not {self.label!r}.")
        if not (isinstance(self.name, str) and isinstance(self.hidden, bool)):
            raise RleSplatError(f"{what} needs a text for its name, and true or false for hidden.")
        if self.color is not None:
            color = tuple(map(as_float, self.color)) if isinstance(self.color, (list, tuple)) else ()
            if len(color) != 3 or not all(0.0 <= c < float("inf") for c in color):
                raise RleSplatError(f"{what} needs three finite numbers for its color, none below zero.")
            object.__setattr__(self, "color", color)
        if self.preset is not None and self.transfer_function is not None:
            raise RleSplatError(f"{what} has a preset and a transfer function; give one of the two.")
        if self.preset is not None:
            preset(self.preset)
        if isinstance(self.transfer_function, dict):
            object.__setattr__(self, "transfer_function", TransferFunction.from_json(self.transfer_function))

    def function(self, volume, own: TransferFunction) -> TransferFunction | None:
        """The transfer function of the label on ``volume``, whose own is ``own``; None if it is hidden."""
        if self.hidden:
            return None
        found = self.transfer_function or own
        if self.preset is not None:
            found = fit_preset(self.preset, volume)[0]
        return found if self.color is None else replace(found, color=((0.0, *self.color),))


def read_label_looks(path) -> tuple[LabelLook, ...]:
    """The list of labels in a JSON file, each an object with the fields of LabelLook."""
    entries = read_json(path, "the label file")
    if not isinstance(entries, list):
        raise RleSplatError(f"The label file {path} must hold a list of labels.")
    found = tuple(from_mapping(LabelLook, entry, "A label of the label file") for entry in entries)
    if len({look.label for look in found}) < len(found):
        raise RleSplatError(f"The label file {path} has a label twice; give each once.")
    return found


def labels_of(label_volume, looks, volume, own: TransferFunction) -> Labels:
    """The Labels of a scene from the looks of some; a label that is only named looks as the volume does."""
    changed = {look.label: look.function(volume, own) for look in looks}
    functions = {label: function for label, function in changed.items() if function is None or function.key != own.key}
    return Labels(label_volume, functions, {look.label: look.name for look in looks if look.name})
