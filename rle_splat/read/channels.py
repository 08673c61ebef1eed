"""Channels: further volumes whose values are brought onto the grid of a scan."""

from os import PathLike
from typing import Any

from ..runtime.steps import drain
from ..volume.regrid import on_grid_steps
from ..volume.volume import Volume
from .formats import format_of, read_steps

MOST_CHANNELS = 16  # of one file


def read_channel(path: str | PathLike | Volume, volume: Volume, **options: Any) -> Volume:
    """Read a second volume, such as the PET of a CT, and bring its values onto the grid of a volume, for ``Channel``.

    Parameters
    ----------
    path : str, Path or Volume
        A file or a folder, as of ``read_volume``, or a volume on another grid.
    volume : Volume
        The scan.
    **options
        Of ``read_volume``. Without any, a raw file is read with the shape of the volume.

    Returns
    -------
    Volume
        Interpolated linearly between voxel centers, in the type of the file; outside it is its smallest value. A
        remark says how the grids differ, where they do.

    Raises
    ------
    RleSplatError
        If the file cannot be read, or lies elsewhere than the volume.
    """
    if isinstance(path, Volume):
        return drain(on_grid_steps(path, volume, values=True))
    return drain(read_channel_steps(path, volume, options or None))[0]


def read_channel_steps(path, volume: Volume, options: dict | None = None):
    """Generator of Progress: as ``read_channel``; returns the channel and options that read the same again."""
    if options is None:
        kind = format_of(path)
        options = {"shape": volume.shape_xyz} if kind is not None and "shape" in kind.options else {}
    found = yield from read_steps(path, **options)
    options = {**level_options(found), **options}
    return (yield from on_grid_steps(found, volume, values=True)), options


def level_options(volume: Volume) -> dict:
    """The option that reads the same level of a pyramid again: if left out, the level follows the free memory."""
    return {"level": volume.levels.index(volume.shape_xyz)} if volume.shape_xyz in volume.levels else {}
