"""Every panel and menu of the extension drawn by a real Blender, on a virtual screen, in every state.

dev.py test runs it.  It fails for an exception, and for whatever else Blender prints while it draws: an unknown icon,
property, operator or menu.  Its photographs are to be looked at.
"""

import tempfile
from pathlib import Path

import bpy

from tests.blender.broken_panels import BROKEN, broken_panel
from tests.blender.layout_recorder import shows, subclasses
from tests.blender.panel_states import STATES, add_volume
from tests.blender.window_driver import (
    MODULE,
    area_of,
    drive,
    in_the_view,
    is_kept,
    new_file,
    open_panels,
    passed,
    photograph,
    redraw,
    until,
    wait_for_rest,
    window,
)


def folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="rle_splat_panels_"))


def of_addon(base) -> list:
    return [cls for cls in subclasses(base) if cls.__module__.startswith(MODULE)]


drawn: set = set()  # panels, since it was cleared


def watch_draws() -> None:
    """Have each panel of the add-on put itself into ``drawn``, once it is registered anew."""
    for cls in of_addon(bpy.types.Panel):
        cls.draw = watched(cls, cls.draw)


def watched(cls, draw):
    def draw_and_note(self, context):
        drawn.add(cls)
        draw(self, context)

    return draw_and_note


def shown(name: str):
    """Draw everything without a word from Blender; keep a photograph where one is wanted."""
    yield
    drawn.clear()
    redraw()
    if is_kept(name):
        yield from photograph(name)


def check_state(name: str):
    """Every panel that shows itself is drawn, in both places, without a word from Blender."""
    yield from new_file()
    with in_the_view():
        STATES[name](folder())
    if name == "labels":  # its photograph is compared with the approved one, pictures of presets included
        yield from wait_for_rest()
    yield from shown(name)
    with in_the_view():
        visible = {cls for cls in of_addon(bpy.types.Panel) if shows(cls, bpy.context)}
        assert drawn == {cls for cls in visible if getattr(cls, "bl_context", "") != "data"}


def check_object_data():
    """The panels in Properties > Object Data of a volume."""
    yield from new_file()
    with in_the_view():
        add_volume(folder())
    yield
    area_of("PROPERTIES").spaces.active.context = "DATA"
    yield
    yield from shown("object_data")
    assert {cls for cls in of_addon(bpy.types.Panel) if getattr(cls, "bl_context", "") == "data"} <= drawn


def close_popup():
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type="ESC", value=value)
    yield


def check_saved_picture():
    """Render to Image opens an image editor with what it made."""
    yield from new_file()
    with in_the_view():
        add_volume(folder())
        bpy.ops.rle_splat.render_image("INVOKE_DEFAULT")

    def images():
        areas = [area for window in bpy.context.window_manager.windows for area in window.screen.areas]
        return [area.spaces.active.image for area in areas if area.type == "IMAGE_EDITOR"]

    yield from until(lambda: images() and images() == [bpy.context.scene.rle_splat.image])
    yield from shown("saved_picture")


def check_popups():
    """The menus, and the line in File > Import."""
    yield from new_file()
    with in_the_view():
        add_volume(folder())
    yield
    for name in (*(cls.__name__ for cls in of_addon(bpy.types.Menu)), "TOPBAR_MT_file_import"):
        with in_the_view():
            bpy.ops.wm.call_menu(name=name)
        yield from shown(name)
        yield from close_popup()


def check_preferences():
    """The extension in the preferences, unfolded."""
    yield from new_file()
    bpy.context.preferences.active_section = "ADDONS"
    area_of("VIEW_3D").type = "PREFERENCES"
    bpy.context.window_manager.addon_search = "RLE Splat"
    yield
    bpy.ops.preferences.addon_expand(module=MODULE)
    yield from shown("preferences")


def check_flaws():
    """Each kind of broken panel is noticed, so that the other checks mean something."""
    yield from new_file()
    unnoticed = []
    for flaw in BROKEN:
        with broken_panel(flaw):
            try:
                redraw()
            except AssertionError:
                continue
            unnoticed.append(flaw)
    redraw()
    assert not unnoticed, f"Blender does not complain of panels with these flaws: {unnoticed}"


def scenario():
    watch_draws()
    open_panels()
    for name in STATES:
        yield from check_state(name)
        passed(name)
    for check in (check_object_data, check_saved_picture, check_popups, check_preferences, check_flaws):
        yield from check()
        passed(check.__name__)


drive(scenario, overlap=False)
