"""The light of an edited world in a real window: F12 says that it is an earlier one until Update World Light is
pressed, which changes nothing of what was rendered before.

    python3 dev.py blender --photograph tests/blender/window_world.py --size 1280x800
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import panel_states, scenes
from tests.blender.scenes import module
from tests.blender.window_driver import (
    area_of,
    drive,
    in_the_view,
    new_file,
    passed,
    photograph,
    until,
    wait_for_rest,
)

SIZE = 64
HANDLERS = (
    "render_init", "render_pre", "render_post", "render_write", "render_complete", "render_cancel", "frame_change_pre",
    "frame_change_post")  # fmt: skip


def add_world(kind: str):
    """A world whose light is rendered: a Background colored by a node, which is returned."""
    world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    bpy.context.scene.world = world
    tree = world.node_tree
    color = tree.nodes.new(kind)
    background = next(node for node in tree.nodes if node.type == "BACKGROUND")
    tree.links.new(color.outputs[0], background.inputs["Color"])
    return color


def add_scene(folder: Path):
    """A white ball under a weak sun, in renders."""
    owner = panel_states.add_volume(folder)
    functions = module("rle_splat.classify.transfer_function")
    module("bridge.look.transfer").write_transfer(owner, functions.TransferFunction(
        name="white", unit=None, opacity=((0.0, 0.0), (100.0, 0.0), (120.0, 0.9)), color=((0.0, 1.0, 1.0, 1.0),),
        shade=functions.Shade(0.0, 1.0, 0.0, 1.0)))  # fmt: skip
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy = 0.01
    scene = scenes.use_cycles((SIZE, SIZE))
    scene.collection.objects.link(sun)
    bpy.context.view_layer.objects.active = owner
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}


def shown(path: Path):
    """The pixels of the Render Result's active slot."""
    scenes.write_exr(path)
    bpy.data.images["Render Result"].save_render(str(path), scene=bpy.context.scene)
    return scenes.load_pixels(path)


def f12(path: Path):
    """Press F12 and wait; returns the pixels."""
    done = []

    def note(*_):
        done.append(True)

    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT")
        bpy.app.handlers.render_complete.append(note)
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    bpy.app.handlers.render_complete.remove(note)
    return shown(path)


def update_world_light():
    """Press the button and wait."""
    with in_the_view():
        assert bpy.ops.rle_splat.update_world_light("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    running = module("bridge.loop.jobs").StepwiseOperator.is_running
    yield from until(lambda: not running())


def check_f12_after_an_edit(path: Path):
    color = add_world("ShaderNodeRGB").outputs[0]
    yield
    for wanted in ((0.8, 0.2, 0.1), (0.1, 0.3, 0.9)):
        color.default_value = (*wanted, 1.0)
        yield  # one tick: Blender notes the edit
        yield from f12(path)
        assert "click update world light" in bpy.context.scene.rle_splat.render_problem.lower()
        yield from update_world_light()
        pixels = yield from f12(path)
        found = np.median(pixels[pixels[..., 3] > 0.95], axis=0)
        problem = bpy.context.scene.rle_splat.render_problem
        print(f"world {wanted}: the volume is {found[:3].round(3)} {problem}")
        assert not problem
        np.testing.assert_allclose(found[:3] / found[:3].max(), np.array(wanted) / max(wanted), atol=0.08)
        passed(f"F12 under {wanted}")


def check_slots(path: Path):
    """Two slots keep their pixels after a Sky node is edited, and no handler of a render or a frame is called."""
    sky, light = add_world("ShaderNodeTexSky"), module("bridge.scene.world_render")
    scene, pixels = bpy.context.scene, []
    slots = bpy.data.images["Render Result"].render_slots
    for slot in (0, 1):
        slots.active_index = slot
        bpy.data.objects["Sun"].hide_render = bool(slot)
        scene.rle_splat.composite_object.location.x += 0.3 * slot
        yield
        pixels.append((yield from f12(path)))
    assert np.abs(pixels[0] - pixels[1]).max() > 0.1
    slots.active_index = 0
    area_of("PROPERTIES").type = "IMAGE_EDITOR"
    area_of("IMAGE_EDITOR").spaces.active.image = bpy.data.images["Render Result"]
    yield from photograph("slot 1 before the edit")
    yield from update_world_light()
    called, before = [], light.light_of(scene)[0]
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).append(lambda *_arguments, name=name: called.append(name))
    elevation = next(one for one in ("sun_elevation", "turbidity") if hasattr(sky, one))
    setattr(sky, elevation, 0.1)
    yield
    assert light.light_of(scene)[1] == light.STALE
    yield from update_world_light()
    assert light.light_of(scene)[1] == ""
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).pop()
    print(f"the mean light was {before[0]}, and is {light.light_of(scene)[0][0]}")
    assert not called and not np.allclose(light.light_of(scene)[0][0], before[0], rtol=0.01)
    yield from wait_for_rest()
    yield from photograph("slot 1 after the edit")
    for slot in (0, 1):
        slots.active_index = slot
        np.testing.assert_array_equal(shown(path), pixels[slot])
    passed("two slots keep their pixels")


def scenario():
    yield from new_file()
    folder = Path(tempfile.mkdtemp(prefix="rle_splat_world_"))
    with in_the_view():
        add_scene(folder)
    yield from check_f12_after_an_edit(folder / "out.exr")
    yield from check_slots(folder / "out.exr")


drive(scenario, overlap=False)
