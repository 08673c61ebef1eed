"""Volume objects and their voxels.

Voxels stay outside the .blend.  They are read when first needed and stay in ``loop.store``.  Their key is the file, its
size, its modification time (of a series, those of its folder's files) and the options, the frame among them.  Of the
frames of a volume object, the last one that was asked for in each scene stays, and those that were read ahead.
"""

from dataclasses import dataclass

import bpy

from ...rle_splat.read.dicom.grouping import SeveralSeries
from ...rle_splat.read.formats import read_steps
from ...rle_splat.read.sequence import sequence_of
from ...rle_splat.runtime.steps import drain, rescale
from ...rle_splat.scene import RleSplatError
from ...rle_splat.volume.measure import measure_steps
from ..data.playback import shown_frame
from ..data.source_options import read_options
from ..loop import index, store
from ..translations import filled
from . import encoded, file_changes
from .source_paths import resolved_path

READING = 0.9  # share of the time until a file is read; the rest is for measuring its values
PURPOSE = "voxels"  # see ``store.Wish``


@dataclass(frozen=True)
class VolumeSource:
    """Where the voxels of a volume object are at a time: file or folder, options of reading, and key of the cache."""

    path: str
    options: dict
    key: tuple


def volume_objects(scene) -> list:
    """The volume objects of a scene, sorted by name."""
    return index.objects(index.of(scene).volumes)


def volume_object(context):
    """The volume that an operator or a panel works on, or None.

    The active object or its parent if that is a volume, else the only selected volume, else the scene's only volume.
    """
    every = volume_objects(context.scene)
    if not every:
        return None
    active = context.view_layer.objects.active
    for candidate in (active, active.parent if active is not None else None):
        if candidate is not None and candidate.rle_splat.is_volume:
            return candidate
    selected = [o for o in every if o.select_get(view_layer=context.view_layer)]
    for candidates in (selected, every):
        if len(candidates) == 1:
            return candidates[0]
    return None


def expose_modules() -> None:
    """Make the modules that Blender bundles importable, such as OpenVDB and OpenImageIO, which readers use."""
    bpy.utils.expose_bundled_modules()


def file_steps(path: str, options: dict):
    """Generator of Progress: read a Volume and measure its values, or open a StoredVolume."""
    if encoded.is_encoded(path):
        return (yield from encoded.open_steps(path, options))
    expose_modules()
    volume = yield from rescale(read_steps(path, **options), 0.0, READING)
    yield from rescale(measure_steps(volume), READING, 1.0)
    return volume


def hash_of(volume) -> str:
    """Hash of the voxels of a volume, or of all of an encoded one."""
    return volume.voxel_key if volume.holds_values else volume.key


def source_of(owner, frame: int) -> VolumeSource:
    """Where the voxels of a volume object are; RleSplatError if the object is no volume, or its file is missing.

    Parameters
    ----------
    frame : int
        Which time point, from 1.
    """
    properties = owner.rle_splat
    if not properties.is_volume:
        raise RleSplatError(f"{owner.name!r} is not a volume; import one with File > Import > Volume.")
    path, options = resolved_path(owner), read_options(properties)
    try:
        if properties.use_sequence:
            path = file_of_frame(path, frame)
            options.pop("frame", None)
        elif properties.frame_count > 1:
            options["frame"] = frame
        state = file_changes.state_of(path, bool(properties.series_key))
    except OSError:
        raise RleSplatError(
            f"The file of {owner.name!r} is not at {path}; click Relocate in the RLE Splat tab to choose its new place."
        ) from None
    return VolumeSource(path, options, (path, state, tuple(sorted(options.items()))))


def is_missing(owner) -> bool:
    """Whether the file of a volume object is not where it was."""
    try:
        source_of(owner, shown_frame(owner))
    except RleSplatError:
        return True
    return False


def files_digest(owner) -> str:
    """Hash of the names, sizes and times of all files of a volume object, whatever it shows; "" if one is gone."""
    properties, path = owner.rle_splat, resolved_path(owner)
    try:
        numbered = sequence_of(path) if properties.use_sequence else None
        if numbered is not None:
            return file_changes.digest((file.name, *file_changes.state_of(file)) for file in numbered.files.values())
        return file_changes.digest(file_changes.state_of(path, bool(properties.series_key)))
    except OSError:
        return ""


