"""What a picture and an animation cost on a cluster: rates measured on one machine, a model of time and bytes made from
them, the model against a local Dask cluster, and its prediction for a large volume on many nodes.

Run it where dask and distributed are installed (the extra scale, ``requirements/cluster.txt``):

    python -m benchmarks.cluster_costs

It prints the tables of docs/explanation/cluster-costs.md.  All rates are processor time, which other programs on the
machine change little.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from unittest.mock import patch

import numpy as np

from rle_splat import Quality, Scene, read_volume
from rle_splat.classify.default import default_transfer_function
from rle_splat.cli.images import writer_for
from rle_splat.encode.store import read_encoded
from rle_splat.pipeline import render as pipeline
from rle_splat.pipeline.sections import SectionImages, over
from rle_splat.runtime.steps import Clock, drain
from rle_splat.view.turntable import turntable

from .phantoms import smooth_shell

PREPARING = ("classify", "gradients", "shadows", "ambient occlusion", "shade", "encode", "plan")
DRAWING = ("splat", "warp", "rays", "setup", "occlusion", "clipping", "clip objects", "report")
PIXEL = 20  # bytes of a finished pixel: rgba and depth, float32
TABLE_RECORD = 8  # bytes in a folder of tables, of each order: a uint16 and its normal
SLAB_PIXEL = 16  # bytes of a pixel of a slab: color and transmittance, float32
TILE = 1024  # pixels: sides of tiles of large pictures
SLABS = 4
RECORD = 4  # bytes that the tables of scalars hold for each visible voxel: a uint16 and its light
FRAMES = 16
GIB = 1 << 30


@dataclass(frozen=True)
class Rates:
    """What one core of this machine does, in processor time."""

    read: float  # bytes of a volume that are read, per second
    prepare: float  # seconds for classifying, shading and encoding, per voxel of the volume
    sample: float  # seconds for splatting, per pixel of the picture and slice of the volume
    pixel: float  # seconds for warping, per pixel
    move: float  # bytes that go from a worker to the client, per second of both together
    write: float  # seconds for writing, per pixel
    client: float  # seconds until the client has loaded what it needs, kernels from the disk among it
    worker: float  # and until a worker has
    visible: float  # share of the voxels that are visible
    check: float  # bytes of tables on the disk that are read and checked, per second
    cover: float  # seconds for compositing two slabs, per pixel

    def preparing(self, voxels: float, voxel_bytes: int = 2) -> float:
        """Seconds until a worker has the tables of so many voxels."""
        return voxels * voxel_bytes / self.read + voxels * self.prepare

    def drawing(self, slices: float, pixels: float) -> float:
        """Seconds for a picture, the tables at hand."""
        return pixels * (slices * self.sample + self.pixel)

    def delivering(self, pixels: float) -> float:
        """Seconds for sending and writing a picture."""
        return pixels * (PIXEL / self.move + self.write)


def processor_seconds(rates: Rates, side: int, pixels: float, workers: int, frames: int = 1) -> float:
    """The model of a picture in tiles, or of an animation with one frame a task: every worker prepares the volume."""
    each = rates.worker + rates.preparing(float(side) ** 3)
    return rates.client + workers * each + frames * (rates.drawing(side, pixels) + rates.delivering(pixels))


def slab_seconds(rates: Rates, tables: int, side: int, pixels: float, workers: int, slabs: int) -> float:
    """The model of a picture in slabs of a folder whose tables take so many bytes, all of which each worker checks."""
    pairs = (slabs - 1) * pixels
    moved = (min(workers, slabs) - 1) * pixels * SLAB_PIXEL  # neighbors are on one worker where these are fewer
    work = rates.drawing(side, pixels) + pairs * rates.cover + moved / rates.move + rates.delivering(pixels)
    return rates.client + workers * (rates.worker + tables / rates.check) + work


def compositing(rates: Rates, pixels: float, nodes: int) -> float:
    """Seconds for the pictures of a slab on each node, in a tree of pairs for each tile.

    All pairs of a level of the tree that belong to different tiles or slabs are composited at once; near its root there
    may be fewer of them than nodes.
    """
    tiles, each, taken = max(pixels / TILE**2, 1.0), pixels * (SLAB_PIXEL / rates.move + rates.cover), 0.0
    left = nodes
    while left > 1:
        pairs, left = left // 2, (left + 1) // 2
        taken += pairs * each / min(nodes, pairs * tiles)
    return taken


def by_tiles(rates: Rates, side: int, pixels: float, nodes: int, cores: int) -> dict[str, float]:
    """The model of the seconds of a picture in tiles on ``nodes`` of ``cores`` each."""
    voxels = float(side) ** 3
    return {
        "read": voxels * 2 / rates.read,  # the disk of a node serves one reader
        "prepare": voxels * rates.prepare / cores,
        "draw": rates.drawing(side, pixels) / (nodes * cores),
        "composite": 0.0,
        "deliver": rates.delivering(pixels),  # to one client
    }


def by_slabs(rates: Rates, side: int, pixels: float, nodes: int, cores: int) -> dict[str, float]:
    """The same for a folder of tables, of which every node reads a slab along z; nothing is left to be prepared."""
    own = float(side) ** 3 / nodes * rates.visible * TABLE_RECORD
    return {
        "read": own / rates.check,
        "prepare": 0.0,
        "draw": rates.drawing(side / nodes, pixels) / cores,
        "composite": compositing(rates, pixels, nodes),
        "deliver": rates.delivering(pixels),
    }


# --- measuring --------------------------------------------------------------------------------------------------------


def write_volume(path: Path, side: int) -> None:
    """A smooth shell as uint16."""
    (60000.0 * smooth_shell(side)).astype(np.uint16).tofile(path)


def layout(side: int) -> tuple:
    """The options of a volume that ``write_volume`` has written."""
    return ("--shape", *[side] * 3, "--dtype", "uint16")


def write_tables(volume: Path, side: int, folder: Path) -> None:
    """Encode a volume into a folder of tables of values."""
    words = ["encode", volume, *layout(side), "-o", folder, "--folder", "--classification", "post"]
    command = [sys.executable, "-m", "rle_splat", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def bytes_of(tables: Path) -> int:
    """Bytes of the tables of scanlines along x, which views along y and z are drawn from."""
    return sum(path.stat().st_size for path in tables.glob("rows.*"))


def command_seconds(volume: Path, size: int, workers: int, *words) -> float:
    """Processor seconds of ``rle-splat render --dask``, its workers among them."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable, "-m", "rle_splat", "render", volume, "--size", size, "-o", Path(folder, "a.npy"),
            "--no-progress", "--threads", 1, "--dask", "--workers", workers, *words,
        ]  # fmt: skip
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def seconds_of(function) -> float:
    """Processor seconds of a call."""
    began = process_time()
    function()
    return process_time() - began


