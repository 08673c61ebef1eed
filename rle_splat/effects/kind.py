"""A kind of effect: one row of the table in ``analyze.py``."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """A kind of effect.

    Attributes
    ----------
    text : str
        What it does, for tooltips: an imperative without a period.
    called_for : callable
        ``called_for(scene, quality) -> (on, reason)``: whether the scene calls for it, and why or why not, as words
        behind "on" or "off".  The scene has the effects before it in the table removed where they are off.  It must not
        look at voxels.
    without : callable
        ``without(scene) -> scene``: the scene with the effect removed.
    stage : str or None
        The stage that its own work is timed as; None where it is part of the work of another effect.
    with_default : callable or None
        ``with_default(scene) -> scene``: the scene with the effect turned on by hand; unchanged where it has it.  None
        where there is no default.
    may_be_idle : bool
        Whether it stays in the scene where it changes nothing, unless it is turned off by hand.
    """

    text: str
    called_for: Callable
    without: Callable
    stage: str | None = None
    with_default: Callable | None = None
    may_be_idle: bool = False
