"""The light of any world, rendered: what Cycles says a white sphere receives from all directions.

A camera for panoramas stands in a small white sphere that only the camera sees.  So each pixel holds the light on a
surface that faces away from it, whatever nodes the world has, with a small sun sampled as Cycles samples it.  It is
fitted by spherical harmonics of order 2.

Blender does not render inside a draw handler or while it renders.  So a world is rendered before it is needed: from a
timer in a window, once its nodes were still for a moment; by operators that make pictures; and when a render begins.
In a window a render begins on a thread of its own, which waits there until the timer has rendered the light.  The light
is kept by a hash of the world's nodes, the last one in the file too.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..rle_splat.scene import Environment, RleSplatError
from ..rle_splat.shade.environment import sphere_moments
from . import image_state, versions, world_nodes
from .messages import sentence_of

WIDTH, HEIGHT, SAMPLES = 32, 16, 64
EVEN = 0.005  # of the mean: a light that changes by less with direction is one of all directions alike
MAP = 256  # pixels across by which Cycles finds where a world is bright; its own choice takes a second
STILL, BUSY = 0.5, 0.2  # seconds without a change before a world is rendered, and between checks for other work
BRIEF, LONGEST = 0.02, 10.0  # seconds between looks of a render that waits for the light, and until it goes on without
MOST_KEPT = 64
STALE = "The world has changed since its light was rendered; the volume shows the earlier light."
NOT_YET = "The world's light is not rendered yet, so it is left out; press Save Picture to render it."
SOON = "The world's light is rendered as soon as the world is still."
_OF_ALL_NODES = {prop.identifier for prop in bpy.types.Node.bl_rna.properties} - {"mute"}


class _Now:
    """Light by the digest of a world; the last digest of each world by session id; what the timer waits for."""

    known: dict = {}
    last: dict = {}
    failed: dict = {}  # digest -> why it could not be rendered
    wanted: int | None = None  # session id of the scene
    since = 0.0
    is_rendering = False
    is_awaited = False  # by a render, which does not begin before


def light_of(scene) -> tuple[tuple | None, str]:
    """The rendered light of a scene's world; in a window one that is not there is rendered soon.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene, evaluated or not.

    Returns
    -------
    light : (tuple of float, Environment or None) or None
        Mean radiance and environment; that of an earlier state of the world where there is none of this one.
    problem : str
        Why it is not the world's light of now; "" where it is.
    """
    key = digest_of(scene)
    found = _kept(scene, key)
    if found is not None:
        _Now.last[scene.world.session_uid] = key
        return found, ""
    _want(scene)
    if key in _Now.failed:
        return None, _Now.failed[key]
    earlier = _Now.known.get(_Now.last.get(scene.world.session_uid))
    if earlier is not None:
        return earlier, STALE
    return None, NOT_YET if bpy.app.background else SOON


def _kept(scene, key: str) -> tuple | None:
    """The light of a digest from memory, or from the file."""
    if key not in _Now.known and scene.rle_splat.world_light:
        with suppress(ValueError, TypeError, RleSplatError):  # one that is damaged is rendered again
            saved, mean, first, second = json.loads(scene.rle_splat.world_light)
            if saved == key:
                _Now.known[key] = tuple(map(float, mean)), None if first is None else Environment(first, second)
    return _Now.known.get(key)


def make_ready(scene, depsgraph) -> None:
    """Render the light of a scene's world if it is needed and not known; for operators.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene.
    depsgraph : bpy.types.Depsgraph
        Its evaluated state.
    """
    image_state.look_again()
    if is_needed(depsgraph.scene_eval) and _kept(scene, digest_of(depsgraph.scene_eval)) is None:
        render_light(scene, digest_of(depsgraph.scene_eval))


def is_needed(scene) -> bool:
    """Whether a scene uses its world's light and it has to be rendered: it is no color and no readable image."""
    settings = scene.rle_splat
    if scene.world is None or settings.lighting != "SCENE" or not settings.use_world:
        return False
    return world_nodes.plain_color(scene.world) is None and world_nodes.light_of(scene.world) is None


def forget() -> None:
    """Drop all light and wishes, before another file is opened."""
    for held in (_Now.known, _Now.last, _Now.failed):
        held.clear()
    _Now.wanted = None
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)


def _want(scene) -> None:
    """Render the world of a scene once it is still; not in background mode, where no timer runs, and in renders."""
    if not bpy.app.background and not bpy.app.is_job_running("RENDER"):
        _Now.wanted, _Now.since = scene.original.session_uid, time.perf_counter()
        if not bpy.app.timers.is_registered(_tick):
            bpy.app.timers.register(_tick, first_interval=STILL)


