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
from rle_splat.cli.images import write_npy
from rle_splat.pipeline import render as pipeline
from rle_splat.runtime.steps import Clock
from rle_splat.view.turntable import turntable

from .phantoms import smooth_shell

PREPARING = ("classify", "gradients", "shadows", "ambient occlusion", "shade", "encode", "plan")
DRAWING = ("splat", "warp", "rays", "setup", "occlusion", "clipping", "clip objects", "report")
PIXEL = 20  # bytes of a finished pixel: rgba and depth, float32
RECORD = 4  # bytes that the tables of scalars hold for each visible voxel: a uint16 and its light
FRAMES = 16
GIB = 1 << 30


@dataclass(frozen=True)
class Rates:
    """What one core of this machine does, in processor time.

    Attributes
    ----------
    read : float
        Bytes of a volume that are read, per second.
    prepare : float
        Seconds for classifying, shading and encoding, per voxel of the volume.
    sample, pixel : float
        Seconds for splatting, per pixel of the picture and slice of the volume, and for warping, per pixel.
    move : float
        Bytes that go from a worker to the client, per second of both together.
    write : float
        Seconds for writing, per pixel.
    client, worker : float
        Seconds until the client and a worker have loaded what they need, kernels from the disk among it.
    visible : float
        Share of the voxels that are visible.
    """

    read: float
    prepare: float
    sample: float
    pixel: float
    move: float
    write: float
    client: float
    worker: float
    visible: float

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
    """The same where every node has a slab of the volume, and pictures of slabs are composited in a binary tree."""
    own = float(side) ** 3 / nodes
    return {
        "read": own * 2 / rates.read,
        "prepare": own * rates.prepare / cores,
        "draw": rates.drawing(side / nodes, pixels) / cores,
        "composite": int(np.ceil(np.log2(nodes))) * pixels * PIXEL / rates.move,
        "deliver": rates.delivering(pixels),
    }


# --- measuring --------------------------------------------------------------------------------------------------------


def write_volume(path: Path, side: int) -> None:
    """A smooth shell as uint16."""
    (60000.0 * smooth_shell(side)).astype(np.uint16).tofile(path)


def command_seconds(volume: Path, side: int, size: int, workers: int, *words) -> float:
    """Processor seconds of ``rle-splat render --dask``, its workers among them."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable, "-m", "rle_splat", "render", volume, "--shape", *[side] * 3, "--dtype", "uint16",
            "--size", size, "-o", Path(folder, "a.npy"), "--no-progress", "--threads", 1, "--dask",
            "--workers", workers, *words,
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
    camera, matrix = turntable(found, width=size, height=size)
    with patch.object(pipeline, "Clock", lambda: Clock(process_time)):
        made = pipeline.render(Scene(found, function, camera, size, size, matrix), Quality(threads=1))
    return made, read, sum(made.report["stages_ms"][stage] for stage in DRAWING) / 1e3


def measured_rates(volume: Path, side: int, size: int) -> Rates:
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
        write = seconds_of(lambda: write_npy(file.name, made.rgba, made.depth)) / pixels
    client, worker = loading_seconds()
    return Rates(
        read=2.0 * side**3 / read, prepare=sum(stages[stage] for stage in PREPARING) / 1e3 / side**3,
        sample=sample, pixel=max(deep / pixels - sample * side, 0.0), move=moving_rate(), write=write, client=client,
        worker=worker, visible=visible,
    )  # fmt: skip


def loading_seconds() -> tuple[float, float]:
    """Processor seconds of the client, and of each worker, for a picture that takes next to nothing."""
    with tempfile.TemporaryDirectory() as folder:
        tiny = Path(folder, "tiny.raw")
        write_volume(tiny, 32)
        one, three = (command_seconds(tiny, 32, 256, workers, "--tile", 64) for workers in (1, 3))
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
        ("visible voxels", f"{100 * rates.visible:.1f} %"),
    ))  # fmt: skip


def print_check(rates: Rates, volume: Path, side: int, size: int) -> None:
    """Print the model against a local cluster of 1, 2 and 4 workers, in processor seconds, row by row."""
    print(table(("job", "workers", "measured", "model", "of it drawing"), ()), flush=True)
    for name, height, frames, words in (
        (f"picture of {size} x {size}", size, 1, ()),
        (f"{FRAMES} frames of {size // 2} x {size // 2}", size // 2, FRAMES, ("--frames", 1, FRAMES, "--turn", 3)),
    ):
        for workers in (1, 2, 4):
            found = command_seconds(volume, side, height, workers, *words)
            expected = processor_seconds(rates, side, height * height, workers, frames)
            share = frames * rates.drawing(side, height * height) / expected
            row = name, workers, f"{found:.1f} s", f"{expected:.1f} s", f"{100 * share:.0f} %"
            print("| " + " | ".join(map(str, row)) + " |", flush=True)
    print()


def prediction_table(rates: Rates, side: int, size: int, nodes: int, cores: int) -> str:
    """A large volume on many nodes, by tiles and by slabs."""
    voxels, pixels = float(side) ** 3, float(size) ** 2
    held = voxels * 2 + voxels * rates.visible * RECORD
    both = [model(rates, side, pixels, nodes, cores) for model in (by_tiles, by_slabs)]
    rows = [(name, *(f"{one[name]:.1f} s" for one in both)) for name in both[0]]
    rows.append(("sum", *(f"{sum(one.values()):.0f} s" for one in both)))
    after = ("draw", "composite", "deliver")
    rows.append(("each frame after", *(f"{sum(one[name] for name in after):.1f} s" for one in both)))
    rows.append(("memory of a node", f"{held / GIB:.0f} GiB", f"{held / nodes / GIB:.1f} GiB"))
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
        rates = measured_rates(volume, args.side, args.size // 2)
        print(f"{os.cpu_count()} cores, {args.side}^3 uint16\n")
        print(rates_table(rates), end="\n\n", flush=True)
        print(prediction_table(rates, 4096, 4096, 64, 16), end="\n\n", flush=True)
        print_check(rates, volume, args.side, args.size)


if __name__ == "__main__":
    main()
