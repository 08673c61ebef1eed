"""What a camera with a lens and a shutter sees: the mean of sharp pictures through the lens, while it is open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .effects.lens import lens_pictures, lens_points, through_lens
from .effects.motion import at_time, motion_pictures
from .scene import Rendering, Scene
from .steps import Progress

# Spreads times evenly, and apart from the golden angles by which the lens's points turn.
SILVER = 2.0**0.5 - 1.0


def exposures(scene: Scene) -> list[Scene]:
    """The sharp, still scenes whose mean picture the scene's is; itself alone if nothing is blurred.

    Every point of the lens has a time of its own, both evenly spread, so that one set of pictures blurs both.
    """
    through, during = lens_pictures(scene), motion_pictures(scene)
    count = max(through, during)
    if count == 1:
        return [replace(scene, camera=replace(scene.camera, aperture_radius=0.0), motion=())]
    camera = scene.camera
    # The first is near the middle of both.
    times = (np.argsort(np.argsort((np.arange(count) * SILVER + 0.5) % 1.0)) + 0.5) / count
    points = lens_points(count, camera.aperture_blades, camera.aperture_rotation, camera.aperture_ratio, times)
    sharp = []
    for point, time in zip(points, times):
        one = at_time(scene, time) if during > 1 else replace(scene, motion=())
        seen = through_lens(one.camera, point) if through > 1 else replace(one.camera, aperture_radius=0.0)
        sharp.append(replace(one, camera=seen))
    return sharp


def exposure_steps(scenes: list[Scene], render_one):
    """Generator of Progress: the mean of the scenes' pictures as one Rendering.

    ``render_one``: a scene -> the generator of its Rendering.  Depth and report are those of the first picture, which
    is the one nearest the middle of the lens and of the time; the report's times are those of all.
    """
    rgba = first = spent = None
    for number, scene in enumerate(scenes):
        steps = render_one(scene)
        while True:
            try:
                step = next(steps)
            except StopIteration as finished:
                one = finished.value
                break
            yield Progress((number + step.fraction) / len(scenes), step.message)
        if first is None:
            rgba, first, spent = one.rgba.astype(np.float64), one, dict(one.report["stages_ms"])
            continue
        rgba += one.rgba
        for stage, milliseconds in one.report["stages_ms"].items():
            spent[stage] += milliseconds
    return Rendering((rgba / len(scenes)).astype(np.float32), first.depth, {**first.report, "stages_ms": spent})
