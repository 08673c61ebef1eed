"""What a user does in a window, for scenarios of window_driver.py: waits for the viewport, drags, presses keys."""

import bpy

from tests.blender.scenes import module
from tests.blender.window_driver import area_of, drawn, is_at_rest, region_of, until, window

OUR_IMPORTS = 2  # the last entries of File > Import: files, a DICOM folder
# Pixels from the left and the upper edge of the window: File in the top bar, and on the way to Import in its menu.
FILE_TO_IMPORT = ((42, 14), (70, 290), (76, 311))
STEP = 16  # pixels between rows of the sidebar that are hovered over: a button has 20
FROM_EDGE = 45, 75, 105  # pixels from the right edge of the sidebar, where the buttons of a row are


def live():
    return module("bridge.live")


def viewport():
    return next(iter(live().viewports_of(area_of("VIEW_3D"))), None)


def settled():
    """Until the viewport has refined what it shows."""
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    yield from until(lambda: viewport() is not None and not viewport().is_busy)
    yield


def refined():
    """Until the viewport has its refined picture and the add-on nothing to do, in ten turns of the window: on a busy
    machine Blender brings the last changes late."""
    rests = 0

    def has_rested() -> bool:
        nonlocal rests
        shown = viewport()
        rests = rests + 1 if shown is not None and shown.is_refined and not shown.is_busy and is_at_rest() else 0
        return rests == 10

    yield from settled()
    yield from until(has_rested)
    yield from drawn()


def middle(right=0.0, up=0.0):
    """The window's pixel in the middle of the viewport, and beside it in pixels."""
    region = region_of(area_of("VIEW_3D"), "WINDOW")
    return region.x + region.width * 0.35 + right, region.y + region.height * 0.5 + up


def simulate(kind, value, at):
    window().event_simulate(type=kind, value=value, x=int(at[0]), y=int(at[1]))


def drag(button, begin, steps):
    """Press a button, move in steps of pixels, and release it."""
    simulate("MOUSEMOVE", "NOTHING", begin)
    yield
    simulate(button, "PRESS", begin)
    yield
    at = begin
    for right, up in steps:
        at = at[0] + right, at[1] + up
        simulate("MOUSEMOVE", "NOTHING", at)
        yield
    simulate(button, "RELEASE", at)
    yield


def press(key, at):
    simulate(key, "PRESS", at)
    simulate(key, "RELEASE", at)
    yield


def choose_import(entry: int):
    """Choose one of our entries in File > Import, from 0: the menus by the mouse, the entry by keys."""
    top = window().height
    for x, below in FILE_TO_IMPORT:
        simulate("MOUSEMOVE", "NOTHING", (x, top - below))
        yield
        if (x, below) == FILE_TO_IMPORT[0]:
            yield from press("LEFTMOUSE", (x, top - below))
            yield
    at = x, top - below
    yield
    yield from press("RIGHT_ARROW", at)
    yield
    yield from press("END", at)
    for _ in range(OUR_IMPORTS - 1 - entry):
        yield from press("UP_ARROW", at)
    yield from press("RET", at)


def confirm_browser(folder, name=""):
    """Choose a file or a folder in the file browser that an operator has opened, and press its button."""

    def browsers():
        return [(one, area) for one in bpy.context.window_manager.windows for area in one.screen.areas
                if area.type == "FILE_BROWSER"]  # fmt: skip

    yield from until(lambda: browsers() and browsers()[0][1].spaces.active.params)
    where, area = browsers()[0]
    params = area.spaces.active.params
    params.directory = str(folder).encode()
    if name:
        params.filename = name
    yield
    region = next(one for one in area.regions if one.type == "WINDOW")
    with bpy.context.temp_override(window=where, area=area, region=region):
        bpy.ops.file.execute()
    yield


def scroll_sidebar(turns: int):
    """Turn the mouse wheel over the add-on's tab, down for positive ``turns``."""
    region = region_of(area_of("VIEW_3D"), "UI")
    at = (region.x + region.width // 3, region.y + region.height // 2)
    simulate("MOUSEMOVE", "NOTHING", at)
    yield
    for _ in range(abs(turns)):
        simulate("WHEELDOWNMOUSE" if turns > 0 else "WHEELUPMOUSE", "PRESS", at)
        yield
    yield from settled()


def find_button(command: str, argument: str = "", columns=FROM_EDGE):
    """The place in the window of a button or a setting of the sidebar; ``command``: how its Python command begins, or
    the end of its data path; ``argument``: one of its arguments; ``columns``: pixels from the sidebar's right edge."""
    area = area_of("VIEW_3D")
    region = region_of(area, "UI")
    columns, seen = [region.x + region.width - away for away in columns], set()
    for y in range(region.y + region.height - STEP, region.y, -STEP):
        for x in columns:
            simulate("MOUSEMOVE", "NOTHING", (x, y))
            yield
            yield
            bpy.context.window_manager.clipboard = ""
            with bpy.context.temp_override(window=window(), area=area, region=region):
                for copy in (bpy.ops.ui.copy_python_command_button, bpy.ops.ui.copy_data_path_button):
                    if copy.poll():
                        copy()
            found = bpy.context.window_manager.clipboard
            if (found.startswith(command) or found.endswith(command)) and argument in found:
                return x, y
            seen.add(found)
    raise AssertionError(f"no button of the sidebar is {command}; there are {sorted(seen)}")


def press_button(command: str, argument: str = "", columns=FROM_EDGE):
    """Find a button of the sidebar, as ``find_button``, and press it with the mouse."""
    at = yield from find_button(command, argument, columns)
    yield from press("LEFTMOUSE", at)


def hover(at):
    """Move the mouse to a place; a button that was hovered over before takes a move to let go."""
    for _ in range(3):
        simulate("MOUSEMOVE", "NOTHING", at)
        yield


def choose(at, index: int):
    """Open the menu of a button with the mouse, and choose an entry by its number with keys."""
    yield from hover(at)
    yield from press("LEFTMOUSE", at)
    yield
    for _ in range(index + 1):
        yield from press("DOWN_ARROW", at)
    yield from press("RET", at)
    yield
