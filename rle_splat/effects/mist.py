"""Mist: colors fade with their distance from the camera, sheet by sheet (algorithm.md 4.2)."""

from ..scene import MODES, Quality, Scene
from ..scene.changed import change
from .kind import Kind
from .ray_mode import MODE_NAMES


def _mist(scene: Scene, _: Quality) -> tuple[bool, str]:
    mist = scene.mist
    if mist is None:
        return False, "the scene has no mist"
    if scene.mode != MODES[0]:
        return False, f"there are no colors to fade in the mode {MODE_NAMES[scene.mode]}"
    falloff = mist.falloff.lower().replace("_", " ")
    return True, f"{falloff} from {mist.start:g} to {mist.start + mist.depth:g}"


MIST = Kind(
    "Fade the volume toward the color of the mist with distance",
    _mist,
    lambda scene: change(scene, mist=None),
)
