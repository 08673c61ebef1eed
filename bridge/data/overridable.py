"""The property functions of ``bpy.props`` with library overrides enabled, for everything a user edits on a volume.
Those of inputs of a picture, of a volume as of a scene, begin with Live.

Without that option Blender silently drops an edited value of an override when the file is opened again.
"""

from functools import partial

from bpy import props

_KEPT = {"LIBRARY_OVERRIDABLE"}

(
    BoolProperty, BoolVectorProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, IntVectorProperty,
    PointerProperty, StringProperty,
) = (
    partial(kind, override=_KEPT)
    for kind in (
        props.BoolProperty, props.BoolVectorProperty, props.EnumProperty, props.FloatProperty,
        props.FloatVectorProperty, props.IntProperty, props.IntVectorProperty, props.PointerProperty,
        props.StringProperty,
    )
)  # fmt: skip

# Overrides find the items of a collection by ``name``, so every item needs a unique name.
CollectionProperty = partial(props.CollectionProperty, override={*_KEPT, "USE_INSERTION"})


def evaluate_anew(group, _context):
    """Tag the datablock for an update: Blender does so for a user's edit of these properties, not for a script's."""
    group.id_data.update_tag()


LiveBool, LiveEnum, LiveFloat, LiveInt, LivePointer, LiveString = (
    partial(kind, update=evaluate_anew)
    for kind in (BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty)
)
