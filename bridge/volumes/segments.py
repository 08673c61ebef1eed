"""Label maps that segment tools make of a volume object: the file of each, and how the object shows it.

Each change becomes a new file, so that undo finds the map of before and no file of the user is overwritten.
"""

import os
import shutil
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ...rle_splat.read.beside import find_segmentations_steps
from ...rle_splat.read.formats import write_steps
from ...rle_splat.runtime.steps import announce, rescale
from ...rle_splat.scene import RleSplatError
from ...rle_splat.segment import body
from ...rle_splat.segment.label_map import BACKGROUND, empty_map, free_number, put_segment, value_steps
from ...rle_splat.volume.volume import NamedLabel, Volume
from ..look import transfer
from ..loop import store
from ..paths import free_name, usable_name
from ..pictures.picture_files import FOLDER
from . import labels
from .source_paths import resolved_path

SUFFIX = ".nii.gz"
LOADED, MADE = 0.2, 0.8  # shares of the time until the map is read and changed
WRITTEN = 0.75  # share of the rest until it is written
NAMED = 3  # files whose names a message lists
VISIBLE = 0.02  # share of the transfer function's largest opacity from which on a value counts as visible
VALUES = 4096  # of the volume's range, at which the transfer function is looked up


@dataclass(frozen=True)
class MadeSegment:
    """A label map, its file, and the number of the segment that is new or changed; None of a map that was found."""

    path: str
    found: labels.LabelMap
    number: int | None


def change_steps(owner, volume: Volume, make_mask, number: int | None = None, name: str = "", over_others: bool = True):
    """Generator of Progress: change the label map of a volume object and write it to a new file.

    The object is read before the first step.

    Parameters
    ----------
    owner : bpy.types.Object
        The volume object.
    volume : Volume
        Its voxels.
    make_mask : callable
        ``make_mask(labels, shown)`` is a generator of Progress that returns the segment's voxels, a (nz, ny, nx) array
        of bool.  ``labels``: the map of before, a Volume.  ``shown``: which voxels belong to no hidden segment.
    number : int or None
        Label of the segment that is changed; None makes one.
    name : str
        Of a new segment.
    over_others : bool
        As of ``put_segment``.

    Returns
    -------
    MadeSegment

    Raises
    ------
    RleSplatError
        If the label file cannot be read, changes with time or is no label map of the volume, or the new file cannot be
        written.
    """
    properties = owner.rle_splat
    if properties.label_file and properties.label_frames > 1:
        raise RleSplatError(
            f"The segments of {owner.name!r} change with time, and tools make one map for all frames; export the "
            "segments of this frame, and choose that file first."
        )
    file = labels.file_of(owner) if properties.label_file else None
    wish = store.wish_of(owner, None, labels.PURPOSE)
    hidden = [row.label for row in properties.labels if not row.show]
    names = named_rows(owner)
    path = _free_path(owner.name)

    def steps():
        if file is None:
            before = empty_map(volume)
        else:
            before = (yield from rescale(labels.load_steps(wish, file, volume), 0.0, LOADED)).volume
        labels.check_grid(before, volume)
        shown = np.isin(before.voxels, hidden, invert=True)
        mask = yield from rescale(make_mask(before, shown), LOADED, MADE)
        chosen = free_number(before) if number is None else number
        after = put_segment(before, chosen, mask, over_others)
        named = {one.label: one for one in (body.NAMES[BACKGROUND], *before.named_labels, *names)}
        if number is None:
            named[chosen] = NamedLabel(chosen, name)
        return (yield from rescale(_written_steps(after, tuple(named.values()), path, chosen), MADE, 1.0))

    return steps()


def body_steps(volume: Volume, transfer_function, name: str):
    """Generator of Progress: the body as the only segment, where ``body_labels`` hides what lies beside it, as a
    MadeSegment; else None. ``name``: of the volume."""
    found = yield from rescale(body.body_labels_steps(volume, transfer_function), 0.0, MADE)
    if found is None:
        return None
    return (yield from rescale(_written_steps(found.volume, body.NAMES, _free_path(name), body.BODY), MADE, 1.0))


def beside_steps(path: str, volume: Volume):
    """Generator of Progress: the segmentation that lies beside a scan; see ``find_segmentations_steps``.

    Parameters
    ----------
    path : str
        Of the scan.

    Returns
    -------
    made : MadeSegment or None
        None if there is none, there are several, or it is not one of this scan.
    reason : str
        A sentence why there is none in spite of a file, or "".
    """
    found = yield from rescale(find_segmentations_steps(path, volume.series), 0.0, LOADED)
    if len(found) != 1:
        names = ", ".join(one.name for one in found[:NAMED]) + (" and others" if len(found) > NAMED else "")
        return None, f"Several segmentations lie beside the scan ({names}); choose one in Segments." if found else ""
    file = labels.LabelFile(str(found[0]), os.path.basename(path))
    try:
        listed = yield from rescale(labels.listed_steps(file, volume), LOADED, 1.0)
    except RleSplatError as problem:
        return None, f"The segments beside the scan are not shown. {problem}"
    if listed.volume.place_key and volume.place_key and listed.volume.place_key != volume.place_key:
        return None, f"{found[0].name} belongs to another frame of reference than the scan, and is not shown."
    return MadeSegment(file.path, listed, None), ""


