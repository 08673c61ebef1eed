"""Whether a picture still shows the scene as it is: every picture knows what it was made from.

Undo takes settings back but not pixels.  So what an image was made from is remembered beside the session, by the
image's session id, and written into the image only when the file is saved.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields, is_dataclass

import numpy as np

from ..rle_splat.scene import RleSplatError, Scene
from ..rle_splat.volume.volume import Volume
from . import backdrop, pictures, render_scene, settings, volumes

MADE_FROM = "rle_splat_made_from"  # custom property of a saved image: JSON of its digest and of whether meshes occlude

_made_from: dict[int, tuple[str, bool]] = {}  # image's session id -> (digest, whether meshes occlude)
_out_of_date: set[int] = set()  # session ids of the images that were last found to be


def digest_of(plain: Scene, quality, tolerance: float | None) -> str:
    """A hash of everything a picture depends on."""
    total = hashlib.blake2b(digest_size=16)
    _feed(total, (plain, quality, tolerance))
    return total.hexdigest()


def note(image, digest: str, with_meshes: bool) -> None:
    """Remember what an image's pixels were made from."""
    _made_from[image.session_uid] = (digest, with_meshes)
    _out_of_date.discard(image.session_uid)


def made_from(image) -> tuple[str, bool] | None:
    """(digest, whether meshes occlude) of an image; None when it is not known."""
    if image.session_uid not in _made_from and MADE_FROM in image:
        _made_from[image.session_uid] = tuple(json.loads(image[MADE_FROM]))
    return _made_from.get(image.session_uid)


def store(image) -> None:
    """Write into the image what it was made from, for when the file is opened again."""
    known = made_from(image)
    if known is not None:
        image[MADE_FROM] = json.dumps(known)


def is_out_of_date(image) -> bool:
    """Whether the scene has changed since the picture was made, as of the last ``judge``."""
    return image is not None and image.session_uid in _out_of_date


def forget() -> None:
    """Forget everything, for another file."""
    _made_from.clear()
    _out_of_date.clear()


def judge(scene, depsgraph) -> bool:
    """Hold the scene's last picture and its camera's backdrop against the scene; whether a judgement changed.

    A picture whose volume is not in memory is not judged: reading it could take long.
    """
    before = set(_out_of_date)
    for row in scene.rle_splat.pictures:
        image = row.image
        if not (_is_shown(scene, row) and pictures.owned_by(image, scene)) or made_from(image) is None:
            continue
        if row.volume is None or not volumes.is_at_hand(row.volume):
            continue
        if made_from(image)[0] == _digest_now(row.volume, depsgraph, made_from(image)[1]):
            _out_of_date.discard(image.session_uid)
        else:
            _out_of_date.add(image.session_uid)
    return _out_of_date != before


def _is_shown(scene, row) -> bool:
    """Whether a row is of the last picture, or of the backdrop that the active camera shows."""
    if row.kind == "backdrop" and row.camera is not None and row.camera == scene.camera:
        entry = backdrop.find(scene, row.camera)
        return entry is not None and entry.image == row.image
    return row.kind == "color" and row.image == scene.rle_splat.image


def _digest_now(volume_object, depsgraph, with_meshes: bool) -> str:
    """The digest of a picture made now; "" where none can be made."""
    try:
        plain, quality = render_scene.read_scene(volume_object, depsgraph, with_meshes=with_meshes)
        return digest_of(plain, quality, settings.tolerance_of(depsgraph.scene_eval))
    except RleSplatError:
        return ""


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
