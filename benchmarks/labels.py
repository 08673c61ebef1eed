"""Seconds of the processor for a frame with 0 to 104 labels, and for a frame of a scan in time with labels.

All cases take turns, on one thread.  docs/explanation/effects.md has the results.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import nibabel
import numpy as np

from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.pipeline.fitting import fitting_steps
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.read.formats import read_volume
from rle_splat.read.labels import read_labels
from rle_splat.runtime.steps import drain
from rle_splat.scene import Labels, Quality
from rle_splat.volume.measure import measure_steps
from rle_splat.volume.volume import Volume

from .frames import view_scene
from .run import Run, make_parser

COUNTS = (0, 1, 20, 104)  # labels; 20 and 104 fill the whole volume
TIMES, ORGANS = 7, 4  # frames of the scan in time, and labels in each
SHIFT = 1.5  # voxels that it moves by from frame to frame
NOISE = 12.0  # of its values, another one in each frame
TURN = 0.5  # degrees that the camera turns by from picture to picture
FUNCTION = TransferFunction(
    opacity=((200, 0.0), (900, 0.15), (1200, 0.4)), color=((0, 0.8, 0.6, 0.5), (1200, 1, 1, 0.9)), shade=Shade()
)


def make_scan(side: int, shift: float = 0.0) -> Volume:
    """A ball with structure in it, int16, moved along x by ``shift`` voxels."""
    z, y, x = np.mgrid[:side, :side, :side].astype(np.float32) * (128.0 / side) - 64.0
    radius = np.sqrt((x - shift) ** 2 + y**2 + z**2)
    values = 1000.0 * np.exp(-((radius / 45.0) ** 6)) + 120.0 * np.sin(x / 5.0) * np.sin(y / 6.0) * np.sin(z / 7.0)
    return Volume(values.astype(np.int16), np.eye(4))


def make_labels(scan: Volume, count: int, shift: float = 0.0, radius: float = 1.0) -> Volume:
    """The voxels nearest to each of ``count`` points, and within ``radius`` sides of it, moved as the scan."""
    side = len(scan.voxels)
    places = np.random.default_rng(0).uniform(0.2 if radius < 1.0 else 0.0, 0.8 if radius < 1.0 else 1.0, (count, 3))
    z, y, x = np.mgrid[:side, :side, :side].astype(np.float32) / side
    nearest, labels = np.full(scan.voxels.shape, radius**2, np.float32), np.zeros(scan.voxels.shape, np.uint8)
    for number, (a, b, c) in enumerate(places, 1):
        apart = (x - a - shift / side) ** 2 + (y - b) ** 2 + (z - c) ** 2
        mine = apart < nearest
        nearest[mine], labels[mine] = apart[mine], number
    return replace(scan, voxels=labels)


def colored(labels: Volume, count: int) -> Labels:
    """Each label in a color of its own, by the values of the scan."""
    colors = np.random.default_rng(3).uniform(0.2, 1.0, (count, 3))
    return Labels(labels, {n: replace(FUNCTION, color=((0.0, *map(float, c)),)) for n, c in enumerate(colors, 1)})


def seconds(
    scan: Volume, labels: Labels | None, lit: bool, quality: str, size: int, azimuth: float, cache, halvings: int = 0
) -> float:
    """Seconds of the processor for a picture; ``halvings``: of the voxels and of the pixels along each side."""
    size >>= halvings
    scene = replace(view_scene(scan, FUNCTION, (azimuth, 20.0), size, shaded=lit), labels=labels)
    began = time.process_time()
    drain(fitting_steps(scene, Quality.preset(quality, threads=1), cache, halvings, is_draft=True))
    return time.process_time() - began


def add_row(run: Run, case: str, lit: bool, frames: list[float], more: str = "") -> None:
    """Take the median of the seconds of some frames into a run, and print it."""
    run.rows.append({"case": case, "lit": lit, "ms": 1e3 * float(np.median(frames))})
    print(f"{case}, {'lit' if lit else 'unlit'}: {run.rows[-1]['ms']:.0f} ms{more}", flush=True)


def count_rows(run: Run, options) -> None:
    """The first picture and the frames of a camera that turns, by the number of labels."""
    scan = make_scan(options.side)
    maps = {n: colored(make_labels(scan, n, radius=1.0 if n > 1 else 0.1), n) if n else None for n in COUNTS}
    caches = {(n, lit): StageCache() for n in COUNTS for lit in (False, True)}
    taken = {case: [] for case in caches}
    for picture in range(1 + options.repeats):
        for (n, lit), cache in caches.items():
            azimuth = 35.0 + TURN * picture
            taken[n, lit].append(seconds(scan, maps[n], lit, "standard", options.size, azimuth, cache))
    for (n, lit), (first, *frames) in taken.items():
        held = f", first picture {first:.2f} s, {caches[n, lit].nbytes / scan.voxels.size:.1f} bytes a voxel"
        add_row(run, f"{n} labels", lit, frames, held)


def write_frames(folder: Path, name: str, frames: list) -> Path:
    """Write arrays of voxels as one file of several times, packed."""
    path = folder / f"{name}.nii.gz"
    nibabel.save(nibabel.Nifti1Image(np.stack([one.T for one in frames], axis=-1), np.eye(4)), path)
    return path


def read_frame(scan_path: Path, map_path: Path, frame: int) -> tuple[Volume, Volume, float, float]:
    """A scan and its map as they are in memory before a picture, and the seconds of the processor for each."""
    began = time.process_time()
    scan = read_volume(scan_path, frame=frame)
    drain(measure_steps(scan))
    middle = time.process_time()
    labels = read_labels(map_path, scan, frame)
    drain(measure_steps(labels))
    return scan, labels, middle - began, time.process_time() - middle


def time_rows(run: Run, options) -> None:
    """Two rounds of a scan in time, by what it has for labels: as it is, and as playback draws it when slow."""
    scans = [make_scan(options.side, SHIFT * n) for n in range(TIMES)]
    maps = [make_labels(scan, ORGANS, SHIFT * n, 0.16) for n, scan in enumerate(scans)]
    random = np.random.default_rng(1)
    noisy = [scan.voxels + np.rint(random.normal(0.0, NOISE, scan.voxels.shape)).astype(np.int16) for scan in scans]
    with TemporaryDirectory() as folder:
        files = [write_frames(Path(folder), "scan", noisy), write_frames(Path(folder), "map", [m.voxels for m in maps])]
        scans, maps, *reading = zip(*(read_frame(*files, n) for n in range(1, TIMES + 1)))
    add_row(run, "reading a frame", False, reading[0][1:])
    add_row(run, "reading a frame and its map", False, np.add(*reading)[1:])
    maps = [colored(one, ORGANS) for one in maps]
    kinds = {"without labels": [None] * TIMES, "one map": maps[:1] * TIMES, "a map each": maps}
    caches = {(kind, lit, half): StageCache() for kind in kinds for lit in (False, True) for half in (0, 1)}
    taken = {case: [] for case in caches}
    for n in (*range(TIMES), *range(TIMES)):
        for (kind, lit, half), cache in caches.items():
            taken[kind, lit, half].append(
                seconds(scans[n], kinds[kind][n], lit, "draft", options.size, 35.0, cache, half)
            )
    for (kind, lit, half), all_frames in taken.items():
        for name, frames in (("first round", all_frames[1:TIMES]), ("second round", all_frames[TIMES:])):
            add_row(run, f"{kind}, {name}{', half as many voxels along each side' if half else ''}", lit, frames)


def main(arguments) -> int:
    parser = make_parser("dev.py bench labels", __doc__, side=128, size=400, repeats=4)
    options = parser.parse_args(arguments)
    run = Run("labels", arguments, threads=1, key=("case", "lit"), time="ms")
    count_rows(run, options)
    time_rows(run, options)
    run.keep()
    return 0
