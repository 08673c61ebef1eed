"""What a picture and an animation cost on a cluster: rates measured on one machine, a model of time and bytes made from
them, the model against a local Dask cluster, and its prediction for a large volume on many nodes.

Run it where dask and distributed are installed (the extra scale, ``requirements/scale.txt``):

    python -m benchmarks.cluster_costs

It prints the tables of docs/explanation/cluster-costs.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from .phantoms import smooth_shell

PREPARING = ("classify", "gradients", "shadows", "ambient occlusion", "shade", "encode", "plan")
DRAWING = ("splat", "warp", "rays", "setup", "occlusion", "clipping", "clip objects", "report")
PIXEL = 20  # bytes of a finished pixel: rgba and depth, float32
FRAMES = 16
GIB = 1 << 30


@dataclass(frozen=True)
class Rates:
    """What one core of this machine does.

    Attributes
    ----------
    read : float
        Bytes of a volume that are read, per second.
    prepare : float
        Seconds for classifying, shading and encoding, per voxel of the volume.
    voxel, pixel : float
        Seconds for splatting and warping, per visible voxel and per pixel of the picture.
    move : float
        Bytes that go from a worker to the client, per second.
    write : float
        Seconds for writing, per pixel.
    start : float
        Seconds until a worker is there.
    visible : float
        Share of the voxels that are visible.
    """

    read: float
    prepare: float
    voxel: float
    pixel: float
    move: float
    write: float
    start: float
    visible: float

    def preparing(self, voxels: float, voxel_bytes: int = 2) -> float:
        """Seconds until a worker of one core has the tables of so many voxels."""
        return voxels * voxel_bytes / self.read + voxels * self.prepare

    def drawing(self, voxels: float, pixels: float) -> float:
        """Seconds of one core for a picture, the tables at hand."""
        return voxels * self.visible * self.voxel + pixels * self.pixel

    def delivering(self, pixels: float) -> float:
        """Seconds of the client for receiving and writing a picture."""
        return pixels * (PIXEL / self.move + self.write)


def picture_seconds(rates: Rates, voxels: float, pixels: float, workers: int, cores: int) -> float:
    """The model of a picture in tiles: each worker reads and prepares the whole volume.

    ``cores``: of all machines together, one for each worker where there are enough.
    """
    crowd, busy = max(workers / cores, 1.0), min(workers, cores)
    drawing = rates.drawing(voxels, pixels) / busy
    return workers * rates.start / busy + rates.preparing(voxels) * crowd + drawing + rates.delivering(pixels)


def frames_seconds(rates: Rates, voxels: float, pixels: float, workers: int, cores: int, frames: int) -> float:
    """The model of an animation, one frame a task."""
    crowd, busy = max(workers / cores, 1.0), min(workers, cores)
    drawing = frames * rates.drawing(voxels, pixels) / busy
    return workers * rates.start / busy + rates.preparing(voxels) * crowd + drawing + rates.delivering(pixels)


def slabs_seconds(rates: Rates, voxels: float, pixels: float, nodes: int, cores: int) -> dict[str, float]:
    """The model of a picture whose slabs are on ``nodes`` of ``cores`` each, composited in a tree."""
    own = voxels / nodes
    rounds = int(np.ceil(np.log2(nodes)))
    return {
        "read": own * 2 / rates.read,  # the disk of a node serves one reader
        "prepare": own * rates.prepare / cores,
        "draw": rates.drawing(own, pixels) / cores,
        "composite": rounds * pixels * PIXEL / rates.move,
        "deliver": rates.delivering(pixels),
    }


# --- measuring --------------------------------------------------------------------------------------------------------


def write_volume(path: Path, side: int) -> None:
    """A smooth shell as uint16."""
    (60000.0 * smooth_shell(side)).astype(np.uint16).tofile(path)


def rendered(volume: Path, side: int, size: int, *words, frames: int = 0) -> tuple[float, dict]:
    """Run ``rle-splat render`` in a process of its own; returns its seconds and its report."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.json")
        series = ("--frames", 1, frames, "--turn", 3) if frames else ()
        command = [
            sys.executable, "-m", "rle_splat", "render", volume, "--shape", *[side] * 3, "--dtype", "uint16",
            "--size", size, "-o", Path(folder, "a.npy"), "--json", report, "--no-progress", *series, *words,
        ]  # fmt: skip
        began = perf_counter()
        subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
        return perf_counter() - began, json.loads(report.read_text())


def best(repeats: int, measure):
    """The quickest of some measurements, by their first value."""
    return min((measure() for _ in range(repeats)), key=lambda one: one[0])


def measured_rates(volume: Path, side: int, size: int, repeats: int) -> Rates:
    """The rates of one core, from two pictures of different sizes and a cluster of one worker."""
    reports = [
        best(repeats, lambda one=one: rendered(volume, side, one, "--threads", 1))[1] for one in (size, 2 * size)
    ]
    voxels = reports[0]["volume"]["visible_voxels"]
    drawing = [sum(report["stages_ms"][stage] for stage in DRAWING) / 1e3 for report in reports]
    pixels = [size * size, 4 * size * size]
    pixel = (drawing[1] - drawing[0]) / (pixels[1] - pixels[0])
    stages = reports[0]["stages_ms"]
    start, move = cluster_rates()
    return Rates(
        read=2.0 * side**3 / (stages["read"] / 1e3),
        prepare=sum(stages[stage] for stage in PREPARING) / 1e3 / side**3,
        voxel=max(drawing[0] - pixel * pixels[0], 0.0) / voxels,
        pixel=pixel, move=move, write=reports[1]["stages_ms"]["write"] / 1e3 / pixels[1], start=start,
        visible=voxels / side**3,
    )  # fmt: skip


