"""Kinds of properties for the inputs of a picture, of a volume as of a scene."""

from functools import partial

from .overridable import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty


def evaluate_anew(group, _context):
    """Tag the datablock for an update: Blender does so for a user's edit of these properties, not for a script's."""
    group.id_data.update_tag()


LiveBool, LiveEnum, LiveFloat, LiveInt, LivePointer, LiveString = (
    partial(kind, update=evaluate_anew)
    for kind in (BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty)
)
