"""Translations of the interface, in Blender's own way: one JSON file for each language, English text -> translation.

A sentence with a name or a number in it is a template with fields in braces: ``filled`` puts them into its translation.
The renderer knows nothing of languages.  Its sentences that users meet most are found again by ``translate``.
"""

import json
import re
from functools import cache
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface

from ..paths import EXTENSION

FOLDER = Path(__file__).parent
# Blender's own translations come first: a word that means something else in them, such as Level, is given this context.
OURS = "RLE Splat"
# Sentences that the renderer composes, and what may stand in their fields REASONS; the first one that fits counts.
COMPOSED = (
    "Preset {name}: {reason}.",
    "the modality is {modality} and the name of the volume contains {word}",
    "the modality of the volume is {modality}",
    "the name of the volume contains {word}",
    "Unit, name and modality do not say what the volume is, so values {side} {value} are shown.",
    "All values are about {value}, so everything is shown.",
    "No spacing was given; 1 × 1 × 1 {unit} is assumed.",
    "{work}, about {seconds} s",
    "Rendering {plan}",
    "reading {file}",
    # Errors.
    "There is no file {path}; check the path.",
    "Cannot read {path}: {problem}; check the path and its permissions.",
    "{file} has no suffix of a known format ({suffixes}); to read it as raw voxels, give its shape and dtype.",
    "The header of {file} is damaged: {problem}; copy or export it again.",
    "{file} is a gzip file that ends too early; copy or download it again.",
    "{file} is a damaged gzip file; copy or download it again.",
    "The voxels of {file} are colors; export one number for each voxel.",
    "The file of {volume} is not at {path}; click Relocate in the RLE Splat tab to choose its new place.",
    "A picture of {width} x {height} pixels needs about {needed} of memory and {free} are free; "
    "{fitting_width} x {fitting_height} pixels would fit.",
    "{volume} is disabled in viewports or excluded from this view layer, so Blender does not update its place; "
    "enable it in the Outliner.",
    # What earlier versions had.
    "The {knob} {removed} was removed; {used} is used instead.",
)
REASONS = ("reason", "side", "work")
CONTEXTS = ("*", "Operator", OURS)  # Blender looks the labels of operators up in a context of their own


def languages() -> dict[str, dict[str, str]]:
    """The translations by Blender's name of the language, such as "de_DE"."""
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(FOLDER.glob("*.json"))}


def with_unit(label: str, unit: str) -> str:
    """A label in the language of the interface, with a unit in brackets if there is one."""
    label = pgettext_iface(label, OURS)
    return f"{label} ({unit})" if unit else label


def with_ellipsis(label: str) -> str:
    """A label in the language of the interface, for a button that opens a dialog or a file browser."""
    return f"{pgettext_iface(label, OURS)}…"


def filled(template: str, **values) -> str:
    """A sentence in the language of the interface.

    Parameters
    ----------
    template : str
        The English sentence, with fields in braces.
    **values
        What stands in the fields.
    """
    return pgettext_iface(template).format(**values)


def translate(sentence: str) -> str:
    """A sentence of the renderer in the language of the interface, if it is whole or one of COMPOSED; else as it is."""
    whole = pgettext_iface(sentence)
    if whole != sentence:
        return whole
    for template in COMPOSED:
        found = _pattern(template).fullmatch(sentence)
        if found is not None:
            return filled(
                template,
                **{name: translate(value) if name in REASONS else value for name, value in found.groupdict().items()},
            )
    return sentence


@cache
def _pattern(template: str) -> re.Pattern:
    """What a filled template looks like."""
    words = re.split(r"\{(\w+)\}", template)
    words[::2] = map(re.escape, words[::2])
    words[1::2] = (f"(?P<{name}>.+)" for name in words[1::2])
    return re.compile("".join(words))


def register():
    bpy.app.translations.register(EXTENSION, {
        language: {(context, text): translated for text, translated in texts.items() for context in CONTEXTS}
        for language, texts in languages().items()
    })  # fmt: skip


def unregister():
    bpy.app.translations.unregister(EXTENSION)