def drawn(volume: Path, side: int, size: int):
    """Render a picture in this process; return its Rendering and the processor seconds of reading and of drawing."""
    found = read_volume(volume, shape=(side,) * 3, dtype="uint16")
    read = seconds_of(lambda: found.value_counts)  # reads every voxel
    function, _ = default_transfer_function(found)
    camera, matrix = turntable(found)
    with patch.object(pipeline, "Clock", lambda: Clock(process_time)):
        made = pipeline.render(Scene(found, function, camera, size, size, matrix), Quality(threads=1))
    return made, read, sum(made.report["stages_ms"][stage] for stage in DRAWING) / 1e3


def checked_seconds(tables: Path) -> float:
    """Processor seconds until the tables of a folder are opened and checked for a view along y."""
    return seconds_of(lambda: drain(read_encoded(tables).tables_steps(1)))


def cover_seconds(pixels: int) -> float:
    """Processor seconds for compositing two slabs of so many pixels."""
    slab = SectionImages((np.full((pixels, 4), 0.5, np.float32),), 1.0, frozenset(), {})
    return seconds_of(lambda: over(slab, slab))


def measured_rates(volume: Path, tables: Path, side: int, size: int) -> Rates:
    """The rates of one core, from pictures of volumes of two sizes and a cluster of one worker."""
    pixels = float(size * size)
    with tempfile.TemporaryDirectory() as folder:
        half = Path(folder, "half.raw")
        write_volume(half, side // 2)
        drawn(half, side // 2, size)  # loads kernels
        _, _, shallow = drawn(half, side // 2, size)
    made, read, deep = drawn(volume, side, size)
    stages, visible = made.report["stages_ms"], made.report["volume"]["visible_fraction"]
    sample = (deep - shallow) / (pixels * (side - side // 2))
    with tempfile.NamedTemporaryFile(suffix=".npy") as file:
        write = seconds_of(lambda: writer_for(file.name)(file.name, made.rgba, made.depth)) / pixels
    client, worker = loading_seconds()
    return Rates(
        read=2.0 * side**3 / read, prepare=sum(stages[stage] for stage in PREPARING) / 1e3 / side**3,
        sample=sample, pixel=max(deep / pixels - sample * side, 0.0), move=moving_rate(), write=write, client=client,
        worker=worker, visible=visible, cover=cover_seconds(size * size) / pixels,
        check=bytes_of(tables) / checked_seconds(tables),
    )  # fmt: skip


def loading_seconds() -> tuple[float, float]:
    """Processor seconds of the client, and of each worker, for a picture that takes next to nothing."""
    with tempfile.TemporaryDirectory() as folder:
        tiny = Path(folder, "tiny.raw")
        write_volume(tiny, 32)
        one, three = (command_seconds(tiny, 256, workers, *layout(32), "--tile", 64) for workers in (1, 3))
    worker = (three - one) / 2
    return one - worker, worker


def moving_rate() -> float:
    """Bytes per processor second that come from a worker to the client."""
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as local, Client(local) as client:
        taken = []
        for n in range(4):
            future = client.submit(np.full, (1024, 1024, 5), float(n), np.float32)
            there = client.submit(lambda made: made.nbytes and process_time(), future).result()
            here = seconds_of(future.result)
            taken.append(here + client.submit(process_time, pure=False).result() - there)
        return 1024 * 1024 * PIXEL / float(np.median(taken))


# --- tables -----------------------------------------------------------------------------------------------------------


def table(header, rows) -> str:
    """A Markdown table."""
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (header, ["---"] * len(header), *rows))


def rates_table(rates: Rates) -> str:
    """The measured rates."""
    return table(("rate of one core", "measured"), (
        ("reading the volume", f"{rates.read / 1e6:.0f} MB/s"),
        ("classifying, shading, encoding", f"{rates.prepare * 1e9:.1f} ns per voxel"),
        ("splatting, per pixel and slice", f"{rates.sample * 1e9:.2f} ns"),
        ("splatting and warping beside, per pixel", f"{rates.pixel * 1e9:.0f} ns"),
        ("pixels from worker to client", f"{rates.move / 1e6:.0f} MB/s"),
        ("writing an .npy, per pixel", f"{rates.write * 1e9:.1f} ns"),
        ("loading the client", f"{rates.client:.1f} s"),
        ("loading a worker", f"{rates.worker:.1f} s"),
        ("reading and checking tables", f"{rates.check / 1e6:.0f} MB/s"),
        ("compositing two slabs, per pixel", f"{rates.cover * 1e9:.1f} ns"),
        ("visible voxels", f"{100 * rates.visible:.1f} %"),
    ))  # fmt: skip


def print_check(rates: Rates, volume: Path, tables: Path, side: int, size: int) -> None:
    """Print the model against a local cluster of 1, 2 and 4 workers, in processor seconds, row by row."""
    whole, part = float(size) ** 2, float(size // 2) ** 2
    frames = "--frames", 1, FRAMES, "--turn", 3
    jobs = (
        (f"picture of {size} x {size}", (volume, size), layout(side), rates.drawing(side, whole),
         lambda workers: processor_seconds(rates, side, whole, workers)),
        (f"{FRAMES} frames of {size // 2} x {size // 2}", (volume, size // 2), (*layout(side), *frames),
         FRAMES * rates.drawing(side, part), lambda workers: processor_seconds(rates, side, part, workers, FRAMES)),
        (f"picture of {size} x {size} in {SLABS} slabs", (tables, size), ("--slabs", SLABS), rates.drawing(side, whole),
         lambda workers: slab_seconds(rates, bytes_of(tables), side, whole, workers, SLABS)),
    )  # fmt: skip
    print(table(("job", "workers", "measured", "model", "of it drawing"), ()), flush=True)
    for name, picture, words, drawing, model in jobs:
        for workers in (1, 2, 4):
            found, expected = command_seconds(*picture, workers, *words), model(workers)
            row = name, workers, f"{found:.1f} s", f"{expected:.1f} s", f"{100 * drawing / expected:.0f} %"
            print("| " + " | ".join(map(str, row)) + " |", flush=True)
    print()


def prediction_table(rates: Rates, side: int, size: int, nodes: int, cores: int) -> str:
    """A large volume on many nodes, by tiles and by slabs."""
    voxels, pixels = float(side) ** 3, float(size) ** 2
    held, tables = voxels * 2 + voxels * rates.visible * RECORD, voxels * rates.visible * TABLE_RECORD
    both = [model(rates, side, pixels, nodes, cores) for model in (by_tiles, by_slabs)]
    rows = [(name, *(f"{one[name]:.1f} s" for one in both)) for name in both[0]]
    rows.append(("sum", *(f"{sum(one.values()):.0f} s" for one in both)))
    after = ("draw", "composite", "deliver")
    rows.append(("each frame after", *(f"{sum(one[name] for name in after):.1f} s" for one in both)))
    rows.append(("memory of a node", f"{held / GIB:.0f} GiB", f"{tables / nodes / GIB:.1f} GiB"))
    return table((f"{side}^3 uint16 on {nodes} nodes of {cores} cores, {size} x {size}", "tiles", "slabs"), rows)


def main() -> None:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=256, help="voxels of the volume along each side")
    parser.add_argument("--size", type=int, default=2048, help="pixels of the picture along each side")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder, "shell.raw")
        write_volume(volume, args.side)
        tables = Path(folder, "shell.rle")
        write_tables(volume, args.side, tables)
        rates = measured_rates(volume, tables, args.side, args.size // 2)
        print(f"{os.cpu_count()} cores, {args.side}^3 uint16\n")
        print(rates_table(rates), end="\n\n", flush=True)
        print(prediction_table(rates, 4096, 4096, 64, 16), end="\n\n", flush=True)
        print_check(rates, volume, tables, args.side, args.size)


if __name__ == "__main__":
    main()
