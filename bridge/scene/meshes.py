"""The surfaces of the evaluated scene as arrays of triangles: those that hide the volume, and glass, which tints it.

Everything that a render engine draws as a mesh counts: meshes with their modifiers, instances of collections, particles
and geometry nodes, text, curves, surfaces and metaballs.  Holdouts and shadow catchers count too.  Hair, point clouds
and Blender's own volumes do not.

The viewport's depsgraph includes collections that are hidden only from renders, and modifiers with their viewport
settings.  The depsgraph of a render has neither limitation.
"""

from typing import NamedTuple

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..look.transfer_nodes import is_transfer_tree

# What an update can name without changing a surface: an object that a surface follows is named beside it.
WITHOUT_SURFACE = (
    bpy.types.Scene, bpy.types.World, bpy.types.Image, bpy.types.Camera, bpy.types.Light, bpy.types.Action,
)  # fmt: skip
OBJECTS_WITHOUT = "CAMERA", "EMPTY", "LIGHT", "LIGHT_PROBE", "SPEAKER"


class Surfaces(NamedTuple):
    """The surfaces that the camera sees, in world space; fields of Scene.

    Attributes
    ----------
    triangles : (n, 3, 3) ndarray of float64
        Triangle, corner, and x, y, z of opaque surfaces; n may be 0.
    panes : (m, 3, 3) ndarray of float64 or None
        Of surfaces that let light through; None where there are none.
    pane_shares : (m, 4) ndarray of float64 or None
    """

    triangles: np.ndarray
    panes: np.ndarray | None
    pane_shares: np.ndarray | None


class _Piece(NamedTuple):
    """One instance of a mesh in the world.

    Attributes
    ----------
    what : object
        The same for the same triangles: the number of what was read of an object, or the bytes of others.
    matrix : bytes
        (4, 4) float64.
    shares : tuple of (tuple of float or None)
        What each material slot lets through, see ``share_of``; empty for opaque triangles.
    """

    what: object
    matrix: bytes
    shares: tuple


class _View(NamedTuple):
    """What a view layer shows: what it was read by, its pieces, and the surfaces made of them."""

    by: tuple
    pieces: tuple
    surfaces: Surfaces


class _Read:
    """What was read last, the number of events so far that may have changed a surface, and of meshes that were read.

    ``meshes``: (session id of a scene, name of a view layer) -> {(session id of an object, address of its evaluated
    data): (number, triangles, materials)}.  The address is that of the same data until the object is named by an event.
    """

    stamp = 0
    count = 0
    known: dict = {}  # (session id of a scene, name of a view layer) -> _View
    meshes: dict = {}


@persistent
def _on_update(_scene=None, depsgraph=None):
    if depsgraph is None or depsgraph.mode == "RENDER":
        return
    updates = [one for one in depsgraph.updates if _has_surface(one.id)]
    _Read.stamp += bool(updates)
    tagged = {one.id.original.session_uid for one in updates if one.is_updated_geometry}
    for meshes in _Read.meshes.values() if tagged else ():
        for key in [key for key in meshes if key[0] in tagged]:
            del meshes[key]


@persistent
def _on_undo(*_arguments):
    _Read.stamp += 1
    _Read.meshes.clear()


HANDLERS = (
    ("depsgraph_update_post", _on_update), ("frame_change_post", _on_update), ("undo_post", _on_undo),
    ("redo_post", _on_undo),
)  # fmt: skip


def _has_surface(one) -> bool:
    if isinstance(one, bpy.types.Object):
        if one.rle_splat.is_volume:  # it instances its box, of edges alone
            return False
        return one.type not in OBJECTS_WITHOUT or one.instance_type != "NONE"
    if isinstance(one, bpy.types.NodeTree):
        return not (one.is_embedded_data or is_transfer_tree(one))  # that of a material is named with its material
    return not isinstance(one, WITHOUT_SURFACE)


def known_surfaces(depsgraph, without=(), instead=None) -> Surfaces:
    """``read_surfaces``, which in a viewport reads again only the meshes that an event has named.

    The arrays are the same ones for as long as no surface differs, and read-only, so that each is hashed once.
    """
    instead = instead or {}
    if depsgraph.mode == "RENDER":
        return read_surfaces(depsgraph, without, instead)
    of = depsgraph.scene.session_uid, depsgraph.view_layer.name
    by = (
        _Read.stamp,
        tuple(one.session_uid for one in without),
        tuple((one.session_uid, triangles.tobytes()) for one, triangles in instead.items()),
    )
    view = _Read.known.get(of)
    if view is None or view.by != by:
        read, _Read.meshes[of] = _read_pieces(depsgraph, without, instead, _Read.meshes.get(of, {}))
        pieces = tuple(piece for piece, *_ in read)
        surfaces = view.surfaces if view is not None and view.pieces == pieces else _join(read)
        _Read.known[of] = view = _View(by, pieces, surfaces)
    return view.surfaces


