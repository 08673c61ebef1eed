"""Volumes larger than memory: a synthetic raw volume, encoded into a folder of tables and shown from it.

The volume is made in chunks: a thin curved wall (a gyroid) inside an ellipsoid, 16 bit.  Encoding, pictures from the
folder and, with --compare, pictures from memory run in processes of their own, whose anonymous memory is read from
outside while they run; pages of mapped files are told apart.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.cli.options import CUSTOM_QUALITY, memory_size
from rle_splat.encode.store import read_encoded
from rle_splat.pipeline.fitting import fitting_steps
from rle_splat.pipeline.render import render
from rle_splat.pipeline.stage_cache import StageCache
from rle_splat.read.formats import read_volume
from rle_splat.runtime.memory import bytes_text, limit_process_to
from rle_splat.runtime.steps import drain
from rle_splat.scene import Quality, Scene
from rle_splat.view.turntable import turntable

from .run import Run, make_parser

SHAPE = 2048, 2048, 1024
WALL, BRIGHT = 0.10, 40000.0  # half-width of the wall in the gyroid's value, and the stored value inside it
PERIODS = 5.0  # of the gyroid along the longest side
PIXELS = 512
LEVEL = 3  # of the quick look
AMPLE = "12GiB"  # for pictures from memory
LOOK_EVERY = 0.02  # seconds
FUNCTION = {
    "name": "Wall", "unit": None, "opacity": [[20000, 0.0], [30000, 0.6]], "color": [[20000, 0.9, 0.6, 0.4]],
    "shade": {"ambient": 0.2, "diffuse": 0.8, "specular": 0.2, "shininess": 20.0},
}  # fmt: skip
VIEWS = {"x": (90.0, 8.0), "y": (10.0, 8.0), "z": (10.0, 80.0)}  # principal axis -> azimuth, elevation


def make_volume(path: Path, shape_xyz) -> None:
    """Write the volume plane by plane, as raw uint16."""
    nx, ny, nz = shape_xyz
    turn = 2.0 * np.pi * PERIODS / max(shape_xyz)
    x, y = np.arange(nx, dtype=np.float32) * turn, np.arange(ny, dtype=np.float32)[:, None] * turn
    still, along_x, along_y = np.sin(x) * np.cos(y), np.cos(x), np.sin(y)
    across = [(np.arange(n, dtype=np.float32) / (n - 1) - 0.5) ** 2 for n in (nx, ny)]
    round_xy = across[0] + across[1][:, None]
    with open(path, "wb") as file:
        for z in range(nz):
            value = still + np.float32(np.cos(turn * z)) * along_y + np.float32(np.sin(turn * z)) * along_x
            plane = BRIGHT * np.clip(1.5 - np.abs(value) / np.float32(2.0 * WALL), 0.0, 1.0)
            plane[round_xy + np.float32((z / (nz - 1) - 0.5) ** 2) > 0.2] = 0.0
            file.write(plane.astype(np.uint16).tobytes())


def watched(words) -> dict:
    """Run a command; seconds, seconds of processor time, the largest anonymous memory and the largest memory in all,
    in bytes, and its output."""
    began, spent, most, whole = time.perf_counter(), _processor_seconds(), 0, 0
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen([sys.executable, *map(str, words)], stdout=output)
        while process.poll() is None:
            try:
                status = Path(f"/proc/{process.pid}/status").read_text()
            except OSError:
                break
            sizes = {line.split(":")[0]: line.split()[1] for line in status.splitlines() if line.startswith("Rss")}
            most = max(most, 1024 * int(sizes.get("RssAnon", 0)))
            whole = max(whole, 1024 * sum(map(int, sizes.values())))
            time.sleep(LOOK_EVERY)
        if process.wait():
            raise SystemExit(f"{' '.join(map(str, words))} ended with code {process.returncode}.")
        output.seek(0)
        text = output.read()
    return {
        "seconds": time.perf_counter() - began, "processor": _processor_seconds() - spent, "anonymous": most,
        "resident": whole, "output": text,
    }  # fmt: skip


def _processor_seconds() -> float:
    """Of all processes that this one has started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def scene_of(volume, view: str, headlight: bool) -> Scene:
    """The picture that is measured."""
    camera, matrix = turntable(volume, *VIEWS[view])
    function = TransferFunction.from_json(FUNCTION)
    return Scene(
        volume=volume, transfer_function=function, camera=camera, width=PIXELS, height=PIXELS, volume_matrix=matrix,
        headlight=headlight,
    )  # fmt: skip


def quality_of(classification: str) -> Quality:
    """One plan, whatever the volume is."""
    if classification == "pre":
        return Quality.preset("standard", classification="pre")
    return Quality(classification="post", depth_rule="preintegrated", rays=0.0, name=CUSTOM_QUALITY)


def frames(args) -> int:
    """In a process of its own: pictures from a folder, from memory, or of larger voxels; prints JSON."""
    limit_process_to(args.memory_limit)
    quality, cache = quality_of(args.classification), StageCache()
    began = time.perf_counter()
    is_folder = args.frames.is_dir()
    volume = read_encoded(args.frames) if is_folder else read_volume(args.frames, shape=args.shape, dtype="uint16")
    scene = scene_of(volume, args.view, not is_folder)
    seconds, spent, halvings, shown = [], [], 0, None
    for _ in range(1 if args.coarse else args.repeats + 1):
        used = time.process_time()
        if args.coarse:
            shown, halvings = drain(fitting_steps(scene, quality, cache))
        else:
            shown = render(scene, quality, cache=cache)
        seconds.append(time.perf_counter() - began)
        spent.append(time.process_time() - used)
        began = time.perf_counter()
    digest = hashlib.sha256(shown.rgba.tobytes() + shown.depth.tobytes()).hexdigest()
    stages = shown.report["stages_ms"]
    found = {"seconds": seconds, "processor_seconds": spent, "halvings": halvings, "digest": digest}
    print(json.dumps({**found, "stages_ms": stages}))
    return 0


