"""A picture on a local Dask cluster of 1, 2 and 4 workers, in tiles and in slabs: how far it is from the picture of one
process, and how much sooner it is there.

Run it where dask and distributed are installed (``requirements/cluster.txt``):

    python -m benchmarks.cluster_speed

The volume is a haze that no ray ends in, so that drawing takes longest.  The clusters are there, and have drawn the
picture once, before they are timed.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from rle_splat.cli.main import main as rle_splat

from .cluster_costs import SLABS, layout, table

HAZE = {
    "name": "Haze", "unit": None, "opacity": [[0, 0.0], [20000, 0.004], [60000, 0.02]],
    "color": [[0, 0.9, 0.5, 0.3], [60000, 0.5, 0.7, 1.0]],
    "shade": {"ambient": 0.4, "diffuse": 0.6, "specular": 0.0, "shininess": 10.0},
}  # fmt: skip


def write_haze(path: Path, side: int) -> None:
    """Waves as raw uint16, few of whose voxels are transparent."""
    turns = np.arange(side, dtype=np.float32) * np.float32(40.0 / side)
    waves = np.sin(turns) + np.sin(1.3 * turns)[:, None] + np.sin(0.7 * turns)[:, None, None]
    (30000.0 + 9000.0 * waves).astype(np.uint16).tofile(path)


def run(*words) -> float:
    """Seconds of a command."""
    began = perf_counter()
    if rle_splat([str(word) for word in words]):
        raise SystemExit("The command failed.")
    return perf_counter() - began


def main() -> None:
    """Measure, and print the table."""
    from distributed import LocalCluster

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--side", type=int, default=256, help="voxels of the volume along each side")
    parser.add_argument("--size", type=int, default=3072, help="pixels of the picture along each side")
    args = parser.parse_args()
    rows, first = [], {}
    with tempfile.TemporaryDirectory() as folder:
        raw, tables, function = (Path(folder, name) for name in ("haze.raw", "haze.rle", "haze.json"))
        write_haze(raw, args.side)
        function.write_text(json.dumps(HAZE), encoding="utf-8")
        run("encode", raw, *layout(args.side), "-o", tables, "--folder", "--classification", "post",
            "--transfer-function", function)  # fmt: skip
        whole, made = Path(folder, "whole.npy"), Path(folder, "made.npy")
        view = tables, "--size", args.size, "--termination", 0, "--threads", 1, "--no-progress", "-o"
        alone = min(run("render", *view, whole) for _ in range(2))
        picture = np.load(whole)
        for workers in (1, 2, 4):
            with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=":0", memory_limit=0) as local:
                for name, words in (("tiles", ()), (f"{SLABS} slabs", ("--slabs", SLABS))):
                    words = "render", *view, made, "--dask", local.scheduler_address, *words
                    seconds = min(run(*words) for _ in range(3))
                    first.setdefault(name, seconds)
                    off = float(np.abs(np.load(made) - picture).max())
                    rows.append((name, workers, f"{off:.1e}", f"{seconds:.2f} s", f"{alone / seconds:.2f}",
                                 f"{100 * first[name] / (workers * seconds):.0f} %"))  # fmt: skip
                    print(rows[-1], flush=True)
    print(f"\n{os.cpu_count()} cores; one process with one thread takes {alone:.2f} s\n")
    print(table(("parts", "workers", "largest difference", "time", "times as fast", "efficiency"), sorted(rows)))


if __name__ == "__main__":
    main()
