"""Whether a picture still shows the scene as it is: every picture knows what it was made from.

Undo takes settings back but not pixels.  So what an image was made from is remembered beside the session, by the
image's session id, and written into the image only when the file is saved.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields, is_dataclass, replace
from typing import NamedTuple

import numpy as np

from ..rle_splat.scene import RleSplatError, Scene
from ..rle_splat.volume.volume import Volume
from . import backdrop, pictures, render_scene, settings, transfer, volumes

MADE_FROM = "rle_splat_made_from"  # custom property of a saved image: a MadeFrom as JSON


class MadeFrom(NamedTuple):
    """What a picture was made from: ``digest`` of all of it, ``look`` of its transfer function alone, and whether
    ``meshes`` hid the volume."""

    digest: str
    look: str
    meshes: bool


_made_from: dict[int, MadeFrom] = {}  # by the image's session id
_out_of_date: set[int] = set()  # session ids of the images that were last found to be


def made_of(plain: Scene, quality, tolerance: float | None, meshes: bool) -> MadeFrom:
    """What a picture of plain data is made from; ``meshes``: whether they were asked to hide the volume."""
    plain = replace(plain, reasons_off={})  # words for reports
    return MadeFrom(_digest((plain, quality, tolerance)), _digest(plain.transfer_function), meshes)


def note(image, made_from: MadeFrom) -> None:
    """Remember what an image's pixels were made from."""
    _made_from[image.session_uid] = made_from
    _out_of_date.discard(image.session_uid)


def made_from(image) -> MadeFrom | None:
    """What an image was made from; None when it is not known, or its pixels were lost with their file."""
    if image.session_uid not in _made_from and MADE_FROM in image and image.size[0] > 0:
        _made_from[image.session_uid] = MadeFrom(*json.loads(image[MADE_FROM]))
    return _made_from.get(image.session_uid)


def store(image) -> None:
    """Write into the image what it was made from, for when the file is opened again."""
    known = made_from(image)
    if known is not None:
        image[MADE_FROM] = json.dumps(known)


def out_of_date(scene) -> list:
    """The images of pictures that the scene shows and that no longer show the scene, as of the last ``judge``.

    Reads properties only, so a panel may call it.
    """
    return [
        row.image for row in shown_rows(scene)
        if row.image.session_uid in _out_of_date or _has_new_look(row)
    ]


def have_new_looks(scene) -> bool:
    """Whether a transfer function of a picture that the scene shows was edited, also by a script that told no one."""
    return any(_has_new_look(row) for row in shown_rows(scene))


def forget() -> None:
    """Forget everything, for another file."""
    _made_from.clear()
    _out_of_date.clear()


def judge(scene, depsgraph) -> bool:
    """Hold the scene's last picture and its camera's backdrop against the scene; whether a judgement changed.

    A picture whose volume is not in memory is not judged: reading it could take long.
    """
    before = set(_out_of_date)
    for row in shown_rows(scene):
        if volumes.is_at_hand(row.volume):
            known = made_from(row.image)
            if known == _made_now(row.volume, depsgraph, known.meshes):
                _out_of_date.discard(row.image.session_uid)
            else:
                _out_of_date.add(row.image.session_uid)
    return _out_of_date != before


def shown_rows(scene) -> list:
    """The rows of the last picture and of the active camera's backdrop, of which it is known what they were made
    from."""
    camera = scene.camera if scene.camera is not None and scene.camera.type == "CAMERA" else None
    entry = backdrop.find(scene, camera) if camera is not None else None
    images = {"color": scene.rle_splat.image, "backdrop": entry.image if entry is not None else None}
    return [
        row for row in scene.rle_splat.pictures
        if row.image is not None and row.image == images.get(row.kind) and row.volume is not None
        and pictures.owned_by(row.image, scene) and made_from(row.image) is not None
    ]


def _has_new_look(row) -> bool:
    known = made_from(row.image)
    try:
        return bool(known.look) and known.look != _digest(transfer.read_transfer(row.volume))
    except RleSplatError:
        return True


def _made_now(volume_object, depsgraph, meshes: bool) -> MadeFrom | None:
    """What a picture made now is made from; None where none can be made."""
    try:
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=meshes)
        return made_of(plain, quality, settings.tolerance_of(depsgraph.scene_eval), meshes)
    except RleSplatError:
        return None


def _digest(value) -> str:
    """A hash of plain data."""
    total = hashlib.blake2b(digest_size=16)
    _feed(total, value)
    return total.hexdigest()


def _feed(total, value) -> None:
    """Add a value of plain data to a hash."""
    if isinstance(value, Volume):
        total.update(f"{value.key}{value.unit}".encode())
    elif is_dataclass(value):
        total.update(type(value).__name__.encode())
        _feed(total, [getattr(value, entry.name) for entry in fields(value)])
    elif isinstance(value, np.ndarray):
        total.update(f"{value.dtype.str}{value.shape}".encode())
        total.update(np.ascontiguousarray(value).data)
    elif isinstance(value, dict):
        _feed(total, sorted(value.items()))
    elif isinstance(value, (tuple, list)):
        total.update(f"({len(value)}".encode())
        for one in value:
            _feed(total, one)
    else:
        total.update(f"{value!r};".encode())
