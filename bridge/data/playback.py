"""Time series: which frame of its source a volume object shows.

The source is a file or a series that holds several volumes, or numbered files that hold one each.  A frame is numbered
from 1, as on the command line.
"""

from __future__ import annotations

import math

import bpy

from .decimals import typed
from .overridable import IntProperty, LiveEnum, LiveFloat, LiveInt

FIXED, HOLD, LOOP = "FIXED", "HOLD", "LOOP"
PLAYBACK_ITEMS = [
    (FIXED, "Fixed", "Show the time point set in Time Point, which can be keyframed"),
    (HOLD, "Hold", "Follow the timeline; before the series, show the first time point, and after it, the last"),
    (LOOP, "Loop", "Follow the timeline, and begin again after the last time point"),
]
PREFIX = "rle_splat."  # of the paths of a volume object's properties
NEAR = 1e-6  # of a frame; 3 frames at a step of 1/3 are one volume, not a little less


class Playback:
    """Mix-in for the property group of a volume object."""

    frame_count: IntProperty(
        name="Time Points", description="Number of time points that the file holds", default=1, min=1
    )
    data_frame: IntProperty(
        name="Frame of the Hash", description="Frame whose voxels have the data hash", default=1, min=1,
        options={"HIDDEN"})  # fmt: skip
    playback: LiveEnum(name="Playback", description="Which time point of the series is shown", items=PLAYBACK_ITEMS)
    frame: LiveInt(name="Time Point", description="Time point to show; 0 and 1 both show the first", default=0, min=0)
    frame_offset: LiveInt(
        name="Offset", description=("Number added to the frame of the timeline. With 0 and a step"
            " of 1, frame 1 shows the first time point"), default=0)  # fmt: skip
    frame_step: LiveFloat(
        name="Step", description="Time points per frame of the timeline. 0.5 shows each twice; a negative step plays "
        "backward", default=1.0, precision=3)  # fmt: skip


def is_playing() -> bool:
    """Whether the user plays the animation."""
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)


def round_of(scene) -> tuple[int, int]:
    """The first and last frame of playback."""
    if scene.use_preview_range:
        return scene.frame_preview_start, scene.frame_preview_end
    return scene.frame_start, scene.frame_end


def frames_until(scene, ahead: int) -> int:
    """How far from the current frame playback is after some more frames, in a round from the first to the last one."""
    first, last = round_of(scene)
    later = min(scene.frame_current, last) + ahead
    if later > last or later < first <= scene.frame_current:
        later = first + (later - first) % max(last - first + 1, 1)
    return later - scene.frame_current


def curves_of(datablock) -> list:
    """The F-curves of the action that a datablock uses, of its own slot; [] without an action."""
    data = datablock.animation_data
    if data is None or data.action is None or data.action_slot is None:
        return []
    bags = (strip.channelbag(data.action_slot) for layer in data.action.layers for strip in layer.strips)
    return [curve for bag in bags if bag is not None for curve in bag.fcurves]


def shown_frame(owner, depsgraph=None, ahead: int = 0) -> int:
    """The frame that a volume object shows, from 1 to the number of frames.

    Parameters
    ----------
    depsgraph : bpy.types.Depsgraph, optional
        Gives the time and animated values; without it those of the current scene.
    ahead : int
        Frames of the timeline after that time.
    """
    properties = owner.rle_splat if depsgraph is None else owner.evaluated_get(depsgraph).rle_splat
    scene = bpy.context.scene if depsgraph is None else depsgraph.scene_eval
    time = scene.frame_current + ahead
    keyed = _keyed_at(owner, time) if ahead else {}
    count, frame = properties.frame_count, int(keyed.get("frame", properties.frame))
    if properties.playback != FIXED:
        time += int(keyed.get("frame_offset", properties.frame_offset)) - 1
        frame = 1 + math.floor(time * keyed.get("frame_step", typed(properties.frame_step)) + NEAR)
    if properties.playback == LOOP:
        return (frame - 1) % count + 1
    return min(max(frame, 1), count)


def _keyed_at(owner, time: float) -> dict:
    """The values that keyframes give to properties of a volume object at a time of the timeline."""
    curves = [curve for curve in curves_of(owner) if curve.data_path.startswith(PREFIX) and not curve.mute]
    return {curve.data_path.removeprefix(PREFIX): curve.evaluate(time) for curve in curves}
