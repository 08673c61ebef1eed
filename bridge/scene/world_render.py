"""The light of any world, rendered: what Cycles says a white sphere receives from all directions.

A white sphere alone in the world gets the light of each of its vertices as a color, by Cycles' baking.  So each color
is the light on a surface that faces as the vertex does, whatever nodes the world has, with a small sun sampled as
Cycles samples it.  It is fitted by spherical harmonics of order 2.

Baking, unlike a render, writes into no render slot, and of the handlers of renders and frames it calls render_stats
alone.  A scene of its own keeps it apart from the user's.  It is done before the light is needed: from a timer in a
window, once the world's nodes were still for a moment; by operators that make pictures; and when a render begins.  In a
window a render begins on a thread of its own, where no datablock may be made.  So it waits there until the timer has
baked the light.  The light is kept by a hash of the world's nodes, the last one in the file too.
"""

from __future__ import annotations

import hashlib
import json
import time
from contextlib import suppress

import bmesh
import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...rle_splat.scene import Environment, RleSplatError
from ...rle_splat.shade.environment import sphere_moments
from .. import versions
from ..loop import timer
from ..messages import sentence_of
from . import image_changes, world_nodes
from .lights import is_any_lit

FINENESS, SAMPLES = 4, 16  # of the sphere, which has 642 vertices then, and for each of them
EVEN = 0.005  # of the mean: a light that changes by less with direction is one of all directions alike
MAP = 256  # pixels across by which Cycles finds where a world is bright; its own choice takes a second
STILL = 0.5  # seconds without a change before a world is rendered
BRIEF, LONGEST = 0.02, 10.0  # seconds between looks of a render that waits for the light, and until it goes on without
MOST_KEPT = 64
STALE = "The world has changed since its light was rendered; the volume shows the earlier light."
NOT_YET = "The world's light is not rendered yet, so it is left out; press Make Picture to render it."
SOON = "The world's light is rendered as soon as the world is still."
_OF_ALL_NODES = {prop.identifier for prop in bpy.types.Node.bl_rna.properties} - {"mute"}


class _WorldLight:
    """Light by the digest of a world; the last digest of each world by session id; what the timer waits for."""

    known: dict = {}
    last: dict = {}
    failed: dict = {}  # digest -> why it could not be rendered
    wanted: tuple | None = None  # session id of the scene, digest of its world
    since = 0.0  # when that was asked for first
    is_awaited = False  # by a render, which does not begin before


def light_of(scene) -> tuple[tuple | None, str]:
    """As ``known_light``; in a window a light that is not there is rendered soon."""
    found, problem = known_light(scene)
    if problem:
        _want(scene, digest_of(scene))
    return found, problem


def known_light(scene) -> tuple[tuple | None, str]:
    """The rendered light of a scene's world.

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
        _WorldLight.last[scene.world.session_uid] = key
        return found, ""
    if key in _WorldLight.failed:
        return None, _WorldLight.failed[key]
    earlier = _WorldLight.known.get(_WorldLight.last.get(scene.world.session_uid))
    if earlier is not None:
        return earlier, STALE
    return None, SOON if timer.is_waiting(_tick) else NOT_YET


def _kept(scene, key: str) -> tuple | None:
    """The light of a digest from memory, or from the file."""
    if key not in _WorldLight.known and scene.rle_splat.world_light:
        with suppress(ValueError, TypeError, RleSplatError):  # one that is damaged is rendered again
            saved, mean, first, second = json.loads(scene.rle_splat.world_light)
            if saved == key:
                _WorldLight.known[key] = tuple(map(float, mean)), None if first is None else Environment(first, second)
    return _WorldLight.known.get(key)


def make_ready(scene, depsgraph) -> None:
    """Render the light of a scene's world if it is needed and not known; for operators.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph
        Its evaluated state.
    """
    image_changes.look_again()
    if is_needed(depsgraph.scene_eval) and _kept(scene, digest_of(depsgraph.scene_eval)) is None:
        render_light(scene, digest_of(depsgraph.scene_eval))


def is_needed(scene) -> bool:
    """Whether a scene uses its world's light and it has to be rendered: it is no color and no readable image."""
    settings = scene.rle_splat
    if scene.world is None or not settings.use_world or not is_any_lit(scene):
        return False
    return world_nodes.plain_color(scene.world) is None and world_nodes.light_of(scene.world) is None


def forget() -> None:
    """Drop all light and wishes, before another file is opened."""
    for held in (_WorldLight.known, _WorldLight.last, _WorldLight.failed):
        held.clear()
    _WorldLight.wanted = None
    timer.stop(_tick)


def _want(scene, key: str) -> None:
    """Render the world of a scene once it is still; not in background mode, where no timer runs, and in renders.

    Views that are drawn again and again ask often; only another world begins the wait anew.
    """
    if not bpy.app.background and not bpy.app.is_job_running("RENDER"):
        wanted = scene.original.session_uid, key
        if wanted != _WorldLight.wanted:
            _WorldLight.wanted, _WorldLight.since = wanted, time.perf_counter()
        timer.start(_tick, STILL)


