"""Reads the file, the folder or the numbered files of a volume object in steps, for Import and Relocate."""

import os
from dataclasses import dataclass

from ...rle_splat.read.dicom.grouping import SeveralSeries
from ...rle_splat.read.dicom.titles import thumbnail
from ...rle_splat.read.sequence import join_numbers, sequence_of
from ...rle_splat.runtime.steps import Progress, announce, rescale
from ...rle_splat.scene import RleSplatError
from ...rle_splat.volume.checks import check_values
from ...rle_splat.volume.histogram import Histogram, histogram_steps
from ...rle_splat.volume.volume import Volume
from ..data.source_options import read_options
from . import volumes
from .facts import BINS

MEASURING = 0.95  # share of the time until a volume is read


@dataclass(frozen=True)
class ReadSource:
    """What was read of the source of a volume object.

    Attributes
    ----------
    path : str
        The file or folder.
    volume : Volume or StoredVolume
        One of the source's volumes.
    counted : Histogram or None
        Of its values; None of encoded voxels.
    frame, frames : int
        Its number among them, from 1, and how many there are.
    remarks : tuple of str
        Sentences about the source.
    """

    path: str
    volume: Volume
    counted: Histogram | None
    frame: int
    frames: int
    remarks: tuple

    @property
    def is_in_time(self) -> bool:
        """Whether there are several volumes, which differ in time."""
        return self.frames > 1 and self.volume.frame_axis == "time"


def found_steps(path: str, options):
    """Generator of Progress: read a volume and check its values; return a ReadSource.

    Parameters
    ----------
    options : SourceOptions or PlainOptions
        With Sequence, the file is one of several numbered ones, and it is the frame that is read.

    Raises
    ------
    RleSplatError
        If it cannot be read, or holds no finite value.
    """
    numbered = sequence_of(path) if options.use_sequence else None
    given = read_options(options)
    if options.use_sequence:
        given.pop("frame", None)
        if numbered is None:
            raise RleSplatError(
                f"{os.path.basename(path)} is not one of several files whose names differ in a number alone; switch "
                "Sequence off, or choose one of the numbered files."
            )
    volume = yield from rescale(volumes.file_steps(path, given), 0.0, MEASURING)
    if not volume.holds_values:
        return ReadSource(path, volume, None, 1, 1, volume.remarks)
    check_values(volume)
    counted = yield from announce(histogram_steps(volume, BINS), MEASURING, 1.0, "counting the values")
    if numbered is None:
        return ReadSource(path, volume, counted, given.get("frame", 1), volume.frames, volume.remarks)
    remarks = volume.remarks
    if numbered.missing:
        frames = join_numbers(numbered.missing)
        remarks += (f"Files of the sequence are missing: there is none for frame {frames} of {numbered.count}.",)
    return ReadSource(path, volume, counted, numbered.frame_of(path), numbered.count, remarks)


def thumbnail_steps(several: SeveralSeries):
    """Generator of Progress: the thumbnails of all series of a refusal; None for one that cannot be decoded."""
    pictures = []
    for i, group in enumerate(several.groups):
        yield Progress(i / len(several.groups), f"looking at series {i + 1} of {len(several.groups)}")
        try:
            pictures.append(thumbnail(group))
        except RleSplatError:
            pictures.append(None)
    return pictures
