"""F12 in a real window at once after an edit of the world: the volume is lit by the new world.

    python3 dev.py blender --photograph tests/blender/window_world.py --size 1280x800
"""

import tempfile
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np

from tests.blender import panel_states, scenes
from tests.blender.window_driver import MODULE, drive, in_the_view, new_file, passed, until

SIZE = 64


def add_world():
    """A world whose light is rendered: a Background colored by an RGB node."""
    world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    bpy.context.scene.world = world
    tree = world.node_tree
    color = tree.nodes.new("ShaderNodeRGB")
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    tree.links.new(color.outputs[0], background.inputs["Color"])
    return color.outputs[0]


def add_scene(folder: Path):
    """A white ball under a weak sun and the world, in renders; returns the world's color."""
    owner = panel_states.add_volume(folder)
    functions = import_module(f"{MODULE}.rle_splat.classify.transfer_function")
    import_module(f"{MODULE}.bridge.transfer").write_transfer(owner, functions.TransferFunction(
        name="white", unit=None, opacity=((0.0, 0.0), (100.0, 0.0), (120.0, 0.9)), color=((0.0, 1.0, 1.0, 1.0),),
        shade=functions.Shade(0.0, 1.0, 0.0, 1.0)))
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy = 0.01
    scene = scenes.use_cycles((SIZE, SIZE))
    scene.collection.objects.link(sun)
    bpy.context.view_layer.objects.active = owner
    color = add_world()
    assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    return color


def light_of_f12(path: Path):
    """Press F12 and wait; returns the mean color where the volume is."""
    done = []

    def note(*_):
        done.append(True)

    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT")
        bpy.app.handlers.render_complete.append(note)
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    bpy.app.handlers.render_complete.remove(note)
    scenes.write_exr(path)
    bpy.data.images["Render Result"].save_render(str(path), scene=bpy.context.scene)
    pixels = scenes.load_pixels(path)
    return np.median(pixels[pixels[..., 3] > 0.95], axis=0)


def scenario():
    yield from new_file()
    folder = Path(tempfile.mkdtemp(prefix="rle_splat_world_"))
    with in_the_view():
        color = add_scene(folder)
    yield
    for wanted in ((0.8, 0.2, 0.1), (0.1, 0.3, 0.9)):
        color.default_value = (*wanted, 1.0)
        yield  # one tick: Blender notes the edit
        found = yield from light_of_f12(folder / "out.exr")
        problem = bpy.context.scene.rle_splat.render_problem
        print(f"world {wanted}: the volume is {found[:3].round(3)} {problem}")
        assert not problem
        np.testing.assert_allclose(found[:3] / found[:3].max(), np.array(wanted) / max(wanted), atol=0.08)
        passed(f"F12 under {wanted}")


drive(scenario)
