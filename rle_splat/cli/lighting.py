"""What encoded colours were lit by, as JSON, and whether a command asks for other lights than those."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ..scene import Light, RleSplatError
from .report import plain

# Directions that differ by less than this are one; a .rle keeps them exactly, a camera file may round.
DIRECTION_TOLERANCE = 1e-6


def describe_lighting(function, lights, headlight: bool, camera) -> dict:
    """Everything the shaded colours of ``function`` depend on besides the volume, JSON-ready.

    ``headlight_direction``: unit world vector along which the camera looks, or None without a headlight.
    ``eye``: homogeneous world position of the eye, for the highlights.
    """
    rotation, position = camera.matrix_world[:3, :3], camera.matrix_world[:3, 3]
    looking = -rotation[:, 2] / np.linalg.norm(rotation[:, 2])
    return {
        "shaded": function.shade is not None and (headlight or bool(lights)),
        "lights": [_light(light) for light in lights],
        "headlight_direction": looking.tolist() if headlight else None,
        "eye": [*position.tolist(), 1.0] if camera.type == "PERSP" else [*(-looking).tolist(), 0.0],
    }


def _light(light: Light) -> dict:
    return {entry.name: plain(getattr(light, entry.name)) for entry in fields(light)}


def check_lighting(args, stored: dict, lights, camera) -> None:
    """Refuse lights that are asked for and are not those the tables were encoded with.

    ``lights`` are those of --lights.  What is not asked for by an option is taken as it was encoded.
    """
    if args.no_shading and stored["shaded"]:
        raise RleSplatError(f"{args.volume} was encoded with shading; leave --no-shading out or encode it again.")
    if args.lights is not None and [_light(light) for light in lights] != stored["lights"]:
        raise RleSplatError(f"{args.volume} was encoded under other lights than {args.lights}; encode it again.")
    headlight = stored["headlight_direction"]
    if args.headlight is False and headlight is not None:
        raise RleSplatError(f"{args.volume} was encoded with a headlight; leave --no-headlight out or encode it again.")
    if args.headlight:
        looking = describe_lighting(_SHADED, (), True, camera)["headlight_direction"]
        if headlight is None or np.abs(np.subtract(looking, headlight)).max() > DIRECTION_TOLERANCE:
            raise RleSplatError(f"{args.volume} was not encoded with a headlight from this view; encode it again.")
