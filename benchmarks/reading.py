"""Seconds and memory from a scan's files to the first picture, beside the libraries by which it is read.

Each time is that of a whole process, the best of several in turns; kernels and compiled Python are on disk.  The scan
is written first: a synthetic head with noise, as DICOM files, one for each slice and not compressed, and as a .nii.gz.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from .run import Run, make_parser

SHAPE, SPACING = (230, 512, 512), (0.45, 0.45, 1.0)  # z, y, x; mm along x, y, z
NOISE = 12.0  # HU, the standard deviation
LIMITS = {"picture": 1.5, "peak": 1.2}  # times the libraries' seconds; times the bytes of the voxels
# Of the process itself: getrusage counts the parent before the process was started, too.  Linux alone tells.
PEAK = """
import json
from pathlib import Path
def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
before = peak()
"""
AFTER = "print(json.dumps({'bytes': peak() - before}))"
# What the libraries take alone: every file read and decoded into one array, or one stream inflated into one.
ALONE = {
    "DICOM": f"""
import sys
from pathlib import Path
import numpy as np
from pydicom import dcmread
{PEAK}
files = sorted(Path(sys.argv[1]).iterdir())
voxels = np.empty({SHAPE}, np.int16)
for plane, file in zip(voxels, files):
    plane[...] = dcmread(file).pixel_array
{AFTER}
""",
    ".nii.gz": f"""
import sys, zlib
import numpy as np
{PEAK}
left = memoryview(np.empty({SHAPE}, np.int16)).cast("B")
inflate, skip = zlib.decompressobj(31), 352
with open(sys.argv[1], "rb") as file:
    while piece := file.read(1 << 20):
        data = inflate.decompress(piece)
        data, skip = data[skip:], max(skip - len(data), 0)
        left[: len(data)] = data
        left = left[len(data) :]
{AFTER}
""",
}
OURS = f"""
import sys
import numpy as np
from .run import Run, make_parser
from rle_splat.read.formats import read_volume
{PEAK}
read_volume(sys.argv[1])
{AFTER}
"""


def write_scan(folder: Path) -> dict[str, Path]:
    """Write the scan in both formats; return the path of each."""
    import nibabel

    from devtools.phantom import head_phantom
    from tests.read import dicom_phantoms

    head = head_phantom(1.0)
    at = [np.linspace(0, count - 1, wanted).astype(int) for count, wanted in zip(head.shape, SHAPE, strict=True)]
    noise = np.random.default_rng(0).normal(0.0, NOISE, SHAPE)
    voxels = np.rint(head[np.ix_(*at)] + noise).clip(-1024, 3071).astype(np.int16)
    dicom = folder / "dicom"
    where = dicom_phantoms.geometry("scan", (1, 0, 0), (0, 1, 0), SPACING[2] * np.arange(SHAPE[0]), SPACING[:2])
    # In the order of the slices, so that the library alone need not sort them.
    for number, path in enumerate(sorted(dicom_phantoms.write_classic(dicom, where))):
        dataset = dicom_phantoms.read(path)
        dataset.ImagePositionPatient = [f"{value:.6f}" for value in where.positions[number]]
        dataset.Rows, dataset.Columns = SHAPE[1:]
        dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 16, 15, 1
        dataset.RescaleSlope, dataset.RescaleIntercept = 1, 0
        dataset.PixelData = voxels[number].tobytes()
        dicom_phantoms.save(dataset, path)
    nifti = folder / "scan.nii.gz"
    affine = np.diag((-SPACING[0], -SPACING[1], SPACING[2], 1.0))
    nibabel.save(nibabel.Nifti1Image(voxels.transpose(2, 1, 0), affine), nifti)
    return {"DICOM": dicom, ".nii.gz": nifti}


def run(*command) -> tuple[float, dict]:
    """Seconds of a process, and what it says in its last line."""
    environ = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    words = [sys.executable, *map(str, command)]
    began = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=environ)
    seconds = time.perf_counter() - began
    lines = done.stdout.strip().splitlines()
    return seconds, json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {}


def measure(paths: dict[str, Path], repeats: int, folder: Path) -> list[dict]:
    """One JSON-ready row for each format."""
    rows = []
    voxel_bytes = 2 * int(np.prod(SHAPE))
    for name, path in paths.items():
        best = {}
        for _ in range(repeats):
            commands = {
                "alone": ("-c", ALONE[name], path), "read": ("-c", OURS, path),
                "picture": ("-m", "rle_splat", "render", path, "-o", folder / "first.png"),
            }  # fmt: skip
            for what, command in commands.items():
                seconds, told = run(*command)
                best[what] = min(best.get(what, (seconds, told)), (seconds, told), key=lambda one: one[0])
        rows.append({
            "format": name, "alone_s": best["alone"][0], "read_s": best["read"][0], "picture_s": best["picture"][0],
            "alone_peak": best["alone"][1]["bytes"] / voxel_bytes, "read_peak": best["read"][1]["bytes"] / voxel_bytes,
            "picture_ratio": best["picture"][0] / best["alone"][0],
        })  # fmt: skip
    return rows


def table(rows: list[dict]) -> str:
    """For people, in Markdown."""
    lines = [
        "| format | library alone, s | read, s | first picture, s | picture / library | peak of reading / voxels |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row['format']} | {row['alone_s']:.2f} | {row['read_s']:.2f} | {row['picture_s']:.2f} | "
            f"{row['picture_ratio']:.2f} (at most {LIMITS['picture']:g}) | {row['read_peak']:.2f} |"
        )
    return "\n".join(lines)


def main(arguments) -> int:
    known = make_parser("dev.py bench reading", __doc__.splitlines()[0], repeats=4).parse_args(arguments)
    run = Run("reading", arguments)
    with tempfile.TemporaryDirectory() as folder:
        run.rows = measure(write_scan(Path(folder)), known.repeats, Path(folder))
    print(table(run.rows))
    run.keep()
    return 0
