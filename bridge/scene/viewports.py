"""The 3D viewports of a window: show a volume that was imported in them, and tell what hides it."""

import math

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector

from ...rle_splat.scene import RleSplatError
from ..live.view import eye_of
from ..loop import timer
from ..translations import filled

PANEL = "RLE_SPLAT_PT_volume"  # the first one of the sidebar's tab
HALF_SENSOR = 36.0  # mm: a viewport's lens is one before a sensor of twice this, along its longer side
ROOM = 1.15  # times the sphere around a volume
BESIDE = 1.1  # times a box that is seen from a side
RIGHT_VIEWS = (2, 3)  # of a quad view, where the sidebar is
NEAREST, FURTHEST = 0.01, 100.0  # times the sphere's radius: the clip range reaches from there to there at least
LEAST_CLIP = 1e-6  # Blender's own
SIDEBAR = 280  # pixels at interface scale 1, of one that was never drawn
# A side of a patient -> where a view from there looks and what is up in it, in LPS (+X left, +Y back, +Z head).  In
# views along the body the front is up.
SIDES = {
    "A": ((0, 1, 0), (0, 0, 1)), "P": ((0, -1, 0), (0, 0, 1)), "L": ((-1, 0, 0), (0, 0, 1)),
    "R": ((1, 0, 0), (0, 0, 1)), "S": ((0, 0, -1), (0, -1, 0)), "I": ((0, 0, 1), (0, -1, 0)),
}  # fmt: skip
SAME_PLACE, TOO_NEAR = 1e-3, 0.5  # of a volume's longest side: a view at its origin that shows a part of it
FAR = 1e30  # world units; Blender takes no infinite distance
TAB_WAIT, TAB_TRIES = 0.1, 10  # seconds; a sidebar knows its tabs when it was drawn


def distance_to_fit(radius: float, lens: float, free: float, is_perspective: bool) -> float:
    """Return the view distance at which a sphere fits into a viewport.

    Parameters
    ----------
    radius : float
        Of the sphere around the view's pivot, world units.
    lens : float
        Focal length, mm.
    free : float
        The shorter side of the part that is free, over the longer side of the region.
    """
    slope = HALF_SENSOR / lens * free
    return radius / (math.sin(math.atan(slope)) if is_perspective else slope)


def distance_to_box(corners: np.ndarray, view, lens: float, free: tuple) -> float:
    """Return the view distance at which a box around a view's pivot fits into a viewport, as it is seen from there.

    Parameters
    ----------
    corners : (8, 3) ndarray
        From the pivot, world units.
    view : bpy.types.RegionView3D
        Its rotation and its projection count.
    lens : float
        Focal length, mm.
    free : (float, float)
        Width and height of the part that is free, over the longer side of the region.
    """
    across, up, deep = np.abs(corners @ np.array(view.view_rotation.to_matrix())).max(axis=0)
    distance = BESIDE * max(across / free[0], up / free[1]) * lens / HALF_SENSOR
    return distance + (deep if view.view_perspective == "PERSP" else 0.0)


def rotation_from(side: str, matrix: np.ndarray) -> Quaternion:
    """Return the rotation of a view that looks at a patient from one side.

    Parameters
    ----------
    matrix : (4, 4) ndarray
        From the volume's own space, LPS, to the world.

    Returns
    -------
    mathutils.Quaternion
        Of the view: it looks along its own -Z, and its Y points up.
    """
    towards, up = (matrix[:3, :3] @ np.array(axis, np.float64) for axis in SIDES[side])
    back = -towards / np.linalg.norm(towards)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return Matrix(np.stack((right, np.cross(back, right), back), axis=1).tolist()).to_quaternion()


def frame(window, boxes: list[np.ndarray], rotation: Quaternion | None = None) -> None:
    """Move the views of a window's 3D viewports so that all of some boxes is seen; views through a camera stay.

    Parameters
    ----------
    boxes : list of (8, 3) ndarray
        Corners in world space.
    rotation : mathutils.Quaternion, optional
        Of the views, but those of a quad view; by default each keeps its own.
    """
    for area in areas_of(window):
        frame_area(area, boxes, rotation)


