"""Depth of field, motion blur and anti-aliasing: the mean of sharp pictures, through points of the lens, at
times of the shutter, and shifted by parts of a pixel.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..runtime.steps import rescale
from ..scene import Rendering, Scene
from ..scene.changed import change
from .antialias import antialias_pictures, shifted
from .lens import DEPTH_OF_FIELD, lens_pictures, lens_points, see_through_lens
from .motion import MOTION_BLUR, at_time, motion_pictures

# Spreads times evenly, and apart from the golden angles by which the lens's points turn.
SILVER = 2.0**0.5 - 1.0


class Blur(NamedTuple):
    """A cause of blur.

    Attributes
    ----------
    name : str
        In the table of effects.
    pictures : callable
        ``pictures(scene)``: how many sharp pictures it takes, 1 for no blur.
    sharpen : callable
        ``sharpen(scene, point, time, number)``: the sharp scene through a point of the lens at a time of the shutter,
        which is the picture of this number.
    remove : callable
        ``remove(scene)``: the scene without it.
    """

    name: str
    pictures: Callable
    sharpen: Callable
    remove: Callable


# In the order in which they are taken out of a scene: the camera moves with its lens.
BLURS = (
    Blur("motion blur", motion_pictures, lambda scene, point, time, number: at_time(scene, time),
         MOTION_BLUR.without),
    Blur("depth of field", lens_pictures, lambda scene, point, time, number: see_through_lens(scene, point),
         DEPTH_OF_FIELD.without),
    Blur("anti-aliasing", antialias_pictures, lambda scene, point, time, number: shifted(scene, number),
         lambda scene: change(scene, antialias=False)),
)  # fmt: skip


def list_exposures(scene: Scene) -> list[Scene]:
    """The sharp, still scenes whose mean is the scene's picture; the scene alone if nothing is blurred.

    Every point of the lens has its own time, both evenly spread, so that one set of pictures blurs both.
    """
    count = max(blur.pictures(scene) for blur in BLURS)
    if count == 1:
        return [scene]
    camera = scene.camera
    # The first is near the middle of both.
    times = (np.argsort(np.argsort((np.arange(count) * SILVER + 0.5) % 1.0)) + 0.5) / count
    points = lens_points(count, camera.aperture_blades, camera.aperture_rotation, camera.aperture_ratio, times)
    scenes = [scene] * count
    for blur in BLURS:
        several = blur.pictures(scene) > 1
        scenes = [
            blur.sharpen(one, point, time, number) if several else blur.remove(one)
            for number, (one, point, time) in enumerate(zip(scenes, points, times, strict=True))
        ]
    return scenes


def exposure_steps(scene: Scene, scenes: list[Scene], sharp_steps):
    """Generator of Progress: render the mean of the pictures of some scenes.

    Parameters
    ----------
    scene : Scene
        With its lens and its shutter.
    scenes : list of Scene
        Its ``list_exposures``.
    sharp_steps : callable
        ``sharp_steps(scene)``: generator of Progress, returns the Rendering of a sharp scene.

    Returns
    -------
    Rendering
        Depth and report are those of the scene without blur, as it stands, which takes one picture more; the report's
        times are those of all: a report has the times of the pictures before it, too.
    """
    if len(scenes) == 1:
        return (yield from sharp_steps(scenes[0]))
    still = scene
    for blur in BLURS:
        still = blur.remove(still)
    made, count = [], len(scenes) + 1
    counted = max(reversed(BLURS), key=lambda one: one.pictures(scene)).name  # the other shares its pictures
    for number, sharp in enumerate((still, *scenes)):
        one = yield from rescale(sharp_steps(sharp), number / count, (number + 1) / count)
        made.append(one.report)
        if sharp is still:
            depth, rgba = one.depth, np.zeros(one.rgba.shape, np.float64)
        else:
            rgba += one.rgba
    return Rendering((rgba / len(scenes)).astype(np.float32), depth, {**made[0], **_times(counted, made)})


def _times(blur: str, reports: list[dict]) -> dict:
    """The stages' and the effects' milliseconds in all pictures; those after the first are counted for this blur."""
    stages = reports[-1]["stages_ms"]
    extra = stages["total"] - reports[0]["stages_ms"]["total"]
    effects = []
    for rows in zip(*(report["effects"] for report in reports)):
        spent = next((row["ms"] for row in reversed(rows) if row["ms"] is not None), None)
        effects.append({**rows[0], "ms": extra if rows[0]["name"] == blur else spent})
    return {"stages_ms": stages, "effects": effects}
