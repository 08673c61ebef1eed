"""Small scenes for the tests: a volume of a few voxels, a camera, meshes, and what a render of them holds."""

import ctypes
import json
import shutil
import sys
from importlib import import_module

import bpy
import numpy as np

MODULE = "bl_ext.user_default.rle_splat"


def module(name: str):
    """A module of the installed add-on, such as "bridge.live"."""
    return import_module(f"{MODULE}.{name}")


def skip_without_graphics():
    """Skip a test where Blender would abort because it cannot draw without a window."""
    import pytest  # scripts that run without pytest import this module, too

    if sys.platform == "linux":
        try:
            ctypes.CDLL("libEGL.so.1")
        except OSError:
            pytest.skip("libEGL.so.1 is not installed, so Blender cannot draw without a window")


def import_raw(folder, voxels, spacing=(1.0, 1.0, 1.0), name="cube"):
    """Import a (nz, ny, nx) array through a raw file and the import operator; returns the volume object.

    The scene shows one voxel spacing unit as one world unit.
    """
    bpy.context.scene.rle_splat.scene_scale = 1.0
    path = folder / f"{name}.raw"
    path.write_bytes(np.ascontiguousarray(voxels).tobytes())
    done = bpy.ops.rle_splat.import_volume(
        filepath=str(path), shape=voxels.shape[::-1], dtype=voxels.dtype.name, spacing=spacing
    )
    assert done == {"FINISHED"}
    return bpy.context.view_layer.objects.active


