"""The volume live in every 3D viewport: handlers that draw it, and the timer that refines it.

Without a visible volume, during a render and in background mode nothing of this runs.
"""

from collections import Counter

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent

from ..data import preferences
from ..data.playback import is_playing
from ..loop import timer, work
from ..messages import tell
from ..render import compositor
from ..scene import render_scene, viewports
from ..translations import filled
from ..volumes import box
from . import ahead, drawing, shown, slice_drawing, slice_places, surface
from .viewport import BITE, Viewport

AFTER_LOCAL = 0.1  # seconds from Blender's own move to Local View until it is corrected

calls: Counter = Counter()  # how often a handler was called ("before", "after"), and how often it went on ("drawn")


class Live:
    """A viewport, and what is held for drawing it.

    ``keys``: of the volumes that it shows.  ``framebuffer``: the viewport's own, during a redraw.  ``placed``: textures
    of the pictures of ``version``.  ``waits``: see ``BlenderSurface``.  ``mesh``: name of one that hides them all.
    ``is_local``: whether the viewport was in Local View.
    """

    def __init__(self):
        self.viewport = Viewport(render_scene.KEPT)
        self.keys, self.framebuffer = (), None
        self.version, self.placed = -1, []
        self.waits: list = []
        self.mesh, self.is_local = "", False


_lives: dict[int, Live] = {}  # by address of the region
_missed: set[int] = set()  # addresses of regions that were drawn without their volumes during a render


@persistent
def _on_update(_scene=None, depsgraph=None):
    """Redraw viewports after an edit, since Blender does not for all that a volume depends on, such as node trees."""
    if _lives and depsgraph is not None and depsgraph.mode != "RENDER" and is_allowed():
        for address in _lives:
            _tag(address)


def _tag(address: int) -> None:
    """Have a region drawn again, unless it was closed."""
    region, _area, _window = surface.region_of(address)
    if region is not None:
        region.tag_redraw()


HANDLERS = (*shown.HANDLERS, ("depsgraph_update_post", _on_update))


def is_allowed() -> bool:
    """Whether viewports may draw volumes now: wanted by the user, not in background mode and not during a render."""
    return preferences.value("show_live") and not (bpy.app.background or bpy.app.is_job_running("RENDER"))


def _volumes_of(context) -> tuple:
    """Keys of the volumes to draw in a viewport; empty at once where the scene has none."""
    if not is_allowed() or not shown.has_volumes(context.scene):
        return ()
    if slice_places.faced_slice(context) is not None:  # whose place in a quad view is for it alone
        return ()
    if shows_last_render(context):  # which would lie under the live picture
        return ()
    return shown.visible_volumes(context.scene, context.view_layer, context.space_data)


def _before() -> None:
    """PRE_VIEW: keep the viewport's framebuffer, which is the one in use, until this redraw ends."""
    calls["before"] += 1
    context = bpy.context
    keys = _volumes_of(context)
    if not keys:
        if bpy.app.is_job_running("RENDER") and preferences.value("show_live") and shown.has_volumes(context.scene):
            _missed.add(context.region.as_pointer())
            timer.start(_tick, timer.PAUSE)
        elif _lives and is_allowed():
            _lives.pop(context.region.as_pointer(), None)  # with its textures
        return
    address = context.region.as_pointer()
    if address not in _lives:
        _forget_closed()
        _lives[address] = Live()
    live = _lives[address]
    was_local, live.is_local = live.is_local, context.space_data.local_view is not None
    if live.is_local and not was_local:
        timer.start(_frame_local, 1e-3 * context.preferences.view.smooth_view + AFTER_LOCAL)
    live.keys, live.framebuffer = keys, gpu.state.active_framebuffer_get()


def _forget_closed() -> None:
    """Drop viewports whose region is not there any more."""
    for address in [address for address in _lives if surface.region_of(address)[0] is None]:
        _lives.pop(address).viewport.stop()


