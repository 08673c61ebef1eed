"""What all benchmarks share: the views, the time of a frame, and what else the machine was doing."""

from __future__ import annotations

import os
import platform
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rle_splat.pipeline.render import render
from rle_splat.runtime.jit import thread_count
from rle_splat.runtime.steps import FRAME
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

# Azimuth and elevation, degrees: all three principal axes, straight and oblique.
VIEWS = ((0, 0), (35, 25), (80, 10), (130, -20), (200, 50), (-60, 75))
ALONE = 0.15  # cores that others may keep busy while a machine still counts as ours


def view_scene(volume: Volume, tf, view, size: int, perspective: bool = False, shaded: bool = True) -> Scene:
    """A square picture of a volume from a turntable view (azimuth, elevation), with a headlight when shaded."""
    camera, matrix = turntable(volume, *view, perspective=perspective, width=size, height=size)
    return Scene(volume, tf, camera, size, size, matrix, headlight=shaded)


def same_view(scene: Scene, volume) -> Scene:
    """The scene with its volume replaced by ready-made tables (a StoredVolume), whose colors are baked in."""
    return replace(scene, volume=volume, lights=(), headlight=False, effects={})


def best_frame(scene: Scene, quality: Quality, repeats: int, cache=None):
    """The rendering whose ``frame_ms`` were fewest of ``repeats``, and those milliseconds.

    The quickest, because whatever else a machine does can only add.
    """
    best, least = None, np.inf
    for _ in range(repeats):
        rendering = render(scene, quality, cache=cache)
        spent = frame_ms(rendering.report)
        if spent < least:
            best, least = rendering, spent
    return best, least


def frame_ms(report: dict) -> float:
    """Milliseconds of what every frame costs."""
    return sum(report["stages_ms"][stage] for stage in FRAME)


class Neighbors:
    """How much of the machine other processes used since this was made; Linux tells, elsewhere it is None."""

    def __init__(self):
        self._before = self._busy()

    @staticmethod
    def _busy():
        """Seconds of wall time, of all cores' work, and of this process's and its finished children's."""
        stat = Path("/proc/stat")
        if not stat.exists():
            return None
        ticks = [int(word) for word in stat.read_text(encoding="ascii").split("\n", 1)[0].split()[1:9]]
        own = os.times()
        busy = (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf("SC_CLK_TCK")  # all but idle and waiting for disks
        return time.monotonic(), busy, own.user + own.system + own.children_user + own.children_system

    def cores(self) -> float | None:
        """Cores that others kept busy, on average."""
        now = self._busy()
        if now is None:
            return None
        wall, busy, own = (after - before for after, before in zip(now, self._before))
        return max(busy - own, 0.0) / max(wall, 1e-9)

    def describe(self) -> str:
        """A sentence for the end of a table."""
        cores = self.cores()
        if cores is None:
            return "What other programs did meanwhile is not known here."
        trust = "" if cores < ALONE else " Trust ratios within this run only, and those with care."
        return f"Other programs kept {cores:.2f} cores busy during the run.{trust}"


def circumstances(threads: int) -> dict:
    """JSON-ready: where and beside what the figures came about."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(), "cores": os.cpu_count(), "threads": thread_count(threads),
        "python": platform.python_version(), "load_before": load,
    }


def describe(where: dict) -> str:
    """The circumstances as a sentence or two."""
    load = where["load_before"]
    said = f"{where['processor']}, {where['cores']} cores; {where['threads']} thread(s); Python {where['python']}."
    if load is None:
        return said
    return f"{said} Load before the run: {load:.2f}."


def _processor() -> str:
    """The processor's name, as well as it can be had."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
