"""The poses of the camera and a volume while the shutter is open, read from their keyframes.

Blender evaluates another time only by setting the frame.  That runs the frame-change handlers of every add-on and
resets values that are not keyframed, and the render thread cannot do it at all.  So the F-curves of an object, of its
parents and of the targets of its Track To constraints are evaluated here.  If anything else moves an object, the
picture has no motion blur, and the report names the cause.
"""

import numpy as np
from mathutils import Euler, Matrix, Quaternion, Vector

from ...rle_splat.scene import Pose
from ..data.playback import curves_of
from .camera import camera_object, without_scale

POSES = 5  # while the shutter is open; motion is linear between two poses
OPENS = {"START": 0.0, "CENTER": -0.5, "END": -1.0}  # when the shutter opens, in units of the shutter time
NEAR = 1e-4  # largest difference of equal matrices, in world units or relative to the largest element

# An object's own properties that transform it.
TRANSFORMS = (
    "location", "rotation_mode", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale",
    "delta_location", "delta_rotation_euler", "delta_rotation_quaternion", "delta_scale",
)  # fmt: skip
# Constraints that depend on time only through their target.
OF_THE_TARGET = (
    "COPY_LOCATION", "COPY_ROTATION", "COPY_SCALE", "COPY_TRANSFORMS", "LIMIT_DISTANCE", "LIMIT_LOCATION",
    "LIMIT_ROTATION", "LIMIT_SCALE", "MAINTAIN_VOLUME", "TRANSFORM", "DAMPED_TRACK", "LOCKED_TRACK", "TRACK_TO",
    "CHILD_OF", "FLOOR", "PIVOT",
)  # fmt: skip
AS_OBJECT = ("OBJECT", "ARMATURE", "LATTICE")  # parent types that act as a plain object parent


class _NotReadError(Exception):
    """Something other than keyframes moves an object; the message completes "the camera depends on"."""


def read_motion(depsgraph, volume_object, camera=None) -> tuple[tuple[Pose, ...], str]:
    """The poses of the camera and a volume while the shutter is open.

    Returns
    -------
    poses : tuple of Pose
        Equally spaced in time from opening to closing; empty without motion.
    reason : str
        Why there are no poses, without a period; "" with poses.
    """
    scene, render = depsgraph.scene, depsgraph.scene.render
    if not render.use_motion_blur:
        return (), "Motion Blur is off in the render settings"
    if not depsgraph.view_layer_eval.use_motion_blur:
        return (), "Motion Blur is off in the view layer"
    shutter = render.motion_blur_shutter
    opens = scene.frame_float + OPENS[render.motion_blur_position] * shutter
    stretch = render.frame_map_old / render.frame_map_new
    times = [stretch * (opens + part * shutter) for part in np.linspace(0.0, 1.0, POSES)]
    places = []
    # One camera for the whole shutter time: Cycles does not switch cameras in it either.
    seen_through = camera_object(depsgraph) if camera is None else camera.evaluated_get(depsgraph)
    for who, one in (("camera", seen_through), ("volume", volume_object.evaluated_get(depsgraph))):
        try:
            at_frame = np.array(_world(one, scene.frame_current_final))
            places.append([np.array(_world(one, time), dtype=np.float64) for time in times])
        except _NotReadError as cause:
            tail = "and only keyframes are read between frames; bake its motion to them"
            return (), f"the {who} depends on {cause}, {tail}"
        seen = np.array(one.matrix_world)
        if np.abs(at_frame - seen).max() > NEAR * max(1.0, np.abs(seen).max()):
            return (), f"the {who} is not where its keyframes place it; insert a keyframe"
    if all(np.array_equal(place, path[0]) for path in places for place in path):
        return (), "no keyframe moves the camera or the volume while the shutter is open"
    return tuple(Pose(without_scale(camera), volume) for camera, volume in zip(*places)), ""


def _world(one, time: float, asking: tuple = ()) -> Matrix:
    """(4, 4) of an evaluated object to the world at a time in frames; ``asking``: the objects that depend on it."""
    if one in asking:
        raise _NotReadError("a cycle of parents and constraints")
    asking = (*asking, one)
    if _is_still(one, asking):
        return one.matrix_world.copy()
    place = _own_place(one, time)
    if one.parent is not None:
        place = _world(_parent(one), time, asking) @ one.matrix_parent_inverse @ place
    for constraint in _constraints(one):
        place = _tracked(place, constraint, _world(_aim(one, constraint), time, asking))
    return place


def _is_still(one, asking: tuple) -> bool:
    """Whether nothing moves the object over time, so that its evaluated matrix holds at all times."""
    if one.rigid_body is not None or _curves(one) or _other_animation(one):
        return False
    on = [] if one.parent is None else [one.parent]
    if one.parent is not None and _odd_parent(one):
        return False
    for constraint in _constraints(one):
        if constraint.type not in OF_THE_TARGET or getattr(constraint, "subtarget", ""):
            return False
        target = getattr(constraint, "target", None)
        on += [] if target is None else [target]
    return all(other not in asking and _is_still(other, (*asking, other)) for other in on)


