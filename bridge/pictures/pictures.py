"""Records which image holds which picture of a scene, and writes finished pictures into their images.

A scene has a row for each picture with its kind, its volume, the camera of a backdrop, and a pointer to the image.
The image stores the scene's id.  Both must agree.  So a picture survives renaming of volume and image, and an image of
the user is never mistaken for one of ours.  A copy of a scene, which has copies of the rows and the id, gets its own
id and pictures in ``settle_copies``.
"""

import json
import uuid

import bpy
from bpy.props import PointerProperty, StringProperty

from ...rle_splat.accuracy.planner.table import TRUTH_TEXTS
from ...rle_splat.pipeline.single_rays import describe_rays
from .. import versions
from ..data import effects
from ..render import compositor
from . import images
from .images import OWNER, owned_by

LONGEST_NAME = 40  # characters of the object's name in an image's name; Blender 4.5 truncates names at 63
SUFFIXES = {
    "color": "Splat", "depth": "Splat Depth", "backdrop": "Splat Backdrop", "composite": "Splat Composite",
    "error": "Splat Error", "shadow": "Splat Shadow",
}  # fmt: skip
SHORTEST_MS = 0.5  # of a stage that the Last Report panel lists; the JSON has all
STAGES = {
    **effects.PANEL_NAMES,
    "classify": "Colors and opacities",
    "clipping": "Clip distances",
    "encode": "List of visible voxels",
    "gradients": "Gradient opacity",
    "kernels": "Loading of code",
    "mixing": "Segments and channels",
    "occlusion": "Meshes that hide the volume",
    "plan": "Choice of settings",
    "rays": "Exact pixels",
    "setup": "Preparation",
    "shade": "Shading",  # as the effect, whose time it is
    "splat": "Voxels to layers",
    "warp": "Layers to picture",
}
NUMBERS = ("depth", "error", "shadow")  # kinds that hold numbers instead of colors


class PictureProperties(bpy.types.PropertyGroup):
    """One picture of a scene.  ``name`` is that of the volume, for messages once it is gone."""

    kind: StringProperty(name="Kind", description="What the picture shows")
    volume: PointerProperty(name="Volume", type=bpy.types.Object, description="The volume in the picture")
    camera: PointerProperty(name="Camera", type=bpy.types.Object, description="The camera whose view shows the picture")
    image: PointerProperty(name="Image", type=bpy.types.Image, description="The image that holds the picture")


def scene_id(scene) -> str:
    """The scene's id; it is created on the first call."""
    settle_copies()
    if not scene.rle_splat.scene_id:
        scene.rle_splat.scene_id = uuid.uuid4().hex
    return scene.rle_splat.scene_id


def own(image, scene) -> None:
    """Mark an image as a picture of this scene."""
    image[OWNER] = scene_id(scene)


def find(scene, volume_object, kind: str, camera=None):
    """Find a picture of a scene; ``kind``: a key of SUFFIXES."""
    for row in scene.rle_splat.pictures:
        if (row.kind, row.volume, row.camera) == (kind, volume_object, camera) and owned_by(row.image, scene):
            return row.image
    return None


def find_or_make(scene, volume_object, kind: str, width: int, height: int, camera=None):
    """Find a picture of a scene and resize it, or create it; its pixels are cleared if its size changes."""
    existing = find(scene, volume_object, kind, camera)
    name = f"{volume_object.name[:LONGEST_NAME]} {SUFFIXES[kind]}"
    image = images.ensure_image(existing, name, width, height, depth=kind in NUMBERS)
    if existing is None:
        own(image, scene)
        _forget_rows(scene, lambda row: not owned_by(row.image, scene))
        add_row(scene, kind, volume_object, camera, image)
    return image


def add_row(scene, kind: str, volume_object, camera, image) -> None:
    """Add the row of a picture whose image already names the scene as its owner."""
    row = scene.rle_splat.pictures.add()
    row.kind, row.volume, row.camera, row.image = kind, volume_object, camera, image
    row.name = volume_object.name


