"""The effects of a scene in Blender: what the user forces on or off, and the list as it was last made out.

Both are kept in the scene's settings, so undo, reloading and copies of the scene have them as they have all else.
"""

from __future__ import annotations

from functools import partial

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ..rle_splat.effects.analyse import EFFECTS

AUTO = "AUTO"
STATES = {AUTO: None, "ON": True, "OFF": False}
STATE_ITEMS = [
    (AUTO, "Auto", "As the scene calls for it"),
    ("ON", "On", "Forced on; refused where the scene gives nothing to do it with"),
    ("OFF", "Off", "Forced off: it costs nothing, and the picture is that of a scene without it"),
]


def property_of(name: str) -> str:
    """The property of EffectOverrideProperties that holds an effect's override."""
    return name.replace(" ", "_").replace("-", "_")


def _evaluate_anew(overrides, _context):
    overrides.id_data.update_tag()


_Override = partial(EnumProperty, items=STATE_ITEMS, default=AUTO, update=_evaluate_anew)


class EffectOverrideProperties(bpy.types.PropertyGroup):
    """One property for each effect of the table."""

    __annotations__ = {
        property_of(name): _Override(name=name.capitalize(), description=kind.text[0].upper() + kind.text[1:])
        for name, kind in EFFECTS.items()
    }


class EffectRowProperties(bpy.types.PropertyGroup):
    """An effect as it was last made out; ``name`` is the effect's."""

    on: BoolProperty(name="On")
    reason: StringProperty(name="Reason", description="Why it is on or off")
    is_timed: BoolProperty(name="Timed", description="Whether a picture was made and its own work can be told apart")
    ms: FloatProperty(name="Time", description="Milliseconds of its own work in the last picture", min=0.0)


def overrides_of(scene) -> dict[str, bool]:
    """What ``scene`` forces: name of an effect -> on or off."""
    chosen = {name: STATES[getattr(scene.rle_splat.effect_overrides, property_of(name))] for name in EFFECTS}
    return {name: on for name, on in chosen.items() if on is not None}


def note_report(settings, report: dict) -> None:
    """Keep the effects of a finished picture, and what each took."""
    note_effects(settings, report.get("effects", ()), "As in the last picture; milliseconds are of the work an effect "
                 "has of its own.")


def note_effects(settings, listed, note: str) -> None:
    """Keep ``listed``, entries of name, on and reason, and, of a picture, ms; ``note`` says what they are of."""
    settings.effect_rows.clear()
    for entry in listed:
        row = settings.effect_rows.add()
        row.name, row.on, row.reason = entry["name"], entry["on"], entry["reason"]
        row.is_timed = entry.get("ms") is not None
        row.ms = entry.get("ms") or 0.0
    settings.effects_note = note
