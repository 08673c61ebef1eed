"""The 3D viewports of a window: show a volume that was imported in them, and tell what hides it."""

import math

import bpy
import numpy as np

from . import box
from .settings import scene_scale_of

PANEL = "RLE_SPLAT_PT_volume"  # the first one of the sidebar's tab
HALF_SENSOR = 36.0  # mm: a viewport's lens is one before a sensor of twice this, along its longer side
ROOM = 1.15  # times the sphere around a volume
NEAREST, FURTHEST = 0.01, 100.0  # times the sphere's radius: the clip range reaches from there to there at least
LEAST_CLIP = 1e-6  # Blender's own
SIDEBAR = 280  # pixels at interface scale 1, of one that was never drawn
TAB_WAIT, TAB_TRIES = 0.1, 10  # seconds; a sidebar knows its tabs when it was drawn


def distance_to_fit(radius: float, lens: float, nearer: float, is_perspective: bool) -> float:
    """Return the view distance at which a sphere fits into a viewport.

    Parameters
    ----------
    radius : float
        Of the sphere around the view's pivot, world units.
    lens : float
        Focal length, mm.
    nearer : float
        The shorter side of the part that is free, over the longer side of the region.
    is_perspective : bool
        Or orthographic.

    Returns
    -------
    float
        World units.
    """
    slope = HALF_SENSOR / lens * nearer
    return radius / (math.sin(math.atan(slope)) if is_perspective else slope)


def world_corners(owner, volume, scene) -> np.ndarray:
    """(8, 3) corners of a volume's box in world space."""
    corners = box.corners_of(volume.shape_xyz, volume.affine) * scene_scale_of(scene, volume.unit)
    matrix = np.array(owner.matrix_world)
    return corners @ matrix[:3, :3].T + matrix[:3, 3]


def frame(window, boxes: list[np.ndarray]) -> None:
    """Move the views of a window's 3D viewports so that all of some boxes is seen; views through a camera stay.

    Parameters
    ----------
    window : bpy.types.Window
    boxes : list of (8, 3) ndarray
        Corners in world space.
    """
    corners = np.concatenate(boxes)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    radius = ROOM * float(np.linalg.norm(corners - middle, axis=1).max())
    if not 0.0 < radius < math.inf:
        return
    for area in _viewports(window):
        space = area.spaces.active
        region = next(one for one in area.regions if one.type == "WINDOW")
        if region.width < 1 or region.height < 1:
            continue
        for view in space.region_quadviews or (space.region_3d,):
            if view.view_perspective == "CAMERA":
                continue
            is_perspective = view.view_perspective == "PERSP"
            view.view_location = middle
            nearer = min(region.height, _free_width(area, region)) / max(region.width, region.height)
            view.view_distance = distance_to_fit(radius, space.lens, nearer, is_perspective)
        space.clip_start = max(min(space.clip_start, NEAREST * radius), LEAST_CLIP)
        space.clip_end = max(space.clip_end, FURTHEST * radius)
        area.tag_redraw()


def _free_width(area, region) -> int:
    """Pixels of a viewport between the sidebar, open or about to be, and as much on the other side: the volume stays in
    the middle, about which the view turns; at least half of them."""
    system = bpy.context.preferences.system
    sidebar = next(one for one in area.regions if one.type == "UI")
    covered = sidebar.width if sidebar.width > 1 else round(SIDEBAR * system.ui_scale)
    return max(region.width - 2 * covered, region.width // 2)


def tab() -> str:
    """The name of the extension's tab in the sidebar."""
    return bpy.types.Panel.bl_rna_get_subclass_py(PANEL).bl_category


def open_tab(window) -> None:
    """Open the sidebar of a window's largest 3D viewport at the extension's tab, once it was drawn."""
    areas = _viewports(window)
    if not areas:
        return
    largest = max(areas, key=lambda area: area.width * area.height)
    largest.spaces.active.show_region_ui = True
    place = largest.as_pointer()
    tries = iter(range(TAB_TRIES))

    def choose():
        area = next((one for one in _all_viewports() if one.as_pointer() == place), None)
        if area is None or next(tries, None) is None:
            return None  # it was closed, or is too narrow to be drawn
        sidebar = next(one for one in area.regions if one.type == "UI")
        try:
            sidebar.active_panel_category = tab()
        except TypeError:
            return TAB_WAIT
        return None

    bpy.app.timers.register(choose, first_interval=TAB_WAIT)


def hiding_meshes(view_layer, corners: np.ndarray) -> list[str]:
    """Return the names of the visible meshes whose bounding box contains a box.

    Parameters
    ----------
    view_layer : bpy.types.ViewLayer
    corners : (n, 3) ndarray
        World space.
    """
    found = []
    for one in view_layer.objects:
        if one.type != "MESH" or one.display_type not in ("SOLID", "TEXTURED") or not one.visible_get():
            continue
        matrix = np.array(one.matrix_world)
        if abs(np.linalg.det(matrix[:3, :3])) < 1e-30:
            continue
        inside = (corners - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
        bounds = np.array(one.bound_box)
        if (inside >= bounds.min(axis=0)).all() and (inside <= bounds.max(axis=0)).all():
            found.append(one.name)
    return found


def hiding_sentence(view_layer, corners: np.ndarray) -> str:
    """What to do where a mesh hides a box; "" where none does.  The parameters are those of ``hiding_meshes``."""
    names = hiding_meshes(view_layer, corners)
    return f"It lies inside {names[0]}, which hides it: hide that object, or move one of them." if names else ""


def _viewports(window) -> list:
    """The areas of a window that show a 3D viewport."""
    return [] if window is None else [area for area in window.screen.areas if area.type == "VIEW_3D"]


def _all_viewports() -> list:
    return [area for window in bpy.context.window_manager.windows for area in _viewports(window)]
