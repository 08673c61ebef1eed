"""The camera, with Blender's parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from os import PathLike
from reprlib import repr as short
from typing import Literal, get_args

import numpy as np

from .checks import LARGEST_SHARE, as_matrix, from_mapping, identity, is_finite_number, positive, read_json
from .errors import RleSplatError

CameraType = Literal["PERSP", "ORTHO"]
SensorFit = Literal["AUTO", "HORIZONTAL", "VERTICAL"]
CAMERA_TYPES = get_args(CameraType)
SENSOR_FITS = get_args(SensorFit)
MOST_BLADES = 64


@dataclass(frozen=True, eq=False)
class Camera:
    """A perspective or orthographic camera with Blender's parameters.

    Parameters
    ----------
    matrix_world : (4, 4) array_like
        Camera space to world space. The camera looks along its -Z axis with +Y up. Scale in the matrix is ignored,
        as Blender does.
    type : {"PERSP", "ORTHO"}
        Perspective or orthographic.
    lens : float
        Focal length in mm.
    sensor_width, sensor_height : float
        Size of the sensor in mm.
    sensor_fit : {"AUTO", "HORIZONTAL", "VERTICAL"}
        The side of the picture that the sensor, or ``ortho_scale``, spans; "AUTO" is the longer one.
    ortho_scale : float, optional
        Size of an orthographic camera's view along the fitted sensor side, in world units. Required if ``type`` is
        "ORTHO".
    shift_x, shift_y : float
        Lens shift, as a fraction of the larger image side.
    clip_start, clip_end : float
        Clip distances in world units. Blender's cameras bring their own.
    pixel_aspect : (2,) sequence of float
        Width and height of a pixel.
    aperture_radius : float
        Radius of the lens in world units; 0 for a pinhole.
    focus_distance : float, optional
        Distance of the plane in focus along the camera's axis, in world units. A camera with an ``aperture_radius`` or
        a ``slant`` needs one.
    aperture_blades : int
        Number of aperture blades; below 3 the aperture is round.
    aperture_rotation : float
        Rotation of the aperture in radians.
    aperture_ratio : float
        Anamorphic ratio of the aperture.
    slant : (2,) sequence of float
        Shear of the parallel rays of an orthographic camera: how far a ray moves to the right and up for each unit
        ahead. Points at ``focus_distance`` do not move.

    Raises
    ------
    RleSplatError
        If a value is out of range or ``matrix_world`` is singular.
    """

    matrix_world: np.ndarray = field(default_factory=identity)
    type: CameraType = "PERSP"
    lens: float = 50.0
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: SensorFit = "AUTO"
    ortho_scale: float | None = None
    shift_x: float = 0.0
    shift_y: float = 0.0
    clip_start: float = 0.1
    clip_end: float = 1e5
    pixel_aspect: Sequence[float] = (1.0, 1.0)
    aperture_radius: float = 0.0
    focus_distance: float | None = None
    aperture_blades: int = 0
    aperture_rotation: float = 0.0
    aperture_ratio: float = 1.0
    slant: Sequence[float] = (0.0, 0.0)

    def __post_init__(self):
        put = partial(object.__setattr__, self)
        put("matrix_world", as_matrix(self.matrix_world, "The camera's matrix_world"))
        axes = self.matrix_world[:3, :3]
        # Scale is ignored, so test the volume spanned by the unit axes.
        if abs(np.linalg.det(axes)) <= 1e-9 * np.prod(np.linalg.norm(axes, axis=0)):
            raise RleSplatError("The camera's matrix_world is singular; give it a scale other than zero on every axis.")
        if self.type not in CAMERA_TYPES:
            raise RleSplatError(
                f"A camera of type {short(self.type)} cannot be rendered; use a perspective or an orthographic camera."
            )
        if self.sensor_fit not in SENSOR_FITS:
            raise RleSplatError(
                f"The camera's sensor_fit must be one of {', '.join(SENSOR_FITS)}, not {short(self.sensor_fit)}."
            )
        for name in ("lens", "sensor_width", "sensor_height", "clip_start", "clip_end", "aperture_ratio"):
            put(name, positive(getattr(self, name), f"The camera's {name}"))
        for name in ("shift_x", "shift_y"):
            value = getattr(self, name)
            if not (is_finite_number(value) and abs(value) <= LARGEST_SHARE):
                raise RleSplatError(f"The camera's {name} must be a finite number within {LARGEST_SHARE:g} of zero.")
            put(name, float(value))
        if self.clip_end <= self.clip_start:
            raise RleSplatError("The camera's clip_end must be larger than its clip_start.")
        for name in ("ortho_scale", "focus_distance"):
            if getattr(self, name) is not None:
                put(name, positive(getattr(self, name), f"The camera's {name}"))
        if self.type == "ORTHO" and self.ortho_scale is None:
            raise RleSplatError("An orthographic camera needs ortho_scale, the size of its view in world units.")
        for name, least in (("aperture_radius", 0.0), ("aperture_rotation", -LARGEST_SHARE)):
            value = getattr(self, name)
            if not (is_finite_number(value) and least <= value <= LARGEST_SHARE):
                raise RleSplatError(f"The camera's {name} must be a number from {least:g} to {LARGEST_SHARE:g}.")
            put(name, float(value))
        if not isinstance(self.aperture_blades, (int, np.integer)) or not 0 <= self.aperture_blades <= MOST_BLADES:
            raise RleSplatError(f"The camera's aperture_blades must be a whole number from 0 to {MOST_BLADES}.")
        slant = tuple(self.slant) if np.iterable(self.slant) else ()
        if len(slant) != 2 or not all(is_finite_number(s) and abs(s) <= LARGEST_SHARE for s in slant):
            raise RleSplatError(f"The camera's slant must be two finite numbers within {LARGEST_SHARE:g} of zero.")
        if self.type != "ORTHO" and any(slant):
            raise RleSplatError("Only an orthographic camera can have a slant; leave slant out or use type ORTHO.")
        put("slant", tuple(float(s) for s in slant))
        if self.focus_distance is None and (self.aperture_radius > 0.0 or any(slant)):
            raise RleSplatError(
                "A camera with an aperture_radius or a slant needs focus_distance, in world units along its axis."
            )
        aspect = tuple(self.pixel_aspect) if np.iterable(self.pixel_aspect) else ()
        if len(aspect) != 2:
            raise RleSplatError("The camera's pixel_aspect must be two numbers.")
        limits = 1.0 / LARGEST_SHARE, LARGEST_SHARE
        put("pixel_aspect", tuple(positive(a, "The camera's pixel_aspect", *limits) for a in aspect))

    @classmethod
    def from_json(cls, path: str | PathLike) -> Camera:
        """Read a Camera from a JSON file whose keys are the parameter names."""
        return from_mapping(cls, read_json(path, "the camera file"), "The camera file")
