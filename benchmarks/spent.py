"""The time of a picture by a peer."""

from __future__ import annotations

from typing import NamedTuple


class Spent(NamedTuple):
    """Milliseconds of a picture."""

    whole: float  # all that a moved camera takes, measured from outside
    frame: float  # the work on voxels and pixels within it
