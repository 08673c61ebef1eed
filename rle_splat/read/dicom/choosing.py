"""Which series is read, and what a chooser says about each: data, a line, a thumbnail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...scene import RleSplatError
from .grouping import FEWEST_SLICES, Group
from .pixels import stored_planes
from .refusals import single_picture

ENOUGH_SLICES = 3  # a group with fewer is not taken by itself beside others
THUMBNAIL_SIDE = 128
WINDOW_PERCENT = (1.0, 99.0)  # of a slice's values, shown black and white where the file has no window


@dataclass(frozen=True)
class SeriesInfo:
    """One row of a chooser.

    Attributes
    ----------
    number : int
        From 1; the value of the option ``series``.
    modality, body_part : str
        Coded values; "" if the files do not say.
    description : str
        Free text of the files: for the chooser alone; it must not be stored or logged.
    slices : int
        Slices of one frame in the files.
    size : (columns, rows)
    spacing : tuple of float or None
        Distances between columns, rows and slices in mm; None if the files do not say or the series is no stack.
    frames : int
    axis : str
        What the frames differ in.
    problem : str
        Why it cannot be read as a volume; "" if it can.
    """

    number: int
    modality: str
    body_part: str
    description: str
    slices: int
    size: tuple
    spacing: tuple | None
    frames: int
    axis: str
    localizer: bool
    problem: str

    @property
    def name(self) -> str:
        """Coded values: "CT CHEST"."""
        return " ".join(word for word in (self.modality, self.body_part) if word) or "DICOM"

    @property
    def title(self) -> str:
        """One line without free text."""
        words = [self.name, f"{self.size[0]} x {self.size[1]}", _count(self.slices, "slice")]
        if self.spacing is not None:
            words.append(" x ".join(f"{s:.4g}" for s in self.spacing) + " mm")
        if self.frames > 1:
            words.append(f"{self.frames} time points" if self.axis == "time" else f"{self.frames} of {self.axis}")
        if self.localizer:
            words.append("localizer")
        return ", ".join(words)


class SeveralSeries(RleSplatError):
    """A path holds several series and none was chosen; ``series``: a SeriesInfo of each."""

    def __init__(self, text: str, series: tuple):
        super().__init__(text)
        self.series = series


def chosen(groups, series: int | None) -> Group:
    """The group to read.

    Parameters
    ----------
    groups : list of Group
    series : int or None
        Number of a group, from 1; None takes the only one that is a stack of slices.

    Raises
    ------
    SeveralSeries
        If there are several and none is given.
    RleSplatError
        If there is no such group.
    """
    infos = tuple(series_info(group, number) for number, group in enumerate(groups, 1))
    listed = "; ".join(f"{info.number}: {info.title}" for info in infos)
    if series is not None:
        if not 1 <= series <= len(groups):
            raise RleSplatError(f"There is no series {series}; choose one of {listed}.")
        return groups[series - 1]
    usable = [group for group in groups if not group.localizer and group.slices >= ENOUGH_SLICES]
    usable = usable or [group for group in groups if group.slices >= FEWEST_SLICES] or list(groups)
    if len(usable) == 1:
        return usable[0]
    if all(group.slices < FEWEST_SLICES for group in usable):
        raise single_picture()
    raise SeveralSeries(f"There are {len(groups)} series; choose one with --series N: {listed}.", infos)


def series_info(group: Group, number: int) -> SeriesInfo:
    """The row of a chooser for a group."""
    first = group.first
    spacing, problem = None, ""
    try:
        spacing = tuple(float(s) for s in np.linalg.norm(group.stack().affine[:3, :3], axis=0))
    except RleSplatError as refusal:
        problem = str(refusal)
    return SeriesInfo(
        number, first.series.modality, first.series.body_part, first.series.description, group.slices,
        (first.storage.columns, first.storage.rows), spacing, len(group.frames), group.axis, group.localizer, problem,
    )  # fmt: skip


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def thumbnail(group: Group) -> np.ndarray:
    """The middle slice as gray levels.

    Parameters
    ----------
    group : Group

    Returns
    -------
    (h, w) ndarray of uint8
        Row 0 on top, at most THUMBNAIL_SIDE a side, pixels in the proportions of the file's grid.

    Raises
    ------
    RleSplatError
        If the slice cannot be decoded.
    """
    picture = group.frames[0][group.slices // 2]
    plane = next(answer[1] for answer in stored_planes([picture]) if answer is not None)
    step = max(1, -(-max(plane.shape) // THUMBNAIL_SIDE))
    values = plane[::step, ::step].astype(np.float64) * picture.slope + picture.intercept
    if picture.series.window is not None and picture.series.window[1] > 0.0:
        center, width = picture.series.window
        low, high = center - width / 2.0, center + width / 2.0
    else:
        low, high = np.percentile(values, WINDOW_PERCENT)
    shown = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)
    if picture.series.inverted:
        shown = 1.0 - shown
    return np.rint(255.0 * shown).astype(np.uint8)
