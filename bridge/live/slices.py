"""Slices: rectangles in the scene that show a volume's values on their plane, as gray levels of a window.

A slice is a mesh object, a child of its volume, or of a cutting object of it (see ``cut_slices``).  Its material emits
the pixels of ``slice_image`` and is transparent where these are, which is outside the volume.  Pixels are of four
32-bit floats, scene-linear: with the view transform Standard a screen shows the gray levels of the window themselves.
"""

from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from ...rle_splat.runtime.steps import drain
from ...rle_splat.scene import RleSplatError
from ...rle_splat.scene.color import decode_srgb
from ...rle_splat.segment.cut_faces import CutFace, Sampled, face_share, plane_around
from ...rle_splat.volume import slices as plain
from .. import linked, presence, versions
from ..data.settings import scene_scale_of
from ..loop import index, store
from ..pictures import images
from ..scene import cut_faces
from ..volumes import volumes
from ..volumes.attached import attach, is_attached, volume_frame, world_matrix
from . import slice_window

CORNERS = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
LAMPS = ("visible_diffuse", "visible_volume_scatter", "visible_shadow")  # rays by which a slice would light the scene
LONGEST_NAME = 40  # characters of the volume's name in a slice's name
ON_CUT = "cut"  # kind of a slice that is the child of a cutting object
FINER = 2.0  # pixels of such a slice along the smallest voxel spacing, for a smooth outline
AROUND = 384  # the most pixels along a side of the plane around it


class Look(NamedTuple):
    """How a slice shows values: those that are black and white, whether black is transparent, and the face of a cut."""

    low: float
    high: float
    clears: bool
    face: CutFace | None

    @property
    def key(self):
        """What equals it, without the labels, so that what is recorded does not keep these in memory."""
        return self._replace(face=self.face and replace(self.face, labels=None))


def slice_objects(scene) -> list:
    """The slices of a scene, sorted by name."""
    return index.objects(index.of(scene).slices)


def add_slice(context, owner, volume, name: str):
    """Add a slice through the middle of a volume, and return it; its picture is not made yet.

    ``name`` is how it lies: "axial", "coronal" or "sagittal".
    """
    one = new_slice(context, f"{owner.name[:LONGEST_NAME]} {name.title()}", name)
    scale = scene_scale_of(context.scene, volume.unit)
    matrix = volume_frame(volume, owner, scale) @ plain.slice_matrix(volume, plain.slice_axis(volume, name))
    # Its own location is along the volume's axes, from the middle.
    attach(one, owner, matrix, Matrix.Diagonal((*np.linalg.norm(matrix[:3, :3], axis=0), 1.0)))
    return one


