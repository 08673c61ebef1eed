"""What is said about a series before one is read: data and one line. Nothing here names a patient."""

from dataclasses import dataclass

import numpy as np

from ...scene import RleSplatError
from .grouping import Group
from .pixels import decode_planes

THUMBNAIL_SIDE = 128
WINDOW_PERCENT = (1.0, 99.0)  # of a slice's values, shown black and white where the file has no window


@dataclass(frozen=True)
class SeriesInfo:
    """A series of a DICOM study, without free text of its files.

    Attributes
    ----------
    number : int
        From 1; the value of ``series`` for ``read_volume``.
    modality, body_part : str
        Such as "CT" and "CHEST"; "" if the files do not say.
    slices : int
        Slices of one time point.
    size : tuple of int
        Columns and rows.
    spacing : tuple of float or None
        Distances between columns, rows and slices in mm; None if the files do not say or the series is no stack.
    frames : int
        Time points, or other volumes in the place of one another.
    axis : str
        What these differ in, such as "time"; "" for one.
    localizer : bool
        Whether its slices are localizers.
    problem : str
        Why it cannot be read as a volume; "" if it can.
    """

    number: int
    modality: str
    body_part: str
    slices: int
    size: tuple
    spacing: tuple | None
    frames: int
    axis: str
    localizer: bool
    problem: str


def series_info(group: Group, number: int) -> SeriesInfo:
    """What is said of a group."""
    first = group.first
    spacing, problem = None, ""
    try:
        spacing = tuple(float(s) for s in np.linalg.norm(group.stack().affine[:3, :3], axis=0))
    except RleSplatError as refusal:
        problem = str(refusal)
    return SeriesInfo(
        number, first.series.modality, first.series.body_part, group.slices,
        (first.storage.columns, first.storage.rows), spacing, len(group.frames), group.axis, group.localizer, problem,
    )  # fmt: skip


def group_title(group: Group) -> str:
    """One line about a group for a list of series: coded values and sizes, no free text."""
    info = series_info(group, 0)
    words = [volume_name(group), f"{info.size[0]} x {info.size[1]}, {_count(info.slices, 'slice')}"]
    if info.spacing is not None:
        words.append(" x ".join(f"{s:.4g}" for s in info.spacing) + " mm")
    if info.frames > 1:
        words.append(f"{info.frames} time points" if info.axis == "time" else f"{info.frames} of {info.axis}")
    if info.localizer:
        words.append("localizer")
    return ", ".join(words)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def volume_name(group: Group) -> str:
    """Name of a volume, by coded values: "CT CHEST"."""
    series = group.first.series
    return " ".join(word for word in (series.modality, series.body_part) if word) or "DICOM"


def thumbnail(group: Group) -> np.ndarray:
    """The middle slice as gray levels; RleSplatError if the slice cannot be decoded.

    Returns
    -------
    (h, w) ndarray of uint8
        Row 0 on top, at most THUMBNAIL_SIDE a side, pixels in the proportions of the file's grid.
    """
    picture = group.frames[0][group.slices // 2]
    plane = next(answer[1] for answer in decode_planes([picture]) if answer is not None)
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
