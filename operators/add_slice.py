"""Add Slice: add planes to the scene that show the volume's values as gray levels."""

import bpy
from bpy.props import EnumProperty

from ..bridge.live import slice_pictures, slice_window, slices
from ..bridge.scene import viewports
from ..bridge.volumes import volumes
from .placing import make_active
from .reading import LoadsFirst
from .refusal import has_values, refuses

ALL = "ALL"
KINDS = (
    ("AXIAL", "Axial", "Perpendicular to the patient's length; without patient axes, to the volume's z axis"),
    ("CORONAL", "Coronal", "Perpendicular to the direction from front to back; without patient axes, to the y axis"),
    ("SAGITTAL", "Sagittal", "Perpendicular to the direction from right to left; without patient axes, to the x axis"),
    (ALL, "All Three", "One of each"),
)


def add_slices(context, owner, volume, names) -> list:
    """Add slices of a volume to the scene, with a window of their own if they are its first ones.

    Parameters
    ----------
    names : list of str
        How they lie, see ``slices.add_slice``.

    Returns
    -------
    list of bpy.types.Object
        The slices, whose pictures are not made yet.
    """
    slice_window.begin(owner.rle_splat, volume)
    found = [slices.add_slice(context, owner, volume, name) for name in names]
    context.view_layer.update()
    context.scene.render.use_lock_interface = True  # renders write pixels that viewports draw
    viewports.show_textures(context.window)
    return found


class RLE_SPLAT_OT_add_slice(LoadsFirst, bpy.types.Operator):
    """Add a plane through the middle of the volume that shows its values in gray (MPR). Move, rotate, scale and animate
    it like any object. While there are slices, Blender's window is locked during a render"""

    bl_idname = "rle_splat.add_slice"
    bl_label = "Add Slice"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Kind", description="How the slice lies", items=KINDS)

    poll = classmethod(has_values)

    @refuses
    def execute(self, context):
        owner = volumes.volume_object(context)
        volume = volumes.load_volume(owner)
        kinds = [kind.lower() for kind, *_ in KINDS[:-1] if self.kind in (kind, ALL)]
        one = add_slices(context, owner, volume, kinds)[-1]
        if one.name not in context.view_layer.objects:
            self.report({"WARNING"}, f"{one.name} is in a collection that is excluded from the view layer; include it "
                                     "in the Outliner to see the slice.")  # fmt: skip
            return {"FINISHED"}
        make_active(self, context, one, "was added")
        slice_pictures.update(context.scene, context.evaluated_depsgraph_get(), may_wait=False)
        return {"FINISHED"}