def _after() -> None:
    """POST_VIEW: look at what this redraw shows, and draw the pictures that there are."""
    calls["after"] += 1
    if not _lives:
        return
    context = bpy.context
    live = _lives.get(context.region.as_pointer())
    if live is None or live.framebuffer is None:
        return
    calls["drawn"] += 1
    framebuffer, live.framebuffer = live.framebuffer, None
    viewport = live.viewport
    request = surface.request_of(context, live.keys)
    had = viewport.problem, viewport.waits
    drawn = surface.BlenderSurface(context, request, framebuffer, live.waits)
    viewport.redraw(request, shown.stamp(), drawn, timer.PLAYING if is_playing() else BITE)
    _draw(live, framebuffer)
    _tell_of(viewport, had[0])
    if had[0] != viewport.problem or (had[1] != viewport.waits and not is_playing()):
        _redraw_panels(context.area)
    if viewport.is_busy:
        timer.start(_tick, timer.PAUSE)


def _draw(live: Live, framebuffer) -> None:
    """Draw the pictures; a driver that cannot is a problem of the viewport."""
    viewport = live.viewport
    try:
        if live.version != viewport.version:
            live.placed = [(drawing.texture_of(one), one.place) for one in viewport.pictures]
            live.version = viewport.version
        if live.placed:
            drawing.draw(live.placed, framebuffer)
    except Exception as problem:
        live.placed = []
        viewport.give_up(f"The viewport cannot draw the volume with this graphics driver: {problem}.")


def _tell_of(viewport: Viewport, had: str) -> None:
    if viewport.problem and viewport.problem != had:
        tell(viewport.problem)


def _tick():
    """Timer function: do one step for a viewport."""
    busy = {address: live for address, live in _lives.items() if live.viewport.is_busy}
    if not busy and not _missed:
        return ahead.work(_tick, _views_in_time()) if is_allowed() else None
    if not preferences.value("show_live"):
        _missed.clear()
        for live in busy.values():
            live.viewport.stop()
        return None
    if timer.must_wait():
        for live in busy.values():
            live.viewport.put_off()
        return timer.BUSY
    if is_playing() and work.is_reading():
        for live in busy.values():
            live.viewport.put_off()
    while _missed:
        _tag(_missed.pop())
    if not busy:
        return None
    address, live = min(busy.items(), key=lambda item: item[1].viewport.wait())
    wait = live.viewport.wait()
    if wait > 0.0:
        return wait
    region, area, window = surface.region_of(address)
    if region is None:  # its area was closed, or its screen is not shown
        _forget_closed()
        return timer.PAUSE
    had = live.viewport.problem, live.mesh, remark_of(area)
    if live.viewport.work():
        live.mesh = _find_mesh_before(live, window)
        region.tag_redraw()
        _tell_of(live.viewport, had[0])
        if had != (live.viewport.problem, live.mesh, remark_of(area)):
            _redraw_panels(area)
    return timer.AT_ONCE


def _views_in_time() -> list:
    """(Viewport, volume object, Depsgraph) for all time series that viewports show."""
    found = []
    for address, live in _lives.items():
        owners = [owner for owner in map(shown.find, live.keys) if owner is not None]
        window = surface.region_of(address)[2]
        if window is not None and window.view_layer.depsgraph is not None:
            found += [(live.viewport, owner, window.view_layer.depsgraph) for owner in owners
                      if owner.rle_splat.frame_count > 1]  # fmt: skip
    return found


def _frame_local() -> None:
    """Timer function: frame the volumes in viewports that have just entered Local View, once these stand still."""
    for address, live in _lives.items():
        region, area, _window = surface.region_of(address)
        if region is not None and live.is_local:
            owners = [owner for owner in map(shown.find, live.keys) if owner is not None]
            placed = [(owner, corners) for owner in owners if len(corners := box.world_corners(owner))]
            viewports.frame_if_too_near(area, placed)


