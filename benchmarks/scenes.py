"""Volumes to measure on: the real ones where they are at hand, a synthetic one everywhere."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from rle_splat.classify.presets import fit_preset
from rle_splat.classify.transfer_function import Shade, TransferFunction
from rle_splat.read.formats import read_volume
from rle_splat.volume.volume import Volume

DATA = Path(os.environ.get("RLE_SPLAT_DATA") or Path(__file__).resolve().parents[1] / ".." / "shared" / "data")
# File, preset, azimuth and elevation that show it.
REAL = {
    "CT head": ("cthead_256x256x113_uint16be.raw.gz", dict(spacing=(1.0, 1.0, 2.0)), "ct-bone"),
    "CT lobster": ("lobster_301x324x56_uint8.raw.gz", dict(spacing=(1.0, 1.0, 1.4)), "ct-specimen"),
    "MRI head": ("mrbrain_256x256x99_uint8.raw.gz", dict(spacing=(1.0, 1.0, 2.0)), "mr-head"),
    "CT engine": ("engine_256x256x110_uint8.raw.gz", {}, "ct-industrial"),
    "X-ray foot": ("foot_256x256x256_uint8_fromjpeg.raw.gz", {}, "xa-limb"),
    "CT bonsai": ("bonsai_256x256x256_uint8.raw.gz", {}, "ct-plant"),
}


def shells(n: int = 256) -> tuple[Volume, TransferFunction]:
    """Concentric shells of a radial field, 8 bit: about a tenth of the voxels is visible."""
    axis = np.linspace(-1.0, 1.0, n, dtype=np.float32)
    voxels = np.empty((n, n, n), np.uint8)
    for z, depth in enumerate(axis):
        radius = np.sqrt(axis[None, :] ** 2 + axis[:, None] ** 2 + depth**2)
        voxels[z] = np.clip(255.0 * (1.0 - radius), 0.0, 255.0)
    opacity = [(0.0, 0.0)]
    for centre, alpha in ((40.0, 0.04), (110.0, 0.1), (180.0, 0.6)):
        opacity += [(centre - 4.0, 0.0), (centre, alpha), (centre + 4.0, 0.0)]
    color = [(40.0, 0.8, 0.4, 0.3), (110.0, 0.3, 0.6, 0.9), (180.0, 1.0, 0.9, 0.6)]
    return Volume(voxels, np.eye(4), name="shells"), TransferFunction("shells", None, opacity, color, None, Shade())


def scenes(names=None):
    """Yields name, volume and transfer function; the real volumes only where their folder is.

    ``names``: only these, all when None or empty.
    """
    if not names or "shells" in names:
        yield "shells", *shells()
    for name, (file, options, preset) in REAL.items():
        if (DATA / file).exists() and (not names or name in names):
            volume = read_volume(DATA / file, **options)
            yield name, volume, fit_preset(preset, volume)[0]