def frame_area(area, boxes: list[np.ndarray], rotation: Quaternion | None = None) -> None:
    """``frame`` for one 3D viewport."""
    corners = np.concatenate(boxes)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    radius = ROOM * float(np.linalg.norm(corners - middle, axis=1).max())
    if not 0.0 < radius < math.inf:
        return
    space = area.spaces.active
    free = _free_shares(area)
    for view in space.region_quadviews or (space.region_3d,):
        if view.view_perspective == "CAMERA":
            continue
        view.view_location = middle
        if rotation is not None and not space.region_quadviews:
            view.view_rotation = rotation
            view.view_distance = distance_to_box(corners - middle, view, space.lens, free)
        else:  # with room to turn
            is_perspective = view.view_perspective == "PERSP"
            view.view_distance = distance_to_fit(radius, space.lens, min(free), is_perspective)
    space.clip_start = max(min(space.clip_start, NEAREST * radius), LEAST_CLIP)
    space.clip_end = max(space.clip_end, FURTHEST * radius)
    area.tag_redraw()


def frame_if_too_near(area, placed: list) -> None:
    """Frame volumes in a viewport that Blender has moved to the origin of one: it knows Empties as points.

    Parameters
    ----------
    placed : list of (bpy.types.Object, ndarray of shape (8, 3))
        Volume objects, and the corners of their boxes in world space.
    """
    view = area.spaces.active.region_3d
    for owner, corners in placed:
        size = float(np.ptp(corners, axis=0).max())
        apart = float(np.linalg.norm(np.array(view.view_location) - np.array(owner.matrix_world.translation)))
        if apart < SAME_PLACE * size and view.view_distance < TOO_NEAR * size:
            frame_area(area, [box for _owner, box in placed])
            return


