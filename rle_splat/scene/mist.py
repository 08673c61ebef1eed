"""Mist, with Blender's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from reprlib import repr as short
from typing import Literal, get_args

from .checks import LARGEST_LENGTH, as_color, from_mapping, is_finite_number, positive, read_json
from .errors import RleSplatError

MistFalloff = Literal["QUADRATIC", "LINEAR", "INVERSE_QUADRATIC"]
MIST_FALLOFFS = get_args(MistFalloff)


@dataclass(frozen=True)
class Mist:
    """The mist of Blender's world: colors fade to one color with distance.

    As in Cycles' mist pass, the distance is measured along the ray for a perspective camera and along the camera's
    axis for an orthographic one.

    Parameters
    ----------
    start : float
        Distance from the camera, in world units, up to which there is no mist.
    depth : float
        Distance beyond ``start``, in world units, at which only the mist's color is left.
    falloff : {"QUADRATIC", "LINEAR", "INVERSE_QUADRATIC"}
        How the mist grows from ``start`` to ``start + depth``, as in Blender.
    color : (3,) sequence of float
        Scene-linear RGB.

    Raises
    ------
    RleSplatError
        If a value is out of range.
    """

    start: float
    depth: float
    falloff: MistFalloff = "QUADRATIC"
    color: Sequence[float] = (0.05, 0.05, 0.05)

    def __post_init__(self):
        if not (is_finite_number(self.start) and 0.0 <= self.start <= LARGEST_LENGTH):
            raise RleSplatError(f"The mist's start must be a finite number, zero or more, not {short(self.start)}.")
        object.__setattr__(self, "start", float(self.start))
        object.__setattr__(self, "depth", positive(self.depth, "The mist's depth"))
        if self.falloff not in MIST_FALLOFFS:
            raise RleSplatError(
                f"The mist's falloff must be one of {', '.join(MIST_FALLOFFS)}, not {short(self.falloff)}."
            )
        object.__setattr__(self, "color", as_color(self.color, "The mist's color"))

    @classmethod
    def from_json(cls, path: str | PathLike) -> Mist:
        """Read a Mist from a JSON file whose keys are the parameter names."""
        return from_mapping(cls, read_json(path, "the mist file"), "The mist file")
