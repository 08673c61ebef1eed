"""The value under the mouse: the first visible surface of the volumes along a ray, as a line of text."""

import math
from typing import NamedTuple

import numpy as np
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d
from mathutils import Vector

from ...rle_splat.pipeline.first_surface import Surface, find_surface
from ...rle_splat.scene import Camera, RleSplatError, Scene
from ...rle_splat.volume.orientation import LETTERS
from ...rle_splat.volume.volume import PATIENT
from ..live.surface import clip_of
from ..scene import clip_objects, render_scene
from ..scene.callouts import MARK
from ..volumes import loading, volumes

ANY_VIEW = Camera(), 1, 1  # a ray needs no camera
PASSED = 1e-6  # of the way to a mesh that hides nothing: so far behind it the ray goes on
MOST_PASSED = 16  # meshes that hide nothing
DIGITS = 4  # of a value, relative to the range of the volume's values

NOTHING = "Nothing visible under the mouse"
NOT_READ = "The volume is not in memory yet"


class Ray(NamedTuple):
    """A ray in world space, followed from ``nearest`` to ``furthest`` world units from its origin."""

    origin: tuple
    direction: tuple
    nearest: float = 0.0
    furthest: float = math.inf


class ProbeHit(NamedTuple):
    """The surface that a ray meets first, its volume object, and the scene that it was found in."""

    surface: Surface
    owner: object
    plain: Scene


def ray_under(context, mouse) -> Ray:
    """The ray through the middle of a pixel of a 3D viewport.

    Parameters
    ----------
    context : bpy.types.Context
        Of the viewport's window region.
    mouse : (x, y)
        Pixel, from the region's lower left.
    """
    region, view = context.region, context.region_data
    place = mouse[0] + 0.5, mouse[1] + 0.5
    origin = region_2d_to_origin_3d(region, view, place, clamp=0.0)
    direction = region_2d_to_vector_3d(region, view, place)
    if not view.is_perspective and view.view_perspective != "CAMERA":
        return Ray(tuple(origin), tuple(direction), -math.inf)  # such a view shows what is behind its origin, too
    ahead = -(view.view_matrix @ origin).z
    along = -(view.view_matrix.to_3x3() @ direction).z  # depth for each world unit
    begin, end = clip_of(context, context.space_data, view)
    return Ray(tuple(origin), tuple(direction), (begin - ahead) / along, (end - ahead) / along)


def visible_owners(context) -> list:
    """The volume objects that are visible in a viewport, live or not; without one, in the view layer."""
    space, where = context.space_data, {"view_layer": context.view_layer}
    if space is not None and space.type == "VIEW_3D":
        where["viewport"] = space
    return [owner for owner in volumes.volume_objects(context.scene) if owner.visible_get(**where)]


def look_along(context, depsgraph, ray: Ray, owners) -> ProbeHit | None:
    """Find the first visible surface of volumes along a ray; RleSplatError as ``render_scene.seen_by``.

    Returns
    -------
    ProbeHit or None
        None if nothing is visible before the first mesh.
    """
    furthest = ray.furthest
    if context.scene.rle_splat.meshes_occlude:
        furthest = min(furthest, _mesh_distance(context.scene, depsgraph, ray))
    nearest = None
    for owner in owners:
        plain = render_scene.seen_by(owner, depsgraph, ANY_VIEW, with_shadows=False)
        surface = find_surface(plain, ray.origin, ray.direction, ray.nearest, furthest)
        if surface is not None and (nearest is None or surface.distance < nearest.surface.distance):
            nearest = ProbeHit(surface, owner, plain)
    return nearest


def _mesh_distance(scene, depsgraph, ray: Ray) -> float:
    """World length from the ray's origin to the first mesh that hides what is behind it; inf without one."""
    begin = ray.nearest if math.isfinite(ray.nearest) else -_reach(depsgraph, ray)
    clips = clip_objects.clip_objects(scene)
    origin, direction = Vector(ray.origin), Vector(ray.direction)
    for _ in range(MOST_PASSED):
        hit, place, _normal, _index, one, _matrix = scene.ray_cast(depsgraph, origin + begin * direction, direction)
        if not hit:
            break
        distance = (place - origin).dot(direction)
        is_solid = one.display_type in ("SOLID", "TEXTURED") and MARK not in one
        if is_solid and one.original not in clips:
            return distance
        begin = distance + PASSED * max(abs(distance - begin), abs(distance))
    return math.inf


