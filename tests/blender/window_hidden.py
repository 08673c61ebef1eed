"""What a user reads where a volume is not to be seen, in a real window: behind a mesh, under an old world light, beside
a volume that cannot be rendered, without its file; and a value under the mouse that goes when the mouse does.

    python3 dev.py blender --photograph tests/blender/window_hidden.py --size 1600x1000
"""

import tempfile
from pathlib import Path

import bpy
import numpy as np

from tests.blender import panel_states, scenes
from tests.blender.scenes import module
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
    region_of,
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
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    (FOLDER / "bad.raw").unlink()
    module("bridge.loop.store").forget_all()
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
    probe, area = module("bridge.look.probe"), area_of("VIEW_3D")
    right = 0.15 * region_of(area, "WINDOW").width  # to the middle of the ball
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


def under_a_sky():
    """A new file with a volume and a world that a sky lights; the node of the sky."""
    yield from new_file()
    with in_the_view():
        panel_states.add_volume(FOLDER)
    world = bpy.context.scene.world = bpy.data.worlds.new("World")
    sky = world.node_tree.nodes.new("ShaderNodeTexSky")
    link_color(world, sky)
    return sky


def check_world_light():
    """An edited world: a sentence and a button, which renders its light."""
    yield from under_a_sky()
    scene = bpy.context.scene
    background = next(node for node in scene.world.node_tree.nodes if node.type == "BACKGROUND")
    state = module("bridge.scene.world").state
    yield from settled()
    assert "click Update World Light" in state(scene), state(scene)
    yield from photograph("world light not rendered yet")
    with in_the_view():
        assert bpy.ops.rle_splat.update_world_light("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    yield from until(lambda: state(scene) == "World: rendered, by direction")
    yield from settled()
    yield from photograph("world light rendered")
    background.inputs["Strength"].default_value = 0.3
    yield from settled()
    assert "Click Update World Light" in state(scene), state(scene)
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
        assert bpy.ops.rle_splat.relocate_volume(filepath=str(FOLDER / "elsewhere.raw")) == {"FINISHED"}
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
    viewports = module("bridge.live.viewport")
    still, viewports.STILL = viewports.STILL, 3600.0  # however long a redraw takes, no refined picture comes between
    for shift in (5.0, 10.0, 15.0):
        owner.rle_splat.shift_by = shift
        yield
    assert viewport().is_busy, "the draft is refined when nothing moves any more"
    yield from photograph("refining")
    viewports.STILL = still
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
            assert bpy.ops.rle_splat.load_segments() == {"FINISHED"}
        yield from settled()
        yield from photograph(f"labels of file {number}")
    assert [row.label_name for row in owner.rle_splat.labels] == ["Segment 3", "Segment 4", "Segment 5", "Segment 6"]
    passed("another label file")


def link_color(world, node):
    tree = world.node_tree
    background = next(one for one in tree.nodes if one.type == "BACKGROUND")
    tree.links.new(node.outputs["Color"], background.inputs["Color"])


def check_panels_read_no_image():
    """A world of 2^23 floats: the panel has its words, and neither reads pixels nor renders them."""
    yield from new_file()
    space = area_of("VIEW_3D").spaces.active
    with in_the_view():
        panel_states.add_volume(FOLDER)
    shown = module("bridge.live.shown")
    setattr(space, shown.SWITCH, False)
    read = []
    nodes, rendered = (module(f"bridge.scene.{name}") for name in ("world_nodes", "world_render"))
    before = nodes._pixels_of, rendered.render_light
    nodes._pixels_of = lambda image: read.append("pixels") or before[0](image)
    rendered.render_light = lambda *arguments, **named: read.append("rendered") or before[1](*arguments, **named)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    texture = scene.world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.new("studio", 2048, 1024, float_buffer=True)
    texture.image.colorspace_settings.name = "Linear Rec.709"
    texture.image.generated_type, texture.image.generated_color = "BLANK", (0.2, 0.3, 0.6, 1.0)
    link_color(scene.world, texture)
    yield from photograph("world of an image, nothing shown")
    state = module("bridge.scene.world").state
    assert state(scene) == "World: its image, by direction", state(scene)
    assert read == [], read
    setattr(space, shown.SWITCH, True)
    yield from settled()
    yield from photograph("world of an image")
    assert read == ["pixels"], read
    nodes._pixels_of, rendered.render_light = before
    passed("panels read no image")


def check_selecting_restarts_nothing():
    """A viewport that Cycles renders goes on, and its samples with it, while objects beside a slice are selected."""
    yield from new_file()
    with in_the_view():
        bpy.ops.mesh.primitive_monkey_add(size=3.0, location=(-3.0, 0.0, 0.0))
        mesh = bpy.context.object
        owner = panel_states.add_volume(FOLDER)
        panel_states.make_active(owner)
        bpy.ops.rle_splat.add_slice(kind="AXIAL")
    scene = scenes.use_cycles((48, 36), transparent=False)
    scene.cycles.preview_samples = 8
    area_of("VIEW_3D").spaces.active.shading.type = "RENDERED"
    yield from settled()
    one = next(one for one in bpy.data.objects if one.rle_splat.is_slice)
    changed = []

    def note(_scene, depsgraph):
        changed.extend(type(update.id).__name__ for update in depsgraph.updates)

    bpy.app.handlers.depsgraph_update_post.append(note)
    for chosen in (mesh, one, owner, mesh):
        with in_the_view():
            panel_states.make_active(chosen)
            bpy.ops.ed.undo_push(message="select")
        yield
    yield from photograph("selected beside a slice")
    assert "Image" not in changed, changed
    one.location.z += 1.0
    yield from until(lambda: "Image" in changed)
    bpy.app.handlers.depsgraph_update_post.remove(note)
    passed("selecting restarts nothing")


def check_memory_is_freed():
    """Another file, and disabling the extension, leave no voxels and no labels."""
    store = module("bridge.loop.store")
    for end in ("another file", "disabled"):
        yield from new_file()
        with in_the_view():
            panel_states.add_labels(FOLDER, panel_states.add_volume(FOLDER))
            bpy.ops.rle_splat.add_slice(kind="AXIAL")
        yield from settled()
        assert {key[0] for key in store._entries} >= {"slice"} and store.nbytes() >= 2 * panel_states.SIDE**3
        if end == "disabled":
            bpy.ops.preferences.addon_disable(module=MODULE)
        else:
            yield from new_file()
        yield
        assert store.nbytes() == 0 and not store._entries, end
        yield from photograph(f"nothing is left, {end}")
    bpy.ops.preferences.addon_enable(module=MODULE)
    yield
    passed("memory is freed")


def check_an_animated_sky():
    """Each frame has the light of its own sky after Update World Light, and before it a sentence."""
    sky = yield from under_a_sky()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 2
    for frame, height in ((1, 1.4), (2, 0.05)):
        sky.sun_elevation = height
        sky.keyframe_insert("sun_elevation", frame=frame)
    scene.frame_set(1)
    yield from settled()
    with in_the_view():
        assert bpy.ops.rle_splat.update_world_light("INVOKE_DEFAULT") == {"RUNNING_MODAL"}
    state = module("bridge.scene.world").state
    yield from until(
        lambda: state(scene) == "World: rendered, by direction" and scene.rle_splat.world_light.count("\n")
    )
    colors = []
    for frame in (1, 2):
        scene.frame_set(frame)
        yield from settled()
        yield from photograph(f"sky of frame {frame}")
        assert state(scene) == "World: rendered, by direction", state(scene)
        (picture,) = viewport().pictures
        colors.append(picture.rgba[..., :3].sum(axis=(0, 1)) / picture.rgba[..., 3].sum())
    print(f"mean colors by frame: {colors}", flush=True)
    assert colors[0].min() > 2.0 * colors[1].max(), "the low sun is darker"
    passed("an animated sky")


def check_behind_glass():
    """A volume behind a pane of green glass is seen through it, in the viewport and by F12."""
    yield from new_file()
    with in_the_view():
        panel_states.add_volume(FOLDER)
        bpy.ops.rle_splat.frame_volume(side="NONE")
    side = panel_states.SIDE
    pane = scenes.add_mesh([(-9, -9, 12), (3.5, -9, 12), (3.5, 16, 12), (-9, 16, 12)], [(0, 1, 2, 3)], name="pane")
    glass = bpy.data.materials.new("glass")
    shader = glass.node_tree.nodes.new("ShaderNodeBsdfGlass")
    shader.inputs["Color"].default_value = (0.3, 0.9, 0.4, 1.0)
    glass.node_tree.links.new(shader.outputs[0], glass.node_tree.get_output_node("ALL").inputs["Surface"])
    pane.data.materials.append(glass)
    scene = scenes.use_cycles((240, 180), transparent=False)
    scene.world = bpy.data.worlds.new("World")
    with in_the_view():
        assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    yield from settled()
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    bpy.context.preferences.view.render_display_type = "NONE"
    with in_the_view():
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from until(lambda: done and not bpy.app.is_job_running("RENDER"))
    bpy.app.handlers.render_complete.pop()
    path = FOLDER / "glass.png"
    scene.render.image_settings.file_format = "PNG"
    bpy.data.images["Render Result"].save_render(str(path))
    picture = scenes.load_pixels(path)
    row, middle_of, apart = 90, 120, int(240 / (2.0 * side))
    behind, beside = picture[row, middle_of - apart, :3], picture[row, middle_of + apart, :3]
    print(f"behind glass {behind}, beside it {beside}", flush=True)
    assert behind[1] > 0.1 and behind[0] < 0.85 * behind[1] and beside[0] > beside[1], (behind, beside)
    area_of("PROPERTIES").type = "IMAGE_EDITOR"
    area_of("IMAGE_EDITOR").spaces.active.image = bpy.data.images["Render Result"]
    yield from photograph("behind glass")
    passed("behind glass")


def check_scale_bar():
    """In perspective it is the length in the middle of the volume, and its line is drawn with words; without any it is
    that of all the view."""
    yield from new_file()
    with in_the_view():
        panel_states.add_volume(FOLDER)
        bpy.ops.rle_splat.frame_volume()
    bars = module("bridge.live.bars")
    bpy.context.scene.rle_splat.show_scale_bar = True
    written, write = [], bars._write
    bars._write = lambda text, *place: written.append(text) or write(text, *place)
    view = area_of("VIEW_3D").spaces.active.region_3d
    for kind, words in (("PERSP", " at the middle of the volume"), ("ORTHO", "")):
        view.view_perspective = kind
        yield from settled()
        written.clear()
        yield from photograph(f"scale bar, {kind.lower()}")
        assert written and all(text.endswith(f"mm{words}") for text in written), written
    bars._write = write
    passed("scale bar")


def scenario():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_render", "RLE_SPLAT_PT_shading", "RLE_SPLAT_PT_labels")
    yield from check_panels_read_no_image()
    yield from check_selecting_restarts_nothing()
    yield from check_memory_is_freed()
    yield from check_an_animated_sky()
    yield from check_behind_glass()
    yield from check_scale_bar()
    yield from check_a_bad_volume_in_f12()
    yield from check_local_view()
    yield from check_value_goes_with_the_mouse()
    yield from check_behind_a_mesh()
    yield from check_world_light()
    yield from check_a_missing_scan()
    yield from check_the_state_keeps_its_height()
    yield from check_another_label_file()


drive(scenario, overlap=False)
