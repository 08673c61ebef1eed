"""Whether a command asks for other lights than those a .rle file was encoded under."""

from __future__ import annotations

import numpy as np

from ..pipeline.encode_scene import describe_light, looking_direction
from ..scene import RleSplatError

# Directions that differ by less than this are one; a .rle keeps them exactly, a camera file may round.
DIRECTION_TOLERANCE = 1e-6


def check_lighting(args, lighting, lights, camera) -> None:
    """Refuse lights that are asked for and are not those of ``lighting``, the description in the .rle file.

    ``lights`` are those of --lights.  What is not asked for by an option is taken as it was encoded.
    """
    if args.no_shading and lighting.get("shaded", True):
        raise RleSplatError(f"{args.volume} was encoded with shading; leave --no-shading out or encode it again.")
    if args.lights is not None and [describe_light(light) for light in lights] != lighting.get("lights"):
        raise RleSplatError(f"{args.volume} was encoded under other lights than {args.lights}; encode it again.")
    headlight = lighting.get("headlight_direction")
    if args.headlight is False and headlight is not None:
        raise RleSplatError(f"{args.volume} was encoded with a headlight; leave --no-headlight out or encode it again.")
    if args.headlight and not _shines_along(headlight, looking_direction(camera)):
        raise RleSplatError(f"{args.volume} was not encoded with a headlight from this view; encode it again.")


def _shines_along(headlight, looking) -> bool:
    return headlight is not None and bool(np.abs(np.subtract(headlight, looking)).max() <= DIRECTION_TOLERANCE)