def _reach(depsgraph, ray: Ray) -> float:
    """World length from the ray's origin within which all objects of the scene lie."""
    corners = [np.array(one.matrix_world) @ np.array([(*c, 1.0) for c in one.bound_box]).T
               for one in depsgraph.objects if one.type == "MESH"]  # fmt: skip
    if not corners:
        return 0.0
    return float(np.linalg.norm(np.concatenate(corners, axis=1)[:3].T - ray.origin, axis=1).max())


def line_under(context, mouse) -> str:
    """What lies under the mouse in a viewport, for people; "" in a viewport without volumes."""
    owners = visible_owners(context)
    if not owners:
        return ""
    depsgraph = context.evaluated_depsgraph_get()
    if not all(loading.is_at_hand(owner, depsgraph) for owner in owners):
        return NOT_READ
    try:
        found = look_along(context, depsgraph, ray_under(context, mouse), owners)
    except RleSplatError as problem:
        return str(problem)
    return NOTHING if found is None else line_of(found, len(owners) > 1)


def line_of(found: ProbeHit, with_name: bool = False) -> str:
    """A surface as a line: value, voxel, position, label, and the volume's name if there are several.

    For example "312 HU, voxel 120 88 41, L 12.3 P 45.0 S 88.1 mm, Liver".
    """
    surface, volume = found.surface, found.plain.volume
    x, y, z = (int(n) for n in np.rint(surface.index))
    parts = [
        value_text(surface.value, *volume.value_range, volume.value_unit or ""), f"voxel {x} {y} {z}",
        position_text(surface.position, volume),
    ]  # fmt: skip
    if surface.label is not None:
        parts.append(found.plain.labels.names.get(surface.label, f"Segment {surface.label}"))
    if with_name:
        parts.append(found.owner.name)
    return ", ".join(parts)


def value_text(value: float, low: float, high: float, unit: str = "") -> str:
    """A value and its unit; see ``number_text``."""
    text = number_text(value, low, high, unit)
    return f"{text} {unit}" if unit else text


def number_text(value: float, low: float, high: float, unit: str = "") -> str:
    """A value with as many decimals as the range of values from ``low`` to ``high`` needs; whole numbers of HU."""
    span = 10.0**DIGITS if unit == "HU" else abs(high - low)
    text = f"{value:.{min(max(DIGITS - 1 - math.floor(math.log10(span)), 0), 9)}f}" if span > 0.0 else f"{value:g}"
    return text.removeprefix("-") if not text.strip("-0.") else text  # no minus before a zero


def position_text(position, volume, axes=(0, 1, 2)) -> str:
    """A point of a volume's own space, some of its axes; a patient's with letters of the sides, such as "L 12.3 mm"."""
    position = [float(value) for value in position]
    if volume.space == PATIENT:
        signed = [(letters[value >= 0.0], abs(value)) for letters, value in zip(LETTERS, position)]
    else:
        signed = list(zip("xyz", position))
    # Adding zero takes the minus from a zero.
    texts = [f"{name} {round(value, 1) + 0.0:.1f}" for name, value in signed]
    return " ".join(texts[axis] for axis in axes) + f" {volume.unit}"


_hovered: dict = {}  # address of an area -> what lies under the mouse in it: a line, session id of a slice or 0
_watched: list = []  # at most the address of the area whose mouse is followed, until it leaves


def hovered(area) -> str:
    """What lay under the mouse when it moved last over an area; "" if it has not."""
    return _hovered.get(area.as_pointer(), ("", 0))[0]


def hovered_slice(area) -> int:
    """Session id of the slice that lay under the mouse when it moved last over an area; 0 elsewhere."""
    return _hovered.get(area.as_pointer(), ("", 0))[1]


def hover(context, line: str, one) -> None:
    """Note what lies under the mouse, a line and a slice or None, and redraw the header that shows it."""
    address, now = context.area.as_pointer(), (line, one.session_uid if one is not None else 0)
    if _hovered.get(address) != now:
        _hovered.clear()  # the mouse is over one area at a time
        _hovered[address] = now
        redraw(context.area)


def redraw(area) -> None:
    """Redraw the header of an area that tells what lies under the mouse."""
    for region in area.regions:
        if region.type == "TOOL_HEADER":
            region.tag_redraw()


def watch(area) -> None:
    """Note that the mouse is followed in an area, or, for None, nowhere."""
    _watched[:] = [] if area is None else [area.as_pointer()]


def is_watched(area) -> bool:
    """Whether the mouse is followed in an area."""
    return area.as_pointer() in _watched


def forget() -> None:
    """Forget what lay under the mouse."""
    _hovered.clear()