def _find_mesh_before(live: Live, window) -> str:
    """Name of a mesh that hides the volumes of a viewport; looked for where its refined pictures are blank."""
    viewport = live.viewport
    is_done = viewport.is_refined and viewport.pictures and not viewport.problem
    if not is_done or any(one.rgba[..., 3].any() for one in viewport.pictures):
        return ""
    owners = [owner for owner in map(shown.find, live.keys) if owner is not None]
    corners = [found for found in map(box.world_corners, owners) if len(found)]
    if not corners or not window.scene.rle_splat.meshes_occlude:
        return ""
    names = viewports.hiding_meshes(window.view_layer, np.concatenate(corners), viewport.eye)
    return names[0] if names else ""


def _redraw_panels(area) -> None:
    for region in area.regions:
        if region.type == "UI":
            region.tag_redraw()


def viewports_of(area) -> list[Viewport]:
    """The viewports of an area that show volumes: one, or up to four in a quad view."""
    addresses = [region.as_pointer() for region in area.regions if region.type == "WINDOW"]
    return [_lives[address].viewport for address in addresses if address in _lives]


def problem_of(area) -> str:
    """Why an area's viewports do not show volumes; "" without a problem."""
    return next((one.problem for one in viewports_of(area) if one.problem), "")


def mesh_before(area) -> str:
    """Name of a mesh that hides all volumes in a viewport of an area; "" without one."""
    addresses = {region.as_pointer() for region in area.regions if region.type == "WINDOW"}
    return next((live.mesh for address, live in _lives.items() if address in addresses and live.mesh), "")


def sentence_of_mesh(area) -> str:
    """Which mesh hides all volumes in a viewport of an area; "" without one."""
    mesh = mesh_before(area)
    return filled("{mesh} hides the volume in this view.", mesh=mesh) if mesh else ""


def shows_last_render(context) -> bool:
    """Whether Blender's viewport compositor puts our picture of the last render into the region that is drawn."""
    shading = context.space_data.shading
    if shading.type not in ("MATERIAL", "RENDERED") or shading.use_compositor == "DISABLED":
        return False
    if shading.use_compositor == "CAMERA" and context.region_data.view_perspective != "CAMERA":
        return False
    return bool(compositor.pictures(context.scene))


def sentence_of_last_render(context) -> str:
    """Why the region that is drawn shows no live volume, where it would but for the last render; else ""."""
    if not (is_allowed() and shown.is_on(context.space_data) and shows_last_render(context)):
        return ""
    return filled(
        "The viewport's compositor shows the volume of the last render. To see it live, disable Compositor in the menu "
        "Viewport Shading."
    )


def remark_of(area) -> str:
    """What differs from the volume in what an area's viewports show; "" for nothing, and while they draw drafts."""
    halvings = max((one.halvings for one in viewports_of(area) if one.is_refined), default=0)
    if not halvings:
        return ""
    return filled(
        "Shown with voxels {times} times as large, because all its voxels need more memory than is free.",
        times=2**halvings,
    )


def try_again(area) -> None:
    """Forget the problems of an area's viewports and draw them anew."""
    for viewport in viewports_of(area):
        viewport.try_again()
    area.tag_redraw()


def stop() -> None:
    """Drop all pictures and work, before another file is opened."""
    for live in _lives.values():
        live.viewport.stop()
    _lives.clear()
    _missed.clear()
    shown.forget()
    ahead.stop()
    timer.stop(_tick)
    timer.stop(_frame_local)


# By names, so that others may be put in their place.
DRAW_HANDLERS = drawing.Handlers((lambda: _before(), "PRE_VIEW"), (lambda: _after(), "POST_VIEW"))


def register():
    slice_drawing.HANDLERS.register()  # first: volumes are drawn over slices
    DRAW_HANDLERS.register()


def unregister():
    DRAW_HANDLERS.unregister()
    slice_drawing.HANDLERS.unregister()
    stop()
    drawing.forget()