def _own_place(one, time: float) -> Matrix:
    """(4, 4) of an object from its own location, rotation, scale and deltas, with F-curves evaluated at a time."""
    if one.rigid_body is not None:
        raise _NotReadError("physics")
    if cause := _other_animation(one):
        raise _NotReadError(cause)
    curves = _curves(one)
    if any(path not in TRANSFORMS or path == "rotation_mode" for path, _index in curves):
        raise _NotReadError("an animated constraint or rotation mode")

    def value(path):
        return [
            curves[path, index].evaluate(time) if (path, index) in curves else number
            for index, number in enumerate(getattr(one, path))
        ]

    mode = one.rotation_mode
    if mode == "QUATERNION":
        turned, delta = (
            Quaternion(value(path)).normalized().to_matrix()
            for path in ("rotation_quaternion", "delta_rotation_quaternion")
        )
    elif mode == "AXIS_ANGLE":
        angle, *axis = value("rotation_axis_angle")
        turned, delta = Matrix.Rotation(angle, 3, axis), Matrix.Identity(3)
    else:
        turned, delta = (Euler(value(path), mode).to_matrix() for path in ("rotation_euler", "delta_rotation_euler"))
    scale = Vector(value("scale")) * Vector(value("delta_scale"))
    place = (delta @ turned @ Matrix.Diagonal(scale)).to_4x4()
    place.translation = Vector(value("location")) + Vector(value("delta_location"))
    return place


def _curves(one) -> dict:
    """(property, index) -> F-curve, for the F-curves that transform the object."""
    return {
        (curve.data_path, curve.array_index): curve
        for curve in curves_of(one)
        if _places(curve) and not curve.is_empty  # Blender evaluates F-curves of muted groups too
    }


def _other_animation(one) -> str:
    """What but its action animates the object's place; "" for nothing."""
    data = one.animation_data
    if data is None:
        return ""
    if any(_places(driver) for driver in data.drivers):
        return "a driver"
    return "NLA strips" if data.use_nla and any(track.strips for track in data.nla_tracks) else ""


def _places(curve) -> bool:
    """Whether an F-curve or driver is active and animates a property that transforms an object."""
    return not curve.mute and (curve.data_path in TRANSFORMS or curve.data_path.startswith("constraints"))


def _odd_parent(one) -> str:
    """The part of its parent that the object follows, such as a bone; "" for the parent as a whole."""
    if one.parent_type not in AS_OBJECT:
        return f"the {one.parent_type.rstrip('_3').lower()} that is its parent"
    if one.parent.type == "CURVE" and one.parent.data.use_path:
        return "the path that is its parent"
    return ""


def _parent(one):
    if cause := _odd_parent(one):
        raise _NotReadError(cause)
    return one.parent


def _constraints(one) -> list:
    """The active constraints of an object."""
    return [each for each in one.constraints if not each.mute and each.influence > 0.0 and each.is_valid]


def _aim(one, constraint):
    """The target of a plain Track To constraint; _NotReadError for any other constraint."""
    plain = constraint.type == "TRACK_TO" and constraint.influence == 1.0 and not constraint.subtarget
    if not plain or {constraint.owner_space, constraint.target_space} != {"WORLD"}:
        name = constraint.bl_rna.properties["type"].enum_items[constraint.type].name
        raise _NotReadError(f"the constraint {name}")
    return constraint.target


def _tracked(place: Matrix, constraint, aim: Matrix) -> Matrix:
    """(4, 4) of an object at ``place`` after a Track To constraint, by Blender's rules."""
    towards = constraint.track_axis
    axis, up = "XYZ".index(towards[-1]), "XYZ".index(constraint.up_axis[-1])
    if axis == up:
        raise _NotReadError("a constraint that tracks along its own up axis")
    away = place.translation - aim.translation
    away = away.normalized() if any(away) else Vector((0.0, 0.0, 1.0))
    along = away if "NEGATIVE" in towards else -away
    upright = aim.col[2].to_3d() if constraint.use_target_z else Vector((0.0, 0.0, 1.0))
    upright -= upright.project(along)
    upright = upright.normalized() if any(upright) else Vector((0.0, 1.0, 0.0))
    right = upright.cross(along).normalized()
    columns = [None] * 3
    columns[axis], columns[up] = along, upright
    columns[3 - axis - up] = right if (axis - up) % 3 == 1 else -right
    turned = Matrix(columns).transposed() @ Matrix.Diagonal([place.col[i].to_3d().length for i in range(3)])
    result = turned.to_4x4()
    result.translation = place.translation
    return result
