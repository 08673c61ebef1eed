"""Opacity by the size of the gradient: surfaces between materials stay, even regions become transparent."""

from ..scene import Quality, Scene
from ..scene.changed import change
from .kind import Kind
from .lighting_kinds import BAKED
from .mixing import is_mixed
from .ray_mode import MODE_NAMES, OF_VALUES


def _gradient_opacity(scene: Scene, _: Quality) -> tuple[bool, str]:
    if not scene.volume.holds_values:
        return False, BAKED
    ends = scene.transfer_function.gradient_opacity
    if ends is None:
        return False, "the transfer function has no gradient opacity"
    if is_mixed(scene):
        return False, "there is none with labels or channels"
    if scene.mode in OF_VALUES:
        return False, f"nothing is absorbed in the mode {MODE_NAMES[scene.mode]}"
    return True, f"from {ends.low:g} to {ends.high:g} values per unit of length"


def _without(scene: Scene) -> Scene:
    tf = scene.transfer_function
    if tf is None or tf.gradient_opacity is None:  # a .rle file's may be left out
        return scene
    return change(scene, transfer_function=change(tf, gradient_opacity=None))


GRADIENT_OPACITY = Kind(
    "Multiply the opacity by a curve over the gradient, so that uniform regions become transparent and surfaces remain",
    _gradient_opacity, _without, stage="gradients",
)  # fmt: skip