def _tick():
    """Timer function: Blender calls it again after the returned seconds, and stops after None."""
    left = _Now.since + STILL - time.perf_counter()
    if left > 0.0:
        return left
    if bpy.app.is_job_running("RENDER") and not _Now.is_awaited:
        return BUSY
    scene = next((one for one in bpy.data.scenes if one.session_uid == _Now.wanted), None)
    _Now.wanted = None
    if scene is not None and is_needed(scene):  # its world may have been removed meanwhile
        key = digest_of(scene)
        if _kept(scene, key) is None and key not in _Now.failed:
            render_light(scene, key)
    return None


@persistent
def _on_update(scene=None, depsgraph=None):
    """An edited world is rendered even if no viewport and no panel shows its light."""
    if depsgraph is not None and depsgraph.id_type_updated("WORLD") and scene.rle_splat.use_composite:
        _want(scene)


@persistent
def _on_render_init(scene, *_arguments):
    """A world is rendered before the render that needs it begins."""
    if _Now.is_rendering or not scene.rle_splat.use_composite:
        return
    image_state.look_again()
    if is_needed(scene):
        key = digest_of(scene)
        if _kept(scene, key) is None:
            if bpy.app.is_job_running("RENDER"):
                _await(scene, key)
            else:
                render_light(scene, key)


def _await(scene, key: str) -> None:
    """Wait on the render's own thread until the timer, which runs on the main thread, has rendered a world.

    Blender calls ``render_init`` before it evaluates the scene and counts as rendering, so that another render may run.
    """
    if not bpy.app.timers.is_registered(_tick):
        return  # no edit was seen; timers are registered on the main thread alone
    until = time.perf_counter() + LONGEST
    _Now.wanted, _Now.since, _Now.is_awaited = scene.session_uid, 0.0, True
    while key not in _Now.known and key not in _Now.failed and time.perf_counter() < until:
        time.sleep(BRIEF)
    _Now.is_awaited = False


HANDLERS = (("depsgraph_update_post", _on_update), ("render_init", _on_render_init))


def render_light(scene, key: str) -> tuple | None:
    """Render the light of a scene's world and keep it, in memory and in the scene.

    Parameters
    ----------
    scene : bpy.types.Scene
        The scene.
    key : str
        Digest of the world.

    Returns
    -------
    (tuple of float, Environment or None) or None
        Mean radiance and environment; None after a failure, which is noted.
    """
    made, _Now.is_rendering = [], True
    try:
        with tempfile.TemporaryDirectory() as folder:
            light = _fitted(_pixels(scene, made, Path(folder) / "light.exr"))
    except Exception as problem:  # of Blender's own operators, such as a build without Cycles
        _Now.failed[key] = f"The world's light could not be rendered: {sentence_of(problem)}"
        return None
    finally:
        _Now.is_rendering = False
        bpy.data.batch_remove(made)
    while len(_Now.known) >= MOST_KEPT:
        _Now.known.pop(next(iter(_Now.known)))
    _Now.known[key] = mean, environment = light
    moments = (None, None) if environment is None else (environment.first.tolist(), environment.second.tolist())
    scene.rle_splat.world_light = json.dumps((key, mean, *moments))
    return light


