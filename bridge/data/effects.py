"""The effects of a scene: the user's overrides, and the list of effects last determined.

Both are properties of the scene, so undo, saving and copying a scene include them.
"""

from functools import partial

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...rle_splat.effects.analyze import EFFECTS
from .overridable import evaluate_anew

# An effect on what Blender renders, not on our pictures.
SHADOWS_ON_MESHES = "shadows on meshes"
# Name of an effect -> what it does, for tooltips.
TEXTS = {name: kind.text for name, kind in EFFECTS.items()} | {
    SHADOWS_ON_MESHES: "Let the volume cast shadows on meshes in renders, not in viewports: soft ones in Cycles, the "
    "outline of dense parts in EEVEE. Cycles also shows the volume's reflection in meshes",
}
# The effects that panels call something else than their names in Title Case.
PANEL_NAMES = {
    "clip objects": "Cutting Objects",
    "indirect light": "Scattering",
    "labels": "Segments",
    "mesh occlusion": "Meshes Hide Volume",
}
AUTO = "auto"
STATES = {AUTO: None, "on": True, "off": False}
STATE_ITEMS = [
    (AUTO, "Auto", "Use the effect if the scene needs it"),
    ("on", "On", "Always use the effect. Rendering ends with an error if the scene lacks what the effect needs"),
    ("off", "Off", "Never use the effect. It then takes no time"),
]
SHADOW_ITEMS = [
    (AUTO, "Auto", "Cast shadows on meshes if a light casts shadows and a mesh can receive them"),
    ("on", "On", "Cast shadows on meshes even if no light casts shadows or no mesh can receive them"),
    ("off", "Off", "Cast no shadows on meshes. This takes no time"),
]


def property_of(name: str) -> str:
    """The property of EffectOverrideProperties for an effect: "depth_of_field" for "depth of field"."""
    return name.replace(" ", "_").replace("-", "_")


def title(name: str) -> str:
    """The name of an effect in panels, such as Depth of Field."""
    return PANEL_NAMES.get(name) or name.title().replace(" Of ", " of ").replace(" On ", " on ")


def items_of(name: str) -> list[tuple]:
    """The choices for an effect, one of TEXTS."""
    return SHADOW_ITEMS if name == SHADOWS_ON_MESHES else STATE_ITEMS


_Override = partial(EnumProperty, default=AUTO, update=evaluate_anew)


class EffectOverrideProperties(bpy.types.PropertyGroup):
    """One enum property for each effect."""

    __annotations__ = {
        property_of(name): _Override(name=title(name), description=text, items=items_of(name))
        for name, text in TEXTS.items()
    }


class EffectRowProperties(bpy.types.PropertyGroup):
    """The last known state of an effect; ``name`` is the effect's name."""

    on: BoolProperty(name="On", description="The effect is on")
    reason: StringProperty(name="Reason", description="Why the effect is on or off")
    is_timed: BoolProperty(name="Timed", description="The effect's own time in the last picture is known")
    ms: FloatProperty(name="Time", description="Milliseconds that the effect took in the last picture", min=0.0)


def overrides_of(scene) -> dict[str, bool]:
    """The effects of our pictures that a scene forces on or off, by name; effects left at Auto are missing."""
    chosen = {name: forced(scene, name) for name in EFFECTS}
    return {name: on for name, on in chosen.items() if on is not None}


def forced(scene, name: str) -> bool | None:
    """The state that a scene forces an effect to, one of TEXTS; None at Auto."""
    return STATES[getattr(scene.rle_splat.effect_overrides, property_of(name))]


def note_report(settings, report: dict) -> None:
    """Save the effects of a finished picture and their times."""
    note_effects(settings, report.get("effects", ()), "For the last picture; the milliseconds are those of each "
                 "effect's own work.")  # fmt: skip


def note_effects(settings, listed, note: str) -> None:
    """Replace the list of effects.

    Parameters
    ----------
    listed : list of dict
        ``name``, ``on`` and ``reason`` of each effect, and ``ms`` if a picture was made.
    note : str
        One sentence on what the list describes.
    """
    settings.effect_rows.clear()
    for entry in listed:
        row = settings.effect_rows.add()
        row.name, row.on, row.reason = entry["name"], entry["on"], entry["reason"]
        row.is_timed = entry.get("ms") is not None
        row.ms = entry.get("ms") or 0.0
    settings.effects_note = note
