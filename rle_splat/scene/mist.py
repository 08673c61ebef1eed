"""The mist of a world."""

from __future__ import annotations

from dataclasses import dataclass
from reprlib import repr as short

from .checks import LARGEST_LENGTH, as_color, from_mapping, is_finite_number, positive, read_json
from .errors import RleSplatError

MIST_FALLOFFS = ("QUADRATIC", "LINEAR", "INVERSE_QUADRATIC")


@dataclass(frozen=True)
class Mist:
    """The mist of Blender's world: colour fades to ``color``, scene-linear RGB, none of it up to ``start`` from the
    camera, all of it ``depth`` further, world units; in between by ``falloff``, of Blender's meaning.

    The distance is the ray's own in perspective, along the camera's axis if it is orthographic, as in Cycles' pass.
    """

    start: float = 5.0
    depth: float = 25.0
    falloff: str = "QUADRATIC"
    color: tuple = (0.05, 0.05, 0.05)

    def __post_init__(self):
        if not (is_finite_number(self.start) and 0.0 <= self.start <= LARGEST_LENGTH):
            raise RleSplatError(f"The mist's start must be a finite number, not below zero, not {short(self.start)}.")
        object.__setattr__(self, "start", float(self.start))
        object.__setattr__(self, "depth", positive(self.depth, "The mist's depth"))
        if self.falloff not in MIST_FALLOFFS:
            raise RleSplatError(f"The mist's falloff must be one of {', '.join(MIST_FALLOFFS)}.")
        object.__setattr__(self, "color", as_color(self.color, "The mist's color"))

    @classmethod
    def from_json(cls, path) -> Mist:
        return from_mapping(cls, read_json(path, "the mist file"), "The mist file")
