"""What all benchmarks share: the views, the time of a frame, and the load by other programs."""

from __future__ import annotations

import os
import platform
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rle_splat.pipeline.render import render
from rle_splat.runtime.jit import thread_count
from rle_splat.runtime.steps import FRAME, Clock
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

# Azimuth and elevation in degrees: all three principal axes, along and oblique to them.
VIEWS = ((0, 0), (35, 25), (80, 10), (130, -20), (200, 50), (-60, 75))
MOVED = 0.05  # degrees that a camera turns between two pictures: nothing but what it sees is made again
ALONE = 0.15  # busy cores of other programs up to which a run counts as undisturbed


def view_scene(volume: Volume, tf, view, size: int, perspective: bool = False, shaded: bool = True) -> Scene:
    """The scene of a picture with ``size`` pixels a side; ``view`` is (azimuth, elevation) in degrees."""
    camera, matrix = turntable(volume, *view, perspective=perspective)
    return Scene(volume, tf, camera, size, size, matrix, headlight=shaded)


def same_view(scene: Scene, volume) -> Scene:
    """The scene with its volume replaced by a StoredVolume, whose colors are already lit."""
    return replace(scene, volume=volume, lights=(), headlight=False, effects={})


def moved_scenes(volume: Volume, tf, view, size: int, perspective: bool, shaded: bool, count: int) -> list[Scene]:
    """``count`` scenes as of ``view_scene``, seen from a camera that turns by MOVED degrees before each of them."""
    azimuth, elevation = view
    turned = (azimuth + MOVED * number for number in range(1, count + 1))
    return [view_scene(volume, tf, (one, elevation), size, perspective, shaded) for one in turned]


def whole_call(scene: Scene, quality: Quality, cache=None):
    """Render a scene; return the Rendering and the milliseconds of the whole call, measured from outside."""
    began = seconds()
    rendering = render(scene, quality, cache=cache)
    return rendering, 1e3 * (seconds() - began)


def quickest_call(scenes, quality: Quality, cache=None):
    """The ``whole_call`` of some scenes that took least, because other load can only add time."""
    return min((whole_call(scene, quality, cache) for scene in scenes), key=lambda call: call[1])


def best_frame(scene: Scene, quality: Quality, repeats: int, cache=None):
    """(rendering, its ``frame_ms``) of the fastest of several pictures, because other load can only add time."""
    best, least = None, np.inf
    for _ in range(repeats):
        rendering = render(scene, quality, cache=cache)
        spent = frame_ms(rendering.report)
        if spent < least:
            best, least = rendering, spent
    return best, least


def time_by_processor() -> None:
    """Time all stages and ``seconds``, from now on, by the processor time of the calling thread, for one thread.

    Other programs make a thread wait, which is not counted, and share its caches, which is.
    """
    Clock.__init__.__defaults__ = (time.thread_time,)


def seconds() -> float:
    """The clock by which stages are timed."""
    return Clock.__init__.__defaults__[0]()


def frame_ms(report: dict) -> float:
    """Milliseconds of the stages that every frame runs."""
    return sum(report["stages_ms"][stage] for stage in FRAME)


class Neighbors:
    """Measures the load by other processes from its creation on; only on Linux."""

    def __init__(self):
        self._before = self._busy()

    @staticmethod
    def _busy():
        """Seconds of wall time, of work on all cores, and of work by this process and its finished children."""
        stat = Path("/proc/stat")
        if not stat.exists():
            return None
        ticks = [int(word) for word in stat.read_text(encoding="ascii").split("\n", 1)[0].split()[1:9]]
        own = os.times()
        busy = (sum(ticks) - ticks[3] - ticks[4]) / os.sysconf("SC_CLK_TCK")  # all but idle and waiting for disks
        return time.monotonic(), busy, own.user + own.system + own.children_user + own.children_system

    def cores(self) -> float | None:
        """Mean number of cores that other processes kept busy; None if unknown."""
        now = self._busy()
        if now is None:
            return None
        wall, busy, own = (after - before for after, before in zip(now, self._before))
        return max(busy - own, 0.0) / max(wall, 1e-9)

    def describe(self) -> str:
        """A sentence for the end of a table."""
        cores = self.cores()
        if cores is None:
            return "The load by other programs is not known on this system."
        trust = "" if cores < ALONE else " Use only ratios within this run, and with care."
        return f"Other programs kept {cores:.2f} cores busy during the run.{trust}"


def circumstances(threads: int) -> dict:
    """The machine and its load, JSON-ready: ``processor``, ``cores``, ``threads``, ``python`` and ``load_before``."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "processor": _processor(), "cores": os.cpu_count(), "threads": thread_count(threads),
        "python": platform.python_version(), "load_before": load,
    }  # fmt: skip


def describe(where: dict) -> str:
    """The result of ``circumstances`` as one or two sentences."""
    load = where["load_before"]
    said = f"{where['processor']}, {where['cores']} cores; {where['threads']} thread(s); Python {where['python']}."
    if load is None:
        return said
    return f"{said} Load before the run: {load:.2f}."


def _processor() -> str:
    """The name of the processor, if the system gives one."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
