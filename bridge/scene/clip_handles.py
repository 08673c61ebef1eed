"""What the handles of cutting objects do: move one face of a box, move a plane along its normal, and tilt it.

Objects are changed by their own location, rotation and scale, so that these can be keyframed.
"""

import bpy
from mathutils import Matrix, Quaternion, Vector

from .. import linked
from ..loop import index
from ..volumes import volumes
from . import clip_objects

FACES = [(axis, side) for axis in range(3) for side in (-1, 1)]
TURNS = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}  # else rotation_euler
THINNEST = 1e-3  # of a box's longest side: it must not become flat


def active_box(context):
    """The cut box that handles are shown for, or None.

    The active object if it is an Empty that cuts as a box, else the first visible one that cuts the active volume.
    """
    if context.scene.rle_splat.clip_objects is None:
        return None
    active = context.view_layer.objects.active
    if active is None:
        return None
    boxes = [one for one in clip_objects.clip_objects(context.scene) if _is_box(one) and one.visible_get()]
    if active in boxes:
        return active
    if not active.rle_splat.is_volume:
        return None
    return next((one for one in boxes if clip_objects.cuts(one, active)), None)


def active_plane(context):
    """The active object if it is visible and cuts a volume as a plane, or shows a slice; else None."""
    if not any(index.of(context.scene)):
        return None
    one = context.view_layer.objects.active
    if one is None or not linked.is_own(one) or not one.visible_get():
        return None
    if one.rle_splat.is_slice:
        return one
    owner = volumes.volume_object(context)
    return None if owner is None else clip_objects.active_plane(context, owner)


def _is_box(one) -> bool:
    return one.type == "EMPTY" and one.empty_display_type == "CUBE" and linked.is_own(one)


def around(one) -> Matrix:
    """The space around an object, in which its own location, rotation and scale count: that space to the world.

    The evaluated matrices are of one time, while location and scale may have been set since.
    """
    evaluated = one.evaluated_get(bpy.context.view_layer.depsgraph)
    return evaluated.matrix_world @ evaluated.matrix_basis.inverted_safe()


def now(one) -> Matrix:
    """The placement of an object by its location, rotation and scale as they are now: its own space to the world."""
    return around(one) @ one.matrix_basis


def face(box, axis: int, side: int) -> tuple[Vector, Vector, float]:
    """Where the handle of a face is.

    Parameters
    ----------
    box : bpy.types.Object
        An Empty shown as a cube.
    axis : int
        0, 1 or 2 of its own axes.
    side : int
        1 or -1, the end of the axis.

    Returns
    -------
    opposite : mathutils.Vector
        Middle of the opposite face in the world, which stays where it is.
    direction : mathutils.Vector
        Unit vector in the world, out of the box.
    extent : float
        Distance between the two faces in world units, which may be 0.
    """
    matrix = now(box)
    half = side * box.empty_display_size * matrix.col[axis].to_3d()
    return matrix.translation - half, half.normalized(), 2.0 * half.length


def move_face(box, axis: int, side: int, extent: float) -> None:
    """Move one face of a box, by the box's location and scale; the opposite face stays.

    ``extent``: new distance between the two faces, in world units.
    """
    longest = max(face(box, other, 1)[2] for other in range(3))
    _, direction, before = face(box, axis, side)
    extent = max(extent, THINNEST * longest)
    if before <= 0.0:
        return  # scaled to nothing along this axis, by hand
    box.scale[axis] *= extent / before
    _shift(box, 0.5 * (extent - before) * direction)


def plane_origin(plane) -> tuple[Vector, Vector, float]:
    """Where the handle of a plane is.

    Returns
    -------
    base : mathutils.Vector
        The point of the plane's normal that is nearest to the origin of the space around the plane, in the world.
    normal : mathutils.Vector
        Unit vector in the world, along the plane's +Z.
    distance : float
        From there to the plane's middle along the normal, in world units.
    """
    matrix, origin = now(plane), around(plane).translation
    normal = (matrix.col[0].to_3d().cross(matrix.col[1].to_3d())).normalized()
    if normal.dot(matrix.col[2].to_3d()) < 0.0:
        normal.negate()
    distance = normal.dot(matrix.translation - origin)
    return matrix.translation - distance * normal, normal, distance


def move_plane(plane, distance: float) -> None:
    """Move a plane along its normal, by its location, to a distance as ``plane_origin`` gives it."""
    _, normal, before = plane_origin(plane)
    _shift(plane, (distance - before) * normal)


def tilt_axis(plane, axis: int) -> tuple[Vector, Vector]:
    """Where the handle is that tilts a plane.

    Parameters
    ----------
    axis : int
        0 or 1 of its own axes.

    Returns
    -------
    middle : mathutils.Vector
        The plane's middle in the world.
    direction : mathutils.Vector
        Unit vector in the world, along the axis.
    """
    matrix = now(plane)
    return matrix.translation, matrix.col[axis].to_3d().normalized()


def tilt(plane, axis: int, angle: float) -> None:
    """Turn a plane about one of its own axes by radians, counterclockwise as seen in the world against that axis."""
    if now(plane).determinant() < 0.0:
        angle = -angle  # its own space is a mirror image of the world
    turn = Quaternion(Matrix.Identity(3).col[axis], angle)
    if plane.rotation_mode == "QUATERNION":
        plane.rotation_quaternion = plane.rotation_quaternion @ turn
    elif plane.rotation_mode == "AXIS_ANGLE":
        before, *direction = plane.rotation_axis_angle
        direction, after = (Quaternion(direction, before) @ turn).to_axis_angle()
        plane.rotation_axis_angle = (after, *direction)
    else:
        euler = plane.rotation_euler
        plane.rotation_euler = (euler.to_matrix() @ turn.to_matrix()).to_euler(euler.order, euler)
    _keyframe(plane, TURNS.get(plane.rotation_mode, "rotation_euler"))


def _shift(one, step: Vector) -> None:
    """Move an object by a step in the world."""
    one.location += around(one).to_3x3().inverted_safe() @ step
    _keyframe(one, "location", "scale")


def _keyframe(one, *names: str) -> None:
    """With Auto Keying on, keyframe properties of an object."""
    if bpy.context.scene.tool_settings.use_keyframe_insert_auto:
        for name in names:
            one.keyframe_insert(name)


def pointing(base: Vector, direction: Vector) -> Matrix:
    """A handle's placement: its own space, whose +Z points along a unit vector, to the world."""
    matrix = direction.to_track_quat("Z", "Y").to_matrix().to_4x4()
    matrix.translation = base
    return matrix
