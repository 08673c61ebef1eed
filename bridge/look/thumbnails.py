"""Thumbnails of presets, rendered from the volume itself, in a window's idle time.

A panel asks for icons while it is drawn.  For one that is missing it draws a placeholder, and a timer makes the picture
in short steps: from the disk, or from a coarser copy of voxels that are in memory.  No file of voxels is read for it.
Nothing runs in background mode, during a render, beside an operator, while a viewport refines,
or once the tab is not shown.
"""

from __future__ import annotations

import zipfile
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import bpy.utils.previews
import numpy as np

from ...rle_splat.pipeline.stage_cache import StageCache
from ...rle_splat.pipeline.thumbnail import SIDE, VOXELS, thumbnail_key, thumbnail_steps
from ...rle_splat.runtime import jit
from ...rle_splat.runtime.cache_folder import cache_folder
from ...rle_splat.runtime.steps import announce, rescale
from ...rle_splat.runtime.whole_files import whole_files
from ...rle_splat.scene import RleSplatError
from ...rle_splat.segment.label_map import BACKGROUND
from ...rle_splat.volume.reduced import factors_of, majority, reduce_steps
from .. import live
from ..held import Held
from ..loop import store, timer
from ..pictures.canvas import redraw_sidebars
from ..scene import viewports
from ..volumes import labels, volumes
from . import preset_entries
from .preset_entries import Entry

BITE = 0.005  # seconds after which the timer begins no further step; a step takes up to 25 ms
BUSY = 0.3  # seconds until it is looked again whether others work
CACHE_BYTES = 1 << 28  # of stages that thumbnails of one volume share
MOST_FILES = 600  # about 10 kB each
FOLDER, PIXELS = "thumbnails", "pixels"  # in the user's cache; the array in a file


@dataclass(frozen=True, eq=False)
class WantedThumbnail:
    """A thumbnail that a panel asked for."""

    key: tuple
    owner: Held
    entry: Entry


@dataclass(frozen=True, eq=False)
class Coarse:
    """The volume that thumbnails are made from, in the store while any is wanted, and the stages that they share."""

    volume: object
    cache: StageCache


COARSE = store.Wish(0, store.ANY, "thumbnails")  # for one Coarse

_collections: list = []  # the one preview collection while the extension is registered
_wanted: dict[tuple, WantedThumbnail] = {}  # by key, in the order in which they were asked for
_failed: set = set()  # keys of thumbnails that cannot be made
_work: list = []  # at most one (WantedThumbnail, generator)


def register():
    _collections.append(bpy.utils.previews.new())


def unregister():
    stop()
    bpy.utils.previews.remove(_collections.pop())


def stop() -> None:
    """Drop all work and all pictures, before another file is opened."""
    _rest()
    _failed.clear()
    for collection in _collections:
        collection.clear()
    timer.stop(_tick)


def _key(owner, entry: Entry) -> tuple:
    properties = owner.rle_splat
    beside = properties.label_file if labels.hides_rest(owner) else ""
    return owner.session_uid, properties.data_key, beside, entry.is_own, entry.name, entry.stamp


def icon(owner, entry: Entry) -> int:
    """The icon of a preset; one that is missing is asked for, and 0 meanwhile.

    It reads only properties of the object, so a panel may call it at every redraw.
    """
    key = _key(owner, entry)
    name = repr(key)
    for collection in _collections:
        if name in collection:
            return collection[name].icon_id
        if key not in _failed and key not in _wanted:
            _wanted[key] = WantedThumbnail(key, Held(owner), entry)
            timer.start(_tick, timer.PAUSE, BITE)
    return 0


def _tick():
    """Timer function: do one step."""
    if not _tab_is_shown():
        _rest()
        return None
    if _others_work():
        return BUSY
    if not _work and not _begin():
        _rest()
        return None
    if _advance():
        redraw_sidebars(bpy.context)  # it asks for more
    return timer.AT_ONCE


def _rest() -> None:
    """Nothing is asked for now: what is unfinished is dropped, and the coarser voxels with it."""
    for _, steps in _work:
        steps.close()
    for held in (_work, _wanted):
        held.clear()
    store.withdraw([COARSE])


def _others_work() -> bool:
    """Whether something runs that users wait for."""
    views = (view for area in viewports.all_areas() for view in live.viewports_of(area))
    return timer.must_wait() or any(view.is_busy for view in views)


def _tab_is_shown() -> bool:
    """Whether a sidebar shows the extension's tab."""
    for area in viewports.all_areas():
        for region in area.regions:
            if region.type == "UI" and region.width > 1 and region.active_panel_category == viewports.tab():
                return True
    return False


