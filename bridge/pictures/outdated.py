"""Detects outdated pictures: the inputs of every picture are recorded and compared with the scene.

Undo restores settings but not pixels.  So the record is kept outside Blender's data, by the image's session id, and is
written into the image only when the file is saved.
"""

import json
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

from ...rle_splat.runtime.array_hash import hash_plain
from ...rle_splat.scene import RleSplatError, Scene
from ..data import settings
from ..look import transfer
from ..scene import render_scene
from ..volumes import loading, volumes
from . import backdrop, pictures

MADE_FROM = "rle_splat_made_from"  # custom property of a saved image: MadeFrom as JSON


class MadeFrom(NamedTuple):
    """The inputs of a picture.

    Attributes
    ----------
    digest : str
        Hash of all inputs.
    transfer_function : str
        Hash of the transfer function alone.
    meshes : bool
        Whether meshes occluded the volume.
    """

    digest: str
    transfer_function: str
    meshes: bool


_made_from: dict[int, MadeFrom] = {}  # by session id of the image
_out_of_date: set[int] = set()  # session ids of the images that the last ``update_status`` found outdated


def made_of(plain: Scene, quality, tolerance: float | None, meshes: bool) -> MadeFrom:
    """The record of a picture's inputs; ``tolerance``: in levels of 1/255."""
    plain = replace(plain, reasons_off={})  # texts for the report, which change no pixel
    return MadeFrom(hash_plain(plain, quality, tolerance), hash_plain(plain.transfer_function), meshes)


def note(image, made_from: MadeFrom) -> None:
    """Record the inputs of an image's pixels."""
    _made_from[image.session_uid] = made_from
    _out_of_date.discard(image.session_uid)


def made_from(image) -> MadeFrom | None:
    """The recorded inputs of an image; None if they are unknown, or its pixels were lost with their file."""
    if image.session_uid not in _made_from and MADE_FROM in image and image.size[0] > 0:
        with suppress(ValueError, TypeError):  # a damaged record is as none
            _made_from[image.session_uid] = MadeFrom(*json.loads(image[MADE_FROM]))
    return _made_from.get(image.session_uid)


def store(image) -> None:
    """Write the record of an image's inputs into the image, before the file is saved."""
    known = made_from(image)
    if known is not None:
        image[MADE_FROM] = json.dumps(known)


def out_of_date(scene) -> list:
    """The outdated pictures among those that the scene shows, as of the last ``update_status``.

    It reads properties only, so a panel may call it.
    """
    return [
        row.image
        for row in shown_rows(scene)
        if row.image.session_uid in _out_of_date or _has_new_transfer_function(scene, row)
    ]


def forget() -> None:
    """Drop all records, before another file is opened."""
    _made_from.clear()
    _out_of_date.clear()


def update_status(scene, depsgraph) -> bool:
    """Compare the scene's last picture and its camera's backdrop with the scene; whether one's state has changed.

    A picture whose volume or labels are not in memory is skipped, because reading could take long; but if another frame
    of the volume is in memory, the picture is outdated.
    """
    before = set(_out_of_date)
    for row in shown_rows(scene):
        if volumes.shows_another(row.volume, depsgraph):
            _out_of_date.add(row.image.session_uid)
        elif loading.is_at_hand(row.volume, depsgraph):
            known = made_from(row.image)
            if known == _made_now(row.volume, depsgraph, known.meshes):
                _out_of_date.discard(row.image.session_uid)
            else:
                _out_of_date.add(row.image.session_uid)
    return _out_of_date != before


def shown_rows(scene) -> list:
    """The rows of the last picture and of the active camera's backdrop whose inputs are known."""
    camera = scene.camera if scene.camera is not None and scene.camera.type == "CAMERA" else None
    entry = backdrop.find(scene, camera) if camera is not None else None
    images = {"color": scene.rle_splat.image, "backdrop": entry.image if entry is not None else None}
    return [
        row for row in scene.rle_splat.pictures
        if row.image is not None and row.image == images.get(row.kind) and row.volume is not None
        and pictures.owned_by(row.image, scene) and made_from(row.image) is not None
    ]  # fmt: skip


def _has_new_transfer_function(scene, row) -> bool:
    known = made_from(row.image)
    try:
        shown = transfer.shown_transfer(row.volume)
        return bool(known.transfer_function) and known.transfer_function != hash_plain(shown)
    except RleSplatError:
        return True


def _made_now(volume_object, depsgraph, meshes: bool) -> MadeFrom | None:
    """The inputs of a picture made now; None if none can be made."""
    try:
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=meshes)
        return made_of(plain, quality, settings.tolerance_of(depsgraph.scene_eval), meshes)
    except RleSplatError:
        return None
