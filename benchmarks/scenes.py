"""The volumes of the benchmarks: synthetic ones, and real scans if they are present."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from rle_splat.classify.presets import fit_preset
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.read.formats import read_volume
from rle_splat.volume.volume import Volume

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[1] / ".." / "shared" / "data")
# Name -> (file, options of read_volume, preset).
REAL = {
    "CT head": ("cthead_256x256x113_uint16be.raw.gz", dict(spacing=(1.0, 1.0, 2.0)), "ct-bone"),
    "CT lobster": ("lobster_301x324x56_uint8.raw.gz", dict(spacing=(1.0, 1.0, 1.4)), "ct-specimen"),
    "MRI head": ("mrbrain_256x256x99_uint8.raw.gz", dict(spacing=(1.0, 1.0, 2.0)), "mr-head"),
    "CT engine": ("engine_256x256x110_uint8.raw.gz", {}, "ct-industrial"),
    "X-ray foot": ("foot_256x256x256_uint8_fromjpeg.raw.gz", {}, "xa-limb"),
    "CT bonsai": ("bonsai_256x256x256_uint8.raw.gz", {}, "ct-botanical"),
}


def shells(n: int = 256) -> tuple[Volume, TransferFunction]:
    """Concentric shells of a radial field, 8 bit, ``n`` voxels along each side; about a tenth of them are visible."""
    axis = np.linspace(-1.0, 1.0, n, dtype=np.float32)
    voxels = np.empty((n, n, n), np.uint8)
    for z, depth in enumerate(axis):
        radius = np.sqrt(axis[None, :] ** 2 + axis[:, None] ** 2 + depth**2)
        voxels[z] = np.clip(255.0 * (1.0 - radius), 0.0, 255.0)
    opacity = [(0.0, 0.0)]
    for center, alpha in ((40.0, 0.04), (110.0, 0.1), (180.0, 0.6)):
        opacity += [(center - 4.0, 0.0), (center, alpha), (center + 4.0, 0.0)]
    color = [(40.0, 0.8, 0.4, 0.3), (110.0, 0.3, 0.6, 0.9), (180.0, 1.0, 0.9, 0.6)]
    return Volume(voxels, np.eye(4), name="shells"), TransferFunction("shells", None, opacity, color, None, Shade())


def scenes(names=None):
    """Yield name, volume and transfer function of the shells and of the scans that are present, or of those named."""
    if not names or "shells" in names:
        yield "shells", *shells()
    for name, (file, options, preset) in REAL.items():
        if (DATA / file).exists() and (not names or name in names):
            volume = read_volume(DATA / file, **options)
            yield name, volume, fit_preset(preset, volume)[0]


def smoke(shape_xyz=(144, 144, 224), seed: int = 8) -> Volume:
    """A synthetic plume of smoke with float32 densities from 0 to 1, without scanner noise."""
    nx, ny, nz = shape_xyz
    z, y, x = (np.linspace(-1.0, 1.0, n, dtype=np.float32) for n in (nz, ny, nx))
    height = 0.5 * (z + 1.0)[:, None, None]
    random = np.random.default_rng(seed)
    fine = _billows((nz, ny, nx), random, cells=(10, 6, 6), octaves=4)
    bend_x, bend_y = (0.22 * height * np.sin(4.0 * height + phase) for phase in (0.4, 2.1))
    radius = np.hypot(x[None, None, :] - bend_x, y[None, :, None] - bend_y)
    width = 0.1 + 0.5 * height**0.8
    column = 1.0 - radius / width + 1.3 * fine * np.sqrt(height + 0.03)
    ends = np.clip(12.0 * height, 0.0, 1.0) * np.clip(5.0 * (1.0 - height), 0.0, 1.0)
    density = np.clip(0.75 * column * ends, 0.0, None) * (1.1 - 0.6 * height)
    return Volume(np.clip(density, 0.0, 1.0).astype(np.float32), np.eye(4), name="smoke")


def _billows(shape_zyx, random, cells, octaves: int) -> np.ndarray:
    """(nz, ny, nx) float32 value noise around zero: each octave is twice as fine and half as strong."""
    total = np.zeros(shape_zyx, np.float32)
    for octave in range(octaves):
        field = random.uniform(-1.0, 1.0, [n * 2**octave + 2 for n in cells]).astype(np.float32)
        for axis, count in enumerate(shape_zyx):
            at = np.linspace(0.0, cells[axis] * 2**octave, count, endpoint=False, dtype=np.float32)
            whole = at.astype(int)
            part = at - whole
            part = (part * part * (3.0 - 2.0 * part)).reshape([-1 if a == axis else 1 for a in range(3)])
            field = np.take(field, whole, axis) * (1.0 - part) + np.take(field, whole + 1, axis) * part
        total += field * 0.5**octave
    return total
