"""Labels and channels: whether a scene has any that change its picture."""

from __future__ import annotations

import numpy as np

from ..runtime.steps import rescale
from ..scene import MODES, Quality, Rendering, Scene
from ..scene.changed import change
from .kind import Kind

CLASSIFIED = "a .rle file holds classified voxels"


def is_mixed(scene: Scene) -> bool:
    """Whether more than one transfer function classifies the voxels."""
    return scene.labels is not None or bool(scene.channels)


def only_hides(scene: Scene) -> bool:
    """Whether the labels of a scene are smooth and only hide: a factor of extinction then does it in ``post``, too."""
    labels = scene.labels
    return labels is not None and labels.smooth and not scene.channels and set(labels.functions.values()) == {None}


def is_masked(scene: Scene) -> bool:
    """Whether hidden voxels get a value that decides no pixel: in modes that show no emission (see ``ray_values``)."""
    return scene.labels is not None and scene.mode != MODES[0]


def is_sampled(scene: Scene) -> bool:
    """Whether, post-classified, each sample of a scene looks up which label it belongs to."""
    return scene.labels is not None and not only_hides(scene) and not is_masked(scene)


def split_light(scene: Scene) -> list[Scene]:
    """The scenes of single channels whose pictures add up to that of a scene.

    Returns
    -------
    list of Scene
        The scene alone, unless it shows channels of microscopy, which have colors of their own, and lights none of
        them.  Light that stained structures emit adds up; surfaces and a scan below a PET hide each other.
    """
    parts = (scene, *scene.channels)
    is_light = (
        _channels_called_for(scene, Quality())[0] and scene.effects.get("channels") is not False and scene.mist is None
        and not scene.effects.get("shading")
        and all(one.volume.color and one.transfer_function.shade is None for one in parts)
        and all(np.array_equal(one.volume.affine, scene.volume.affine) for one in parts)
    )  # fmt: skip
    if not is_light:
        return [scene]
    off = {name: on for name, on in scene.effects.items() if not on}  # what is forced on may be of one channel alone
    first = change(scene, channels=(), effects=off)
    further = [
        change(first, volume=one.volume, transfer_function=one.transfer_function, labels=None)
        for one in scene.channels if is_shown(one.transfer_function)
    ]  # fmt: skip
    return [first, *further]


def add_light_steps(scene: Scene, scenes: list[Scene], make_steps):
    """Generator of Progress: the sum of the pictures of some scenes; returns its Rendering.

    Colors are summed and end at the opacity 1 - (1 - a1)(1 - a2)...: two saturated channels of red and green are
    yellow, as in ImageJ's composites.  The depth is that of the nearest channel, the report that of the first with the
    times of all.

    Parameters
    ----------
    scenes : list of Scene
        Its ``split_light``.
    make_steps : callable
        ``make_steps(scene)``: generator of Progress, returns the Rendering of a scene of one channel.
    """
    if len(scenes) == 1:
        return (yield from make_steps(scenes[0]))
    color, opacity, depth, reports = 0.0, 0.0, np.full(1, np.inf, np.float32), []
    for number, single in enumerate(scenes):
        made = yield from rescale(make_steps(single), number / len(scenes), (number + 1) / len(scenes))
        color, opacity = color + made.rgba[..., :3], opacity + (1.0 - opacity) * made.rgba[..., 3:]
        depth = np.minimum(depth, made.depth)
        reports.append(made.report)
    stages = reports[-1]["stages_ms"]
    row = {"on": True, "reason": _channels_called_for(scene, Quality())[1], "ms": stages["total"]}
    row["ms"] -= reports[0]["stages_ms"]["total"]
    effects = [{**one, **row} if one["name"] == "channels" else one for one in reports[0]["effects"]]
    remarks = list(dict.fromkeys(remark for report in reports for remark in report["remarks"]))
    report = {**reports[0], "effects": effects, "stages_ms": stages, "remarks": remarks}
    return Rendering(np.concatenate((np.minimum(color, opacity), opacity), axis=-1), depth, report)


def is_shown(function) -> bool:
    """Whether a transfer function has any opacity."""
    return max(alpha for _, alpha in function.opacity) > 0.0


def _labels_called_for(scene: Scene, quality: Quality) -> tuple[bool, str]:
    labels = scene.labels
    if labels is None:
        return False, "the volume has no segments"
    if not scene.volume.holds_values:
        return False, CLASSIFIED
    hidden = sum(function is None for function in labels.functions.values())
    if scene.mode != MODES[0]:
        return hidden > 0, f"{hidden} hidden; the mode {scene.mode} uses one transfer function"
    if not labels.functions:
        return False, "no segment is hidden or has a transfer function"
    return True, f"{len(labels.functions) - hidden} segment(s) with a transfer function, {hidden} hidden"


def _channels_called_for(scene: Scene, quality: Quality) -> tuple[bool, str]:
    if not scene.channels:
        return False, "the volume is the only channel"
    if not scene.volume.holds_values:
        return False, CLASSIFIED
    if scene.mode != MODES[0]:
        return False, f"the mode {scene.mode} shows the values of one volume"
    if not any(is_shown(channel.transfer_function) for channel in scene.channels):
        return False, f"{len(scene.channels)} further channel(s) are fully transparent"
    return True, f"{len(scene.channels)} further channel(s) are added"


LABELS = Kind(
    "Give each segment its own transfer function, or hide it", _labels_called_for,
    lambda scene: change(scene, labels=None), stage="mixing",
)  # fmt: skip
CHANNELS = Kind(
    "Add further volumes on the same grid, each with its own transfer function", _channels_called_for,
    lambda scene: change(scene, channels=()), stage="mixing",
)  # fmt: skip