def _pixels(scene, made: list, path: Path) -> np.ndarray:
    """(HEIGHT, WIDTH, 3) float32: the radiance of white surfaces, by the direction against their normal.

    ``made``: gets the datablocks to remove afterwards.
    """
    own = bpy.data.scenes.new("RLE Splat World Light")
    made.append(own)
    own.world = scene.world.copy()  # to change what it is sampled by
    made.append(own.world)
    own.world.cycles.sampling_method, own.world.cycles.sample_map_resolution = "MANUAL", MAP
    own.frame_set(scene.frame_current, subframe=scene.frame_subframe)
    _choose_settings(own, path)
    camera_data = bpy.data.cameras.new(own.name)
    camera_data.type = "PANO"
    versions.panorama_settings(camera_data).panorama_type = "EQUIRECTANGULAR"
    mesh = _sphere(own.name)
    for data in (camera_data, mesh):
        one = bpy.data.objects.new(own.name, data)
        made.extend((one, data))
        own.collection.objects.link(one)
        if data == mesh:
            made.append(mesh.materials[0])
            for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
                setattr(one, f"visible_{ray}", False)
        else:
            own.camera = one
    bpy.ops.render.render(write_still=True, scene=own.name)
    image = bpy.data.images.load(str(path))
    made.append(image)
    pixels = np.empty(WIDTH * HEIGHT * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(HEIGHT, WIDTH, -1)[::-1, :, :3]


def _choose_settings(own, path: Path) -> None:
    """Cycles on the CPU with settings of its own, whatever the user's scene has."""
    render, cycles = own.render, own.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = WIDTH, HEIGHT, 100
    render.use_compositing = render.use_sequencer = False
    render.filepath, render.use_file_extension = str(path), False
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.image_settings.color_mode = "RGBA"
    cycles.device, cycles.samples = "CPU", SAMPLES
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = 1
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0


def _sphere(name: str):
    """A white sphere of radius 1 about the origin, smooth, whose normals point inwards."""
    rows, columns = 2 * HEIGHT, 2 * WIDTH
    latitude = np.pi * (np.arange(rows + 1) / rows - 0.5)
    longitude = 2.0 * np.pi * np.arange(columns) / columns
    flat = np.cos(latitude)[:, None]
    around = flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)[:, None] * np.ones(columns)
    corners = np.stack(around, axis=-1).reshape(-1, 3)
    first = np.arange(rows * columns).reshape(rows, columns)
    right = np.roll(first, -1, axis=1)
    faces = np.stack((first, first + columns, right + columns, right), axis=-1).reshape(-1, 4)
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners.tolist(), [], faces.tolist())
    mesh.shade_smooth()
    material = bpy.data.materials.new(name)
    tree = versions.material_tree(material)
    tree.nodes.clear()
    white = tree.nodes.new("ShaderNodeBsdfDiffuse")
    white.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(white.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    mesh.materials.append(material)
    return mesh


def _fitted(pixels: np.ndarray) -> tuple:
    """Mean radiance and environment behind the pixels; None for the environment of a light that is alike all around."""
    latitude = (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT) * np.pi
    # An unturned camera looks along -Z with +Y up, and the middle of a panorama is where it looks.
    longitude = 2.0 * np.pi * ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5)
    flat = np.cos(latitude)[:, None]
    seen = np.stack(
        (flat * np.sin(longitude), np.sin(latitude)[:, None] * np.ones(WIDTH), -flat * np.cos(longitude)), axis=-1
    )
    weights = (flat * np.ones(WIDTH)).ravel()
    mean, environment = sphere_moments(-seen.reshape(-1, 3), pixels.reshape(-1, 3).astype(np.float64), weights)
    most = max(np.abs(environment.first).max(), np.abs(environment.second).max())
    return mean, None if most <= EVEN * max(mean) else environment


def digest_of(scene) -> str:
    """Hash of all that the light of a scene's world depends on, as a hexadecimal string."""
    total = hashlib.blake2b(digest_size=16)
    visible = getattr(scene.world, "cycles_visibility", None)
    total.update(f"{None if visible is None else visible.diffuse}".encode())
    _feed_tree(total, scene.world.node_tree, scene.frame_current)
    return total.hexdigest()


def _feed_tree(total, tree, frame: int) -> None:
    for node in sorted(tree.nodes, key=lambda one: one.name):
        total.update(f"{node.name}{node.bl_idname}".encode())
        for prop in node.bl_rna.properties:
            if prop.identifier not in _OF_ALL_NODES:
                _feed_value(total, getattr(node, prop.identifier), frame)
        for socket in (*node.inputs, *node.outputs):  # an output holds the color of an RGB node
            _feed_value(total, getattr(socket, "default_value", None), frame)
    for link in tree.links:
        ends = link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier
        total.update(f"{ends}{link.is_muted}".encode())


def _feed_value(total, value, frame: int) -> None:
    """Add a property of a node: a number, a text, or what a datablock or a curve says."""
    if isinstance(value, bpy.types.NodeTree):
        _feed_tree(total, value, frame)
    elif isinstance(value, bpy.types.Image):
        total.update(f"{image_state.state_of(value, frame)}".encode())
    elif isinstance(value, bpy.types.Object):
        total.update(np.array(value.matrix_world).tobytes())
    elif isinstance(value, bpy.types.Text):
        total.update(value.as_string().encode())
    elif isinstance(value, (bpy.types.TexMapping, bpy.types.ColorMapping, bpy.types.ImageUser)):
        for prop in value.bl_rna.properties:
            if prop.identifier != "rna_type":
                _feed_value(total, getattr(value, prop.identifier), frame)
    elif isinstance(value, bpy.types.ColorRamp):
        total.update(np.array([value.evaluate(n / 64.0) for n in range(65)]).tobytes())
    elif isinstance(value, bpy.types.CurveMapping):
        value.initialize()
        values = [value.evaluate(curve, n / 64.0) for curve in value.curves for n in range(65)]
        total.update(np.array(values).tobytes())
    elif isinstance(value, (bool, int, float, str)):
        total.update(f"{value!r};".encode())
    elif hasattr(value, "__len__"):
        total.update(f"{[one for one in value if isinstance(one, (bool, int, float, str))]};".encode())
