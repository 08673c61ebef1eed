"""Depth of field and motion blur: the mean of sharp pictures through points of the lens at times of the shutter."""

from __future__ import annotations

import numpy as np

from ..runtime.steps import part
from ..scene import Rendering, Scene
from ..scene.changed import changed
from .lens import lens_pictures, lens_points, through_lens
from .motion import at_time, motion_pictures

# Spreads times evenly, and apart from the golden angles by which the lens's points turn.
SILVER = 2.0**0.5 - 1.0
LENS, SHUTTER = "depth of field", "motion blur"  # their names in the table of effects


def exposures(scene: Scene) -> list[Scene]:
    """The sharp, still scenes whose mean is the scene's picture.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of Scene
        The scene alone if nothing is blurred.

    Notes
    -----
    Every point of the lens has its own time, both evenly spread, so that one set of pictures blurs both.
    """
    through, during = lens_pictures(scene), motion_pictures(scene)
    count = max(through, during)
    if count == 1:
        return [scene]
    camera = scene.camera
    # The first is near the middle of both.
    times = (np.argsort(np.argsort((np.arange(count) * SILVER + 0.5) % 1.0)) + 0.5) / count
    points = lens_points(count, camera.aperture_blades, camera.aperture_rotation, camera.aperture_ratio, times)
    sharp = []
    for point, time in zip(points, times):
        one = at_time(scene, time) if during > 1 else changed(scene, motion=())
        seen = through_lens(one.camera, point) if through > 1 else changed(one.camera, aperture_radius=0.0)
        sharp.append(changed(one, camera=seen))
    return sharp


def exposure_steps(scene: Scene, scenes: list[Scene], sharp_steps):
    """Render the mean of the pictures of some scenes.

    Parameters
    ----------
    scene : Scene
        With its lens and its shutter.
    scenes : list of Scene
        Its ``exposures``.
    sharp_steps : callable
        ``sharp_steps(scene)``: generator of Progress, returns the Rendering of a sharp scene.

    Yields
    ------
    Progress

    Returns
    -------
    Rendering
        Depth and report are those of the scene without blur, as it stands, which takes one picture more; the report's
        times are those of all.
    """
    if len(scenes) == 1:
        return (yield from sharp_steps(scenes[0]))
    still = changed(scene, motion=(), camera=changed(scene.camera, aperture_radius=0.0))
    made, count = [], len(scenes) + 1
    for number, sharp in enumerate((still, *scenes)):
        one = yield from part(sharp_steps(sharp), number / count, (number + 1) / count)
        made.append(one.report)
        if sharp is still:
            depth, rgba = one.depth, np.zeros(one.rgba.shape, np.float64)
        else:
            rgba += one.rgba
    return Rendering((rgba / len(scenes)).astype(np.float32), depth, {**made[0], **_times(scene, made)})


def _times(scene: Scene, reports: list[dict]) -> dict:
    """The stages' and the effects' milliseconds in all pictures; those after the first are counted for the blur."""
    stages = {stage: sum(report["stages_ms"][stage] for report in reports) for stage in reports[0]["stages_ms"]}
    extra = stages["total"] - reports[0]["stages_ms"]["total"]
    blur = LENS if lens_pictures(scene) >= motion_pictures(scene) else SHUTTER  # the other shares its pictures
    effects = []
    for rows in zip(*(report["effects"] for report in reports)):
        known = [row["ms"] for row in rows if row["ms"] is not None]
        spent = sum(known) if known else None
        effects.append({**rows[0], "ms": extra if rows[0]["name"] == blur else spent})
    return {"stages_ms": stages, "effects": effects}
