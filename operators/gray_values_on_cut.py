"""Gray Values on Cut: show the volume's values where it is cut, or no longer."""

from itertools import chain

import bpy

from ..bridge import linked
from ..bridge.live import cut_slices, slice_pictures, slice_window
from ..bridge.scene import clip_objects, viewports
from ..bridge.volumes import volumes
from ..bridge.volumes.attached import is_attached
from .reading import LoadsFirst
from .refusal import has_values, needs, refuses


def own_cuts(scene, owner) -> list:
    """The cutting objects that are children of a volume, and can be edited."""
    return [one for one in clip_objects.clip_objects(scene) if is_attached(one, owner) and linked.is_own(one)]


def shows_values(scene, owner) -> bool:
    """Whether all cuts that are children of a volume show its values."""
    found = own_cuts(scene, owner)
    return bool(found) and all(cut_slices.slices_of(scene, one) for one in found)


class RLE_SPLAT_OT_gray_values_on_cut(LoadsFirst, bpy.types.Operator):
    """Show the volume's gray values on the cut faces of what is visible, also inside closed surfaces. Click again to
    remove them. Window, level and Transparent Black are those of the volume's slices"""

    bl_idname = "rle_splat.gray_values_on_cut"
    bl_label = "Gray Values on Cut"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return has_values(cls, context) and needs(
            cls, own_cuts(context.scene, volumes.volume_object(context)), "Add a box or a plane that cuts the volume"
        )

    @refuses
    def execute(self, context):
        scene, owner = context.scene, volumes.volume_object(context)
        cuts = {cut: cut_slices.slices_of(scene, cut) for cut in own_cuts(scene, owner)}
        if all(cuts.values()):
            for one in chain(*cuts.values()):
                cut_slices.remove(one)
            return {"FINISHED"}
        slice_window.begin(owner.rle_splat, volumes.load_volume(owner))
        for cut in [cut for cut, found in cuts.items() if not found]:
            cut_slices.add_slices(context, owner, cut)
        context.view_layer.update()
        scene.render.use_lock_interface = True  # renders write pixels that viewports draw
        viewports.show_textures(context.window)
        slice_pictures.update(scene, context.evaluated_depsgraph_get(), may_wait=False)
        return {"FINISHED"}