def _tick():
    """Timer function: Blender calls it again after the returned seconds, and stops after None."""
    left = _WorldLight.since + STILL - time.perf_counter()
    if left > 0.0:
        return left
    if bpy.app.is_job_running("RENDER") and not _WorldLight.is_awaited:
        return timer.BUSY
    wanted, _WorldLight.wanted = _WorldLight.wanted, None
    scene = next((one for one in bpy.data.scenes if wanted and one.session_uid == wanted[0]), None)
    if scene is not None and is_needed(scene):  # its world may have been removed meanwhile
        key = digest_of(scene)
        if _kept(scene, key) is None and key not in _WorldLight.failed:
            render_light(scene, key)
    return None


@persistent
def _on_update(scene=None, depsgraph=None):
    """An edited world is rendered even if no viewport and no panel shows its light."""
    if depsgraph is not None and depsgraph.id_type_updated("WORLD") and scene.rle_splat.use_composite:
        if is_needed(scene):
            _want(scene, digest_of(scene))


@persistent
def _on_render_init(scene, *_arguments):
    """A world is rendered before the render that needs it begins."""
    if not scene.rle_splat.use_composite:
        return
    image_changes.look_again()
    if is_needed(scene):
        key = digest_of(scene)
        if _kept(scene, key) is None:
            if bpy.app.is_job_running("RENDER"):
                _await(scene, key)
            else:
                render_light(scene, key)


def _await(scene, key: str) -> None:
    """Wait on the render's own thread until the timer, which runs on the main thread, has rendered a world.

    Blender calls ``render_init`` before it evaluates the scene.
    """
    if not timer.is_waiting(_tick):
        return  # no edit was seen; timers are registered on the main thread alone
    until = time.perf_counter() + LONGEST
    _WorldLight.wanted, _WorldLight.since, _WorldLight.is_awaited = (scene.session_uid, key), 0.0, True
    while key not in _WorldLight.known and key not in _WorldLight.failed and time.perf_counter() < until:
        time.sleep(BRIEF)
    _WorldLight.is_awaited = False


HANDLERS = (("depsgraph_update_post", _on_update), ("render_init", _on_render_init))


def render_light(scene, key: str) -> tuple | None:
    """Render the light of a scene's world and keep it, in memory and in the scene.

    Parameters
    ----------
    key : str
        Digest of the world.

    Returns
    -------
    (tuple of float, Environment or None) or None
        Mean radiance and environment; None after a failure, which is noted.
    """
    made: list = []
    try:
        light = _fitted(*_baked(scene, made))
    except Exception as problem:  # of Blender's own operators, such as a build without Cycles
        _WorldLight.failed[key] = f"The world's light could not be rendered: {sentence_of(problem)}"
        return None
    finally:
        bpy.data.batch_remove(made)
    while len(_WorldLight.known) >= MOST_KEPT:
        _WorldLight.known.pop(next(iter(_WorldLight.known)))
    _WorldLight.known[key] = mean, environment = light
    moments = (None, None) if environment is None else (environment.first.tolist(), environment.second.tolist())
    scene.rle_splat.world_light = json.dumps((key, mean, *moments))
    return light


def _baked(scene, made: list) -> tuple[np.ndarray, np.ndarray]:
    """Normals and radiances of a white sphere's vertices, (n, 3) float64 each; ``made`` gets datablocks to remove."""
    own = bpy.data.scenes.new("RLE Splat World Light")
    made.append(own)
    own.world = scene.world.copy()  # to change what it is sampled by
    made.append(own.world)
    own.world.cycles.sampling_method, own.world.cycles.sample_map_resolution = "MANUAL", MAP
    own.frame_current, own.frame_subframe = scene.frame_current, scene.frame_subframe
    own.render.engine = "CYCLES"
    own.cycles.device, own.cycles.samples = "CPU", SAMPLES  # settings of its own, whatever the user's scene has
    own.cycles.use_adaptive_sampling = own.cycles.use_denoising = False
    own.cycles.sample_clamp_direct = 0.0
    mesh = _sphere(own.name)
    ball = bpy.data.objects.new(own.name, mesh)
    made.extend((ball, mesh, mesh.materials[0]))
    own.collection.objects.link(ball)
    with bpy.context.temp_override(
            scene=own, view_layer=own.view_layers[0], object=ball, active_object=ball, selected_objects=[ball]):
        bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT"}, target="VERTEX_COLORS")
    normals, colors = np.empty(3 * len(mesh.vertices)), np.empty(4 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", normals)
    mesh.color_attributes[0].data.foreach_get("color", colors)
    return normals.reshape(-1, 3), colors.reshape(-1, 4)[:, :3].astype(np.float64)


def _sphere(name: str):
    """A white sphere of radius 1 about the origin, smooth, with a color of floats at each vertex."""
    mesh = bpy.data.meshes.new(name)
    ball = bmesh.new()
    bmesh.ops.create_icosphere(ball, subdivisions=FINENESS, radius=1.0)
    ball.to_mesh(mesh)
    ball.free()
    mesh.shade_smooth()
    mesh.color_attributes.active_color = mesh.color_attributes.new(name, "FLOAT_COLOR", "POINT")
    material = bpy.data.materials.new(name)
    tree = versions.material_tree(material)
    tree.nodes.clear()
    white = tree.nodes.new("ShaderNodeBsdfDiffuse")
    white.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(white.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    mesh.materials.append(material)
    return mesh


def _fitted(normals: np.ndarray, radiances: np.ndarray) -> tuple:
    """Mean radiance and environment behind the light of a sphere; None for the latter where it is alike all around."""
    mean, environment = sphere_moments(normals, radiances, np.ones(len(normals)))
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
        total.update(f"{image_changes.state_of(value, frame)}".encode())
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
