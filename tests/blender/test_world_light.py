"""The light of any world: from its image, rendered, and on a ball as Cycles has it on a white sphere."""

import bpy
import numpy as np
import pytest

from tests.blender import scenes

pytestmark = pytest.mark.usefixtures("by_numpy")

WIDTH, HEIGHT = 64, 32
BALL = scenes.ball(15, 25.0)


@pytest.fixture
def ball(addon, tmp_path):
    """A white ball in the middle of the world, seen from the front, without light objects."""
    found = scenes.import_raw(tmp_path, BALL)
    found.location = (-7.0, -7.0, -7.0)
    scenes.add_camera(location=(0.0, -40.0, 0.0), rotation=(np.pi / 2.0, 0.0, 0.0), type="ORTHO", ortho_scale=16.0)
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 32
    scene.render.resolution_percentage = 100
    scene.rle_splat.quality = "strict"  # what is tested is the light, not the edge of the ball
    return found


def panorama():
    """A sky, a ground, a warm patch to the left and a blue one behind, (HEIGHT, WIDTH, 4), lowest row first."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    pixels = np.ones((HEIGHT, WIDTH, 4), np.float32)
    pixels[..., :3] = np.where((v >= HEIGHT // 2)[..., None], (0.3, 0.5, 0.9), (0.2, 0.12, 0.08))
    for color, row, column, width in (((5.0, 3.5, 1.5), 20, 6, 9.0), ((0.0, 1.0, 4.0), 12, 40, 8.0)):
        away = ((u - column) ** 2 + (v - row) ** 2) / width**2
        pixels[..., :3] += np.exp(-away)[..., None] * np.array(color, np.float32)
    return pixels


def new_world():
    world = bpy.data.worlds.new("World")
    if world.node_tree is None:
        world.use_nodes = True
    bpy.context.scene.world = world
    return world.node_tree, next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")


def image_world(rotation=(0.0, 0.0, 0.0), strength=1.0, gray=False):
    image = bpy.data.images.new("sky", WIDTH, HEIGHT, float_buffer=True)
    pixels = panorama()
    if gray:
        pixels[..., :3] = pixels[..., :3].mean(axis=-1, keepdims=True)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    tree, background = new_world()
    texture, mapping, source = (
        tree.nodes.new(f"ShaderNode{name}") for name in ("TexEnvironment", "Mapping", "TexCoord")
    )
    texture.image = image
    mapping.inputs["Rotation"].default_value = rotation
    background.inputs["Strength"].default_value = strength
    tree.links.new(source.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    return tree, background


def sky_world():
    tree, background = new_world()
    gradient, ramp = tree.nodes.new("ShaderNodeTexGradient"), tree.nodes.new("ShaderNodeValToRGB")
    tree.links.new(gradient.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], background.inputs["Color"])
    return ramp


def read(bridge, volume, **how):
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return bridge("scene.render_scene").read_scene(volume, depsgraph, with_meshes=False, **how)[0]


def held():
    kinds = "scenes", "worlds", "cameras", "objects", "meshes", "materials"
    images = [one.name for one in bpy.data.images if one.name != "Render Result"]
    return [len(getattr(bpy.data, kind)) for kind in kinds], images


@pytest.mark.parametrize("kind", ("POINT", "TEXTURE"))
def test_the_image_and_cycles_say_the_same_of_a_turned_world(addon, bridge, kind):
    tree, _ = image_world((0.4, -0.3, 1.1), 1.5)
    next(node for node in tree.nodes if node.type == "MAPPING").vector_type = kind
    scene = bpy.context.scene
    mean, environment = bridge("scene.world_nodes").light_of(scene.world)
    before = held()
    render = bridge("scene.world_render")
    rendered_mean, rendered = render._read_line(render.render_light(scene)[1])
    assert before == held()
    np.testing.assert_allclose(rendered_mean, mean, rtol=0.02)
    np.testing.assert_allclose(rendered.first, environment.first, atol=0.02 * max(mean))
    np.testing.assert_allclose(rendered.second, environment.second, atol=0.02 * max(mean))
    assert np.abs(environment.first).max() > 0.1 * max(mean)


def test_a_ball_is_lit_as_cycles_lights_a_sphere(ball, bridge, core, tmp_path):
    """Pixel by pixel where the ball fills them: within 8 % of the brightest, 2 % in the mean."""
    image_world((0.0, 0.0, 0.7), gray=True)  # one channel of light
    functions = core("classify.transfer_function")
    shade = functions.Shade(0.0, 1.0, 0.0, 1.0)
    bridge("look.transfer").write_transfer(
        ball,
        functions.TransferFunction(
            name="white",
            unit=None,
            opacity=((0.0, 0.0), (120.0, 0.0), (121.0, 1.0), (255.0, 1.0)),
            color=((0.0, 1.0, 1.0, 1.0), (255.0, 1.0, 1.0, 1.0)),
            shade=shade,
        ),
    )
    plain = read(bridge, ball)
    assert plain.environment is not None and not plain.headlight
    ours = scenes.picture()
    scenes.use_cycles((32, 32), samples=64)
    bpy.context.scene.cycles.max_bounces = 1
    bpy.ops.mesh.primitive_uv_sphere_add(radius=5.2, segments=64, ring_count=32)
    bpy.ops.object.shade_smooth()
    material = bpy.data.materials.new("white")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    white = tree.nodes.new("ShaderNodeBsdfDiffuse")
    white.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(white.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    bpy.context.object.data.materials.append(material)
    theirs = scenes.rendered(tmp_path / "sphere.exr")[..., :3]
    row, column = np.mgrid[:32, :32] - 15.5
    inside = np.hypot(row, column) < 9.0  # of 10.4 pixels
    assert ours[inside, 3].min() > 0.99 and np.ptp(theirs[inside], axis=0).max() > 0.25
    away = np.abs(ours[..., :3] - theirs)[inside]
    assert away.max() < 0.08 * theirs[inside].max() and away.mean() < 0.02 * theirs[inside].max()


def test_any_world_is_rendered_when_a_picture_is_made(ball, bridge):
    ramp = sky_world()
    said = []
    plain = read(bridge, ball, warn=said.append)
    assert plain.world is None and plain.headlight and "not rendered yet" in said[0]
    assert bridge("scene.world").state(bpy.context.scene) == said[0]
    first = scenes.picture()
    plain = read(bridge, ball, warn=said.append)
    assert plain.environment is not None and not plain.headlight and len(said) == 1
    assert bridge("scene.world").state(bpy.context.scene) == "World: rendered, by direction"
    # A gradient along +X: brighter from the right.
    assert first[12:20, 20:24, 0].mean() > 1.2 * first[12:20, 8:12, 0].mean()
    ramp.color_ramp.elements[1].color = (0.3, 0.3, 0.3, 1.0)
    earlier = read(bridge, ball, warn=said.append).environment
    np.testing.assert_array_equal(earlier.first, plain.environment.first)
    assert "has changed" in said[1]
    again = scenes.picture()
    assert again[..., 0].max() < 0.7 * first[..., 0].max()


def test_baking_a_world_leaves_renders_and_render_handlers_alone(ball, tmp_path):
    """Both slots of the Render Result keep their pixels, and no handler of a render or a frame is called."""
    scene, path = scenes.use_cycles((8, 8), transparent=False), tmp_path / "slot.exr"
    scenes.write_exr(path)
    bpy.ops.render.render()
    result, found = bpy.data.images["Render Result"], []
    for gray in (0.25, 0.75):
        scenes.gray_world(gray)
        result.render_slots.active_index = len(found)
        found.append(scenes.rendered(path))
    result.render_slots.active_index = 0
    called = []
    names = ["frame_change_pre", "frame_change_post", *(
        f"render_{event}" for event in ("init", "pre", "post", "write", "complete", "cancel"))]  # fmt: skip
    for name in names:
        getattr(bpy.app.handlers, name).append(lambda *_arguments, name=name: called.append(name))
    sky_world()
    assert bpy.ops.rle_splat.update_world_light() == {"FINISHED"}
    for name in names:
        getattr(bpy.app.handlers, name).pop()
    assert called == []
    for slot, pixels in enumerate(found):
        result.render_slots.active_index = slot
        result.save_render(str(path), scene=scene)
        np.testing.assert_array_equal(scenes.load_pixels(path), pixels)


def test_in_background_a_render_begins_with_the_worlds_light(ball, bridge):
    scenes.use_cycles((8, 8))
    bpy.context.scene.render.use_compositing = False
    bpy.context.scene.rle_splat.use_composite = True
    sky_world()
    bpy.ops.render.render()
    said = []
    assert read(bridge, ball, warn=said.append).environment is not None and not said


def animate(ramp):
    """Make the world twice, and then three times as bright."""
    strength = next(n for n in bpy.context.scene.world.node_tree.nodes if n.type == "BACKGROUND").inputs["Strength"]
    for frame in (1, 2, 3):
        strength.default_value = frame
        strength.keyframe_insert("default_value", frame=frame)
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 1, 3


def test_each_frame_of_an_animated_world_has_its_own_light(ball, bridge):
    animate(sky_world())
    scene = bpy.context.scene
    scene.frame_set(2)
    called = []
    bpy.app.handlers.frame_change_post.append(lambda *_: called.append("frame"))
    assert bpy.ops.rle_splat.update_world_light() == {"FINISHED"}
    bpy.app.handlers.frame_change_post.pop()
    assert scene.frame_current == 2 and called == []
    assert scene.rle_splat.world_light.count("\n") == 2
    said, found = [], []
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        found.append(read(bridge, ball, warn=said.append).world)
    assert said == []
    np.testing.assert_allclose(found, np.outer((1.0, 2.0, 3.0), found[0]), rtol=0.01)


def test_in_background_each_frame_is_rendered_with_its_own_light(ball, tmp_path):
    """A white ball under a brighter and brighter world, of which nothing was rendered before."""
    animate(sky_world())
    scene = scenes.use_cycles((8, 8))
    ball.rle_splat.use_shading = True
    assert bpy.ops.rle_splat.show_in_renders() == {"FINISHED"}
    scene.rle_splat.world_light = ""
    scenes.write_exr(tmp_path / "frame")
    bpy.ops.render.render(animation=True)
    assert scene.rle_splat.render_problem == "" and scene.rle_splat.world_light.count("\n") == 2
    found = [scenes.load_pixels(path)[..., :3].max() for path in sorted(tmp_path.glob("frame*.exr"))]
    steps = np.diff(found)  # there is ambient light, too
    assert steps[0] > 0.5 * found[0] and abs(steps[1] - steps[0]) < 0.02 * steps[0]


def test_undo_brings_back_the_light_of_the_world_before(ball, bridge):
    ramp = sky_world()
    scenes.picture()
    bpy.ops.ed.undo_push(message="before")
    first = read(bridge, ball).world
    ramp.color_ramp.elements[1].color = (0.3, 0.3, 0.3, 1.0)
    scenes.picture()
    assert read(bridge, ball).world[0] < 0.7 * first[0]
    bpy.ops.ed.undo_push(message="darker")
    bpy.ops.ed.undo()
    said = []
    assert read(bridge, bpy.data.objects["cube"], warn=said.append).world == first and not said


def test_update_world_light_is_for_worlds_that_need_it(ball, bridge):
    new_world()
    assert not bpy.ops.rle_splat.update_world_light.poll()
    ramp = sky_world()
    assert bpy.ops.rle_splat.update_world_light.poll()
    changes = bridge("scene.world_render")._may_change
    assert not changes(bpy.context.scene.world)
    ramp.color_ramp.elements[1].keyframe_insert("color", frame=1)
    assert changes(bpy.context.scene.world)
    bpy.context.scene.rle_splat.use_world = False
    assert not bpy.ops.rle_splat.update_world_light.poll()


def test_a_saved_file_keeps_the_rendered_light(ball, bridge, tmp_path):
    sky_world()
    scenes.picture()
    kept = read(bridge, ball).environment
    name = ball.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "sky.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "sky.blend"))
    again = read(bridge, bpy.data.objects[name]).environment
    np.testing.assert_array_equal(again.first, kept.first)
    np.testing.assert_array_equal(again.second, kept.second)
    settings = bpy.context.scene.rle_splat
    for damaged in ("{", "7", settings.world_light.replace("[", "{", 1), '["a", [1], [2], [3]]'):
        settings.world_light = damaged
        assert bridge("scene.world_render").light_of(bpy.context.scene)[0] is None
    scenes.picture()
    np.testing.assert_allclose(read(bridge, bpy.data.objects[name]).environment.first, kept.first, atol=1e-6)


def test_what_the_panel_says_of_the_world(ball, bridge, monkeypatch):
    """A panel is drawn often: no image is read for it and no render is scheduled."""
    state, scene = bridge("scene.world").state, bpy.context.scene
    for module, name in (("scene.world_nodes", "_pixels_of"), ("scene.world_render", "_bake")):
        monkeypatch.setattr(bridge(module), name, lambda *_: pytest.fail("a panel reads or renders the world"))
    scene.world = None
    assert "has none" in state(scene)
    _, background = new_world()
    assert "if the scene has a light" in state(scene)
    background.inputs["Strength"].default_value = 0.0
    assert "black" in state(scene)
    image_world()
    assert state(scene) == "World: its image, by direction"
    sky_world()
    assert "not rendered yet" in state(scene)
    scene.rle_splat.use_world = False
    assert "turned off" in state(scene)
    assert "not part of this Light Source" in state(scene, "HEADLIGHT")


def test_what_changes_a_world_changes_its_light(ball, bridge, tmp_path):
    """Nodes whose value is at their output, settings inside a node, and pixels that a script writes."""
    digest = bridge("scene.world_render").digest_of
    tree, _ = image_world()
    texture = next(node for node in tree.nodes if node.type == "TEX_ENVIRONMENT")
    color = tree.nodes.new("ShaderNodeRGB")
    found = [digest(bpy.context.scene)]

    def check(changed=True):
        bpy.context.view_layer.update()
        found.append(digest(bpy.context.scene))
        assert (found[-1] != found[-2]) is changed

    check(changed=False)
    color.outputs[0].default_value = (0.2, 0.4, 0.6, 1.0)
    check()
    texture.texture_mapping.rotation = (0.0, 0.0, 1.0)
    check()
    texture.color_mapping.brightness = 0.5
    check()
    texture.image_user.frame_offset = 3
    check()
    tree, _ = image_world()
    texture = next(node for node in tree.nodes if node.type == "TEX_ENVIRONMENT")
    first = read(bridge, ball).world
    texture.image.pixels.foreach_set(0.5 * panorama().ravel())
    scenes.picture()
    np.testing.assert_allclose(read(bridge, ball).world, 0.5 * np.array(first), rtol=1e-5)
    texture.image.filepath_raw, texture.image.file_format = str(tmp_path / "sky.exr"), "OPEN_EXR"
    texture.image.save()
    texture.image = loaded = bpy.data.images.load(str(tmp_path / "sky.exr"))
    loaded.colorspace_settings.name = "Non-Color"
    saved = read(bridge, ball).world
    loaded.pixels.foreach_set(panorama().ravel())
    scenes.picture()
    np.testing.assert_allclose(read(bridge, ball).world, first, rtol=1e-5)
    loaded.reload()
    bpy.context.view_layer.update()
    np.testing.assert_allclose(read(bridge, ball).world, saved, rtol=1e-5)
