"""The series among which a user chooses, when a place holds several: what the chooser shows, for one dialog at a time.

Descriptions are free text of the files: they are shown here, and never stored.
"""

from dataclasses import dataclass

import bpy.utils.previews
import numpy as np

from ...rle_splat.read.dicom.titles import SeriesInfo, series_info


@dataclass(frozen=True)
class Offer:
    """Series to choose from.

    Attributes
    ----------
    titles, descriptions : tuple of str
        One line about each, without free text of the files, and that text.
    operator : str
        Name of the operator in ``bpy.ops.rle_splat`` that reads the chosen one.
    options : dict
        Its properties, but for ``series``.
    icons : object
        Thumbnails by number of the series, as Blender's previews.
    """

    rows: tuple[SeriesInfo, ...]
    titles: tuple[str, ...]
    descriptions: tuple[str, ...]
    operator: str
    options: dict
    icons: object

    def icon(self, number: int) -> int:
        """Icon of the thumbnail of a series; 0 if it has none."""
        name = str(number)
        return self.icons[name].icon_id if name in self.icons else 0


_offer: list = []  # at most one


def offer(several, thumbnails, operator: str, options: dict) -> None:
    """Offer the series of a SeveralSeries.

    Parameters
    ----------
    thumbnails : list of (ndarray or None)
        (h, w) uint8 for each series, row 0 on top.
    """
    forget()
    rows = tuple(series_info(group, number) for number, group in enumerate(several.groups, 1))
    icons = bpy.utils.previews.new()
    for row, gray in zip(rows, thumbnails):
        if gray is not None:
            picture = icons.new(str(row.number))
            for kind in ("icon", "image"):
                setattr(picture, f"{kind}_size", gray.shape[::-1])
                getattr(picture, f"{kind}_pixels_float").foreach_set(_rgba(gray))
    descriptions = tuple(group.first.series.description for group in several.groups)
    _offer.append(Offer(rows, several.titles, descriptions, operator, options, icons))


def _rgba(gray: np.ndarray) -> np.ndarray:
    """Flat RGBA in [0, 1], bottom row first, of gray levels (h, w) uint8, top row first."""
    rgba = np.ones((*gray.shape, 4), dtype=np.float32)
    rgba[..., :3] = gray[::-1, :, None] / np.float32(255.0)
    return rgba.ravel()


def offered() -> Offer | None:
    """The series that are offered now."""
    return _offer[0] if _offer else None


def forget() -> None:
    """Drop the offer and its thumbnails."""
    for one in _offer:
        bpy.utils.previews.remove(one.icons)
    _offer.clear()


def sentence(several) -> str:
    """What a script reads: all series in one sentence."""
    listed = "; ".join(f"{number} is {title}" for number, title in enumerate(several.titles, 1))
    return f"{several.problem}; set series to the number of one: {listed}."


def facts(row: SeriesInfo, description: str) -> list[tuple[str, str]]:
    """(name, text) of what a chooser says about a series."""
    spacing = "" if row.spacing is None else " x ".join(f"{s:.4g}" for s in row.spacing) + " mm"
    several = "" if row.frames == 1 else f"{row.frames}" if row.axis == "time" else f"{row.frames}, of {row.axis}"
    rows = (
        ("Modality", " ".join(filter(None, (row.modality, row.body_part)))), ("Description", description),
        ("Slices", str(row.slices)), ("Size", " x ".join(map(str, row.size)) + " pixels"), ("Spacing", spacing),
        ("Time Points" if row.axis in ("", "time") else "Volumes", several),
        ("Kind", "Localizer" if row.localizer else ""), ("Problem", row.problem),
    )  # fmt: skip
    return [(name, text) for name, text in rows if text]
