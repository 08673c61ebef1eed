"""What a user does in a window, for scenarios of window_driver.py: waits for the viewport, drags, presses keys."""

from importlib import import_module

from tests.blender.real_blender import MODULE
from tests.blender.window_driver import area_of, region_of, until, window


def live():
    return import_module(f"{MODULE}.bridge.live")


def viewport():
    return next(iter(live().viewports_of(area_of("VIEW_3D"))), None)


def settled():
    """Until the viewport has refined what it shows."""
    area_of("VIEW_3D").tag_redraw()
    yield
    yield
    yield from until(lambda: viewport() is not None and not viewport().is_busy)
    yield


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
