"""Checks that the requested lights are those that a .rle file was encoded with."""

import numpy as np

from ..scene import RleSplatError
from ..scene.plain import plain
from ..view.projection import depth_row

# Directions that differ by less than this are equal: a .rle file stores them exactly, a camera file may round them.
DIRECTION_TOLERANCE = 1e-6


def check_lighting(args, lighting, lights, camera) -> None:
    """Refuse options that ask for other lights than those of a .rle file; RleSplatError if they differ.

    Parameters
    ----------
    args : argparse.Namespace
        With ``volume``, ``no_shading``, ``lights`` and ``headlight``; an option that is not given is not checked.
    lighting : dict
        The description of the lights in the .rle file.
    lights : tuple of Light
        The lights of --lights.
    camera : Camera
        The camera, for the direction of a headlight.
    """
    if args.no_shading and lighting.get("shaded", True):
        raise RleSplatError(f"{args.volume} was encoded with shading; remove --no-shading, or encode it again.")
    if args.lights is not None and plain(lights) != lighting.get("lights"):
        raise RleSplatError(
            f"{args.volume} was encoded with other lights than {args.lights}; remove --lights, or encode it again."
        )
    headlight = lighting.get("headlight_direction")
    if args.headlight is False and headlight is not None:
        raise RleSplatError(f"{args.volume} was encoded with a headlight; remove --no-headlight, or encode it again.")
    if args.headlight and not _shines_along(headlight, depth_row(camera)[:3]):
        raise RleSplatError(
            f"{args.volume} was not encoded with a headlight from this view; remove --headlight, or encode it again."
        )


def _shines_along(headlight, looking) -> bool:
    return headlight is not None and bool(np.abs(np.subtract(headlight, looking)).max() <= DIRECTION_TOLERANCE)
