"""The time of a picture by a peer."""

from __future__ import annotations

from typing import NamedTuple


class Spent(NamedTuple):
    """Milliseconds of a picture.

    Attributes
    ----------
    whole : float
        All that a moved camera takes, measured from outside.
    frame : float
        The work on voxels and pixels within it.
    """

    whole: float
    frame: float
