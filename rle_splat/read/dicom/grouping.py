"""Pictures -> series: which belong together, which are frames in time, which are copies, and in which order."""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ...scene import RleSplatError
from . import stacking
from .pictures import SEPARATORS, TIMES, ImageFrame
from .refusals import Refused, no_positions, single_picture

# Direction cosines and, relative, pixel spacings of one stack differ by at most this, and by this at a slice's edge.
SAME_DIRECTION, PART_OF_PIXEL = 1e-3, 0.5
FEWEST_SLICES = 2
ENOUGH_SLICES = 3  # a group with fewer is not taken by itself beside others
MIXED = "sequence"


class SeveralSeries(RleSplatError):
    """A path holds several series, and none of them is chosen.

    Parameters
    ----------
    groups : sequence of Group
        A series' number is its place among them, from 1.
    titles : callable
        ``titles(group) -> str``: one line about a group, without free text of the files.
    asked : int or None
        The number that was asked for, which there is not; None if there was none.
    """

    def __init__(self, groups, titles, asked: int | None = None):
        self.problem = f"There are {len(groups)} series" if asked is None else f"There is no series {asked}"
        advice = "choose one by its number (series)" if asked is None else f"use 1 to {len(groups)}"
        self.groups = tuple(groups)
        self.titles = tuple(titles(group) for group in groups)
        self.thumbnails = None  # one for each group, from whoever shows a chooser
        listed = "; ".join(f"{number} is {title}" for number, title in enumerate(self.titles, 1))
        super().__init__(f"{self.problem}; {advice}: {listed}.")


@dataclass(frozen=True)
class Group:
    """Pictures of one series with one size, pixel spacing and orientation.

    Attributes
    ----------
    frames : tuple of tuple of ImageFrame
        Slices in the order of the stack, for each frame in time (or of another axis).
    axis : str
        What tells the frames apart: "time", "echo time", "b-value", "image type"; "" for one frame.
    times : tuple
        The separating value of each frame.
    remarks : tuple of str
    refusal : RleSplatError or None
        Why the group makes no volume.
    """

    frames: tuple
    axis: str = ""
    times: tuple = ()
    remarks: tuple = ()
    refusal: RleSplatError | None = field(default=None, compare=False)

    @property
    def first(self) -> ImageFrame:
        """The first slice of the first frame."""
        return self.frames[0][0]

    @property
    def slices(self) -> int:
        """Slices of the first frame, in the files."""
        return len(self.frames[0])

    @property
    def localizer(self) -> bool:
        """Whether its pictures are localizers."""
        return self.first.localizer

    def stack(self, frame: int = 0, spacing=None) -> stacking.Stack:
        """Geometry of one frame; ``spacing`` (sx, sy, sz) in mm for files without positions. Raises Refused."""
        if self.refusal is not None:
            raise self.refusal
        slices = self.frames[frame]
        if len(slices) < FEWEST_SLICES:
            raise single_picture()
        if has_geometry(slices[0]):
            if spacing is not None:
                raise RleSplatError("The files of this series state its geometry; leave out the spacing.")
            storage = slices[0].storage
            return stacking.stack(*collect_planes(slices), (storage.rows, storage.columns))
        if spacing is None:
            raise no_positions()
        return stacking.stack_without_positions(len(slices), spacing)


def has_geometry(picture: ImageFrame) -> bool:
    """Whether a picture says where it lies."""
    return None not in (picture.position, picture.orientation, picture.spacing)


def collect_planes(pictures) -> tuple[list, list, list]:
    """Positions, orientations and pixel spacings of pictures that all say where they lie."""
    return tuple(map(list, zip(*((p.position, p.orientation, p.spacing) for p in pictures))))


