"""Voxels in mapped files: a read beyond the end of a file that was cut short would end the program."""

import os
from pathlib import Path

import numpy as np

from ..scene import RleSplatError, Scene


def list_mapped_files(scene: Scene) -> list[tuple[Path, int]]:
    """The mapped files of a scene's voxels, and the byte at which each has to end at the earliest."""
    volumes = [scene.volume, *(channel.volume for channel in scene.channels)]
    if scene.labels is not None:
        volumes.append(scene.labels.volume)
    files = (_file_of(volume.voxels) for volume in volumes if volume.holds_values)
    return [(Path(one.filename), one.offset + one.nbytes) for one in files if one is not None]


def refuse_cut_files(files: list[tuple[Path, int]]) -> None:
    """RleSplatError if one of ``list_mapped_files`` has become too short; one that was replaced stays in memory."""
    for path, end in files:
        held = os.path.getsize(path) if path.is_file() else end
        if held < end:
            raise RleSplatError(
                f"{path} was cut short while it was read: {held} of {end} bytes are left; restore the file."
            )


def is_mapped(array: np.ndarray) -> bool:
    """Whether an array lies in a mapped file and takes no memory of its own."""
    return _file_of(array) is not None


def _file_of(array) -> np.memmap | None:
    """The mapped file that an array is a view of; a copy of one is a memmap, too, without a file's name."""
    while array is not None and not (isinstance(array, np.memmap) and array.filename is not None):
        array = getattr(array, "base", None)
    return array
