"""What a user reads where a volume is not to be seen, in a real window: behind a mesh, under an old world light, beside
a volume that cannot be rendered, without its file; and a value under the mouse that goes when the mouse does.

    python3 dev.py blender --photograph tests/blender/window_hidden.py --size 1600x1000
"""

import tempfile
from importlib import import_module
from pathlib import Path

import bpy
import numpy as np

from tests.blender import panel_states, scenes
from tests.blender.user_steps import live, middle, settled, simulate, viewport
from tests.blender.window_driver import (
    MODULE,
    area_of,
    drive,
    in_the_view,
    new_file,
    open_panels,
    passed,
    photograph,
    until,
)

FOLDER = Path(tempfile.mkdtemp(prefix="rle_splat_hidden_"))


def check_behind_a_mesh():
    """A scan larger than the wall that the view is in: the viewport says so, and a button hides the wall."""
    yield from new_file()
    with in_the_view():
        bpy.ops.mesh.primitive_cube_add(size=2.0)
        bpy.context.object.name = "Cube"
        owner = panel_states.add_volume(FOLDER)
    view = area_of("VIEW_3D")
    view.spaces.active.region_3d.view_perspective = "PERSP"
    owner.scale = (0.5,) * 3
    owner.location = (0.0, 0.0, 0.0)
    yield from settled()
    assert live().mesh_before(view) == ""
    region_3d = view.spaces.active.region_3d
    region_3d.view_location, region_3d.view_distance = (0.0, 0.0, 0.0), 0.3
    view.spaces.active.clip_start = 0.01
    owner.location = (-12.0, 0.0, -2.0)
    yield from until(lambda: live().mesh_before(view) == "Cube")
    yield from photograph("behind a mesh")
    assert live().sentence_of_mesh(view) == "Cube hides the volume in this view."
    with in_the_view():
        assert bpy.ops.rle_splat.hide_mesh(mesh="Cube") == {"FINISHED"}
    yield from until(lambda: live().mesh_before(view) == "")
    yield from settled()
    yield from photograph("the mesh is hidden")
    passed("behind a mesh")


def check_a_bad_volume_in_f12():
    """Of two volumes one has no file: the other is in the picture, and the panel names the first."""
    yield from new_file()
    with in_the_view():
        panel_states.add_volume(FOLDER, "good")
        bad = panel_states.add_volume(FOLDER, "bad")
        bad.location.x += 12.0
        bpy.context.scene.camera.data.ortho_scale = 40.0
        scene = scenes.use_cycles((96, 72), transparent=False)
        assert bpy.ops.rle_splat.composite() == {"FINISHED"}
    (FOLDER / "bad.raw").unlink()
    import_module(f"{MODULE}.bridge.loop.store").forget_all()
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    bpy.app.handlers.render_complete.pop()
    print(scene.rle_splat.render_problem, flush=True)
    assert scene.rle_splat.render_problem.startswith("'bad' is left out of the picture: The file of 'bad'")
    yield from settled()
    assert viewport().problem.startswith("The file of 'bad'"), viewport().problem
    assert any(one.rgba[..., 3].max() > 0.5 for one in viewport().pictures), "the other is in the viewport, too"
    area_of("PROPERTIES").type = "IMAGE_EDITOR"
    area_of("IMAGE_EDITOR").spaces.active.image = bpy.data.images["Render Result"]
    yield from photograph("a bad volume is left out")
    passed("a bad volume is left out")


def check_value_goes_with_the_mouse():
    """The value at the surface stands in the header while the mouse is over the viewport, and no longer."""
    yield from new_file()
    with in_the_view():
        panel_states.add_volume(FOLDER)
        bpy.ops.rle_splat.frame_volume()
        bpy.ops.wm.tool_set_by_id(name="rle_splat.window_tool")
    yield from settled()
    probe, area = import_module(f"{MODULE}.bridge.look.probe"), area_of("VIEW_3D")
    right = 0.15 * area.width  # to the middle of the ball
    for by in range(4):
        simulate("MOUSEMOVE", "NOTHING", middle(right + by))
        yield
    assert "voxel" in probe.hovered(area), "over the volume"
    yield from photograph("value under the mouse")
    other = area_of("PROPERTIES")
    for by in range(4):
        simulate("MOUSEMOVE", "NOTHING", (other.x + 30 + by, other.y + 200))
        yield
    assert probe.hovered(area) == "", "the mouse is elsewhere"
    yield from photograph("value gone")
    passed("the value goes with the mouse")


