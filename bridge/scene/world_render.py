"""The light of any world, rendered: what Cycles says a white sphere receives from all directions.

A white sphere alone in the world gets the light of each of its vertices as a color, by Cycles' baking.  So each color
is the light on a surface that faces as the vertex does, whatever nodes the world has, with a small sun sampled as
Cycles samples it.  It is fitted by spherical harmonics of order 2.

Baking, unlike a render, writes into no render slot, and of the handlers of renders and frames it calls render_stats
alone.  A scene of its own keeps it apart from the user's.  It is done by *Update World Light*, by operators that make
pictures, and, where a render runs on the main thread, before each of its frames.  In a window a render has a thread of
its own, where no datablock may be made: it shows the light that there is, and says if that is an earlier one.

The light is a property of the scene, so it follows undo and is saved: a line for each state of the world.
"""

import hashlib
import json
from contextlib import suppress

import bmesh
import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...rle_splat.runtime.steps import Progress
from ...rle_splat.scene import Environment, RleSplatError
from ...rle_splat.shade.environment import sphere_moments
from .. import versions
from ..held import Held
from ..messages import sentence_of, tell
from . import image_changes, world_nodes
from .lights import is_any_lit

FINENESS, SAMPLES = 4, 16  # of the sphere, which has 642 vertices then, and for each of them
EVEN = 0.005  # of the mean: a light that changes by less with direction is one of all directions alike
MAP = 256  # pixels across by which Cycles finds where a world is bright; its own choice takes a second
MOST_KEPT = 1024  # states of a world
STALE = (
    "The world has changed since its light was rendered; the volume shows the earlier light. Click Update World Light."
)
NOT_YET = "The world's light is not rendered yet, so it is left out; click Update World Light."
_OF_ALL_NODES = {prop.identifier for prop in bpy.types.Node.bl_rna.properties} - {"mute"}


def light_of(scene) -> tuple[tuple | None, str]:
    """The rendered light of a scene's world.

    Returns
    -------
    light : (tuple of float, Environment or None) or None
        Mean radiance and environment; that of an earlier state of the world where there is none of this one.
    problem : str
        Why it is not the world's light of now; "" where it is.
    """
    lines = scene.rle_splat.world_light
    found = _read_line(_line_of(lines, digest_of(scene)))
    if found is not None:
        return found, ""
    earlier = _read_line(lines.rpartition("\n")[2])
    return (None, NOT_YET) if earlier is None else (earlier, STALE)


def _line_of(lines: str, key: str) -> str:
    """The line of a digest, "" without one."""
    begin = lines.find(f'["{key}", ')
    return "" if begin < 0 else lines[begin:].partition("\n")[0]


def _read_line(line: str) -> tuple | None:
    """The light of a line; None for one that is damaged, which is rendered again."""
    with suppress(ValueError, TypeError, RleSplatError):
        _, mean, first, second = json.loads(line)
        return tuple(map(float, mean)), None if first is None else Environment(first, second)
    return None


def _is_there(scene, key: str) -> bool:
    return _read_line(_line_of(scene.rle_splat.world_light, key)) is not None


def make_ready(scene, depsgraph) -> None:
    """Render the light of a scene's world if it is needed and not there; a failure is printed."""
    image_changes.look_again()
    if is_needed(depsgraph.scene_eval) and not _is_there(scene, digest_of(depsgraph.scene_eval)):
        try:
            add_light(scene, *render_light(scene))
        except RleSplatError as problem:  # the picture is made all the same, and says what it lacks
            tell(str(problem))


def update_steps(scene):
    """Generator of Progress: a world's light now and, if animated, in all frames; returns the new ``world_light``.

    Raises
    ------
    RleSplatError
        If it cannot be rendered.
    """
    image_changes.look_again()
    held, now = Held(scene), scene.frame_current
    others = range(scene.frame_start, scene.frame_end + 1) if _may_change(scene.world) else ()
    frames = [*others, now][-MOST_KEPT:]
    found: dict = {}
    for n, frame in enumerate(frames):
        yield Progress(n / len(frames), "rendering the world's light")
        key, line = render_light(held.get(), frame, known=found)
        found.pop(key, None)  # to the end: that of now is the last
        found[key] = line
    return "\n".join(found.values())