def ball(side=11, slope=40.0):
    """(side, side, side) uint8: 250 in the middle, and ``slope`` less a voxel outward."""
    outward = np.sqrt(sum((axis - side // 2) ** 2 for axis in np.mgrid[:side, :side, :side]))
    return np.clip(250.0 - slope * outward, 0.0, 255.0).astype(np.uint8)


def give_transfer(volume_object, opacity, color):
    """Unshaded constant-color transfer function, opacities per world unit."""
    function = module("rle_splat.classify.transfer_function").TransferFunction(
        name="test", unit=None, opacity=tuple(opacity), color=((0.0, *color), (255.0, *color)),
        opacity_unit_distance=1.0, shade=None)  # fmt: skip
    module("bridge.look.transfer").write_transfer(volume_object, function)


def even_cube(folder, side, alpha, color, name="cube"):
    """Import a cube of ``side`` voxels a side, of one color and opacity, unshaded; returns its object."""
    owner = import_raw(folder, np.full((side, side, side), 100, np.uint8), name=name)
    give_transfer(owner, ((0.0, 0.0), (50.0, alpha), (255.0, alpha)), color)
    return owner


def add_camera(location=(0.0, 0.0, 10.0), rotation=(0.0, 0.0, 0.0), **settings):
    """An active camera, looking down -Z unless rotated."""
    data = bpy.data.cameras.new("Camera")
    for name, value in settings.items():
        setattr(data, name, value)
    camera = bpy.data.objects.new("Camera", data)
    camera.location, camera.rotation_euler = location, rotation
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    return camera


def add_mesh(vertices, faces, color=None, name="mesh"):
    """A mesh object; with a color it emits that radiance."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(v) for v in vertices], [], faces)
    mesh_object = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(mesh_object)
    if color is not None:
        mesh.materials.append(emission(color))
    return mesh_object


def emission(color):
    """A material that emits ``color`` (linear RGB) and reflects nothing."""
    material = bpy.data.materials.new("emission")
    if material.node_tree is None:  # always there from 5.0 on
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeEmission")
    shader.inputs["Color"].default_value = (*color, 1.0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def use_cycles(size=(64, 64), samples=1, transparent=True):
    """Cycles on the CPU, box-filtered over one pixel, without noise of its own: emission only.

    It marches through volumes: from Blender 5.0 on it takes five seconds to begin otherwise.
    """
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    if hasattr(scene.cycles, "volume_biased"):
        scene.cycles.volume_biased = True
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 1.0
    scene.render.film_transparent = transparent
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.compositor_device = "CPU"
    return scene


def gray_world(value):
    """A world of even radiance (``film_transparent`` off shows it)."""
    world = bpy.data.worlds.new("world")
    if world.node_tree is None:
        world.use_nodes = True
    bpy.context.scene.world = world
    tree = world.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBackground")
    shader.inputs["Color"].default_value = (value, value, value, 1.0)
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])


def write_exr(path):
    """Have renders written to ``path`` as 32-bit EXR."""
    render = bpy.context.scene.render
    if hasattr(render.image_settings, "media_type"):
        render.image_settings.media_type = "IMAGE"
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGBA"
    render.image_settings.color_depth = "32"
    render.filepath = str(path)
    return render


def rendered(path, **options):
    """Render and return the composited picture, (H, W, 4) float32 premultiplied, row 0 on top."""
    write_exr(path)
    bpy.ops.render.render(write_still=True, **options)
    return load_pixels(path)


def load_pixels(path):
    """(H, W, 4) float32, row 0 on top, of an image file."""
    image = bpy.data.images.load(str(path))
    pixels = image_pixels(image)
    bpy.data.images.remove(image)
    return pixels


def image_pixels(image):
    """(H, W, 4) float32, row 0 on top."""
    width, height = image.size
    flat = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(height, width, 4)[::-1].copy()


def centroid(weights):
    """(column, row) of the middle of mass, pixel (c, r) covering [c, c+1)."""
    rows, columns = np.indices(weights.shape) + 0.5
    total = weights.sum()
    return np.array(((columns * weights).sum() / total, (rows * weights).sum() / total))


def add_white_floor(half: float):
    """A white diffuse square about the origin, facing up."""
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
    floor = add_mesh(corners, [(0, 1, 2, 3)])
    material = bpy.data.materials.new("white")
    if material.node_tree is None:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    shader = material.node_tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])
    floor.data.materials.append(material)
    return floor


SIDE = 7  # voxels of the uniform cube that the tests of situations show
RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)


def add_cube(folder, name="cube", color=RED, value=100, **transfer):
    """Import a uniform cube of SIDE voxels a side about (3, 3, 3), of one color, unshaded; returns its object.

    ``transfer``: of its file, in place of those values.
    """
    owner = import_raw(folder, np.full((SIDE, SIDE, SIDE), value, np.uint8), name=name)
    load_color(folder, color, **transfer)
    return owner


def load_color(folder, color, alpha=0.3, **transfer):
    """Give the active volume one color and opacity, by the operator that reads a file."""
    function = {
        "name": "one color",
        "unit": None,
        "opacity": [[0.0, 0.0], [50.0, alpha], [255.0, alpha]],
        "color": [[0.0, *color], [255.0, *color]],
        "opacity_unit_distance": 1.0,
        "shade": False,
        **transfer,
    }
    path = folder / "one_color.json"
    path.write_text(json.dumps(function))
    assert bpy.ops.rle_splat.load_transfer_function(filepath=str(path)) == {"FINISHED"}


def cube_scene(folder, size=(24, 24), **cube):
    """A cube as ``add_cube`` makes it in Cycles, seen from above, a world unit of two pixels; returns its object.

    Its pictures are small: modules that use it are marked with the fixture ``by_numpy``, so that no kernel is compiled.
    """
    scene = use_cycles(size)
    owner = add_cube(folder, **cube)
    add_camera((3.0, 3.0, 30.0), type="ORTHO", ortho_scale=12.0)
    scene.rle_splat.quality = "standard"
    return owner


def ball_scene(folder, count=1, **camera):
    """Balls of 11 voxels along x, seen from above in ``draft``, 24 x 24 pixels; returns their object.  ``camera``:
    settings."""
    owner = import_raw(folder, np.concatenate([ball()] * count, axis=2))
    add_camera((0.0, 0.0, 40.0), **camera)
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = 24
    scene.render.resolution_percentage = 100
    scene.rle_splat.quality = "draft"
    return owner


def blot_scene(folder):
    """A soft blot of a medium about the world's origin, unlit, and a camera 4 units before it; returns its object."""
    outward = sum((axis - 6.0) ** 2 for axis in np.mgrid[:13, :13, :13])
    owner = import_raw(folder, np.rint(255.0 * np.exp(-0.25 * outward)).astype(np.uint8), spacing=(0.02,) * 3)
    give_transfer(owner, [(0.0, 0.0), (255.0, 0.9)], (1.0, 1.0, 1.0))
    owner.location = (-0.12, -0.12, -0.12)
    add_camera((0.0, 0.0, 4.0), lens=50.0, clip_start=0.01)
    bpy.context.scene.rle_splat.lighting = "NONE"
    return owner


def activate(*objects):
    """Select these objects and no other, the first of them active."""
    for one in bpy.context.view_layer.objects:
        one.select_set(one in objects)
    bpy.context.view_layer.objects.active = objects[0]


def in_scene(scene):
    """A context as of a window that shows ``scene``."""
    return bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0])


def picture_of(scene=None, **options):
    """Render to Image of the active volume; returns (the image, its pixels)."""
    assert bpy.ops.rle_splat.render_image(**options) == {"FINISHED"}
    image = (scene or bpy.context.scene).rle_splat.image
    return image, image_pixels(image)


def picture(scene=None, **options):
    """The pixels of Render to Image of the active volume, (H, W, 4) float32, row 0 on top."""
    return picture_of(scene, **options)[1]


def read_scene(volume_object, with_meshes=False):
    """The renderer's scene and quality, as a picture of the volume object has them."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    reader = module("bridge.scene.render_scene")
    return reader.read_scene(volume_object, depsgraph, with_meshes=with_meshes)


def backdrops(camera):
    """The images that a camera object shows behind or in front of the scene."""
    return [entry.image for entry in camera.data.background_images]


def backdrop_of(camera):
    """The pixels of the one image that a camera shows."""
    images = backdrops(camera)
    assert len(images) == 1 and images[0] is not None, images
    return image_pixels(images[0])


def set_anew(camera):
    """The pixels of the backdrop as Preview in Camera View makes it now."""
    assert bpy.ops.rle_splat.preview_in_camera_view() == {"FINISHED"}
    return backdrop_of(camera)


def lower_curve(owner):
    """Make a volume transparent through its opacity curve, as a script does."""
    for point in owner.rle_splat.transfer.nodes["Opacity"].mapping.curves[0].points:
        point.location = (point.location[0], 0.0)


def shown_at(pixels):
    """(column, row) of the middle of what a picture shows, which must be something."""
    assert pixels[..., 3].max() > 0.1, "the picture is blank"
    return centroid(pixels[..., 3])


def update():
    """What Blender does after every edit."""
    bpy.context.view_layer.update()


def to_frame(frame):
    bpy.context.scene.frame_set(frame)


def stored(blend, kind, name):
    """A datablock as it was written: one of ``bpy.data.<kind>``, linked from a copy beside the .blend."""
    copy = blend.with_name(f"copy of {blend.name}")
    shutil.copyfile(blend, copy)
    with bpy.data.libraries.load(str(copy), link=True) as (_, wanted):
        setattr(wanted, kind, [name])
    return getattr(wanted, kind)[0]


def save_and_reload(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