def _measured(args, source: Path, **options) -> dict:
    """``frames`` in a process of its own, watched."""
    words = ["-m", "benchmarks.beyond_memory", "--frames", source, "--shape", *args.shape, "--repeats", args.repeats]
    words += ["--classification", args.classification]
    for name, value in options.items():
        words += [f"--{name.replace('_', '-')}", *([] if value is True else [value])]
    found = watched(words)
    return {**found, **json.loads(found["output"]), "process_seconds": found["seconds"]}


def _forget(path: Path) -> None:
    """Let the system forget what it holds of a file, so that it is read from the disk."""
    with open(path, "rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _say(what: str, found: dict) -> None:
    times = found["seconds"] if isinstance(found["seconds"], list) else [found["seconds"]]
    each = ", ".join(f"{seconds:.2f}" for seconds in times)
    held = f"anonymous {bytes_text(found['anonymous'])}, resident {bytes_text(found['resident'])}"
    print(f"{what:<42}{each:>28} s   {held}", flush=True)


def measure(args, folder: Path) -> dict:
    """All measurements; files go to ``folder``."""
    volume, tables = folder / "volume.raw", folder / "volume.rle"
    (folder / "wall.json").write_text(json.dumps(FUNCTION))
    began = time.perf_counter()
    make_volume(volume, args.shape)
    print(f"The volume: {bytes_text(volume.stat().st_size)}, made in {time.perf_counter() - began:.0f} s", flush=True)
    limit = f"{args.memory_limit / 2**20:.0f}MiB"
    words = ["-m", "rle_splat", "encode", volume, "-o", tables, "--folder", "--memory-limit", limit]
    words += ["--shape", *args.shape, "--dtype", "uint16", "--transfer-function", folder / "wall.json", "--headlight"]
    words += ["--azimuth", VIEWS["x"][0], "--elevation", VIEWS["x"][1], "--classification", args.classification]
    found = {"shape": args.shape, "limit": args.memory_limit, "encode": watched(words)}
    size = sum(file.stat().st_size for file in tables.iterdir())
    found["bytes"] = {"volume": volume.stat().st_size, "folder": size}
    _say("encode into a folder", found["encode"])
    print(f"The folder: {bytes_text(size)}", flush=True)
    if args.coarse:
        scene_words = words[words.index("--shape") : words.index("--classification")]
        _forget(volume)
        for once in ("first", "again"):
            words = ["-m", "rle_splat", "render", volume, "-o", folder / "level.png", "--level", LEVEL, *scene_words]
            found[f"level {once}"] = watched([*words, "--memory-limit", limit])
            _say(f"one voxel of {2**LEVEL}^3, {once}", found[f"level {once}"])
        found["coarse"] = _measured(args, volume, memory_limit=limit, coarse=True, view="x")
        _say(f"larger voxels (halved {found['coarse']['halvings']} times)", found["coarse"])
    for view in VIEWS if args.classification == "post" else ("x",):  # light is baked where it follows the view
        found[view] = {"folder": _measured(args, tables, memory_limit=limit, view=view)}
        _say(f"along {view}, from the folder", found[view]["folder"])
        if args.compare:
            found[view]["memory"] = _measured(args, volume, memory_limit=AMPLE, view=view)
            _say(f"along {view}, from memory", found[view]["memory"])
            same = found[view]["memory"]["digest"] == found[view]["folder"]["digest"]
            folder, memory = (min(found[view][one]["processor_seconds"][1:]) for one in ("folder", "memory"))
            spent = f"{folder:.2f} and {memory:.2f} s of processor time, ratio {folder / memory:.2f}"
            print(f"  the same bits: {same}; a frame takes {spent}", flush=True)
    return found


def add_folder_options(parser) -> None:
    """Add the options that ``measured_in_folder`` takes."""
    parser.add_argument("--folder", type=Path, help="where the files go; they are removed at the end")


def measured_in_folder(measure, args, name: str, arguments) -> int:
    """Call ``measure(args, folder)`` with a folder of its own, which is removed, and keep its figures."""
    run = Run(name, arguments)
    if args.folder is not None:
        args.folder.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir=args.folder))
    try:
        found = measure(args, folder)
    finally:
        shutil.rmtree(folder)
    run.keep(**found)
    return 0


def main(arguments) -> int:
    parser = make_parser(
        "dev.py bench beyond-memory", __doc__.splitlines()[0], repeats={"help": "frames after the first"},
        classification="pre",
    )  # fmt: skip
    parser.add_argument("--shape", nargs=3, type=int, default=SHAPE, metavar=("NX", "NY", "NZ"))
    parser.add_argument("--memory-limit", type=memory_size, default="2GiB", help="of encoding and of each picture")
    parser.add_argument("--compare", action="store_true", help="pictures from memory too")
    parser.add_argument("--coarse", action="store_true", help="few voxels, and the larger ones that fit, too")
    add_folder_options(parser)
    parser.add_argument("--frames", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--view", choices=VIEWS, default="x", help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    if args.frames is not None:
        return frames(args)
    return measured_in_folder(measure, args, "beyond-memory", arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
