"""A camera, by Blender's own settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from reprlib import repr as short

import numpy as np

from .checks import LARGEST_SHARE, as_matrix, from_mapping, identity, is_finite_number, positive, read_json
from .errors import RleSplatError

CAMERA_TYPES = ("PERSP", "ORTHO")
SENSOR_FITS = ("AUTO", "HORIZONTAL", "VERTICAL")
MOST_BLADES = 64


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with Blender's own parameters and meaning.

    ``matrix_world`` takes camera space to the world; the camera looks along its -Z with +Y up, and scale in
    the matrix is ignored as Blender ignores it.  ``lens`` and the sensor are in mm, ``ortho_scale`` and the
    clip distances in world units, ``shift_x`` and ``shift_y`` in fractions of the larger image side.
    ``aperture_radius``, world units, is that of the lens, 0 for none; what lies at ``focus_distance``, planar and in
    world units, is sharp.  ``aperture_blades``, ``aperture_rotation`` (radians) and ``aperture_ratio`` shape its blur.
    ``slant``: how far the rays of an orthographic camera move, to the right and up, for each unit that they go ahead;
    what lies at ``focus_distance`` stays where it is.
    """

    matrix_world: np.ndarray = field(default_factory=identity)
    type: str = "PERSP"
    lens: float = 50.0
    sensor_width: float = 36.0
    sensor_height: float = 24.0
    sensor_fit: str = "AUTO"
    ortho_scale: float = 6.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    clip_start: float = 0.1
    clip_end: float = 1000.0
    pixel_aspect: tuple = (1.0, 1.0)
    aperture_radius: float = 0.0
    focus_distance: float = 10.0
    aperture_blades: int = 0
    aperture_rotation: float = 0.0
    aperture_ratio: float = 1.0
    slant: tuple = (0.0, 0.0)

    def __post_init__(self):
        put = partial(object.__setattr__, self)
        put("matrix_world", as_matrix(self.matrix_world, "The camera's matrix_world"))
        axes = self.matrix_world[:3, :3]
        # Scale is ignored, so what counts is whether the axes span space: the volume of their directions.
        if abs(np.linalg.det(axes)) <= 1e-9 * np.prod(np.linalg.norm(axes, axis=0)):
            raise RleSplatError("The camera's matrix_world is singular; give it a scale other than zero on every axis.")
        if self.type not in CAMERA_TYPES:
            raise RleSplatError(
                f"A camera of type {short(self.type)} cannot be splatted; use a perspective or an orthographic camera."
            )
        if self.sensor_fit not in SENSOR_FITS:
            raise RleSplatError(f"The camera's sensor_fit must be one of {', '.join(SENSOR_FITS)}.")
        for name in ("lens", "sensor_width", "sensor_height", "ortho_scale", "clip_start", "clip_end"):
            put(name, positive(getattr(self, name), f"The camera's {name}"))
        for name in ("shift_x", "shift_y"):
            value = getattr(self, name)
            if not (is_finite_number(value) and abs(value) <= LARGEST_SHARE):
                raise RleSplatError(f"The camera's {name} must be a finite number within {LARGEST_SHARE:g} of zero.")
            put(name, float(value))
        if self.clip_end <= self.clip_start:
            raise RleSplatError("The camera's clip_end must be larger than its clip_start.")
        for name in ("focus_distance", "aperture_ratio"):
            put(name, positive(getattr(self, name), f"The camera's {name}"))
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
            raise RleSplatError("Only an orthographic camera has a slant; leave it out.")
        put("slant", tuple(float(s) for s in slant))
        aspect = tuple(self.pixel_aspect) if np.iterable(self.pixel_aspect) else ()
        if len(aspect) != 2:
            raise RleSplatError("The camera's pixel_aspect must be two numbers.")
        limits = 1.0 / LARGEST_SHARE, LARGEST_SHARE
        put("pixel_aspect", tuple(positive(a, "The camera's pixel_aspect", *limits) for a in aspect))

    @classmethod
    def from_json(cls, path) -> Camera:
        return from_mapping(cls, read_json(path, "the camera file"), "The camera file")
