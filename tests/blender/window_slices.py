"""Slices in a real window, by a mouse: true grays in Solid shading, the four-up view, the wheel, and a window of their
own by dragging.  dev.py test runs it; its photographs are to be looked at."""

import os
import tempfile
from pathlib import Path

import addon_utils
import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from tests.blender import scenes
from tests.blender.real_blender import MODULE
from tests.blender.scenes import module
from tests.blender.window_driver import (
    SHOTS,
    TAB,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    region_of,
    until,
    window,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_slices_"))
N = 24  # voxels a side
GRAY = 150  # value of the lower half, in a window from 0 to 255
KINDS = ("axial", "coronal", "sagittal")


def slices() -> dict:
    return {one.rle_splat.slice_kind: one for one in bpy.data.objects if one.rle_splat.is_slice}


def settled():
    live = module("bridge.live")
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    yield from until(lambda: not any(one.is_busy for one in live.viewports_of(area_of("VIEW_3D"))))
    yield


def regions() -> list:
    """The regions of the quad view that show a slice, by its kind, with their views."""
    area = area_of("VIEW_3D")
    views = area.spaces.active.region_quadviews
    found = {}
    for region, view in zip([one for one in area.regions if one.type == "WINDOW"], views):
        ahead = np.array(view.view_rotation.to_matrix())[:, 2]
        for kind, one in slices().items():
            normal = np.array(one.matrix_world.to_3x3().col[2].normalized())
            if not view.is_perspective and abs(ahead @ normal) > 0.999:
                found[kind] = region
    return found


def send(kind: str, place, value: str = "PRESS", **keys) -> None:
    window().event_simulate(type=kind, value=value, x=int(place[0]), y=int(place[1]), **keys)


def middle(region) -> np.ndarray:
    """A pixel near the middle of a region that the sidebar does not cover."""
    return np.array([region.x + 2 * region.width // 5, region.y + region.height // 2 + 17])


def set_up():
    open_panels(*(f"RLE_SPLAT_PT_{name}" for name in ("volume", "slices", "display", "shading", "render", "picture")))
    yield from new_file()
    z, y, x = np.mgrid[:N, :N, :N]
    inside = (x - 11.5) ** 2 + (y - 11.5) ** 2 + (z - 11.5) ** 2 < 120.0
    voxels = np.where(inside, GRAY + 2 * x + y, 0).astype(np.uint8)
    with in_the_view():
        owner = scenes.import_raw(FOLDER, voxels, name="head")
        assert bpy.ops.rle_splat.reload_volume(orientation="LPS") == {"FINISHED"}
        scenes.load_color(FOLDER, (0.8, 0.45, 0.3), alpha=0.5)
    bpy.ops.ed.undo_push(message="start")
    yield from settled()
    return owner.name


def check_four_up(name):
    """One button: three slices face their views as grays of the window, without the volume before them."""
    scenes.activate(bpy.data.objects[name])
    with in_the_view():
        assert bpy.ops.rle_splat.four_up_view("EXEC_DEFAULT", True) == {"FINISHED"}
    yield from settled()
    bpy.data.objects[name].rle_splat.slice_center = 127.5
    bpy.data.objects[name].rle_splat.slice_width = 255.0
    scenes.activate(bpy.data.objects[name])
    yield from settled()
    assert not area_of("VIEW_3D").spaces.active.overlay.show_text, "Blender's names of the views, which are the world's"
    letters = module("bridge.live.letters")
    drawn, draw = [], letters.blf.draw
    letters.blf.draw = lambda font, text: drawn.append((bpy.context.region.as_pointer(), text)) or draw(font, text)
    yield from photograph("four_up")
    letters.blf.draw = draw
    print(f"texts of the views: {sorted({text for _, text in drawn})}", flush=True)
    for place, sides in (("Axial, S 12.0 mm", "RLAP"), ("Coronal, P 12.0 mm", "RLSI"), ("Sagittal, L 12.0 mm", "APSI")):
        (region,) = {region for region, text in drawn if text == place}
        assert {text for one, text in drawn if one == region} == {place, *sides}, "no side that the view looks along"
    assert set(regions()) == set(KINDS) and len(slices()) == 3
    # None lies under the sidebar.
    area, owner = area_of("VIEW_3D"), bpy.data.objects[name]
    sidebar = next(one for one in area.regions if one.type == "UI")
    corners = module("bridge.volumes.box").world_corners(owner)
    views = area.spaces.active.region_quadviews
    for region, view in zip([one for one in area.regions if one.type == "WINDOW"], views):
        places = [location_3d_to_region_2d(region, view, Vector(corner)) for corner in corners]
        assert all(0.0 < place.y < region.height for place in places), places
        assert all(0.0 < place.x and region.x + place.x < sidebar.x for place in places), (region.x, sidebar.x, places)


def check_true_gray(name):
    """In Solid shading a slice has the gray of its values, whatever lights the viewport."""
    space = area_of("VIEW_3D").spaces.active
    region = regions()["axial"]
    at = middle(region)
    seen = {}
    for light in ("STUDIO", "FLAT"):
        space.shading.light = light
        yield from settled()
        yield from photograph(f"gray_{light.lower()}", looked_at=True)
        picture = scenes.load_pixels(Path(os.environ[SHOTS]) / f"gray_{light.lower()}.png")
        seen[light] = np.rint(255.0 * picture[picture.shape[0] - 1 - at[1], at[0], :3])
    print(f"gray at {at}: {seen}", flush=True)
    values = scenes.image_pixels(slices()["axial"].rle_splat.slice_image)[..., 0]
    srgb = 255.0 * np.where(values <= 0.0031308, 12.92 * values, 1.055 * np.maximum(values, 1e-9) ** (1 / 2.4) - 0.055)
    for color in seen.values():
        assert np.ptp(color) <= 1 and np.abs(srgb - color[0]).min() <= 1.0, color
    assert np.abs(np.subtract(*seen.values())).max() <= 1
    space.shading.light = "STUDIO"


def check_value(name):
    """Over a slice the tool tells the slice's value, and not that of the surface before it."""
    at = middle(regions()["axial"])
    for by in range(2):
        send("MOUSEMOVE", at + by, "NOTHING")
        yield
    probe = module("bridge.look.probe")
    line = probe.hovered(area_of("VIEW_3D"))
    assert probe.hovered_slice(area_of("VIEW_3D")) == slices()["axial"].session_uid
    yield from photograph("value")
    print(f"over the slice: {line}", flush=True)
    value, voxel = line.split(", ")[:2]
    x, y, z = (int(number) for number in voxel.split()[1:])
    assert z == N // 2 and abs(float(value) - (GRAY + 2 * x + y)) <= 1.5, line  # half a voxel along x and y


def check_wheel(name):
    """The wheel over a slice moves that one by a layer; undo brings it back; elsewhere it zooms."""
    before = {kind: one.matrix_world.translation.copy() for kind, one in slices().items()}
    at = middle(regions()["coronal"])
    send("MOUSEMOVE", at, "NOTHING")
    yield
    for _ in range(3):
        send("WHEELUPMOUSE", at)
        yield
    yield from settled()
    yield from photograph("wheel")
    moved = {kind: (one.matrix_world.translation - before[kind]).length for kind, one in slices().items()}
    print(f"moved {moved}", flush=True)
    np.testing.assert_allclose([moved[kind] for kind in KINDS], (0.0, 3.0, 0.0), atol=1e-4)


def check_drag(name):
    """A drag over a slice changes the slices' window and not the volume's."""
    properties = bpy.data.objects[name].rle_splat
    before = properties.window_center, properties.window_width, properties.slice_center, properties.slice_width
    at = middle(regions()["sagittal"])
    send("MOUSEMOVE", at, "NOTHING")
    yield
    send("LEFTMOUSE", at)
    yield
    for step in range(1, 6):
        send("MOUSEMOVE", at + (12 * step, 8 * step), "NOTHING")
        yield
    send("LEFTMOUSE", at + (60, 40), "RELEASE")
    yield from settled()
    yield from photograph("dragged")
    properties = bpy.data.objects[name].rle_splat
    after = properties.window_center, properties.window_width, properties.slice_center, properties.slice_width
    print(f"windows before {before}, after {after}", flush=True)
    assert after[:2] == before[:2] and after[2] > before[2] and after[3] > before[3]


def check_back(name):
    """The same button leaves the quad view, and the volume is shown with its slices again."""
    scenes.activate(bpy.data.objects[name])
    with in_the_view():
        assert bpy.ops.rle_splat.four_up_view("EXEC_DEFAULT", True) == {"FINISHED"}
    assert area_of("VIEW_3D").spaces.active.overlay.show_text, "as before"
    yield from settled()
    bpy.data.objects[name].rle_splat.slices_clear_black = True
    yield from settled()
    view = area_of("VIEW_3D").spaces.active
    assert view.region_3d.is_perspective
    view.show_object_viewport_volume = False
    yield
    yield from photograph("clear_black")
    assert not len(area_of("VIEW_3D").spaces.active.region_quadviews)


def check_eye_closed(name):
    """With the volume's eye closed, slices and the screen have another window after two turns of Blender's loop."""
    assert not area_of("VIEW_3D").spaces.active.show_object_viewport_volume
    gray = {"before": [], "after": []}
    for state, means in gray.items():
        yield from photograph(f"eye_closed_{state}", looked_at=True)
        picture = scenes.load_pixels(Path(os.environ[SHOTS]) / f"eye_closed_{state}.png")
        means += [scenes.image_pixels(one.rle_splat.slice_image)[..., 0].mean() for one in slices().values()]
        means.append(picture[..., 0].mean())
        if state == "before":
            bpy.data.objects[name].rle_splat.slice_center -= 60.0
            yield
            yield
    print(f"mean grays of the slices and the screen: {gray}", flush=True)
    assert (np.subtract(gray["after"][:3], gray["before"][:3]) > 0.02).all()
    assert gray["after"][3] > gray["before"][3] + 0.002, "the screen shows it, too"


def check_display(name):
    """A MIP begins with grays that suit it, on black, beside a scale bar and a color bar; the cut is switched off."""
    properties, space = bpy.data.objects[name].rle_splat, area_of("VIEW_3D").spaces.active
    space.show_object_viewport_volume = True
    for one in slices().values():
        one.hide_set(True)
    scenes.activate(bpy.data.objects[name])
    bpy.context.scene.rle_splat.show_scale_bar = bpy.context.scene.rle_splat.show_color_bar = True
    properties.display = "mip"
    with in_the_view():
        assert bpy.ops.rle_splat.plain_background() == {"FINISHED"}
    yield from settled()
    yield from photograph("mip_on_black", looked_at=True)
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    picture = scenes.load_pixels(Path(os.environ[SHOTS]) / "mip_on_black.png")[::-1]
    scale = bpy.context.preferences.system.ui_scale
    low, high = (region.y + round(height * scale) for height in (62.0, 218.0))
    bar = picture[low:high, region.x + round(76.0 * scale), :3]
    assert np.ptp(bar) > 0.8 and (np.diff(bar[:, 0]) >= -0.01).all(), "no color bar from black to white"
    properties.display = "composite"
    yield from settled()
    yield from photograph("shaded_again")


def check_tab():
    """After the extension was installed its tab is open; at the next start it is not opened again."""
    space, sidebar = area_of("VIEW_3D").spaces.active, region_of(area_of("VIEW_3D"), "UI")
    yield from until(lambda: sidebar.active_panel_category == TAB)
    yield from photograph("installed")
    assert space.show_region_ui
    space.show_region_ui = False
    addon_utils.disable(MODULE)  # the preferences stay, as from one start to the next
    addon_utils.enable(MODULE)
    show_once = module("operators.show_tab").show_once
    due = module("bridge.loop.timer")._due
    assert show_once in due, "each start looks whether it was opened"
    yield from until(lambda: show_once not in due)
    assert not space.show_region_ui


def scenario():
    yield from check_tab()
    passed("check_tab")
    name = yield from set_up()
    for check in (
        check_four_up,
        check_true_gray,
        check_value,
        check_wheel,
        check_drag,
        check_back,
        check_eye_closed,
        check_display,
    ):
        yield from check(name)
        passed(check.__name__)


drive(scenario)