def groups_of(pictures, same_voxels) -> list[Group]:
    """Group pictures.

    Parameters
    ----------
    pictures : sequence of ImageFrame
    same_voxels : callable
        ``same_voxels(a, b) -> bool``: whether two pictures have the same stored voxels.

    Returns
    -------
    list of Group
        By series number, then in the files' order.
    """
    by_kind = {}
    for picture in pictures:
        by_kind.setdefault(_kind(picture), []).append(picture)
    parallel = [part for kept in by_kind.values() for part in parallel_parts(kept)]
    found = [group for part in parallel for group in _groups_of_parallel(part, same_voxels)]
    return sorted(found, key=lambda group: group.first.series.number)


def _kind(picture: ImageFrame) -> tuple:
    """What is equal for all pictures of a group."""
    storage = picture.storage
    said = (picture.position is None, picture.orientation is None, picture.spacing is None)
    return (
        picture.series.key, storage.rows, storage.columns, *said, picture.localizer, picture.stack, storage.kind,
    )  # fmt: skip


def parallel_parts(pictures) -> list[list[ImageFrame]]:
    """Pictures of one kind, by orientation and pixel spacing, in the order of each part's first one."""
    storage = pictures[0].storage
    gap = min(SAME_DIRECTION, PART_OF_PIXEL / max(storage.rows, storage.columns))
    said = [(*(picture.orientation or ()), *np.log(picture.spacing or ())) for picture in pictures]
    parts = {}
    for picture, part in zip(pictures, stacking.parts_at_gaps(said, gap).tolist()):
        parts.setdefault(part, []).append(picture)
    return list(parts.values())


def _groups_of_parallel(pictures, same_voxels) -> list[Group]:
    """Groups of parallel pictures of one kind: one for each straight line of slices."""
    if not has_geometry(pictures[0]):
        ordered = sorted(pictures, key=lambda picture: (picture.instance_number, picture.number))
        return [Group((tuple(ordered),))]
    try:
        positions, orientations, _ = collect_planes(pictures)
        row, column, normal = stacking.axes(stacking.common_orientation(orientations))
    except Refused as problem:
        return [Group((tuple(pictures),), refusal=problem)]
    positions = np.array(positions)
    lines = stacking.parallel_lines(positions, row, column)
    split = [np.flatnonzero(lines == line) for line in range(lines.max() + 1)]
    if min(len(part) for part in split) < FEWEST_SLICES:  # no parallel stacks: the stack's own refusal says how far off
        split = [np.arange(len(pictures))]
    return [
        group
        for part in split
        for group in _tell_apart([pictures[i] for i in part], positions[part], normal, same_voxels)
    ]  # fmt: skip


def _tell_apart(pictures, positions, normal, same_voxels) -> list[Group]:
    """The groups of pictures on one line: mostly one, with frames where places repeat."""
    order = stacking.sort_along(positions, normal)
    pictures, positions = [pictures[i] for i in order], positions[order]
    place = stacking.places(positions, normal)
    kept, copies = _without_copies(pictures, place, lambda a, b: _same_object(a, b) and same_voxels(a, b))
    remarks = _copies_remark(copies)
    pictures, place = [pictures[i] for i in kept], place[kept]
    most = int(np.bincount(place).max())
    if most == 1:
        return [Group((tuple(pictures),), remarks=remarks)]
    splits = [(name, split) for name in _separator_names(pictures) if (split := _split_by(name, pictures, place))]
    for name, split in splits:
        frames = _frames_of(name, split, len(set(place.tolist())))
        if frames is not None:
            return [Group(*frames[:3], remarks + frames[3])]
    if splits:  # parts that overlap, such as two acquisitions of neighboring regions
        parts = splits[0][1]
        return [
            Group((tuple(parts[value][here] for here in sorted(parts[value])),), remarks=remarks) for value in parts
        ]
    kept, more = _without_copies(pictures, place, same_voxels)
    if len(kept) == len(set(place.tolist())):
        return [Group((tuple(pictures[i] for i in kept),), remarks=_copies_remark(copies + more))]
    refusal = Refused(
        f"This series has up to {most} different slices at one place, and nothing in its files tells them apart; "
        "export each time point or contrast as a series of its own."
    )
    return [Group((tuple(pictures),), remarks=remarks, refusal=refusal)]


