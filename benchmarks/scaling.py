"""Time and memory as functions of the volume's size: 128^3 to 1024^3 voxels, 8 bit, about 3 % of them kept.

There are two series.  "scaled": one shell with finer and finer sampling, so that the kept voxels grow with the volume.
"boxed": the same 128^3 object and picture in a larger and larger box of transparent voxels, so that only the volume
grows.  Every step runs in its own process to measure its peak memory: first for reading, classifying, encoding along
one principal axis and drawing, then for encoding along all three, as `rle-splat encode` does.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np

from rle_splat.classify.classification import classify
from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.encode.encode import encode
from rle_splat.encode.stored import StoredVolume
from rle_splat.pipeline.encode_scene import encode as encode_scene
from rle_splat.read.formats import read_volume
from rle_splat.scene import Quality, RleSplatError, Scene
from rle_splat.view.turntable import turntable
from rle_splat.volume.volume import Volume

from .frames import best_frame, same_view
from .plots import IMAGES, scaling_plot
from .run import Run, make_parser

SERIES = ("scaled", "boxed")
SMALLEST = 128
TINY = 16  # voxels along each side of the volume that only compiles and loads kernels
SIZES = (128, 256, 512)
LARGE = 1024
# Radius and half thickness of the shell, in half sides of the volume: 3 % of its voxels.
RADIUS, HALF_THICKNESS = 0.7, 0.0195
AXIS = 1
VIEWS = ((0, 0), (35, 25), (-30, -20))  # all along the principal axis y, so that one set of tables is enough
REPEATS = 2
FRAMES_MS = 1000.0  # time for the pictures of a view, if REPEATS take less
MIB = 1 << 20
MOST_BYTES = 8 << 30  # limit for reading, encoding and drawing 1024^3 voxels


def slab(series: str, n: int, z: int) -> np.ndarray:
    """(n, n) uint8: plane ``z`` of the synthetic volume."""
    side = n if series == "scaled" else SMALLEST
    at = ((np.arange(n, dtype=np.float32) - 0.5 * (n - 1)) / (0.5 * side)) ** 2
    radius = np.sqrt(at[z] + at[:, None] + at[None, :])
    return np.maximum(255.0 * (1.0 - np.abs(radius - RADIUS) / HALF_THICKNESS), 0.0).astype(np.uint8)


def write_volume(path: Path, series: str, n: int) -> None:
    """Write the raw file, plane by plane."""
    with open(path, "wb") as file:
        for z in range(n):
            file.write(slab(series, n, z))


def step(path: Path, series: str, n: int, size: int, threads: int, frames_ms: float) -> dict:
    """Read, classify, encode and draw one raw file; JSON-ready times, counts and the peak memory of this process."""
    quality = Quality(classification="pre", threads=threads)
    _run(_small(), "scaled", SMALLEST, size, quality, 1, 0.0)  # loads the kernels
    spacing = (SMALLEST / n if series == "scaled" else 1.0,) * 3
    began = time.perf_counter()
    volume = read_volume(path, shape=(n, n, n), dtype="uint8", spacing=spacing)
    read_ms = 1e3 * (time.perf_counter() - began)
    result = _run(volume, series, n, size, quality, REPEATS, frames_ms)
    peak = peak_memory()
    began = time.perf_counter()
    three = encode_scene(_scenes(volume, series, n, size)[0], quality)
    return {
        "series": series, "n": n, "volume_bytes": n**3, "read_ms": read_ms, **result, "peak_bytes": peak,
        "three_axes_ms": 1e3 * (time.perf_counter() - began),
        "three_axes_bytes": sum(tables.nbytes for tables in three.axes.values()),
        "three_axes_peak_bytes": peak_memory(),
    }  # fmt: skip


def _small() -> Volume:
    planes = [slab("scaled", TINY, z) for z in range(TINY)]
    return Volume(np.stack(planes), np.eye(4))


def _scenes(volume, series, n, size) -> list[Scene]:
    """The views; the object fills the same part of the picture in both series."""
    tf = TransferFunction("shell", None, ((0, 0), (255, 0.6)), ((0, 0.9, 0.6, 0.3), (255, 1, 1, 1)), 1.0, None)
    fit = 1.25 if series == "scaled" else 1.25 * SMALLEST / n
    scenes = []
    for view in VIEWS:
        camera, matrix = turntable(volume, *view, fit=fit)
        scenes.append(Scene(volume, tf, camera, size, size, matrix, headlight=False))
    return scenes


def _run(volume, series, n, size, quality, repeats, frames_ms) -> dict:
    """The fastest of ``repeats`` runs of each stage, and of more runs for fast pictures."""
    scenes = _scenes(volume, series, n, size)
    tf, index_to_world = scenes[0].transfer_function, scenes[0].index_to_world
    classified, classify_ms = _quickest(partial(classify, volume, tf, index_to_world, threads=quality.threads), repeats)
    tables, encode_ms = _quickest(
        partial(encode, classified, classified.color, AXIS, quality.model, threads=quality.threads), repeats
    )
    stored = StoredVolume.of({AXIS: tables}, volume.affine, volume.unit, classified.unit_length, tf.to_json())
    kept = classified.visible_voxels
    del classified
    frames = []
    for scene in scenes:
        scene = same_view(scene, stored)
        _, first = _quickest(partial(best_frame, scene, quality, 1), 1)  # with all stages
        frames.append(best_frame(scene, quality, max(repeats, int(frames_ms / first)))[1])
    return {
        "kept_voxels": kept, "runs": len(tables.runs), "table_bytes": tables.nbytes, "classify_ms": classify_ms,
        "encode_ms": encode_ms, "frame_ms": median(frames),
    }  # fmt: skip


def _quickest(make, repeats: int):
    """(result, least milliseconds) of ``make()``; only one result exists at a time, for a true peak memory."""
    least = np.inf
    for _ in range(repeats):
        result = None
        began = time.perf_counter()
        result = make()
        least = min(least, 1e3 * (time.perf_counter() - began))
    return result, least


def peak_memory() -> int | None:
    """Peak memory of this process in bytes; None if the platform does not report it."""
    try:
        import resource
    except ImportError:
        return None
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def _in_own_process(path, series, n, options) -> dict:
    command = [
        sys.executable, "-m", "benchmarks", "scaling", "--step", str(path), series, str(n), "--size", str(options.size),
        "--threads", str(options.threads), "--frames-ms", str(options.frames_ms),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise RleSplatError(f"The step {series} {n}^3 failed with the error below.\n{done.stderr.strip()[-400:]}")
    return json.loads(done.stdout.splitlines()[-1])


def table_lines(rows) -> list[str]:
    """The table as lines of text."""
    lines = [
        f"{'series':<8}{'volume':>8}{'MiB':>8}{'kept':>12}{'runs':>12}{'tables MiB':>12}{'classify ms':>13}"
        f"{'encode ms':>11}{'frame ms':>10}{'ns/kept':>9}{'ns/run':>8}{'peak MiB':>10}"
        f"{'3 axes MiB':>12}{'peak MiB':>10}"
    ]
    for row in rows:
        peak, three_peak = (
            "-" if row[name] is None else f"{row[name] / MIB:.0f}" for name in ("peak_bytes", "three_axes_peak_bytes")
        )
        lines.append(
            f"{row['series']:<8}{row['n']:>6}^3{row['volume_bytes'] / MIB:8.0f}{row['kept_voxels']:12d}"
            f"{row['runs']:12d}{row['table_bytes'] / MIB:12.1f}{row['classify_ms']:13.1f}{row['encode_ms']:11.1f}"
            f"{row['frame_ms']:10.1f}{1e6 * row['frame_ms'] / max(row['kept_voxels'], 1):9.1f}"
            f"{1e6 * row['frame_ms'] / max(row['runs'], 1):8.0f}{peak:>10}{row['three_axes_bytes'] / MIB:12.1f}"
            f"{three_peak:>10}"
        )
    return lines


def main(arguments) -> int:
    parser = make_parser("dev.py bench scaling", __doc__, size=512, threads=0)
    parser.add_argument("--sizes", type=int, nargs="*", default=list(SIZES), help="voxels along each side")
    parser.add_argument(
        "--large", action="store_true", help=f"also {LARGE}, which needs 1 GiB of disk and several GiB of memory"
    )
    parser.add_argument("--scratch", type=Path, help="folder for the temporary volumes (default: the system's)")
    parser.add_argument("--frames-ms", type=float, default=FRAMES_MS, help="time for the pictures of a view")
    parser.add_argument("--image", type=Path, default=IMAGES / "scaling.png", help="the plot")
    parser.add_argument("--no-image", action="store_true")
    parser.add_argument("--step", nargs=3, metavar=("FILE", "SERIES", "N"), help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.step:
        path, series, n = options.step
        print(json.dumps(step(Path(path), series, int(n), options.size, options.threads, options.frames_ms)))
        return 0
    run = Run("scaling", arguments, options.threads)
    rows = run.rows
    sizes = [*options.sizes, *([LARGE] if options.large else [])]
    with tempfile.TemporaryDirectory(dir=options.scratch) as folder:
        largest = max(sizes)
        if shutil.disk_usage(folder).free < 2 * largest**3:
            raise RleSplatError(
                f"There is not enough space for {largest}^3 bytes in {folder}; choose another folder with --scratch."
            )
        path = Path(folder) / "volume.raw"
        write_volume(path, SERIES[0], TINY)
        _in_own_process(path, SERIES[0], TINY, options)  # compiles the kernels; its peak memory is not used
        for n in sizes:
            for series in SERIES:
                write_volume(path, series, n)
                rows.append(_in_own_process(path, series, n, options))
                path.unlink()
                print(f"measured {series} {n}^3", flush=True)
    print("\n" + "\n".join(table_lines(rows)))
    print(
        "Frame: splat + warp, standard, median of three views. Peak: of the whole process with Python and the compiled "
        "kernels, which take most of the smallest volume's peak; first for one principal axis and the frames, then for "
        "the tables of all three."
    )
    peaks = [row["three_axes_peak_bytes"] for row in rows if row["three_axes_peak_bytes"]]
    if peaks:
        print(f"The largest peak is {max(peaks) / 2**30:.2f} GiB; {MOST_BYTES / 2**30:.0f} GiB are allowed.")
    run.keep()
    if not options.no_image:
        print(scaling_plot(rows, options.image, MOST_BYTES))
    return 0