def _free_shares(area) -> tuple[float, float]:
    """Width and height of the free part of a viewport, over the longer side of the whole; halves if it was never drawn.

    What is free lies between the sidebar, open or about to be, and as much on the other side, since the volume stays in
    the middle, about which the view turns; it is at least half of the width.
    """
    region = next(one for one in area.regions if one.type == "WINDOW")
    if min(region.width, region.height) <= 1:
        return 0.5, 0.5
    width, longer = max(region.width - 2 * _covered(area), region.width // 2), max(region.width, region.height)
    return width / longer, region.height / longer


def _covered(area) -> int:
    """Pixels of a viewport's width that its sidebar, open or about to be, lies over."""
    sidebar = next(one for one in area.regions if one.type == "UI")
    return sidebar.width if sidebar.width > 1 else round(SIDEBAR * bpy.context.preferences.system.ui_scale)


def frame_quad(area, corners: np.ndarray) -> None:
    """Move the views of a quad view so that a box is seen beside the sidebar.

    It fills the orthographic views; the view in perspective has room to turn.

    Parameters
    ----------
    corners : (8, 3) ndarray
        World space.
    """
    space = area.spaces.active
    width, height = 0.5 * area.width, 0.5 * area.height
    covered = _covered(area) if space.show_region_ui and bpy.context.preferences.system.use_region_overlap else 0
    free = max(width - covered, 0.5 * width)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    radius = ROOM * float(np.linalg.norm(corners - middle, axis=1).max())
    slope, longer = HALF_SENSOR / space.lens, max(width, height)
    for number, view in enumerate(space.region_quadviews):
        if view.view_perspective == "PERSP":
            view.view_distance = distance_to_fit(radius, space.lens, min(free, height) / longer, True)
        else:
            view.view_distance = distance_to_box(corners - middle, view, space.lens, (free / longer, height / longer))
        across = 2.0 * slope * view.view_distance / longer  # world units of a pixel at the pivot
        right = view.view_rotation @ Vector((1.0, 0.0, 0.0))
        is_right = number in RIGHT_VIEWS
        view.view_location = Vector(middle) + right * (0.5 * (width - free) * across if is_right else 0.0)
    area.tag_redraw()


def tab() -> str:
    """The name of the extension's tab in the sidebar."""
    return bpy.types.Panel.bl_rna_get_subclass_py(PANEL).bl_category


def open_tab(window) -> None:
    """Open the sidebar of a window's largest 3D viewport at the extension's tab, once it was drawn."""
    areas = areas_of(window)
    if not areas:
        return
    largest = max(areas, key=lambda area: area.width * area.height)
    largest.spaces.active.show_region_ui = True
    place = largest.as_pointer()
    tries = iter(range(TAB_TRIES))

    def choose():
        area = next((one for one in all_areas() if one.as_pointer() == place), None)
        if area is None or next(tries, None) is None:
            return None  # it was closed, or is too narrow to be drawn
        sidebar = next(one for one in area.regions if one.type == "UI")
        try:
            sidebar.active_panel_category = tab()
        except TypeError:
            return TAB_WAIT
        return None

    timer.start(choose, TAB_WAIT)


def hiding_meshes(view_layer, corners: np.ndarray, eye=None) -> list[str]:
    """Return the names of the visible meshes that hide a box.

    Parameters
    ----------
    corners : (n, 3) ndarray
        Of the box, world space.
    eye : (4,) array_like, optional
        Homogeneous, see ``eye_of``: a mesh that meets all rays from it to the corners and the middle hides the box.
        Without an eye, a mesh whose bounding box contains the box does.
    """
    found = []
    for one in view_layer.objects:
        if one.type != "MESH" or one.display_type not in ("SOLID", "TEXTURED") or not one.visible_get():
            continue
        matrix = np.array(one.matrix_world)
        if abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
            continue
        inside, bounds = (corners - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T, np.array(one.bound_box)
        if eye is None:
            hides = (inside >= bounds.min(axis=0)).all() and (inside <= bounds.max(axis=0)).all()
        else:
            points = np.concatenate((inside, inside.mean(axis=0, keepdims=True)))
            hides = _meets_all(one.evaluated_get(view_layer.depsgraph), np.linalg.solve(matrix, eye), points)
        if hides:
            found.append(one.name)
    return found


def _meets_all(evaluated, eye: np.ndarray, points: np.ndarray) -> bool:
    """Whether a mesh meets the rays from an eye to some points, all in its own space."""
    for point in points:
        towards = eye[:3] - eye[3] * point  # to the eye, of any length for an eye at infinity
        length = float(np.linalg.norm(towards))
        if not 0.0 < length < math.inf:
            return False
        reach = length if eye[3] else math.inf
        if not evaluated.ray_cast(Vector(point), Vector(towards / length), distance=min(reach, FAR))[0]:
            return False
    return True


def hiding_sentence(view_layer, corners: np.ndarray, eye=None) -> str:
    """What to do where a mesh hides a box; "" where none does.  The parameters are those of ``hiding_meshes``."""
    names = hiding_meshes(view_layer, corners, eye)
    return filled("{mesh} hides it: hide that object, or move one of them.", mesh=names[0]) if names else ""


def view_of(context) -> tuple[np.ndarray, np.ndarray | None]:
    """The view of the 3D viewport that an operator is called in, or of the window's largest one.

    Parameters
    ----------
    context : bpy.types.Context
        The context.  In background mode, where nobody sees a viewport, the view is that of the scene's active camera.

    Returns
    -------
    matrix : ndarray, shape (4, 4), float64
        View space to the world.  The view looks along its own -Z, and its Y points up.
    pivot : ndarray, shape (3,), float64, or None
        The point about which the view turns, in the world; None for a view through a camera.

    Raises
    ------
    RleSplatError
        Without a viewport and a camera.
    """
    is_seen = not bpy.app.background
    region, areas = (context.region_data, areas_of(context.window)) if is_seen else (None, [])
    if region is None and areas:
        region = max(areas, key=lambda area: area.width * area.height).spaces.active.region_3d
    if region is not None:
        pivot = None if region.view_perspective == "CAMERA" else np.array(region.view_location, dtype=np.float64)
        return np.array(region.view_matrix.inverted(), dtype=np.float64), pivot
    if context.scene.camera is None:
        raise RleSplatError("There is no 3D viewport and no active camera, so no view; add a camera.")
    return np.array(context.scene.camera.matrix_world, dtype=np.float64), None


def eyes_of(window) -> list:
    """``eye_of`` of the 3D viewports of a window, or of None, as they are drawn next; not of views through a camera."""
    found = []
    for area in areas_of(window):
        view = area.spaces.active.region_3d
        if view.view_perspective != "CAMERA":
            placed = Matrix.Translation(view.view_location) @ view.view_rotation.to_matrix().to_4x4()
            moved = placed @ Matrix.Translation((0.0, 0.0, view.view_distance))
            found.append(eye_of(moved.inverted(), view.view_perspective == "PERSP"))
    return found


def show_textures(window) -> None:
    """Have the 3D viewports of a window, or of None, show image textures in Solid shading."""
    for area in areas_of(window):
        area.spaces.active.shading.color_type = "TEXTURE"


def has_viewport(window) -> bool:
    """Whether a window, or None, shows a 3D viewport."""
    return len(areas_of(window)) > 0


def areas_of(window) -> list:
    """The areas of a window, or of None, that are 3D viewports."""
    return [] if window is None else [area for area in window.screen.areas if area.type == "VIEW_3D"]


def all_areas() -> list:
    """Those of all windows."""
    return [area for window in bpy.context.window_manager.windows for area in areas_of(window)]
