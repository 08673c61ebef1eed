"""Labels and channels: whether a scene has any that change its picture."""

from __future__ import annotations

from ..scene import MODES, Quality, Scene
from ..scene.changed import change
from .kind import Kind


def is_mixed(scene: Scene) -> bool:
    """Whether more than one transfer function classifies the voxels."""
    return scene.labels is not None or bool(scene.channels)


def only_hides(scene: Scene) -> bool:
    """Whether the labels of a scene are smooth and only hide: a factor of extinction then does it in ``post``, too."""
    labels = scene.labels
    return labels is not None and labels.smooth and not scene.channels and set(labels.functions.values()) == {None}


def is_sampled(scene: Scene) -> bool:
    """Whether, post-classified, each sample of a scene looks up which label it belongs to."""
    return scene.labels is not None and not only_hides(scene)


def _obstacle(scene: Scene) -> str:
    """Why a scene's voxels cannot be classified by several functions; "" if they can."""
    if not scene.volume.holds_values:
        return "a .rle file holds classified voxels"
    return "" if scene.mode == MODES[0] else f"the mode {scene.mode} shows the values of one volume"


def _labels_called_for(scene: Scene, quality: Quality) -> tuple[bool, str]:
    labels = scene.labels
    if labels is None:
        return False, "the scene has no label volume"
    if reason := _obstacle(scene):
        return False, reason
    hidden = sum(function is None for function in labels.functions.values())
    if not labels.functions:
        return False, "no label is hidden or has a transfer function"
    return True, f"{len(labels.functions) - hidden} label(s) with a transfer function, {hidden} hidden"


def _channels_called_for(scene: Scene, quality: Quality) -> tuple[bool, str]:
    if not scene.channels:
        return False, "the volume is the only channel"
    if reason := _obstacle(scene):
        return False, reason
    shown = sum(max(alpha for _, alpha in channel.transfer_function.opacity) > 0.0 for channel in scene.channels)
    if not shown:
        return False, f"{len(scene.channels)} further channel(s) are fully transparent"
    return True, f"{len(scene.channels)} further channel(s) are added"


LABELS = Kind(
    "gives each segment its own transfer function, or hides it", _labels_called_for,
    lambda scene: change(scene, labels=None), stage="mixing",
)  # fmt: skip
CHANNELS = Kind(
    "adds further volumes on the same grid, each by its own transfer function", _channels_called_for,
    lambda scene: change(scene, channels=()), stage="mixing",
)  # fmt: skip