def forget() -> None:
    """Drop all surfaces."""
    _Read.known.clear()
    _Read.meshes.clear()


def read_surfaces(depsgraph, without=(), instead=None) -> Surfaces:
    """The triangles of all surfaces that the camera sees.

    Objects hidden from renders or from camera rays, and collections set to Indirect Only, are left out.

    Parameters
    ----------
    instead : dict of bpy.types.Object to ndarray, optional
        Triangles of some objects in their own space, in place of those of their meshes; they are opaque.
    """
    return _join(_read_pieces(depsgraph, without, instead or {}, {})[0])


def _read_pieces(depsgraph, without, instead: dict, known: dict) -> tuple[list, dict]:
    """(_Piece, triangles, materials) of each instance; and what is known of meshes now, as ``_Read.meshes`` has it."""
    pieces: list = []
    meshes: dict = {}
    shares: dict = {}
    for instance in seen_meshes(depsgraph, without):
        evaluated, original = instance.object, instance.object.original
        matrix = np.array(instance.matrix_world, dtype=np.float64).tobytes()
        if original in instead:
            triangles = instead[original]
            pieces.append((_Piece(triangles.tobytes(), matrix, ()), triangles, None))
            continue
        # Objects generated by geometry nodes have no original; of one original several meshes may be shown.
        key = None if original is None else original.session_uid, evaluated.data.as_pointer()
        if key not in meshes:
            found = known.get(key) if original is not None else None
            if found is None:
                _Read.count += 1
                found = _Read.count, *_object_triangles(evaluated, depsgraph)
            meshes[key] = found
        number, triangles, materials = meshes[key]
        for slot in evaluated.material_slots:
            if slot.material not in shares:
                share = share_of(slot.material)
                shares[slot.material] = None if share is None else tuple(share.tolist())
        passing = tuple(shares[slot.material] for slot in evaluated.material_slots)
        pieces.append((_Piece(number, matrix, passing), triangles, materials))
    return pieces, meshes


def _join(pieces: list) -> Surfaces:
    """The surfaces of pieces as ``_read_pieces`` returns them."""
    placed, passing = [], []
    for piece, triangles, materials in pieces:
        if not len(triangles):
            continue
        matrix = np.frombuffer(piece.matrix).reshape(4, 4)
        placed.append(triangles @ matrix[:3, :3].T + matrix[:3, 3])
        passing.append(np.zeros((len(triangles), 4)))
        for number, share in enumerate(piece.shares):
            if share is not None:
                # Blender draws an index beyond the slots by the last of them.
                passing[-1][np.minimum(materials, len(piece.shares) - 1) == number] = share
    if not placed:
        return Surfaces(np.empty((0, 3, 3), dtype=np.float64), None, None)
    world, shares = np.concatenate(placed), np.concatenate(passing)
    finite, glass = np.isfinite(world).all(axis=(1, 2)), shares.any(axis=1)
    opaque, panes = world[finite & ~glass], finite & glass
    found = Surfaces(opaque, world[panes], shares[panes]) if panes.any() else Surfaces(opaque, None, None)
    for array in found:
        if array is not None:
            array.flags.writeable = False
    return found


def seen_meshes(depsgraph, without=()):
    """Generator of the instances that ``read_surfaces`` takes, in the depsgraph's order; parameters as of it."""
    for instance in depsgraph.object_instances:
        # Curves, text, metaballs and geometry nodes that evaluate to a mesh are listed as separate MESH instances.
        if instance.object.type == "MESH" and _is_seen(instance, depsgraph.view_layer):
            if instance.object.original not in without:
                yield instance


def _is_seen(instance, view_layer) -> bool:
    """Whether camera rays meet this instance; checks the object and its instancer, as viewports list hidden ones."""
    shown = (instance.object,) if instance.parent is None else (instance.object, instance.parent)
    if not instance.show_self or any(one.hide_render or not one.visible_camera for one in shown):
        return False
    # Objects generated by geometry nodes have no original in the view layer.
    owner = (instance.parent or instance.object).original
    return owner is None or not owner.indirect_only_get(view_layer=view_layer)


