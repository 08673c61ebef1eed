"""The presets that a volume is offered: ours for its modality first, then the user's own, then the others.

The name of a file that states no modality suggests one, as the import chooses a preset by it.
"""

from dataclasses import dataclass

from ...rle_splat.classify.default import modality_of_name
from ...rle_splat.classify.presets import PRESETS
from ...rle_splat.volume.volume import PATIENT
from ..translations import filled
from . import own_presets, preset_items

MODALITY = "Modality: "  # line of a volume's facts
NAMES = {"CT": "CT", "MR": "MR", "XA": "C-Arm", "PT": "PET", "RTDOSE": "Dose", "SMOKE": "Smoke"}
OWN = "OWN"
OF_THINGS = ("ct-botanical", "ct-industrial")


@dataclass(frozen=True)
class Entry:
    """A preset that can be applied.

    Attributes
    ----------
    name : str
        Of ``apply_preset``, or of a preset of the user.
    label, description : str
        Texts for display.
    stamp : tuple or None
        Changes with the content of a preset of the user; None for ours.
    """

    name: str
    label: str
    description: str
    stamp: tuple | None = None

    @property
    def is_own(self) -> bool:
        """Whether it is the user's."""
        return self.stamp is not None

    def is_of(self, properties) -> bool:
        """Whether a volume's transfer function has its name; ``properties``: ``object.rle_splat``."""
        row = None if self.is_own else PRESETS.get(self.name)
        return properties.transfer_name.casefold() == (row.label if row else self.label).casefold()


@dataclass(frozen=True)
class PresetGroup:
    """Entries under one heading; ``is_open``: whether they are shown at first."""

    name: str
    label: str
    entries: tuple[Entry, ...]
    is_open: bool


def modality_of(properties) -> str | None:
    """The modality of a volume, a key of NAMES; None if it is not known."""
    if properties.value_unit == "HU":
        return "CT"
    line = next((line for line in properties.facts.splitlines() if line.startswith(MODALITY)), MODALITY)
    return line.removeprefix(MODALITY) or None


def is_offered(name: str, properties) -> bool:
    """Whether a volume is offered a preset of ours: a patient none of plants and machines."""
    return name not in OF_THINGS or properties.space != PATIENT


def groups(properties) -> list[PresetGroup]:
    """The groups of a volume, those that suit it first; none of them is empty.

    It reads only properties, so a panel may call it at every redraw.
    """
    modality = modality_of(properties) or modality_of_name(properties.facts.partition("\n")[0])
    kind = NAMES.get(modality, modality)
    suggested, *items = preset_items.IMPORT_ITEMS
    suits, others = [Entry(*suggested)], []
    for name, label, description in items:
        if not is_offered(name, properties):
            continue
        if PRESETS[name].modality in (modality, None):
            suits.append(Entry(name, label.removeprefix(f"{kind} "), description))  # the heading says it
        else:
            others.append(Entry(name, label, description))
    own = [Entry(one.name, one.name, "User preset", one.stamp) for one in own_presets.listed()]
    found = [
        PresetGroup("SUITS", filled("For {kind}", kind=kind) if kind else filled("For Any Scan"), tuple(suits), True),
        PresetGroup(OWN, filled("Own"), tuple(own), True),
        PresetGroup("OTHERS", filled("Others"), tuple(others), False),
    ]
    return [group for group in found if group.entries]


def transfer_steps(entry: Entry, volume):
    """Generator of Progress: the transfer function of an entry and why, as ``preset_items.chosen_transfer_steps``."""
    if entry.is_own:
        return (yield from own_presets.transfer_steps(entry.name, volume))
    return (yield from preset_items.chosen_transfer_steps(entry.name, volume))