def check_world_light():
    """An edited world: a sentence and a button, which renders its light."""
    yield from new_file()
    with in_the_view():
        panel_states.add_volume(FOLDER)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    sky = scene.world.node_tree.nodes.new("ShaderNodeTexSky")
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    scene.world.node_tree.links.new(sky.outputs[0], background.inputs["Color"])
    state = import_module(f"{MODULE}.bridge.scene.world").state
    yield from settled()
    assert "press Update World Light" in state(scene), state(scene)
    yield from photograph("world light not rendered yet")
    with in_the_view():
        assert bpy.ops.rle_splat.update_world_light("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from until(lambda: state(scene) == "World: rendered, by direction")
    yield from settled()
    yield from photograph("world light rendered")
    background.inputs["Strength"].default_value = 0.3
    yield from settled()
    assert "Press Update World Light" in state(scene), state(scene)
    passed("world light")


def check_local_view():
    """Local View shows all of a volume, not the place of its Empty."""
    yield from new_file()
    with in_the_view():
        owner = panel_states.add_volume(FOLDER)
        panel_states.make_active(owner)
    view = area_of("VIEW_3D").spaces.active.region_3d
    view.view_perspective = "PERSP"
    yield from settled()
    with in_the_view():
        bpy.ops.view3d.localview()
    yield from until(lambda: (view.view_location - owner.location).length > 3.0 and view.view_distance > 8.0)
    yield from settled()
    yield from photograph("local view")
    passed("local view")


def check_a_missing_scan():
    """A .blend whose scan is gone: the sentence is in the viewport and beside the button that mends it."""
    yield from new_file()
    with in_the_view():
        owner = panel_states.add_volume(FOLDER, "gone")
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "gone.blend"))
    (FOLDER / "gone.raw").rename(FOLDER / "elsewhere.raw")
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "gone.blend"))
    yield from until(lambda: viewport() is not None and viewport().problem)
    assert viewport().problem.startswith("The file of 'gone'"), viewport().problem
    yield from photograph("missing scan")
    owner = bpy.data.objects["gone"]
    with in_the_view():
        panel_states.make_active(owner)
        assert bpy.ops.rle_splat.relocate(filepath=str(FOLDER / "elsewhere.raw")) == {"FINISHED"}
    yield from until(lambda: viewport().problem == "" and viewport().pictures)
    yield from settled()
    yield from photograph("missing scan found")
    passed("a missing scan")


def check_the_state_keeps_its_height():
    """While a slider is dragged nothing below the line of the state moves."""
    yield from new_file()
    with in_the_view():
        owner = panel_states.add_volume(FOLDER)
    yield from settled()
    yield from photograph("up to date")
    for shift in (5.0, 10.0, 15.0):
        owner.rle_splat.shift_by = shift
        yield
    assert viewport().is_busy, "the draft is refined when nothing moves any more"
    yield from photograph("refining")
    passed("the state's height")


def check_another_label_file():
    """Another label file: names and colors are its own, and the picture shows them at once."""
    yield from new_file()
    side = panel_states.SIDE
    with in_the_view():
        owner = panel_states.add_volume(FOLDER, "labeled")
        bpy.ops.rle_splat.frame_volume()
    for number, count in enumerate((2, 4)):
        path = FOLDER / f"labels {count}.raw"
        (np.arange(side**3) * count // side**3 + 1 + 2 * number).astype(np.uint8).tofile(path)
        owner.rle_splat.label_file = str(path)
        with in_the_view():
            assert bpy.ops.rle_splat.read_labels() == {"FINISHED"}
        yield from settled()
        yield from photograph(f"labels of file {number}")
    assert [row.label_name for row in owner.rle_splat.labels] == ["Label 3", "Label 4", "Label 5", "Label 6"]
    passed("another label file")


def scenario():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_render", "RLE_SPLAT_PT_shading", "RLE_SPLAT_PT_labels")
    yield from check_a_bad_volume_in_f12()
    yield from check_local_view()
    yield from check_value_goes_with_the_mouse()
    yield from check_behind_a_mesh()
    yield from check_world_light()
    yield from check_a_missing_scan()
    yield from check_the_state_keeps_its_height()
    yield from check_another_label_file()


drive(scenario)
