"""Handles in the 3D viewport: six on the faces of a cut box; on a cut plane or a slice one that moves, two that tilt.

A drag is one step of undo.  Esc or the right mouse button cancels it.
"""

from functools import partial

import bpy
from mathutils import Matrix

from ..bridge.loop import timer
from ..bridge.scene import clip_handles

AXIS_COLORS = ((1.0, 0.2, 0.32), (0.55, 0.86, 0.0), (0.16, 0.56, 1.0))  # of Blender's x, y and z
PLANE_COLOR = (1.0, 0.75, 0.2)
RING = 0.8  # radius in units of Blender's size of gizmos


def _arrow(group, color, get, put):
    """A new arrow whose distance from its base is read and set by functions."""
    arrow = group.gizmos.new("GIZMO_GT_arrow_3d")
    arrow.draw_style = "BOX"
    arrow.length = 0.0
    _paint(arrow, color)
    arrow.target_set_handler("offset", get=get, set=put)
    return arrow


def _paint(handle, color) -> None:
    handle.color, handle.alpha = color, 0.8
    handle.color_highlight, handle.alpha_highlight = color, 1.0
    handle.use_draw_modal = True


def _extent(axis: int, side: int) -> float:
    box = clip_handles.active_box(bpy.context)
    return 0.0 if box is None else clip_handles.face(box, axis, side)[2]


def _set_extent(axis: int, side: int, extent: float) -> None:
    box = clip_handles.active_box(bpy.context)
    if box is not None:
        clip_handles.move_face(box, axis, side, extent)


def _distance() -> float:
    plane = clip_handles.active_plane(bpy.context)
    return 0.0 if plane is None else clip_handles.plane_origin(plane)[2]


def _set_distance(distance: float) -> None:
    plane = clip_handles.active_plane(bpy.context)
    if plane is not None:
        clip_handles.move_plane(plane, distance)


def _ring(group, axis: int):
    """A new ring that tilts the active plane; it counts the angle since it was made."""
    turned = [0.0]

    def turn(angle: float) -> None:
        plane = clip_handles.active_plane(bpy.context)
        if plane is not None:
            clip_handles.tilt(plane, axis, turned[0] - angle)  # Blender counts clockwise about the ring's axis
            turned[0] = angle

    ring = group.gizmos.new("GIZMO_GT_dial_3d")
    ring.draw_options = {"CLIP"}
    ring.line_width, ring.scale_basis = 2.0, RING
    ring.select_bias = -2.0  # where an edge of it passes the arrow, the mouse takes the arrow
    _paint(ring, AXIS_COLORS[axis])
    ring.target_set_handler("offset", get=lambda: turned[0], set=turn)
    return ring


class Handles:
    """What both groups of handles share.

    A subclass has ``moved(context)``, the object that its handles move or None, and ``places(context)``, a matrix for
    each handle.
    """

    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT", "SHOW_MODAL_ALL"}

    before = None  # the object, and where it was when no handle was dragged
    is_dragged = False

    def draw_prepare(self, context):
        for handle, place in zip(self.gizmos, self.places(context)):
            if not handle.is_modal:
                handle.matrix_basis = place
        if any(handle.is_modal for handle in self.gizmos):
            self.is_dragged = True
            return
        one = self.moved(context)
        now = None if one is None else (one.session_uid, one.matrix_basis.copy())
        if self.is_dragged and now is not None and self.before is not None and _are_apart(now[1], self.before[1]):
            timer.start(_push_undo)
        self.before, self.is_dragged = now, False


def _are_apart(one: Matrix, other: Matrix) -> bool:
    """Whether two placements differ by more than the rounding of a drag that was cancelled."""
    size = max(max(map(abs, row)) for row in other)
    return any(abs(a - b) > 1e-5 * size for rows in zip(one, other) for a, b in zip(*rows))


def _push_undo() -> None:
    """Timer function: make a step of undo, as Blender does not for the handles of extensions."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo_push(message="Move Handle")


class RLE_SPLAT_GGT_clip_box(Handles, bpy.types.GizmoGroup):
    """A handle on each face of a cut box. The opposite face stays"""

    bl_label = "Handles of a Cut Box"

    moved = staticmethod(clip_handles.active_box)

    @classmethod
    def poll(cls, context):
        return clip_handles.active_box(context) is not None

    def setup(self, _context):
        for face in clip_handles.FACES:
            _arrow(self, AXIS_COLORS[face[0]], partial(_extent, *face), partial(_set_extent, *face))

    def places(self, context):
        box = clip_handles.active_box(context)
        faces = () if box is None else (clip_handles.face(box, *face) for face in clip_handles.FACES)
        return [clip_handles.pointing(base, direction) for base, direction, _ in faces]


class RLE_SPLAT_GGT_clip_plane(Handles, bpy.types.GizmoGroup):
    """A handle that moves a cut plane or a slice along its normal, and two rings that tilt it"""

    bl_label = "Handles of a Plane"

    moved = staticmethod(clip_handles.active_plane)

    @classmethod
    def poll(cls, context):
        return clip_handles.active_plane(context) is not None

    def setup(self, _context):
        _arrow(self, PLANE_COLOR, _distance, _set_distance)
        for axis in (0, 1):
            _ring(self, axis)

    def places(self, context):
        plane = clip_handles.active_plane(context)
        if plane is None:
            return []
        places = clip_handles.plane_origin(plane)[:2], *(clip_handles.tilt_axis(plane, axis) for axis in (0, 1))
        return [clip_handles.pointing(base, direction) for base, direction in places]
