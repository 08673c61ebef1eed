"""What the set of effects needs to know of a kind of effect: one row of the table in ``analyse.py``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """A kind of effect, beside its name.

    ``text``: what it does, for people.  ``called_for(scene, quality) -> (on, reason)``: whether the scene, from which
    what is off before it in the table is gone already, calls for it, and why or why not, as words that stand behind
    "on" or "off"; it must not look at voxels.  ``without(scene) -> scene``: the scene that has never heard of it.
    ``stage``: of the clock, the work it has of its own; None where that is part of the work of the effect ``within``,
    and its milliseconds cannot be told apart.  ``with_default(scene) -> scene``: what turning it on by hand adds, which
    is nothing to a scene that has it; None when nothing could be meant.  ``may_be_idle``: whether it may stay where it
    changes nothing: then only a hand takes it out of a scene, and turning it on there is not refused.
    ``fitted(scene, quality) -> (quality, remark)``: the quality that a scene with the effect can be rendered by, and a
    sentence for the report, "" for none; None when any quality will do.
    """

    text: str
    called_for: Callable
    without: Callable
    stage: str | None = None
    within: str | None = None
    with_default: Callable | None = None
    may_be_idle: bool = False
    fitted: Callable | None = None