def file_of_frame(path: str, frame: int) -> str:
    """The file of a frame of numbered files, of which ``path`` is one; FileNotFoundError without any such file."""
    found = sequence_of(path)
    if found is None:
        raise FileNotFoundError(path)
    return str(found.file(frame))


def load_steps(owner, depsgraph=None, ahead: int = 0):
    """Generator of Progress: load the voxels of a volume object as ``load_volume`` does; return the Volume.

    The object is read before the first step, so it may be deleted meanwhile.
    """
    source = source_of(owner, shown_frame(owner, depsgraph, ahead))
    return _cached_steps(source, store.wish_of(owner, depsgraph, PURPOSE))


def load_ahead_steps(owner, ahead: int):
    """Generator of Progress: load the voxels that a volume object shows some frames of the timeline later."""
    source = source_of(owner, shown_frame(owner, ahead=ahead))
    return _cached_steps(source, store.frame_wish(owner, source.key))


def _cached_steps(source: VolumeSource, wish: store.Wish):
    """Generator of Progress: the voxels of a source, from memory or its file."""
    try:
        return (yield from store.steps(wish, source.key, lambda: file_steps(source.path, source.options)))
    except SeveralSeries as several:
        raise RleSplatError(
            f"{several.problem} at {source.path}; click Relocate in the RLE Splat tab to choose one."
        ) from None


def load_volume(owner, warn=None, depsgraph=None, ahead: int = 0):
    """The voxels of a volume object, from memory or from its file.

    Parameters
    ----------
    warn : callable, optional
        Called with one sentence if the voxels differ from those that were imported.
    depsgraph : bpy.types.Depsgraph, optional
        Gives the time of a volume in time; without it that of the current scene.
    ahead : int
        Frames of the timeline after that time.

    Raises
    ------
    RleSplatError
        If the object is no volume, or its file is missing or cannot be read.
    """
    volume = drain(load_steps(owner, depsgraph, ahead))
    properties = owner.rle_splat
    if warn is None or not properties.data_key:
        return volume
    frame = shown_frame(owner, depsgraph, ahead)
    if frame != properties.data_frame:
        if properties.files_digest and properties.files_digest != files_digest(owner):
            warn(f"The files of {owner.name!r} have changed since the import; if frame {frame} looks wrong, import "
                 "them again.")  # fmt: skip
    elif hash_of(volume) != properties.data_key:
        warn(_changed(owner))
    return volume


def _changed(owner) -> str:
    return filled(
        "The voxels of {volume} are not those that were imported, because {path} has changed; import it again, or "
        "click Relocate to choose the original file.", volume=repr(owner.name), path=resolved_path(owner))  # fmt: skip


def list_changes(scene) -> list[str]:
    """A sentence for each volume of a scene in memory whose voxels are not those that were imported; reads no file."""
    found = []
    for owner in volume_objects(scene):
        properties = owner.rle_splat
        if properties.data_key and shown_frame(owner) == properties.data_frame:
            volume = at_hand(owner)
            if volume is not None and hash_of(volume) != properties.data_key:
                found.append(_changed(owner))
    return found


def at_hand(owner, depsgraph=None, ahead: int = 0):
    """The voxels of a volume object if they are in memory, so that ``load_volume`` returns at once, else None.

    ``ahead``: frames of the timeline after the depsgraph's time.
    """
    try:
        return store.find(source_of(owner, shown_frame(owner, depsgraph, ahead)).key)
    except RleSplatError:
        return None


def is_at_hand(owner, depsgraph=None, ahead: int = 0) -> bool:
    """Whether ``at_hand`` finds voxels."""
    return at_hand(owner, depsgraph, ahead) is not None


def shows_another(owner, depsgraph=None) -> bool:
    """Whether a volume object shows a frame that is not in memory, while another one is that it showed before."""
    has_one = store.has_any(store.wish_of(owner, depsgraph, PURPOSE))
    return owner.rle_splat.frame_count > 1 and has_one and not is_at_hand(owner, depsgraph)


def forget_all() -> None:
    """Forget all voxels and labels, and what is known of their files."""
    store.forget_all()
    file_changes.forget()
