"""Four-Up View: an axial, a coronal and a sagittal slice beside the volume, in one viewport."""

import bpy
import numpy as np

from ..bridge.live import slice_pictures, slice_places, slices
from ..bridge.scene import viewports
from ..bridge.volumes import box, volumes
from .add_slice import add_slices
from .reading import LoadsFirst
from .refusal import has_values, refuse, refuses
from .use_window_tool import TOOL

HAD_TEXT = "rle_splat_had_text"  # custom property of a screen: whether its viewport had Blender's text before


class RLE_SPLAT_OT_four_up_view(LoadsFirst, bpy.types.Operator):
    """Show an axial, a coronal and a sagittal slice (MPR) beside the volume, linked by lines where they cross. The
    wheel over one moves it, dragging changes window and level. Click again for one view"""

    bl_idname = "rle_splat.four_up_view"
    bl_label = "Four-Up View"
    bl_options = {"REGISTER", "UNDO"}

    poll = classmethod(has_values)

    @refuses
    def execute(self, context):
        area, region = _viewport(context)
        if area is None:
            return refuse(self, "No 3D viewport is open in this window; open one.")
        owner, space = volumes.volume_object(context), area.spaces.active
        where = {"area": area, "region": region, "space_data": space}
        if len(space.region_quadviews):
            _leave(context, space, where)
            space.overlay.show_text |= bool(context.screen.pop(HAD_TEXT, False))
            return {"FINISHED"}
        volume = volumes.load_volume(owner)
        kinds = {one.rle_splat.slice_kind: one for one in slices.slice_objects(context.scene)
                 if slices.volume_of(one) == owner}  # fmt: skip
        for one in add_slices(context, owner, volume, [kind for kind in slice_places.SIDE_OF if kind not in kinds]):
            kinds[one.rle_splat.slice_kind] = one
        with context.temp_override(**where):
            bpy.ops.screen.region_quadview()
        _place_views(space, owner, kinds)
        # Blender names its views by the world, such as Right for a view from a patient's left.
        context.screen[HAD_TEXT] = space.overlay.show_text
        space.overlay.show_text = False
        viewports.frame(context.window, [box.world_corners(owner)])
        viewports.frame_quad(area, box.world_corners(owner))
        slice_pictures.update(context.scene, context.evaluated_depsgraph_get(), may_wait=False)
        if context.mode == "OBJECT":
            with context.temp_override(**where):
                bpy.ops.wm.tool_set_by_id(name=TOOL)
        return {"FINISHED"}


def _viewport(context) -> tuple:
    """(area, region) of the 3D viewport that the operator was called in, or of the window's largest one."""
    areas = [context.area] if context.area is not None and context.area.type == "VIEW_3D" else []
    if not areas and context.window is not None and not bpy.app.background:
        areas = sorted(viewports.areas_of(context.window), key=lambda area: -area.width * area.height)
    if not areas:
        return None, None
    return areas[0], next(region for region in areas[0].regions if region.type == "WINDOW")


def _leave(context, space, where: dict) -> None:
    """End a quad view with the view of its volume; Blender itself ends it with that of its first region."""
    view = next((one for one in space.region_quadviews if one.is_perspective), space.region_quadviews[0])
    held = [getattr(view, name).copy() for name in ("view_rotation", "view_location")]
    perspective, distance = view.view_perspective, view.view_distance
    with context.temp_override(**where):
        bpy.ops.screen.region_quadview()
    view = space.region_3d
    view.view_perspective, view.view_distance = perspective, distance
    view.view_rotation, view.view_location = held


def _place_views(space, owner, kinds: dict) -> None:
    """Turn the orthographic views of a new quad view straight onto the slices."""
    matrix = np.array(owner.matrix_world)
    straight = [view for view in space.region_quadviews if view.view_perspective == "ORTHO"]
    for view, kind in zip(straight, ("coronal", "axial", "sagittal")):
        view.lock_rotation = False
        view.view_rotation = slice_places.straight_onto(kinds[kind], kind, matrix)