def cluster_rates() -> tuple[float, float]:
    """Seconds until a worker process is there and has imported the renderer, and bytes per second from it."""
    from distributed import Client, LocalCluster

    def loaded():
        import rle_splat.pipeline.render  # noqa: F401

    began = perf_counter()
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as local, Client(local) as client:
        client.submit(loaded).result()
        start = perf_counter() - began
        taken = []
        for n in range(3):
            future = client.submit(np.full, (1024, 1024, 5), float(n), np.float32)
            client.submit(lambda made: made.nbytes, future).result()
            began = perf_counter()
            future.result()
            taken.append(perf_counter() - began)
        return start, 1024 * 1024 * PIXEL / min(taken)


# --- tables -----------------------------------------------------------------------------------------------------------


def table(header, rows) -> str:
    """A Markdown table."""
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in (header, ["---"] * len(header), *rows))


def rates_table(rates: Rates) -> str:
    """The measured rates."""
    return table(("rate of one core", "measured"), (
        ("reading the volume", f"{rates.read / 1e6:.0f} MB/s"),
        ("classifying, shading, encoding", f"{rates.prepare * 1e9:.1f} ns per voxel"),
        ("splatting, per visible voxel", f"{rates.voxel * 1e9:.1f} ns"),
        ("splatting and warping, per pixel", f"{rates.pixel * 1e9:.0f} ns"),
        ("pixels from worker to client", f"{rates.move / 1e6:.0f} MB/s"),
        ("writing an .npy, per pixel", f"{rates.write * 1e9:.1f} ns"),
        ("starting a worker", f"{rates.start:.1f} s"),
        ("visible voxels", f"{100 * rates.visible:.1f} %"),
    ))  # fmt: skip


def checked_table(rates: Rates, volume: Path, side: int, size: int, repeats: int) -> str:
    """The model against a local cluster of 1, 2 and 4 workers."""
    cores, rows = os.cpu_count() or 1, []
    for workers in (1, 2, 4):
        words = "--dask", "--workers", workers, "--threads", 1
        found = best(repeats, lambda words=words: rendered(volume, side, size, *words))[0]
        expected = picture_seconds(rates, side**3, size * size, workers, cores)
        rows.append((f"picture of {size} x {size}", workers, f"{found:.1f} s", f"{expected:.1f} s"))
    for workers in (1, 2, 4):
        words = "--dask", "--workers", workers, "--threads", 1
        found = best(repeats, lambda words=words: rendered(volume, side, size // 2, *words, frames=FRAMES))[0]
        expected = frames_seconds(rates, side**3, size * size / 4, workers, cores, FRAMES)
        rows.append((f"{FRAMES} frames of {size // 2} x {size // 2}", workers, f"{found:.1f} s", f"{expected:.1f} s"))
    return table(("job", "workers", "measured", "model"), rows)


def prediction_table(rates: Rates, side: int, size: int, nodes: int, cores: int) -> str:
    """A large volume on many nodes, by tiles and by slabs."""
    voxels, pixels = float(side) ** 3, float(size) ** 2
    held = voxels * 2 + voxels * rates.visible * 16
    tiles = {
        "read": voxels * 2 / rates.read, "prepare": voxels * rates.prepare / cores,
        "draw": rates.drawing(voxels, pixels) / (nodes * cores), "composite": 0.0, "deliver": rates.delivering(pixels),
    }  # fmt: skip
    slabs = slabs_seconds(rates, voxels, pixels, nodes, cores)
    rows = [(name, f"{tiles[name]:.1f} s", f"{slabs[name]:.1f} s") for name in tiles]
    rows.append(("sum", f"{sum(tiles.values()):.0f} s", f"{sum(slabs.values()):.0f} s"))
    rows.append(("each frame after", *(
        f"{one['draw'] + one['composite'] + one['deliver']:.1f} s" for one in (tiles, slabs)
    )))  # fmt: skip
    rows.append(("memory of a node", f"{held / GIB:.0f} GiB", f"{held / nodes / GIB:.1f} GiB"))
    return table((f"{side}^3 uint16 on {nodes} nodes of {cores} cores, {size} x {size}", "tiles", "slabs"), rows)


def main() -> None:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=256, help="voxels of the volume along each side")
    parser.add_argument("--size", type=int, default=2048, help="pixels of the picture along each side")
    parser.add_argument("--repeats", type=int, default=2, help="of each measurement, of which the quickest counts")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        volume = Path(folder, "shell.raw")
        write_volume(volume, args.side)
        rates = measured_rates(volume, args.side, args.size // 2, args.repeats)
        print(f"{os.cpu_count()} cores, {args.side}^3 uint16\n")
        print(rates_table(rates), end="\n\n", flush=True)
        print(checked_table(rates, volume, args.side, args.size, args.repeats), end="\n\n", flush=True)
    print(prediction_table(rates, 4096, 4096, 64, 16))


if __name__ == "__main__":
    main()
