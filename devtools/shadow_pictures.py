"""dev.py shadows: a scan without its shadow, with ours and as Cycles' own volume, side by side, with figures."""

from __future__ import annotations

import time

from .blender_job import run_job
from .environments import any_bpy
from .places import OUT, pixels, say

FOLDER = OUT / "shadows"


def shadows(size: str, samples: int) -> int:
    """Make shadows.png and figures.json in out/shadows."""
    width, height = pixels(size)
    began = time.monotonic()
    run_job(any_bpy(), "shadow_scene.py", FOLDER, size=[width, height], samples=samples)
    say(f"{FOLDER / 'shadows.png'}\n{FOLDER / 'figures.json'}\nDone in {time.monotonic() - began:.0f} s.")
    return 0