def _object_triangles(evaluated, depsgraph) -> tuple[np.ndarray, np.ndarray]:
    """As ``mesh_triangles``, of an object."""
    # In the viewport a Subdivision modifier may exist on the GPU only, and a mesh in edit mode in its edit data only;
    # to_mesh evaluates both.
    copied = depsgraph.mode == "VIEWPORT" and (evaluated.mode == "EDIT" or len(evaluated.modifiers) > 0)
    mesh = evaluated.to_mesh() if copied else evaluated.data
    try:
        return mesh_triangles(mesh)
    finally:
        if copied:
            evaluated.to_mesh_clear()


def mesh_triangles(mesh) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of a mesh.

    Returns
    -------
    triangles : (n, 3, 3) ndarray of float64
        Triangle, corner, and x, y, z in the mesh's own space.
    materials : (n,) ndarray of int32
        The slot of each triangle's material.
    """
    mesh.calc_loop_triangles()
    corners = np.empty(len(mesh.loop_triangles) * 3, dtype=np.int32)
    mesh.loop_triangles.foreach_get("vertices", corners)
    materials = np.empty(len(mesh.loop_triangles), dtype=np.int32)
    mesh.loop_triangles.foreach_get("material_index", materials)
    positions = np.empty(len(mesh.vertices) * 3, dtype=np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.astype(np.float64).reshape(-1, 3)[corners.reshape(-1, 3)], materials


LEAST = 1.0 / 256.0  # of a share that shows
UNKNOWN = 0.5  # of a share that a texture or another node decides, and white for such a color
OPAQUE = np.zeros(4)


def share_of(material) -> np.ndarray | None:
    """The share of light that passes a surface.

    Known are the Principled, Glass, Refraction and Transparent BSDFs, and mixed and added shaders of them.

    Returns
    -------
    (4,) ndarray of float64 or None
        Of red, green, blue and alpha, as ``Scene.pane_shares``; None for an opaque one.
    """
    tree = None if material is None else material.node_tree
    output = None if tree is None else tree.get_output_node("ALL")
    if output is None:
        return None
    found = np.clip(_shader(output.inputs["Surface"]), 0.0, 1.0)
    return found if found.max() >= LEAST else None


def takes_light(material) -> bool:
    """Whether lamps may change how a surface looks, which they do not if it emits or lets light through alone."""
    tree = None if material is None else material.node_tree
    return tree is None or any(
        node.type in ("GROUP", "SUBSURFACE_SCATTERING") or node.type.startswith("BSDF_") for node in tree.nodes
        if node.type != "BSDF_TRANSPARENT"
    )  # fmt: skip


def has_glass(depsgraph) -> bool:
    """Whether any object of a view layer has a material that lets light through."""
    glass = {material for material in bpy.data.materials if share_of(material) is not None}
    return bool(glass) and any(
        slot.material in glass for one in depsgraph.view_layer.objects for slot in one.material_slots
    )


def _shader(socket) -> np.ndarray:
    """What passes the shader that is linked to a socket."""
    node = socket.links[0].from_node if socket.is_linked else None
    while node is not None and node.type == "REROUTE":
        node = node.inputs[0].links[0].from_node if node.inputs[0].is_linked else None
    if node is None or node.mute:
        return OPAQUE
    if node.type == "BSDF_PRINCIPLED":
        alpha, glass = _number(node, "Alpha"), _number(node, "Transmission Weight") * (1.0 - _number(node, "Metallic"))
        return (1.0 - alpha) + alpha * glass * _color(node, "Base Color")
    if node.type in ("BSDF_GLASS", "BSDF_REFRACTION", "BSDF_TRANSPARENT"):
        return _color(node, "Color")
    if node.type == "MIX_SHADER":
        share = _number(node, 0)
        return (1.0 - share) * _shader(node.inputs[1]) + share * _shader(node.inputs[2])
    if node.type == "ADD_SHADER":
        return _shader(node.inputs[0]) + _shader(node.inputs[1])
    return OPAQUE


def _number(node, name) -> float:
    socket = node.inputs[name]
    return UNKNOWN if socket.is_linked else float(socket.default_value)


def _color(node, name: str) -> np.ndarray:
    """(4,): a color, and that nothing of the surface itself is seen."""
    socket = node.inputs[name]
    return np.array((*((1.0, 1.0, 1.0) if socket.is_linked else socket.default_value[:3]), 1.0))
