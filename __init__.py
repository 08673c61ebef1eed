"""RLE Splat: render medical volumes by splatting on the CPU, together with the meshes of a Blender scene."""

from . import bridge, operators, panels

FLOORS = (bridge, operators, panels)


def register():
    for floor in FLOORS:
        floor.register()


def unregister():
    for floor in reversed(FLOORS):
        floor.unregister()
