"""Translations of the interface, in Blender's own way: one JSON file for each language, English text -> translation.

A text that Blender composes, such as a sentence with a name in it, stays English.
"""

from __future__ import annotations

import json
from pathlib import Path

import bpy

from ..paths import EXTENSION

FOLDER = Path(__file__).parent
# Blender's own translations come first: a word that means something else in them, such as Level, is given this context.
OURS = "RLE Splat"
CONTEXTS = ("*", "Operator", OURS)  # Blender looks the labels of operators up in a context of their own


def languages() -> dict[str, dict[str, str]]:
    """The translations by Blender's name of the language, such as "de_DE"."""
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(FOLDER.glob("*.json"))}


def with_unit(label: str, unit: str) -> str:
    """A label in the language of the interface, with a unit in brackets if there is one."""
    told = bpy.app.translations.pgettext_iface(label, OURS)
    return f"{told} ({unit})" if unit else told


def register():
    bpy.app.translations.register(EXTENSION, {
        language: {(context, text): told for text, told in texts.items() for context in CONTEXTS}
        for language, texts in languages().items()
    })  # fmt: skip


def unregister():
    bpy.app.translations.unregister(EXTENSION)
