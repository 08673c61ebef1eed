"""The kinds of property for what a user edits of a volume: ``bpy.props``, kept on library overrides as well.

Blender drops every other value of an override when the file is read again, without a word.
"""

from functools import partial

from bpy import props

_KEPT = {"LIBRARY_OVERRIDABLE"}

(
    BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, IntVectorProperty, PointerProperty,
    StringProperty,
) = (
    partial(kind, override=_KEPT)
    for kind in (
        props.BoolProperty, props.EnumProperty, props.FloatProperty, props.FloatVectorProperty, props.IntProperty,
        props.IntVectorProperty, props.PointerProperty, props.StringProperty,
    )
)  # fmt: skip

# Blender finds the items of a collection again by their ``name``: give each that is added one that no other has.
CollectionProperty = partial(props.CollectionProperty, override={*_KEPT, "USE_INSERTION"})