def new_slice(context, title: str, kind: str):
    """Add a slice without a place; ``kind``: how it lies, or ON_CUT."""
    mesh = bpy.data.meshes.new(title)
    mesh.from_pydata(CORNERS, [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set(
        "vector", np.array([(0.5 * (x + 1), 0.5 * (y + 1)) for x, y, _ in CORNERS], np.float32).ravel()
    )
    one = bpy.data.objects.new(title, mesh)
    linked.put_into_scene(context, one)
    one.rle_splat.is_slice = True
    one.rle_splat.slice_kind = kind
    for ray in LAMPS:
        setattr(one, ray, False)
    image = _new_image(title)
    mesh.materials.append(None)
    one.material_slots[0].link = "OBJECT"  # an object copied with its mesh shared shows its own slice
    one.material_slots[0].material = _material(image)
    one.rle_splat.slice_image = image
    return one


def _new_image(title: str):
    image = images.ensure_image(None, title, 1, 1)
    images.clear(image)
    return image


def _material(image):
    """A material that emits an image and lets everything through where it is transparent."""
    material = bpy.data.materials.new(image.name)
    nodes, links = (getattr(versions.material_tree(material), name) for name in ("nodes", "links"))
    nodes.clear()
    kinds = ("TexImage", "Emission", "BsdfTransparent", "MixShader", "OutputMaterial")
    texture, emission, transparent, mix, output = (nodes.new(f"ShaderNode{kind}") for kind in kinds)
    texture.image, texture.extension = image, "EXTEND"
    for column, node in enumerate((texture, emission, transparent, mix, output)):
        node.location = (220.0 * column, 0.0)
    links.new(texture.outputs["Color"], emission.inputs["Color"])
    links.new(texture.outputs["Alpha"], mix.inputs["Fac"])
    links.new(transparent.outputs[0], mix.inputs[1])
    links.new(emission.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    nodes.active = texture  # Solid shading with Texture colors shows it
    return material


def settle_copies(objects) -> None:
    """Give each slice that shares an image with another one, such as a copy, an image and a material of its own."""
    taken = set()
    for one in sorted(filter(linked.is_own, objects), key=lambda one: one.session_uid):
        image = one.rle_splat.slice_image
        if image is None or image in taken or not linked.is_own(image):
            _give_own(one, image)
        taken.add(one.rle_splat.slice_image)


def _give_own(one, image) -> None:
    """Give a slice a new image, in a copy of its material if that shows the old one."""
    mine = _new_image(one.name)
    one.rle_splat.slice_image = mine
    for slot in one.material_slots:
        tree = slot.material.node_tree if slot.material is not None else None
        shown = [node for node in tree.nodes if getattr(node, "image", None) == image] if tree is not None else []
        if image is not None and shown:
            slot.link = "OBJECT"
            slot.material = linked.own_copy(slot.material)
            for node in slot.material.node_tree.nodes:
                if getattr(node, "image", None) == image:
                    node.image = mine
            return
    if len(one.material_slots):
        one.material_slots[0].link = "OBJECT"
        one.material_slots[0].material = _material(mine)


def content(one, depsgraph, ahead: int = 0) -> tuple:
    """What a slice shows, some frames of the timeline after a depsgraph's time.

    Returns
    -------
    volume : Volume
        The voxels.
    matrix : ndarray, shape (4, 4), float64
        The slice's own space to voxel indices.
    look : Look
        How it shows the values.

    Raises
    ------
    RleSplatError
        If there is no volume, its file is missing, or the slice has no place in it.
    """
    owner = volume_of(one)
    if owner is None:
        raise RleSplatError(
            f"The slice {one.name!r} is not the child of a volume: its volume was deleted, or its parent cleared; "
            "delete the slice, or make a volume its parent."
        )
    volume = volumes.load_volume(owner, None, depsgraph, ahead)
    evaluated = owner.evaluated_get(depsgraph)
    frame = volume_frame(volume, evaluated, scene_scale_of(depsgraph.scene_eval, volume.unit))
    try:
        matrix = np.linalg.inv(frame) @ world_matrix(one, depsgraph)
    except np.linalg.LinAlgError:
        raise RleSplatError(f"{owner.name!r} has a scale of 0, so its slices are empty; set it above 0.") from None
    face = cut_faces.read_face(one.parent, owner, volume, depsgraph, frame, ahead) if is_on_cut(one) else None
    return volume, matrix, Look(*slice_window.read(evaluated.rle_splat), face)


def is_on_cut(one) -> bool:
    """Whether a slice lies on a cut, and is the child of a cutting object."""
    return one.rle_splat.slice_kind == ON_CUT


def volume_of(one):
    """The volume object that a slice is a child of, itself or by a cutting object; None if there is none in a scene."""
    if is_on_cut(one):
        one = one.parent
        if one is None or presence.is_deleted(one):
            return None
    owner = one.parent
    return owner if is_attached(one, owner) and not presence.is_deleted(owner) else None


def size_of(volume, matrix: np.ndarray, look: Look, most: int | None = None) -> tuple[int, int]:
    """Pixels of a slice, from what ``content`` returns; ``most``: of a draft. A face beside the volume has one."""
    if look.face is None:
        return plain.slice_size(volume, matrix, most)
    return plain.slice_size(volume, matrix, most if len(plain.cut_polygon(volume.shape_xyz, matrix)) else 1, FINER)


def sampled_steps(volume, matrix: np.ndarray, look: Look, size: tuple[int, int]):
    """Generator: the values on a slice, from what ``content`` returns, and on a cut those of the plane around it.

    Returns
    -------
    sampled : Sampled
    around : Sampled or None
    """
    sampled = Sampled(*(yield from plain.resample_steps(volume, matrix, *size)), matrix)
    if look.face is None:
        return sampled, None
    around, side = plane_around(volume, matrix), min(max(size), AROUND)
    return sampled, Sampled(*(yield from plain.resample_steps(volume, around, side, side)), around)


def share_of(sampled: Sampled, around: Sampled | None, look: Look) -> np.ndarray:
    """How much of each pixel is shown if it is not black, from what ``sampled_steps`` and ``content`` return."""
    return sampled.inside if look.face is None else face_share(sampled, around, look.face, not look.clears)


def picture_steps(values: np.ndarray, share: np.ndarray, look: Look):
    """Generator of fractions done: the pixels of a slice, from its values and ``share_of`` them.

    Returns
    -------
    ndarray, shape (height, width, 4), float32
        Scene-linear gray and alpha, 1 inside the volume and 0 outside, where black is transparent, and where the volume
        shows nothing on a cut; row 0 on top.
    """
    height, width = values.shape
    rgba = np.zeros((height, width, 4), np.float32)
    rows = max(plain.PIXELS_A_STEP // width, 1)
    for begin in range(0, height, rows):
        band = slice(begin, begin + rows)
        levels = plain.gray_levels(values[band], look.low, look.high)
        shows = share[band] * (levels > 0.0) if look.clears else share[band]
        rgba[band, :, :3] = (decode_srgb(levels) * shows)[..., np.newaxis]
        rgba[band, :, 3] = shows
        yield min(begin + rows, height) / height
    return rgba


def show(one, rgba: np.ndarray) -> None:
    """Write pixels into a slice's image, which is resized if necessary."""
    image = one.rle_splat.slice_image
    height, width = rgba.shape[:2]
    images.write_color(images.ensure_image(image, image.name, width, height), rgba)


def opaque_part(values: np.ndarray, share: np.ndarray, look: Look) -> np.ndarray:
    """The part of a slice that is not transparent, from what ``picture_steps`` takes.

    Returns
    -------
    ndarray, shape (n, 3, 3), float64
        Triangles in the slice's own space.
    """
    levels = share - 0.5
    if look.clears:
        over = np.nan_to_num((values - look.low) / (look.high - look.low), nan=-1.0)
        levels = np.where(share, over, -1.0) if look.face is None else np.minimum(levels, over)
    part = plain.positive_part(levels)
    return np.concatenate((part, np.zeros((*part.shape[:2], 1))), axis=2)


def opaque_key(volume, matrix: np.ndarray, look: Look) -> tuple:
    """The key in the store of ``opaque_part``, from what ``content`` returns."""
    return "opaque", volume.key, matrix.tobytes(), look.key


def is_whole(look: Look) -> bool:
    """Whether a slice is opaque wherever it lies in its volume."""
    return look.face is None and not look.clears


def outlines(depsgraph) -> dict:
    """The part of each slice that lies in its volume and is not transparent: it hides what is behind it.

    Returns
    -------
    dict of bpy.types.Object to ndarray, shape (n, 3, 3), float64
        Triangles in the slice's own space.  A slice whose volume is not in memory is not in it.
    """
    found = {}
    for one in slice_objects(depsgraph.scene):
        owner = volume_of(one)
        if owner is None or volumes.at_hand(owner, depsgraph) is None:
            continue
        try:
            volume, matrix, look = content(one, depsgraph)
        except RleSplatError:
            continue
        found[one] = _whole(volume, matrix) if is_whole(look) else _opaque_part(one, depsgraph, volume, matrix, look)
    return found


def _opaque_part(one, depsgraph, volume, matrix: np.ndarray, look: Look) -> np.ndarray:
    """What is in the store, or made for this picture alone: the store keeps to its limit of memory."""
    key = opaque_key(volume, matrix, look)
    part = store.find(key)
    if part is None:
        sampled, around = drain(sampled_steps(volume, matrix, look, size_of(volume, matrix, look)))
        part = opaque_part(sampled.values, share_of(sampled, around, look), look)
        store.put(store.wish_of(one, depsgraph, "opaque"), key, part)
    return part


def _whole(volume, matrix: np.ndarray) -> np.ndarray:
    polygon = plain.cut_polygon(volume.shape_xyz, matrix)
    corners = np.column_stack((polygon, np.zeros(len(polygon))))
    fan = [corners[[0, i, i + 1]] for i in range(1, len(corners) - 1)]
    return np.array(fan).reshape(-1, 3, 3)
