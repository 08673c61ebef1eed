"""The six data sets of the paper's tables: the printed figures, the most similar file, and a stand-in.

A missing scan is replaced by a synthetic volume with the same dimensions and the same fraction of kept voxels under the
same transfer function.  It is called a stand-in wherever it appears.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from rle_splat.classify.transfer_function import TransferFunction
from rle_splat.read.formats import read_volume
from rle_splat.volume.volume import Volume

from .scenes import DATA

TRANSFER_FUNCTIONS = Path(__file__).parent / "transfer_functions"
STAND_IN = "(stand-in)"


@dataclass(frozen=True)
class DataSet:
    """One row of the paper's tables and the data that we measure for it."""

    name: str  # this and what follows as printed in the paper; sizes of the volume and of the tables in MB
    resolution: str
    paper_volume_mb: float
    paper_mb: float
    paper_seconds: tuple[float, float]  # without and with run-length encoding
    paper_speedup: float
    file: str  # ours, from here on
    shape_xyz: tuple[int, int, int]
    spacing: tuple[float, float, float]  # along x, y and z
    transfer: str  # name of its transfer function in benchmarks/transfer_functions
    kept: float  # fraction of the scan's voxels that the transfer function keeps; the stand-in has the same
    caveat: str = ""  # how our scan differs from the paper's

    @property
    def path(self) -> Path:
        return DATA / self.file

    def transfer_function(self) -> TransferFunction:
        return TransferFunction.from_json(TRANSFER_FUNCTIONS / f"{self.transfer}.json")

    def load(self) -> tuple[str, Volume, TransferFunction]:
        """(name, volume, transfer function); the volume is the scan, or its stand-in if the scan is missing."""
        function = self.transfer_function()
        if not self.path.exists():
            return f"{self.name} {STAND_IN}", stand_in(self.shape_xyz, self.spacing, self.kept, function), function
        return self.name, read_volume(self.path, spacing=self.spacing), function


PAPER = (
    DataSet(
        "CT head", "128x128x128", 1.9, 5.1, (7.38, 0.41), 18.0, "cthead_128x128x113_uint8_derived.raw.gz",
        (128, 128, 113), (2.0, 2.0, 2.0), "ct-head", 0.061, "128x128x113, made from a 256x256x113 scan",
    ),
    DataSet(
        "CT lobster", "320x320x34", 3.32, 12.4, (12.21, 1.13), 10.8, "lobster_301x324x56_uint8.raw.gz",
        (301, 324, 56), (1.0, 1.0, 1.4), "ct-lobster", 0.069, "the same scan at 301x324x56",
    ),
    DataSet(
        "MRI head", "256x256x109", 6.8, 38.7, (22.48, 2.3), 9.8, "mrbrain_256x256x99_uint8.raw.gz",
        (256, 256, 99), (1.0, 1.0, 2.0), "mri-head", 0.127, "slices 1 to 99 of 109",
    ),
    DataSet(
        "CT engine", "256x256x110", 6.9, 39.1, (24.31, 2.67), 9.1, "engine_256x256x110_uint8.raw.gz",
        (256, 256, 110), (1.0, 1.0, 1.0), "ct-engine", 0.14,
    ),
    DataSet(
        "X-ray foot", "256x256x256", 16.0, 55.2, (53.88, 2.03), 26.5, "foot_256x256x256_uint8_fromjpeg.raw.gz",
        (256, 256, 256), (1.0, 1.0, 1.0), "xray-foot", 0.075, "decoded from JPEG: noise of a few gray levels",
    ),
    DataSet(
        "CT bonsai", "256x256x256", 16.0, 60.1, (55.04, 2.43), 22.7, "bonsai_256x256x256_uint8.raw.gz",
        (256, 256, 256), (1.0, 1.0, 1.0), "ct-bonsai", 0.088,
    ),
)  # fmt: skip


def stand_in(shape_xyz, spacing, kept: float, function: TransferFunction) -> Volume:
    """A synthetic volume, uint8, of folded shells, whose runs are a few to a few dozen voxels long as in scans.

    ``function`` keeps the fraction ``kept`` of its voxels.
    """
    nx, ny, nz = shape_xyz
    z, y, x = (np.linspace(-1.0, 1.0, n, dtype=np.float32) for n in (nz, ny, nx))
    density = np.empty((nz, ny, nx), np.float32)
    for k, depth in enumerate(z):
        across, along = y[:, None], x[None, :]
        radius = np.sqrt((along / 0.8) ** 2 + (across / 0.9) ** 2 + (depth / 0.85) ** 2)
        folds = np.sin(9.0 * along + 3.0 * depth) * np.sin(8.0 * across) * np.cos(7.0 * depth)
        density[k] = np.cos(14.0 * radius) + 0.8 * folds - 1.6 * np.maximum(radius - 0.75, 0.0) / 0.25
    edge = np.quantile(density[::2, ::2, ::2], 1.0 - kept)
    low = next(value for (value, _), (_, alpha) in pairwise(function.opacity) if alpha > 0.0)  # opacity begins
    inside = (density - edge) / max(float(density.max()) - edge, 1e-6)
    outside = (density - edge) / max(edge - float(density.min()), 1e-6)
    # Rounding must not move a value across the one where opacity begins.
    values = np.where(inside > 0.0, np.floor(low) + 1.0 + inside * (254.0 - low), np.floor(low * (1.0 + outside)))
    affine = np.diag((*spacing, 1.0))
    return Volume(np.clip(values, 0.0, 255.0).astype(np.uint8), affine, name="stand-in")
