"""Lights, with Blender's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from os import PathLike
from reprlib import repr as short
from typing import Literal, get_args

import numpy as np

from .checks import as_color, as_matrix, identity, is_finite_number, list_of
from .errors import RleSplatError

LightType = Literal["SUN", "POINT", "SPOT", "AREA"]
LIGHT_TYPES = get_args(LightType)


@dataclass(frozen=True, eq=False)
class Light:
    """A light with Blender's parameters. It shines along the -Z axis of ``matrix_world``.

    Parameters
    ----------
    type : {"SUN", "POINT", "SPOT", "AREA"}
        As in Blender. A SUN shines from infinitely far away.
    color : (3,) sequence of float
        Scene-linear RGB.
    energy : float
        W/m^2 for a SUN, W for other types, for world units of a meter; where these are mm, watts times 1e6.
    matrix_world : (4, 4) array_like
        Light space to world space.
    radius : float
        Radius of a POINT or SPOT in world units.
    angle : float
        Angular diameter of a SUN in radians.
    size, size_y : float
        Sides of an AREA in light space; only a RECTANGLE or an ELLIPSE uses ``size_y``.
    shape : {"SQUARE", "RECTANGLE", "DISK", "ELLIPSE"}
        Shape of an AREA.
    spot_size : float
        Full opening angle of a SPOT in radians.
    spot_blend : float
        Softness of the edge of a SPOT, 0 to 1.
    casts_shadow : bool
        Whether the volume and meshes block this light.

    Raises
    ------
    RleSplatError
        If the type is unknown, the color is negative or a number is negative or not finite.
    """

    type: LightType = "SUN"
    color: Sequence[float] = (1.0, 1.0, 1.0)
    energy: float = 1.0
    matrix_world: np.ndarray = field(default_factory=identity)
    radius: float = 0.0
    angle: float = 0.0
    size: float = 1.0
    size_y: float = 1.0
    shape: Literal["SQUARE", "RECTANGLE", "DISK", "ELLIPSE"] = "SQUARE"
    spot_size: float = 0.785398
    spot_blend: float = 0.15
    casts_shadow: bool = True

    def __post_init__(self):
        object.__setattr__(self, "matrix_world", as_matrix(self.matrix_world, "A light's matrix_world"))
        if self.type not in LIGHT_TYPES:
            raise RleSplatError(f"A light's type must be one of {', '.join(LIGHT_TYPES)}, not {short(self.type)}.")
        object.__setattr__(self, "color", as_color(self.color, "A light's color"))
        for name in ("energy", "radius", "angle", "size", "size_y", "spot_size", "spot_blend"):
            value = getattr(self, name)
            if not (is_finite_number(value) and value >= 0.0):
                raise RleSplatError(f"A light's {name} must be a finite number, not below zero, not {short(value)}.")
            object.__setattr__(self, name, float(value))

    @classmethod
    def list_from_json(cls, path: str | PathLike) -> tuple[Light, ...]:
        """Read a tuple of Light from a JSON file that holds a list of objects; their keys are the parameter names."""
        return list_of(cls, path, "the lights file", "lights", "light")
