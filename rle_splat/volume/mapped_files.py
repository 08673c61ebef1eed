"""Voxels in mapped files: a read beyond the end of a file that was cut short would end the program."""

from __future__ import annotations

import os
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..runtime.steps import step_within
from ..scene import RleSplatError, Scene


def whole_steps(steps, scene: Scene):
    """Generator: the steps; return their result.

    Raises
    ------
    RleSplatError
        Before a step, if a mapped file of the scene is shorter than its voxels.  A file that was replaced stays whole
        in memory.
    """
    files = [(Path(one.filename), one.offset + one.nbytes) for one in map(_file_of, _arrays(scene)) if one is not None]
    return step_within(steps, lambda: _check_ends(files)) if files else steps


@contextmanager
def _check_ends(files):
    """Context manager: RleSplatError if one of (path, its end) ends earlier."""
    for path, end in files:
        held = os.path.getsize(path) if path.is_file() else end
        if held < end:
            raise RleSplatError(
                f"{path} was cut short while it was read: {held} of {end} bytes are left; restore the file."
            )
    yield


def is_mapped(array: np.ndarray) -> bool:
    """Whether an array lies in a mapped file and takes no memory of its own."""
    return _file_of(array) is not None


def _arrays(scene: Scene) -> list[np.ndarray]:
    """The voxels of a scene's volumes that hold values."""
    volumes = [scene.volume, *(channel.volume for channel in scene.channels)]
    if scene.labels is not None:
        volumes.append(scene.labels.volume)
    return [volume.voxels for volume in volumes if volume.holds_values]


def _file_of(array) -> np.memmap | None:
    """The mapped file that an array is a view of; a copy of one is a memmap, too, without a file's name."""
    while array is not None and not (isinstance(array, np.memmap) and array.filename is not None):
        array = getattr(array, "base", None)
    return array
