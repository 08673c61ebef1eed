"""Where slices are: under the mouse, straight before a view, and how far one may be scrolled."""

import math

import numpy as np
from mathutils import Matrix, Vector

from ...rle_splat.pipeline.first_surface import point_along
from ...rle_splat.scene import RleSplatError
from ...rle_splat.volume.orientation import LETTERS
from ...rle_splat.volume.slices import SLICE_NAMES
from ...rle_splat.volume.volume import PATIENT
from ..look import probe
from ..scene import render_scene
from ..scene.viewports import SIDES
from ..translations import translate
from ..volumes import box, loading, volumes
from . import shown, slices

SIDE_OF = {"axial": "I", "coronal": "A", "sagittal": "L"}  # where reading workstations look from
FACING = 0.999  # cosine between a view and a slice's normal above which the slice is seen straight on
EDGE_ON = 1e-4  # cosine below which a ray passes along a slice


def visible_slices(context) -> list:
    """The slices that a 3D viewport shows."""
    where = {"view_layer": context.view_layer, "viewport": context.space_data}
    return [one for one in slices.slice_objects(context.scene) if one.visible_get(**where)]


def faced_slice(context):
    """The slice that a region of a quad view is for: an orthographic view straight onto it; else None."""
    view = context.region_data
    if view is None or view.is_perspective or not len(context.space_data.region_quadviews):
        return None
    ahead = view.view_rotation @ Vector((0.0, 0.0, 1.0))
    found = (one for one in visible_slices(context) if not slices.is_on_cut(one))
    return next((one for one in found if abs(ahead.dot(_normal(one))) > FACING), None)


def _normal(one) -> Vector:
    return one.matrix_world.to_3x3().col[0].cross(one.matrix_world.to_3x3().col[1]).normalized()


def _place_of(one, depsgraph) -> tuple | None:
    """How a slice lies and where its middle is: (volume, axis of its normal, point of the volume's own space); None if
    its voxels are not in memory."""
    owner = slices.volume_of(one)
    if owner is None or volumes.at_hand(owner, depsgraph) is None:
        return None
    try:
        volume, matrix, _window = slices.content(one, depsgraph)
    except RleSplatError:
        return None
    right, up, _ahead, middle = (volume.affine @ matrix)[:3].T
    return volume, int(np.abs(np.cross(right, up)).argmax()), middle


def place_text(one, depsgraph) -> str:
    """How a slice lies and where its middle is, such as "Axial, S 12.3 mm"; "" if its voxels are not in memory."""
    found = _place_of(one, depsgraph)
    if found is None:
        return ""
    volume, axis, middle = found
    return f"{translate(SLICE_NAMES[axis].title())}, {probe.position_text(middle, volume, [axis])}"


def growing_side(one, depsgraph) -> str:
    """The side of the patient toward which a slice's position grows, such as "S+"; "" if that is not known."""
    found = _place_of(one, depsgraph)
    return "" if found is None or found[0].space != PATIENT else f"{LETTERS[found[1]][1]}+"


def under(context, mouse):
    """The slice that is seen under the mouse in a 3D viewport; None where a volume or nothing is."""
    ray = probe.ray_under(context, mouse)
    hits = [(distance, one) for one in visible_slices(context) if (distance := _distance(one, ray)) is not None]
    if not hits:
        return None
    distance, nearest = min(hits, key=lambda hit: hit[0])
    if shown.is_on(context.space_data) and faced_slice(context) is None:
        depsgraph = context.evaluated_depsgraph_get()
        owners = [owner for owner in probe.visible_owners(context) if loading.is_at_hand(owner, depsgraph)]
        try:
            found = probe.look_along(context, depsgraph, ray, owners)
        except RleSplatError:
            return None
        if found is not None and found.surface.distance < distance:
            return None
    return nearest


def hovered(context):
    """The slice that lay under the mouse when it moved last over the context's area; None elsewhere."""
    uid = 0 if context.area is None else probe.hovered_slice(context.area)
    return next((one for one in slices.slice_objects(context.scene) if one.session_uid == uid), None)


