"""Frames what is visible: moves the cameras of a figure and zooms all by the same factor."""

from dataclasses import replace

import numpy as np

from ..pipeline.render import render_steps
from ..pipeline.stage_cache import StageCache
from ..runtime.steps import Progress, map_steps
from ..scene import Quality, Scene
from .names import VISIBLE, share_beside
from .page import MM_PER_POINT
from .plan import Figure, tile_size
from .scale import pixels_per_world_unit

SIDE = 320  # pixels of the longer side of the drafts that are measured
WIDER = 1.5  # of the drafts' views, so that they show the whole box of a volume from its corners, too
ASPECTS = (2.0 / 3.0, 1.5)  # least and largest width of a picture over its height
ROOM = 1.16  # of the pictures' size over that of what is visible, for the letters at the edges


def frame_steps(figure: Figure, cache: StageCache):
    """Generator of Progress: center what is visible in each panel, and let the largest fill its picture.

    Parameters
    ----------
    figure : Figure
        Its cameras see all that is visible, in a frame of 1.5 times theirs.

    Returns
    -------
    Figure
        With the same scale in all panels, and a style with an aspect. Unchanged where a camera is not orthographic,
        pixels belong to a picture of a certain size (a crop, ends of rays), or nothing is visible.
    """
    scenes = [panel.scene for panel in figure.panels]
    of_pixels = any(scene.crop is not None or scene.ray_ends is not None for scene in scenes)
    if of_pixels or any(scene.camera.type != "ORTHO" for scene in scenes):
        return figure
    found = []
    for n, scene in enumerate(scenes):
        found.append((yield from _measure_steps(scene, cache, n, len(scenes))))
    width, height = np.max([size for _, size in found], axis=0)
    if not height > 0.0:
        return figure
    style = figure.style
    size, across = style.font_size * MM_PER_POINT, tile_size(style, len(scenes))[0] / style.pixels_per_mm
    width /= 1.0 - max(share_beside(panel.names, size, across) for panel in figure.panels)
    if style.aspect is None:
        style = replace(style, aspect=round(float(np.clip(width / height, *ASPECTS)), 2))
    pixels = dict(zip(("width", "height"), tile_size(style, len(scenes))))
    view_height = ROOM * float(max(height, width / style.aspect))
    panels = []
    for panel, (middle, _) in zip(figure.panels, found):
        camera, shift = panel.scene.camera, np.eye(4)
        shift[:2, 3] = middle
        moved = replace(
            camera, matrix_world=camera.matrix_world @ shift, ortho_scale=view_height, sensor_fit="VERTICAL",
            shift_x=0.0, shift_y=0.0,
        )  # fmt: skip
        panels.append(replace(panel, scene=replace(panel.scene, camera=moved, **pixels)))
    return replace(figure, panels=tuple(panels), style=style)


def _measure_steps(scene: Scene, cache: StageCache, n: int, count: int):
    """Generator of Progress: the middle of what is visible in the camera's space, and its width and height, each (2,)
    float64 in world units; zeros where nothing is visible."""
    share = SIDE / max(scene.width, scene.height)
    small = replace(
        scene, width=max(round(share * scene.width), 1), height=max(round(share * scene.height), 1),
        camera=replace(scene.camera, ortho_scale=WIDER * scene.camera.ortho_scale),
    )  # fmt: skip

    def say(step: Progress) -> Progress:
        return Progress((n + step.fraction) / count, "Measuring what is visible")

    rendering = yield from map_steps(render_steps(small, Quality.preset("draft"), cache=cache), say)
    seen = rendering.rgba[..., 3] > VISIBLE
    if not seen.any():
        return np.zeros(2), np.zeros(2)
    ends = np.array([np.flatnonzero(seen.any(axis=axis))[[0, -1]] + (0, 1) for axis in (0, 1)])
    ends = (ends - 0.5 * np.array([[small.width], [small.height]])) / pixels_per_world_unit(small, None)
    return ends.mean(axis=1) * (1.0, -1.0), np.ptp(ends, axis=1)
