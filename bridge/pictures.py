"""Which image datablock holds which picture of a scene, and how a finished picture gets there.

A scene keeps a row for each picture: its kind, its volume, for a backdrop its camera, and a pointer to its image.
The image names the scene in turn, by the scene's id.  Both must agree.  So a renamed volume or image keeps its
picture, an image of the user's is never taken for one of ours, and a copy of a scene, whose rows and id are copied
too, gets an id and pictures of its own (``settle_copies``).
"""

from __future__ import annotations

import json
import uuid

import bpy
from bpy.props import PointerProperty, StringProperty

from ..rle_splat.accuracy.planner.table import TRUTH_TEXTS
from ..rle_splat.pipeline.single_rays import rays_lines
from . import compositor, effects, images, versions
from .images import OWNER, owned_by

LONGEST_NAME = 40  # characters of the object's name in a new image's name; Blender 4.5 cuts names at 63
SUFFIXES = {
    "color": "Splat", "depth": "Splat Depth", "backdrop": "Splat Backdrop", "composite": "Splat Composite",
    "error": "Splat Error", "shadow": "Splat Shadow",
}  # fmt: skip
NUMBERS = ("depth", "error", "shadow")  # kinds that hold numbers, not colors


class PictureProperties(bpy.types.PropertyGroup):
    """One picture of a scene."""

    kind: StringProperty(name="Kind", description="What the picture shows")
    volume: PointerProperty(name="Volume", type=bpy.types.Object, description="Whose picture it is")
    camera: PointerProperty(name="Camera", type=bpy.types.Object, description="The camera that shows a backdrop")
    image: PointerProperty(name="Image", type=bpy.types.Image, description="The image that holds the picture")


def scene_id(scene) -> str:
    """The scene's own id, given when it is first asked for."""
    settle_copies()
    if not scene.rle_splat.scene_id:
        scene.rle_splat.scene_id = uuid.uuid4().hex
    return scene.rle_splat.scene_id


def own(image, scene) -> None:
    """Mark an image as a picture of this scene's."""
    image[OWNER] = scene_id(scene)


def find(scene, volume_object, kind: str, camera=None):
    """The scene's picture of that volume and kind, a key of SUFFIXES, or None."""
    for row in scene.rle_splat.pictures:
        if (row.kind, row.volume, row.camera) == (kind, volume_object, camera) and owned_by(row.image, scene):
            return row.image
    return None


def find_or_make(scene, volume_object, kind: str, width: int, height: int, camera=None):
    """The scene's picture of that volume and kind, of this size: the one of last time, or a new one."""
    existing = find(scene, volume_object, kind, camera)
    name = f"{volume_object.name[:LONGEST_NAME]} {SUFFIXES[kind]}"
    image = images.ensure_image(existing, name, width, height, depth=kind in NUMBERS)
    if existing is None:
        own(image, scene)
        _forget_rows(scene, lambda row: not owned_by(row.image, scene))
        add_row(scene, kind, volume_object, camera, image)
    return image


def add_row(scene, kind: str, volume_object, camera, image) -> None:
    """Note that an image, which names the scene as its owner, is this picture."""
    row = scene.rle_splat.pictures.add()
    row.kind, row.volume, row.camera, row.image = kind, volume_object, camera, image


def keep(scene, volume_object, rgba, depth, *, kind: str = "color", camera=None):
    """Write a picture and its depth into the volume's images; returns (image, depth image)."""
    height, width = depth.shape
    image = find_or_make(scene, volume_object, kind, width, height, camera)
    images.write_color(image, rgba)
    return image, keep_numbers(scene, volume_object, depth, "depth")


def keep_numbers(scene, volume_object, numbers, kind: str):
    """Write (H, W) numbers into the volume's image of that kind, one of NUMBERS; returns the image."""
    height, width = numbers.shape
    image = find_or_make(scene, volume_object, kind, width, height)
    images.write_numbers(image, numbers)
    return image


def show(image, rendering) -> None:
    """Write a rendering into an image of ours, resized to it where need be."""
    height, width = rendering.depth.shape
    images.write_color(images.ensure_image(image, image.name, width, height), rendering.rgba)


def settle_copies() -> None:
    """Give each copy of a scene an id and pictures of its own.

    A copy has the id of its original.  The original is the older one, whose session id is the smaller.
    """
    taken = set()
    for scene in sorted(bpy.data.scenes, key=lambda one: one.session_uid):
        if scene.library is None and scene.rle_splat.scene_id:
            if scene.rle_splat.scene_id in taken:
                _become_own(scene)
            taken.add(scene.rle_splat.scene_id)


def _become_own(scene) -> None:
    """Make a copied scene's pictures its own.

    Those that a camera of the copy's own shows are copied; the others are made when they are next wanted.
    """
    settings = scene.rle_splat
    settings.scene_id = uuid.uuid4().hex
    settings.image = settings.depth_image = settings.error_image = None
    _forget_rows(scene, lambda row: row.image is None or not _copied_for(scene, row))
    for row in settings.pictures:
        theirs, row.image = row.image, _own_copy(scene, row.image)
        for entry in row.camera.data.background_images:
            if entry.image == theirs:
                entry.image = row.image
    if settings.use_composite:
        versions.unshare_compositor(scene)
        compositor.exchange_images(scene, lambda image: _own_copy(scene, image))
        settings.composite_image = next(iter(compositor.images_of(scene)), None)


def _own_copy(scene, image):
    """A copy of another scene's picture that is this scene's."""
    copy = images.copy_of(image)
    copy[OWNER] = scene.rle_splat.scene_id
    return copy


def _copied_for(scene, row) -> bool:
    """Whether a copied scene's row is of a camera that only this scene has."""
    return row.kind == "backdrop" and row.camera is not None and row.camera.users_scene == (scene,)


def release_deleted(scene, is_deleted) -> None:
    """Let go of the pictures of volumes and cameras that were deleted; ``is_deleted(object)`` tells."""
    _forget_rows(scene, lambda row: any(one is not None and is_deleted(one) for one in (row.volume, row.camera)))


def _forget_rows(scene, unwanted) -> None:
    rows = scene.rle_splat.pictures
    for index in range(len(rows) - 1, -1, -1):
        if unwanted(rows[index]):
            rows.remove(index)


def _error_lines(report: dict) -> list[str]:
    """What is known of a picture's error, and against which truth."""
    error = report.get("error", {})
    if error.get("truth") not in TRUTH_TEXTS:
        return []
    against = f"against {error['truth']}, {TRUTH_TEXTS[error['truth']]}"
    if error["tolerance"] is None:
        return [f"Not measured; its errors are {against}"]
    return [f"Error in levels: {error['sentence']}, {against}", error.get("statement", ""), report["plan"]["name"]]


def note_report(settings, report: dict) -> None:
    """Keep what a picture took in the scene's settings, for people and for machines."""
    stages = report.get("stages_ms", {})
    lines = [f"{name.replace('_', ' ')}: {value:.0f} ms" for name, value in stages.items()
             if isinstance(value, (int, float))]
    settings.last_report = "\n".join((
        *report.get("remarks", ()), *_error_lines(report), *rays_lines(report.get("rays")), *lines
    ))
    settings.last_report_json = json.dumps(report, default=str)
    effects.note_report(settings, report)
