"""Clip objects: planes and boxes that cut the volume."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from reprlib import repr as short
from typing import Literal, get_args

import numpy as np

from .checks import as_matrix, identity, list_of
from .errors import RleSplatError

ClipKind = Literal["plane", "box"]
ClipSide = Literal["inside", "outside"]
CLIP_KINDS = get_args(ClipKind)
CLIP_SIDES = get_args(ClipSide)
# Least volume spanned by the unit axes of a clip object; below it the object is flat.
FLATTEST_CLIP = 1e-9


@dataclass(frozen=True, eq=False)
class Clip:
    """A plane or a box that cuts the volume.

    Parameters
    ----------
    kind : {"box", "plane"}
        A box is the cube from -1 to 1 of its own space. A plane is z = 0 of its own space; its inside is z < 0.
    matrix_world : (4, 4) array_like
        The object's own space to world space.
    keep : {"inside", "outside"}
        Which side of the volume stays. With "inside", a plane cuts away the side to which its +Z axis points.

    Raises
    ------
    RleSplatError
        If ``kind`` or ``keep`` is unknown or ``matrix_world`` is flat.
    """

    kind: ClipKind = "box"
    matrix_world: np.ndarray = field(default_factory=identity)
    keep: ClipSide = "inside"

    def __post_init__(self):
        if self.kind not in CLIP_KINDS:
            raise RleSplatError(f"A cutting object's kind must be {' or '.join(CLIP_KINDS)}, not {short(self.kind)}.")
        if self.keep not in CLIP_SIDES:
            raise RleSplatError(f"A cutting object's keep must be {' or '.join(CLIP_SIDES)}, not {short(self.keep)}.")
        object.__setattr__(self, "matrix_world", as_matrix(self.matrix_world, "A cutting object's matrix_world"))
        axes = self.matrix_world[:3, :3]
        lengths = np.linalg.norm(axes, axis=0)
        if not (lengths > 0.0).all() or abs(np.linalg.det(axes / lengths)) <= FLATTEST_CLIP:
            raise RleSplatError(
                f"A cutting {self.kind}'s matrix_world is flat; give it a scale other than zero on every axis."
            )

    @classmethod
    def list_from_json(cls, path: str | PathLike) -> tuple[Clip, ...]:
        """Read a tuple of Clip from a JSON file that holds a list of objects; their keys are the parameter names."""
        return list_of(cls, path, "the clip file", "planes and boxes", "plane or box")