def _written_steps(labels_after: Volume, named: tuple, path: str, number: int):
    """Generator of Progress: write a label map with the names of its segments, as a MadeSegment."""
    after = replace(labels_after, named_labels=named, remarks=())
    os.makedirs(os.path.dirname(path), exist_ok=True)
    yield from rescale(write_steps(after, path), 0.0, WRITTEN, "writing the segments")
    values = yield from announce(value_steps(after), WRITTEN, 1.0, "reading labels")
    return MadeSegment(path, labels.LabelMap(after, values), number)


def show(owner, volume: Volume, made: MadeSegment, hide: str = "") -> None:
    """Show a label map that was made as that of a volume object, with the segment chosen in the list.

    Parameters
    ----------
    owner : bpy.types.Object
    hide : {"", "BACKGROUND", "OTHERS"}
        What is hidden: nothing more, what is in no segment, or all but the segment.
    """
    properties = owner.rle_splat
    properties.label_file = made.path
    properties.labels_of = os.path.basename(labels.file_of(owner).path)  # rows stay as they are: they are of this map
    store.put(store.wish_of(owner, None, labels.PURPOSE), labels.file_of(owner).key(volume), made.found)
    labels.list_labels(owner, made.found)
    for index, row in enumerate(properties.labels):
        if row.label == made.number:
            properties.active_label, row.show = index, True
        elif hide == "OTHERS" or (hide == "BACKGROUND" and row.label == BACKGROUND):
            row.show = False


def named_rows(owner) -> tuple[NamedLabel, ...]:
    """Names and colors of the rows of a volume object's labels."""
    return tuple(
        NamedLabel(row.label, row.label_name, tuple(row.color) if row.use_color else None)
        for row in owner.rle_splat.labels
    )


def chosen_row(owner):
    """The row that is chosen in the list of segments; None without rows, or if it is that of the background."""
    properties = owner.rle_splat
    if properties.active_label >= len(properties.labels):
        return None
    row = properties.labels[properties.active_label]
    return None if row.label == BACKGROUND else row


def lowest_visible(owner, depsgraph=None) -> float:
    """The lowest value that a volume object's transfer function shows; RleSplatError if it shows nothing."""
    properties = owner.rle_splat
    values = np.linspace(properties.value_low, properties.value_high, VALUES)
    opacities = transfer.read_transfer(owner, depsgraph).alpha_at(values)
    if not opacities.any():
        raise RleSplatError(f"All of {owner.name!r} is transparent; choose a preset.")
    return float(values[opacities >= VISIBLE * opacities.max()][0])


def brightest_near(volume: Volume, index) -> tuple[int, int, int]:
    """The voxel (x, y, z) with the highest value of the eight around a voxel index of fractions."""
    first = np.clip(np.floor(index), 0, np.array(volume.shape_xyz) - 1).astype(int)
    near = tuple(slice(n, n + 2) for n in first[::-1])
    values = np.nan_to_num(volume.physical(volume.voxels[near]), nan=-np.inf)
    x, y, z = first + np.unravel_index(values.argmax(), values.shape)[::-1]
    return int(x), int(y), int(z)


def is_temporary(path: str) -> bool:
    """Whether a file lies in Blender's temporary folder, which is emptied when Blender ends."""
    return os.path.normpath(path).startswith(os.path.normpath(bpy.app.tempdir) + os.sep)


def _folder(blend_file: str) -> str:
    """The folder of a .blend for label maps and pictures; Blender's temporary one before its first save."""
    if not blend_file:
        return os.path.join(bpy.app.tempdir, "segments")
    blend_file = os.path.abspath(blend_file)
    return os.path.splitext(blend_file)[0] + FOLDER


def _free_path(name: str, blend_file: str | None = None) -> str:
    """A file name for a label map of a volume object of a name, which no file has."""
    folder = _folder(bpy.data.filepath if blend_file is None else blend_file)
    plain = usable_name(name.replace(".", "_"), "volume")
    return free_name(os.path.join(folder, f"{plain} segments"), SUFFIX, lambda path: not os.path.exists(path))


def _keep_temporary(blend_file, *_):
    """Copy label maps from Blender's temporary folder beside the .blend that is being saved."""
    for owner in bpy.data.objects if blend_file else ():
        if owner.library is not None or not (owner.rle_splat.is_volume and owner.rle_splat.label_file):
            continue
        path = resolved_path(owner, "label_file")
        if is_temporary(path) and os.path.isfile(path):
            kept = _free_path(owner.name, blend_file)
            try:
                os.makedirs(os.path.dirname(kept), exist_ok=True)
                shutil.copy2(path, kept)
            except OSError:
                continue  # the path of the temporary file is saved, and Relocate tells that it is gone
            owner.rle_splat.label_file = kept


HANDLERS = (("save_pre", _keep_temporary),)
