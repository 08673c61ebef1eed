"""Migration of .blend files of earlier versions.

Version 0.1.0 found pictures by name: rows and owners are added that its files lack.  Values of the knobs that were
removed are replaced, and settings that were removed are taken out.  Gradient opacities get their curve.  Mode and
lighting were a scene's, and are now each volume's own.  Highlights are Blinn-Phong's, also where they were Phong's.
"""

import bpy
from bpy.app.handlers import persistent

from ...rle_splat.classify.transfer_function import BLINN_PER_PHONG
from ...rle_splat.scene import without_removed
from .. import messages
from ..look import transfer_nodes
from ..pictures import images, pictures
from ..render import compositor
from ..volumes import volumes
from . import settings
from .playback import curves_of
from .volume_properties import LIGHTING_ITEMS, MODE_ITEMS

# Settings of a scene in files of earlier versions -> their items in the order of their numbers; None of a checkbox.
ITEMS_OF_SCENE = {"mode": MODE_ITEMS, "use_grays": None, "lighting": LIGHTING_ITEMS}


@persistent
def _on_load_post(*_):
    for scene in bpy.data.scenes:
        if scene.library is None and not scene.rle_splat.scene_id:
            _adopt(scene)
    _replace_removed()


def _give_to_volumes(scene) -> None:
    """Give the volumes of a scene the mode and the lighting that earlier versions stored in the scene."""
    own, unlike = scene.rle_splat, {}
    for name, items in ITEMS_OF_SCENE.items():
        number = own.get(name)
        if number is None:
            continue
        del own[name]
        value = bool(number) if items is None else items[number][0]
        for one in volumes.volume_objects(scene):
            if one.library is not None and getattr(one.rle_splat, name) != value:
                unlike[one.name] = None
            elif one.library is None and not one.rle_splat.is_property_set(name):
                setattr(one.rle_splat, name, value)
    if unlike:
        messages.complain(own, f"Mode and Lighting of {', '.join(map(repr, unlike))} come from the linked file; make a "
                               "library override to use those of this scene.")  # fmt: skip
    if any(curve.data_path.removeprefix("rle_splat.") in ITEMS_OF_SCENE for curve in curves_of(scene)):
        messages.complain(own, "Mode and Lighting are animated in the scene; they belong to each volume now, so insert "
                               "these keyframes there.")  # fmt: skip


def _replace_highlights() -> None:
    """Give volumes whose highlights were Phong's, the number 1, the shininess of Blinn-Phong highlights."""
    for own in (one.rle_splat for one in bpy.data.objects if one.library is None and one.override_library is None):
        if own.get("highlight") == 1:
            own.shininess *= BLINN_PER_PHONG
        if "highlight" in own:
            del own["highlight"]


@persistent
def _replace_removed(*_):
    """Replace removed values of the knobs by those that are used instead, take out removed settings, and give volumes
    what was their scene's."""
    _replace_highlights()
    for tree in [tree for tree in bpy.data.node_groups if tree.library is None]:
        if transfer_nodes.is_transfer_tree(tree):
            transfer_nodes.add_gradient_node(tree)
    for scene in [scene for scene in bpy.data.scenes if scene.library is None]:
        own, sentences = scene.rle_splat, []
        _give_to_volumes(scene)
        for name in [name for name in settings.REMOVED_PROPERTIES if own.get(name) is not None]:
            del own[name]
            sentences.append(settings.removed_sentence(name))
        if removed := [name for name in settings.REMOVED_NUMBERS if getattr(own, name) == ""]:
            others = [name for name in settings.OF_PRE if settings.not_in_post(own, name)]
            saved = {name: settings.saved_value(own, name) for name in (*removed, *others)}
            knobs, of_values = without_removed(saved)
            sentences += of_values
            for name in removed:  # the classification first, which sets the others, too
                setattr(own, name, str(knobs[name]))
        if sentences:
            messages.complain(own, " ".join(sentences))


HANDLERS = (("load_post", _on_load_post), ("blend_import_post", _replace_removed))


def _adopt(scene) -> None:
    """Add rows and owners for the pictures of a scene and its cameras."""
    own = scene.rle_splat
    if own.backdrop_object is not None:
        for camera in (one for one in scene.objects if one.type == "CAMERA"):
            for entry in camera.data.background_images:
                if entry.source == "IMAGE":
                    _adopt_image(scene, entry.image, "backdrop", own.backdrop_object, camera)
    for image in compositor.images_of(scene):
        pictures.own(image, scene)
    for owner in volumes.volume_objects(scene):
        for kind in ("color", "depth", "error", "shadow"):
            name = f"{owner.name[: pictures.LONGEST_NAME]} {pictures.SUFFIXES[kind]}"
            _adopt_image(scene, bpy.data.images.get((name, None)), kind, owner)


def _adopt_image(scene, image, kind: str, volume_object, camera=None) -> None:
    if image is None or image.library is not None or images.MARK not in image or pictures.OWNER in image:
        return
    pictures.own(image, scene)
    pictures.add_row(scene, kind, volume_object, camera, image)