def _same_object(a: ImageFrame, b: ImageFrame) -> bool:
    """Whether two pictures may be copies of one: the same object, or objects that have no name."""
    return a.series.instance == b.series.instance and a.number == b.number


def _without_copies(pictures, place, same) -> tuple[list[int], int]:
    """Indices of pictures that are no copies of an earlier one at their place, and the number of copies."""
    kept, at = [], {}
    for i, here in enumerate(place.tolist()):
        others = at.setdefault(here, [])
        if any(same(pictures[j], pictures[i]) for j in others):
            continue
        others.append(i)
        kept.append(i)
    return kept, len(pictures) - len(kept)


def _copies_remark(copies: int) -> tuple:
    if not copies:
        return ()
    return (f"{copies} picture{'s are copies' if copies > 1 else ' is a copy'} of others and left out.",)


def _separator_names(pictures) -> list[str]:
    """Names of values that may tell pictures apart, in the order in which they are tried."""
    dimensions = {name for name in pictures[0].apart if name not in SEPARATORS}
    return [*SEPARATORS, *sorted(dimensions)]


def _split_by(name: str, pictures, place) -> dict | None:
    """Pictures by place by a value, in the values' order, if it differs among all at each place; else None.

    Values of a frame may differ by place, as times do, if they are all lower than those of the next frame. The least
    one stands for the frame then.
    """
    if any(name not in picture.apart for picture in pictures):
        return None
    split, at = {}, {}
    for picture, here in zip(pictures, place.tolist()):
        value = picture.apart[name]
        if value in at.setdefault(here, {}):
            return None
        at[here][value] = split.setdefault(value, {})[here] = picture
    if len({len(found) for found in at.values()}) == 1:
        frames = list(zip(*(sorted(found) for found in at.values())))
        if all(max(values) < min(later) for values, later in pairwise(frames)):
            return {min(values): {here: at[here][v] for here, v in zip(at, values)} for values in frames}
    return {value: split[value] for value in sorted(split)}


def _frames_of(name: str, split: dict, count: int):
    """(frames, axis, times, remarks) if at least half of the parts, and two of more than two, have ``count`` slices.

    Frames that lack a slice are left out, with a remark.
    """
    complete = {value: part for value, part in split.items() if len(part) == count}
    if len(complete) < max(math.ceil(len(split) / 2), 2 if len(split) > 2 else 1):
        return None
    remarks = ()
    if len(complete) < len(split):
        remarks = (f"{len(split) - len(complete)} of {len(split)} frames lack slices and are left out.",)
    frames = tuple(tuple(part[here] for here in sorted(part)) for part in complete.values())
    axis = "time" if name in TIMES else name if name in SEPARATORS else MIXED
    return frames, axis, tuple(complete), remarks


def choose_group(groups, series: int | None, titles, key: str | None = None) -> Group:
    """The group to read; RleSplatError if there is no such group, or several and none is given (SeveralSeries).

    Parameters
    ----------
    groups : list of Group
    series : int or None
        Number of a group, from 1; None takes the only one that is a stack of slices.
    titles : callable
        ``titles(group) -> str`` for the list in the refusal.
    key : str or None
        ``Series.key`` of a series that was read before: it is taken wherever it is in the list now, and ``series`` only
        tells its groups apart. Where it is not in the list, the only one that is a stack of slices is taken.
    """
    if key is not None:
        own = [group for group in groups if group.first.series.key == key]
        numbered = [group for number, group in enumerate(groups, 1) if number == series and group in own]
        if len(numbered or own) == 1:
            return (numbered or own)[0]
        series = None
    if series is not None:
        if not 1 <= series <= len(groups):
            raise SeveralSeries(groups, titles, series)
        return groups[series - 1]
    usable = [group for group in groups if not group.localizer and group.slices >= ENOUGH_SLICES]
    usable = usable or [group for group in groups if group.slices >= FEWEST_SLICES] or list(groups)
    if len(usable) == 1:
        return usable[0]
    if all(group.slices < FEWEST_SLICES for group in usable):
        raise single_picture()
    raise SeveralSeries(groups, titles)