def _begin() -> bool:
    """Begin the next thumbnail that can be made; whether there is one."""
    for key, wanted in list(_wanted.items()):
        owner = wanted.owner.find()
        volume = None if owner is None else volumes.at_hand(owner)
        without_rest = volume is not None and labels.hides_rest(owner)
        if volume is None or not volume.holds_values or (without_rest and not labels.are_at_hand(owner, volume)):
            del _wanted[key]  # the panel asks again when it is drawn the next time
            continue
        segments = labels.map_at_hand(owner, volume) if without_rest else None
        _work.append((wanted, picture_steps(wanted.entry, volume, segments)))
        return True
    return False


def _advance() -> bool:
    """Do one step; whether a thumbnail is done."""
    wanted, steps = _work[0]
    try:
        next(steps)
        return False
    except StopIteration as finished:
        _show(wanted.key, finished.value)
    except (RleSplatError, MemoryError):  # a damaged preset, say, which applying it tells
        _failed.add(wanted.key)
    _work.clear()
    _wanted.pop(wanted.key, None)
    return True


def _show(key: tuple, pixels: np.ndarray) -> None:
    """Make an icon of (SIDE, SIDE, 3) uint8 pixels, row 0 at the top."""
    (collection,) = _collections
    name = repr(key)
    preview = collection[name] if name in collection else collection.new(name)
    rgba = np.ones((SIDE, SIDE, 4), np.float32)
    rgba[..., :3] = pixels[::-1] / np.float32(255.0)
    preview.image_size = SIDE, SIDE
    preview.image_pixels_float.foreach_set(rgba.ravel())


def picture_steps(entry: Entry, volume, segments=None):
    """Generator of Progress: the thumbnail of a preset, from the disk or rendered and then kept there.

    Parameters
    ----------
    entry : Entry
    volume : Volume
    segments : Volume, optional
        The label map of a volume whose rest, which is in no segment, is hidden.

    Returns
    -------
    (SIDE, SIDE, 3) ndarray of uint8
        sRGB, row 0 at the top.

    Raises
    ------
    RleSplatError
        If the preset cannot be read, or nothing can be rendered, or its kernels would have to be compiled first.
    """
    function, _ = yield from rescale(preset_entries.transfer_steps(entry, volume), 0.0, 0.1)
    key = thumbnail_key(volume, function, segments)
    kept = load_file(key)
    if kept is not None:
        return kept
    # The viewport has compiled the kernels of others.
    if function.gradient_opacity is not None and jit.compiled() and not jit.shipped_level():
        raise RleSplatError("A preset with gradient opacity has no picture here, since it would take long.")
    of_volume = "thumbnails", volume.key, segments and segments.key
    coarse = store.find(of_volume)
    if coarse is None:
        small = yield from announce(_reduced_steps(volume, segments), 0.1, 0.5, "reducing the volume")
        coarse = Coarse(small, StageCache(CACHE_BYTES))
        store.put(COARSE, of_volume, coarse)
    spacing = float(volume.spacing.min())
    pixels = yield from rescale(thumbnail_steps(coarse.volume, function, spacing, coarse.cache), 0.5, 1.0)
    save_file(key, pixels)
    return pixels


def _reduced_steps(volume, segments):
    """Generator of fractions done: a coarser volume, with its lowest value in what is in no segment."""
    factors = factors_of(volume, VOXELS)
    small = yield from reduce_steps(volume, factors)
    if segments is None:
        return small
    found = yield from reduce_steps(segments, factors, majority)
    return replace(small, voxels=np.where(found.voxels == BACKGROUND, small.voxels.min(), small.voxels))


def file_folder() -> Path:
    """Where thumbnails are kept; it may not exist yet."""
    return cache_folder() / FOLDER


def delete_files() -> int:
    """Delete the thumbnails on disk, which show patients, and return their bytes."""
    deleted = 0
    for file in file_folder().glob("*.npz"):
        with suppress(OSError):
            size = file.stat().st_size
            file.unlink()
            deleted += size
    return deleted


def load_file(key: str) -> np.ndarray | None:
    """A thumbnail that was kept on disk; its file is named by a hash of voxels and transfer function.

    Parameters
    ----------
    key : str
        See ``thumbnail_key``.

    Returns
    -------
    (SIDE, SIDE, 3) ndarray of uint8, or None
        None if it is not there, or damaged.
    """
    try:
        with np.load(file_folder() / f"{key}.npz", allow_pickle=False) as stored:
            pixels = stored[PIXELS]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return pixels if pixels.shape == (SIDE, SIDE, 3) and pixels.dtype == np.uint8 else None


def save_file(key: str, pixels: np.ndarray) -> None:
    """Keep a thumbnail, and forget the oldest beyond MOST_FILES; where nothing can be written it is not kept."""
    place = file_folder()
    with suppress(OSError):
        place.mkdir(exist_ok=True)
        with whole_files([place / f"{key}.npz"]) as (part,):
            np.savez_compressed(part, **{PIXELS: pixels})
        files = sorted(place.glob("*.npz"), key=lambda file: file.stat().st_mtime, reverse=True)
        for file in files[MOST_FILES:]:
            file.unlink(missing_ok=True)
