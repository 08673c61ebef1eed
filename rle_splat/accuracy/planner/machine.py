"""What this machine takes for the work that plans are counted in: measured once, and kept in the user's cache folder.

Plans for a tolerance are chosen by these figures and by what is counted in the scene, never by the times of a run, so
the same scene has the same plan at every run, whatever else the machine does meanwhile.  The figures are the least of
several measurements of one synthetic scene.
"""

from __future__ import annotations

import json
import os
import platform
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...classify.transfer_function import TransferFunction
from ...pipeline.choose_source import choose_source
from ...pipeline.plan_model import Model, calibration_mark
from ...pipeline.render import render_steps
from ...pipeline.single_rays import can_trace
from ...pipeline.stage_cache import StageCache
from ...raycast.scalar_rays import COMPOSITED
from ...runtime.cache_folder import RELEASE, cache_folder
from ...runtime.jit import compiled, thread_count
from ...runtime.memory import total_bytes
from ...runtime.steps import Progress, map_steps
from ...runtime.whole_files import whole_files
from ...scene import Quality, Scene
from ...view.turntable import turntable
from ...volume.volume import Volume
from .features import features_of, pilots
from .ray_cost import FEW_SLABS
from .single_rays import single_ray_steps

MEASURING = "Measuring this machine, once"
ROWS_APART = 8  # of the picture, from one whose rays are followed to the next


class Size(NamedTuple):
    """Of a measurement: voxels along a side of the volume, pixels along a side of its picture, and how often each frame
    is made, the least time of which counts."""

    side: int
    pixels: int
    repeats: int


KERNELS, NUMPY = Size(80, 320, 5), Size(24, 48, 1)  # numpy takes hundreds of times as long


@dataclass(frozen=True)
class MachineProfile:
    """The speed of a machine, for one classification, size of records, number of threads and way to compute.

    Attributes
    ----------
    splat, warp : float
        Their time over that on the machine of the model's calibration.
    cell_us, slab_us : float
        Microseconds of a single ray for each cell that it walks through or composites, and for each slab in the cells
        that it composites; 0 where the classification has no single rays.
    memory : int
        Bytes of the machine.
    """

    splat: float
    warp: float
    cell_us: float
    slab_us: float
    memory: int


def profile_steps(quality: Quality):
    """Generator of Progress: the MachineProfile for a quality, from the user's cache folder or measured and kept there.

    Where nothing can be kept it is measured at each call.
    """
    path, key = cache_folder() / f"machine-{RELEASE}.json", _key(quality)
    known = _read(path)
    with suppress(KeyError, TypeError):
        profile = MachineProfile(**known[key])
        if all(isinstance(value, (int, float)) and value >= 0.0 for value in asdict(profile).values()):
            return profile
    profile = yield from _measure_steps(quality)
    _write(path, {**_read(path), key: asdict(profile)})
    return profile


def _key(quality: Quality) -> str:
    """What a profile is for; machines may share a folder."""
    how = "numba" if compiled() else "numpy"
    machine = f"{platform.node()}, {platform.machine()}, {os.cpu_count()} cores, {total_bytes()} bytes"
    what = f"{quality.classification}, records of {quality.record} bytes, calibration {calibration_mark()}"
    return f"{machine}, {thread_count(quality.threads)} threads, {how}, {what}"


def _read(path: Path) -> dict:
    with suppress(OSError, ValueError):
        found = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(found, dict):
            return found
    return {}


def _write(path: Path, profiles: dict) -> None:
    """Whole or not at all, since another process may read it meanwhile."""
    with suppress(OSError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with whole_files([path]) as (part,):
            part.write_text(json.dumps(profiles, indent=1), encoding="utf-8")


def synthetic_scene(size: Size) -> Scene:
    """Blobs of different opacities with empty space between them, lit by a headlight."""
    z, y, x = np.mgrid[: size.side, : size.side, : size.side] * (2.0 * np.pi / size.side)
    field = np.sin(2.0 * x + np.sin(y)) + np.sin(3.0 * y + 0.5 * z) + np.sin(2.0 * z - np.sin(3.0 * x))
    volume = Volume(np.rint(127.5 + 42.0 * field).astype(np.uint8), np.eye(4))
    function = TransferFunction(
        opacity=((130.0, 0.0), (180.0, 0.1), (230.0, 0.8)), color=((0.0, 0.9, 0.5, 0.2), (255.0, 1.0, 1.0, 0.9)),
    )  # fmt: skip
    camera, matrix = turntable(volume, 30.0, 20.0)
    return Scene(volume, function, camera, size.pixels, size.pixels, matrix)


def _measure_steps(quality: Quality):
    """Generator of Progress: the MachineProfile of this machine."""
    yield Progress(0.0, MEASURING)
    size = KERNELS if compiled() else NUMPY
    scene, cache, model = synthetic_scene(size), StageCache(), Model.of(quality.classification)
    plain = Quality(classification=quality.classification, threads=quality.threads, record=quality.record)
    plans, drawn, taken = pilots(plain), {}, {}
    for _ in range(size.repeats + 1):  # the first also fills the caches
        for name, plan in plans.items():
            drawn[name] = yield from map_steps(render_steps(scene, plan, cache=cache), _say)
            taken.setdefault(name, []).append(drawn[name].report["stages_ms"])
    features = features_of(scene, plain, drawn)
    ratios = {"splat": [], "warp": []}
    for name, plan in plans.items():
        for stage, expected in zip(ratios, model.milliseconds(features, plan), strict=True):
            ratios[stage].append(min(stages[stage] for stages in taken[name][1:]) / max(expected, 1e-6))
    speeds = {stage: max(float(np.median(values)), 1e-3) for stage, values in ratios.items()}
    cell_us, slab_us = 0.0, 0.0
    if can_trace(choose_source(scene, plain)):
        cell_us, slab_us = yield from _ray_steps(scene, plain, cache, size)
    return MachineProfile(speeds["splat"], speeds["warp"], cell_us, slab_us, total_bytes())


def _ray_steps(scene: Scene, quality: Quality, cache: StageCache, size: Size):
    """Generator of Progress: ``cell_us`` and ``slab_us``."""
    rows, columns = (each.ravel() for each in np.mgrid[0 : size.pixels : ROWS_APART, 0 : size.pixels])
    spent = {}
    for _ in range(size.repeats + 1):
        for slabs in (FEW_SLABS, 2 * FEW_SLABS):
            steps = single_ray_steps(scene, quality, columns, rows, slabs, cache)
            _, work, took = yield from map_steps(steps, lambda _: Progress(0.0, MEASURING))
            spent.setdefault(slabs, []).append(took)
    few, many = (1e3 * min(times[1:]) for times in spent.values())
    slab = max(many - few, 0.05 * few)
    cells = max(few - slab, 0.1 * few)
    composited = max(int(work[:, COMPOSITED].sum()), 1)
    return cells / max(int(work.sum()), 1), slab / (FEW_SLABS * composited)


def _say(step: Progress) -> Progress:
    return step if "kernels" in step.message else step._replace(fraction=0.0, message=MEASURING)
