"""Channels: further volumes whose values are brought onto the grid of a scan."""

from ..volume.regrid import on_grid_steps
from ..volume.volume import Volume
from .formats import format_of, read_steps

MOST_CHANNELS = 16  # of one file


def read_channel_steps(path, volume: Volume, options: dict | None = None):
    """Generator of Progress: read a channel and bring it onto the grid of a volume.

    Parameters
    ----------
    path : str or Path
    options : dict, optional
        Of ``read_volume``; without them a raw file is read with the shape of the volume.

    Returns
    -------
    channel : Volume
    options : dict
        Options that read the same channel again.

    Raises
    ------
    RleSplatError
        If the file cannot be read, or lies elsewhere than the volume.
    """
    if options is None:
        kind = format_of(path)
        options = {"shape": volume.shape_xyz} if kind is not None and "shape" in kind.options else {}
    found = yield from read_steps(path, **options)
    options = {**level_options(found), **options}
    return (yield from on_grid_steps(found, volume, values=True)), options


def level_options(volume: Volume) -> dict:
    """The option that reads the same level of a pyramid again: if left out, the level follows the free memory."""
    return {"level": volume.levels.index(volume.shape_xyz)} if volume.shape_xyz in volume.levels else {}
