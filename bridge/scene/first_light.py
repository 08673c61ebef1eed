"""The light on the first volume of a scene: a headlight where the scene's own lights would leave it dark."""

import numpy as np

from ...rle_splat.classify.transfer_function import Shade
from ...rle_splat.scene import RleSplatError
from ...rle_splat.shade.brightness import relative_brightness
from ...rle_splat.shade.lighting import lighting
from ..volumes import volumes
from . import render_scene, viewports

DARK = 0.5  # of the brightness under a headlight: Blender's default scene gives about 0.4
SIDES = np.concatenate((np.eye(3), -np.eye(3)))  # directions to an eye, in the world
UNUSED = "The scene's lights do not shine on it."


def light_if_dark(context, added: list, corners: np.ndarray) -> str:
    """Choose Headlight for a scene's first volumes if its lights leave them dark; later ones are lit as the first is.

    Parameters
    ----------
    corners : (n, 3) ndarray
        World coordinates around one of them.

    Returns
    -------
    str
        One sentence if the light was changed, else "".
    """
    if len(volumes.volume_objects(context.scene)) > len(added):
        return ""
    try:
        eye = viewports.view_of(context)[0]
    except RleSplatError:
        return ""  # nobody looks
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    lights, world = render_scene.read_light(context.evaluated_depsgraph_get())
    if not (lights or world):  # the volume then has a headlight in any case
        return ""
    radiance = None if world is None else world.radiance

    def brightness(to_eye) -> float:
        falling = lighting(np.eye(4), Shade(0.0, 1.0, 0.0, 1.0), lights, eye=np.append(to_eye, 0.0), world=radiance)
        return relative_brightness(falling, middle)

    # The dullest side counts, too: from above, a lamp above it leaves no volume dark.
    if min(map(brightness, (eye[:3, 2] / np.linalg.norm(eye[:3, 2]), *SIDES))) >= DARK:
        return ""
    for one in added:
        one.rle_splat.lighting = "HEADLIGHT"
    return "The scene's lights leave it dark, so a headlight lights it; see Lighting."


def unused_lights(scene, lighting: str) -> str:
    """What a panel says while a headlight takes the place of a scene's lights; "" otherwise."""
    if lighting != "HEADLIGHT" or not any(one.type == "LIGHT" for one in scene.objects):
        return ""
    return UNUSED