def keep(scene, volume_object, rgba, depth, *, kind: str = "color", camera=None):
    """Write a picture and its depth into the scene's images.

    Parameters
    ----------
    rgba : ndarray, shape (height, width, 4)
        Premultiplied scene-linear colors, row 0 on top.
    depth : ndarray, shape (height, width)
        Planar distance in world units.
    """
    height, width = depth.shape
    image = find_or_make(scene, volume_object, kind, width, height, camera)
    images.write_color(image, rgba)
    return image, keep_numbers(scene, volume_object, depth, "depth")


def keep_numbers(scene, volume_object, numbers, kind: str):
    """Write numbers into a scene's image.

    Parameters
    ----------
    numbers : ndarray, shape (height, width)
        The numbers, row 0 on top.
    kind : str
        One of NUMBERS.
    """
    height, width = numbers.shape
    image = find_or_make(scene, volume_object, kind, width, height)
    images.write_numbers(image, numbers)
    return image


def show(image, rendering) -> None:
    """Write a Rendering into one of our images, which is resized if necessary."""
    height, width = rendering.depth.shape
    images.write_color(images.ensure_image(image, image.name, width, height), rendering.rgba)


def settle_copies() -> None:
    """Give each copy of a scene its own id and pictures.

    A copy has the id of its original.  The original is the one with the smaller session id.
    """
    taken = set()
    for scene in sorted(bpy.data.scenes, key=lambda one: one.session_uid):
        if scene.library is None and scene.rle_splat.scene_id:
            if scene.rle_splat.scene_id in taken:
                _become_own(scene)
            taken.add(scene.rle_splat.scene_id)


def _become_own(scene) -> None:
    """Give a copied scene a new id; copy the pictures that its own cameras and compositor show, drop the others."""
    settings = scene.rle_splat
    settings.scene_id = uuid.uuid4().hex
    settings.image = settings.depth_image = settings.error_image = None
    _forget_rows(scene, lambda row: row.image is None or not (
        row.kind == "backdrop" and row.camera is not None and row.camera.users_scene == (scene,)))  # fmt: skip
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
    """A copy of another scene's picture, owned by this scene."""
    copy = images.copy_of(image)
    copy[OWNER] = scene.rle_splat.scene_id
    return copy


def release_deleted(scene, is_deleted) -> None:
    """Drop the rows of deleted volumes and cameras; Blender empties pointers to objects that a script removes."""
    _forget_rows(
        scene,
        lambda row: row.volume is None or is_deleted(row.volume) or (row.camera is not None and is_deleted(row.camera)),
    )


def _forget_rows(scene, unwanted) -> None:
    rows = scene.rle_splat.pictures
    for index in range(len(rows) - 1, -1, -1):
        if unwanted(rows[index]):
            rows.remove(index)


def _error_lines(report: dict) -> list[str]:
    """Lines on a picture's error and the truth that it is measured against."""
    error = report.get("error", {})
    if error.get("truth") not in TRUTH_TEXTS:
        return []
    if error["tolerance"] is None:
        return ["The error of this picture is not measured. To measure it, use Maximum Error in the Advanced panel."]
    against = TRUTH_TEXTS[error["truth"]]
    measured = f"Error in 8-bit steps: {error['sentence']}; the reference is {against}"
    return [measured, error.get("statement", ""), report["plan"]["name"]]


def note_report(settings, report: dict) -> None:
    """Store the report of a picture in the scene's settings, as text and as JSON, with the list of effects."""
    stages = report.get("stages_ms", {})
    lines = [f"{STAGES.get(name, name).capitalize()}: {value:.0f} ms" for name, value in stages.items()
             if isinstance(value, (int, float)) and (value >= SHORTEST_MS or name == "total")]  # fmt: skip
    settings.last_report = "\n".join((
        *report.get("remarks", ()), report.get("plan", {}).get("why", ""), *_error_lines(report),
        *describe_rays(report.get("rays")), *lines
    ))  # fmt: skip
    settings.last_report_json = json.dumps(report, default=str)
    effects.note_report(settings, report)