def _may_change(world) -> bool:
    """Whether a world may differ from frame to frame."""
    trees = [world.node_tree]
    for tree in trees:
        inner = (getattr(node, "node_tree", None) for node in tree.nodes)
        trees += [one for one in dict.fromkeys(inner) if one is not None and one not in trees]
    nodes = [node for tree in trees for node in tree.nodes]
    images = [node.image for node in nodes if getattr(node, "image", None) is not None]
    return (
        any(one.animation_data is not None for one in (world, *trees))
        or any(image.source in ("MOVIE", "SEQUENCE") for image in images)
        or any(getattr(node, "object", None) is not None for node in nodes)
    )


def add_light(scene, key: str, line: str) -> None:
    """Add a line to the light of a scene."""
    lines = [one for one in scene.rle_splat.world_light.split("\n") if _read_line(one) and not _line_of(one, key)]
    scene.rle_splat.world_light = "\n".join([*lines, line][-MOST_KEPT:])


def is_needed(scene) -> bool:
    """Whether a scene uses its world's light and it has to be rendered: it is no color and no readable image."""
    settings = scene.rle_splat
    if scene.world is None or not settings.use_world or not is_any_lit(scene):
        return False
    return world_nodes.plain_color(scene.world) is None and not world_nodes.has_image(scene.world)


@persistent
def _on_render(scene, *_arguments):
    """Before a render and each of its frames, on the main thread: the world is that of the frame by then."""
    if scene.rle_splat.use_composite and not bpy.app.is_job_running("RENDER") and is_needed(scene):
        image_changes.look_again()
        if not _is_there(scene, digest_of(scene)):
            with suppress(RleSplatError):  # the render notes what it lacks
                add_light(scene, *render_light(scene))


HANDLERS = (("render_init", _on_render), ("render_pre", _on_render))


def render_light(scene, frame: int | None = None, known: dict | None = None) -> tuple[str, str]:
    """Render the light of a scene's world at a frame, by default the current one.

    Parameters
    ----------
    known : dict of str to str
        Lines by digest, which are not made again.

    Returns
    -------
    key, line : str
        Digest of the world at that frame, and its light as a line of ``world_light``.

    Raises
    ------
    RleSplatError
        If it cannot be rendered, such as by a build without Cycles.
    """
    made: list = []
    try:
        own = _scene_of(scene, scene.frame_current if frame is None else frame, made)
        with bpy.context.temp_override(scene=own, view_layer=own.view_layers[0]):
            key = digest_of(bpy.context.evaluated_depsgraph_get().scene_eval)
        if known and key in known:
            return key, known[key]
        mean, environment = _fitted(*_bake(own, made))
    except Exception as problem:  # of Blender's own operators
        raise RleSplatError(f"The world's light could not be rendered: {sentence_of(problem)}") from problem
    finally:
        bpy.data.batch_remove(made)
    moments = (None, None) if environment is None else (environment.first.tolist(), environment.second.tolist())
    return key, json.dumps((key, mean, *moments))


def _scene_of(scene, frame: int, made: list):
    """A scene with nothing but the world of another one, at a frame; ``made`` gets datablocks to remove."""
    own = bpy.data.scenes.new("RLE Splat World Light")
    made.append(own)
    own.world = scene.world.original.copy()  # to change what it is sampled by
    made.append(own.world)
    own.world.cycles.sampling_method, own.world.cycles.sample_map_resolution = "MANUAL", MAP
    own.frame_current, own.frame_subframe = frame, scene.frame_subframe
    return own


def _bake(own, made: list) -> tuple[np.ndarray, np.ndarray]:
    """Normals and radiances of a white sphere's vertices, (n, 3) float64 each; ``made`` gets datablocks to remove."""
    own.render.engine = "CYCLES"
    own.cycles.device, own.cycles.samples = "CPU", SAMPLES  # settings of its own, whatever the user's scene has
    own.cycles.use_adaptive_sampling = own.cycles.use_denoising = False
    own.cycles.sample_clamp_direct = 0.0
    mesh = _sphere(own.name)
    ball = bpy.data.objects.new(own.name, mesh)
    made.extend((ball, mesh, mesh.materials[0]))
    own.collection.objects.link(ball)
    with bpy.context.temp_override(
        scene=own, view_layer=own.view_layers[0], object=ball, active_object=ball, selected_objects=[ball]
    ):
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
