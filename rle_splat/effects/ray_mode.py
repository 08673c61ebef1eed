"""What a pixel shows of its ray, where that is not emission and absorption: the modes of ``ray_values``."""

from __future__ import annotations

from dataclasses import replace

from ..scene import MODES, Quality, Scene
from .kind import Kind

MODE_NAMES = dict(zip(MODES, ("composite", "X-ray", "MIP", "MinIP", "average"), strict=True))

OF_VALUES = ("mip", "minip", "average")  # modes that absorb nothing


def _mode(scene: Scene, _: Quality) -> tuple[bool, str]:
    return scene.mode != MODES[0], f"mode {MODE_NAMES[scene.mode]}"


MODE = Kind(
    "absorption alone, or the largest, smallest or mean value of each ray, in place of emission and absorption", _mode,
    lambda scene: replace(scene, mode=MODES[0]), stage="splat",
)