def line_on(one, context, mouse) -> str:
    """The value under the mouse of a slice, for people; "" for None, and before the voxels are in memory."""
    owner = None if one is None else slices.volume_of(one)
    depsgraph = context.evaluated_depsgraph_get()
    if owner is None or not loading.is_at_hand(owner, depsgraph):
        return ""
    ray = probe.ray_under(context, mouse)
    try:
        plain = render_scene.seen_by(owner, depsgraph, probe.ANY_VIEW, with_shadows=False)
    except RleSplatError as problem:
        return str(problem)
    found = point_along(plain, ray.origin, ray.direction, _distance(one, ray))
    several = len(probe.visible_owners(context)) > 1
    return "" if found is None else probe.line_of(probe.ProbeHit(found, owner, plain), several)


def _distance(one, ray) -> float | None:
    """World length along a ray to a slice's rectangle; None if it misses."""
    direction, normal = Vector(ray.direction).normalized(), _normal(one)
    if abs(direction.dot(normal)) < EDGE_ON:
        return None
    distance = (one.matrix_world.translation - Vector(ray.origin)).dot(normal) / direction.dot(normal)
    place = one.matrix_world.inverted_safe() @ (Vector(ray.origin) + distance * direction)
    return distance if ray.nearest <= distance <= ray.furthest and max(abs(place.x), abs(place.y)) <= 1.0 else None


def scroll(one, layers: float) -> bool:
    """Move a slice along its normal by layers of voxels, within its volume; return whether it moved."""
    if slices.is_on_cut(one):
        return False  # it moves with its cut
    owner = slices.volume_of(one)
    step = one.matrix_basis.to_3x3() @ Vector((0.0, 0.0, layers))  # its own z is a voxel long
    before = one.location.copy()
    if owner is not None:
        corners = box.world_corners(owner)
        to_world = one.matrix_world @ one.matrix_basis.inverted_safe()
        along = np.array(_normal(one))
        if len(corners):
            low, high = (float(limit(corners @ along)) for limit in (np.min, np.max))
            at, by = (float(np.dot(along, vector)) for vector in (
                one.matrix_world.translation, to_world.to_3x3() @ step))  # fmt: skip
            if by and not low <= at + by <= high:
                step *= max(0.0, min(1.0, ((high if by > 0.0 else low) - at) / by))
    one.location = before + step
    return one.location != before


def straight_onto(one, kind: str, matrix: np.ndarray):
    """The rotation of a view that looks straight at a slice as a reading workstation shows it.

    Parameters
    ----------
    kind : {"axial", "coronal", "sagittal"}
        How it lies.
    matrix : (4, 4) ndarray
        From the volume's own space, LPS in a patient, to the world.

    Returns
    -------
    mathutils.Quaternion
        Of the view, which looks along its own -Z with Y up.
    """
    towards, up = (Vector((matrix[:3, :3] @ np.array(axis, np.float64)).tolist()) for axis in SIDES[SIDE_OF[kind]])
    back = _normal(one)
    back = back if back.dot(towards) < 0.0 else -back
    columns = one.matrix_world.to_3x3().col
    upward = max((sign * columns[axis].normalized() for axis in (0, 1) for sign in (-1, 1)), key=up.dot)
    right = upward.cross(back).normalized()
    return Matrix((right, back.cross(right), back)).transposed().to_quaternion()


def crossing(one, other) -> tuple | None:
    """Both ends in the world of the line in which another slice cuts a slice's rectangle; None where it does not."""
    inverse = one.matrix_world.inverted_safe()
    normal = one.matrix_world.to_3x3().transposed() @ _normal(other)  # of the other plane, in the slice's own space
    offset = normal.dot(inverse @ other.matrix_world.translation)
    length = math.hypot(normal.x, normal.y)
    if length <= EDGE_ON * normal.length:
        return None
    ends = []
    for axis, across in ((0, 1), (1, 0)):
        if abs(normal[across]) < 1e-12:
            continue
        for side in (-1.0, 1.0):
            place = Vector((0.0, 0.0, 0.0))
            place[axis] = side
            place[across] = (offset - normal[axis] * side) / normal[across]
            if abs(place[across]) <= 1.0 + 1e-9:
                ends.append(place)
    if len(ends) < 2:
        return None
    pair = max(((a, b) for a in ends for b in ends), key=lambda two: (two[0] - two[1]).length)
    return tuple(one.matrix_world @ end for end in pair)
