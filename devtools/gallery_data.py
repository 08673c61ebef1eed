"""What the gallery shows: scans where the data folder has them, else volumes made of numbers.

Each function takes a folder that it may write to and returns (file, properties of rle_splat.import_volume, where it is
from).  Runs in an environment with numpy.
"""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("RLE_SPLAT_DATA") or ROOT.parent / "shared" / "data")
MADE = "made of numbers"


def _scan(name: str) -> Path | None:
    path = DATA / name
    return path if path.is_file() else None


def _raw(folder: Path, name: str, voxels: np.ndarray, spacing, **options) -> tuple[Path, dict]:
    """(nz, ny, nx) voxels as a bare file, and what it takes to import it."""
    path = folder / f"{name}.raw"
    path.write_bytes(np.ascontiguousarray(voxels).tobytes())
    return path, {"shape": voxels.shape[::-1], "dtype": voxels.dtype.name, "byte_order": "little",
                  "header_bytes": 0, "spacing": spacing, **options}  # fmt: skip


def head(folder: Path):
    """A CT head in Hounsfield units; ``upside down`` tells whether its z runs from the crown down."""
    path = _scan("cthead_256x256x113_uint16be.raw.gz")
    if path is not None:
        options = {"spacing": (1.0, 1.0, 2.0), "use_calibration": True, "intercept": -1024.0, "value_unit": "HU",
                   "modality": "CT", "preset": "ct-bone"}  # fmt: skip
        return path, options, path.name
    from phantom import SPACING_MM, head_phantom

    return *_raw(folder, "head", head_phantom(), (SPACING_MM,) * 3, modality="CT", value_unit="HU",
                 preset="ct-bone"), MADE  # fmt: skip


def chest(folder: Path):
    """A chest with contrast in its vessels, 8 bit: soft tissue from 20, blood from 60, bone from 150; z upwards, y to
    the back."""
    path = _scan("ct_chest_256x256x133_uint8.mha")
    if path is None:
        return *_raw(folder, "chest", _made_chest(), (2.5, 2.5, 2.5), modality="CT", preset="x-ray"), MADE
    header, _, data = path.read_bytes().partition(b"ElementDataFile = LOCAL\n")
    facts = dict(line.split(" = ", 1) for line in header.decode("ascii").splitlines())
    voxels = np.frombuffer(zlib.decompress(data), np.uint8)
    voxels = voxels.reshape([int(n) for n in reversed(facts["DimSize"].split())])
    spacing = tuple(round(float(s), 5) for s in facts["ElementSpacing"].split())
    upright = voxels[::-1, ::-1]  # its slices run from the head down, its rows from the back
    return *_raw(folder, "chest", upright, spacing, modality="CT", preset="x-ray"), path.name


LUNGS, HEART, BONE = 1, 2, 3  # labels of a chest's organs; 0 for all else


def organs(folder: Path, chest_file: Path, shape_xyz) -> Path:
    """A file of the labels of a chest as ``chest`` gives it: by its values and by what is around them."""
    voxels = np.fromfile(chest_file, np.uint8).reshape(tuple(reversed(shape_xyz)))
    body, air_or_lung = voxels > 12, np.ones(voxels.shape, bool)
    for axis in (1, 2):  # what has the body on either side of it, across and from front to back
        before = np.maximum.accumulate(body, axis)
        air_or_lung &= before & np.flip(np.maximum.accumulate(np.flip(body, axis), axis), axis)
    labels = np.zeros(voxels.shape, np.uint8)
    bone = voxels > 150
    # Vessels in the lungs have air around them and are far from ribs; marrow has bone around it, blood has not.
    labels[(_share(air_or_lung & ~body, 5) > 0.65) & (_share(bone, 7) < 0.004)] = LUNGS
    blood = (voxels > 55) & (voxels < 160)
    labels[blood & (_share(blood, 4) > 0.6) & (_share(bone, 4) < 0.02)] = HEART
    far_from_blood = _share(labels == HEART, 6) < 0.1  # dense contrast in a vein is as bright as bone
    labels[(_share(bone, 5) > 0.01) & far_from_blood & (labels != HEART)] = BONE
    path = folder / "organs.raw"
    path.write_bytes(labels.tobytes())
    return path


def _share(mask, reach: int) -> np.ndarray:
    """What share of the voxels up to ``reach`` away along each axis is in a mask, float32."""
    share = mask.astype(np.float32)
    for axis in range(3):
        padded = np.pad(share, [(reach + 1, reach) if a == axis else (0, 0) for a in range(3)], mode="edge")
        total = np.cumsum(padded, axis, dtype=np.float32)
        high = np.take(total, range(2 * reach + 1, total.shape[axis]), axis)
        low = np.take(total, range(total.shape[axis] - 2 * reach - 1), axis)
        share = (high - low) / (2 * reach + 1)
    return share


def brain(folder: Path):
    """A brain by magnetic resonance."""
    path = _scan("flair_brain_124x160x140_uint8.nrrd")
    if path is None:
        return *_raw(folder, "brain", _made_brain(), (1.2, 1.2, 1.2), modality="MR", preset="mr-brain"), MADE
    header, _, data = path.read_bytes().partition(b"\n\n")
    sizes = next(line for line in header.decode("ascii").splitlines() if line.startswith("sizes:"))
    shape = [int(n) for n in reversed(sizes.split()[1:])]
    voxels = np.frombuffer(zlib.decompress(data, 16 + zlib.MAX_WBITS), np.uint8).reshape(shape)
    return *_raw(folder, "brain", voxels, (1.0, 1.0, 1.0), modality="MR", preset="mr-brain"), path.name


def smoke(folder: Path):
    """Smoke whose y axis points up, as simulations have it."""
    path = _scan("smoke_fog.vdb")
    if path is not None:
        return path, {}, path.name
    import sys

    sys.path.append(str(ROOT))
    from benchmarks.scenes import smoke as plume

    voxels = plume((72, 72, 112)).voxels.transpose(1, 0, 2)[::-1]  # z up to y up
    return *_raw(folder, "smoke", voxels, (4.0, 4.0, 4.0), modality="SMOKE", preset="smoke"), MADE


# --- stand-ins ----------------------------------------------------------------------------------------------------


def _grid(shape_zyx):
    return np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape_zyx), indexing="ij")


def _cover(distance, voxels: float):
    """How much of a voxel is inside, from a signed distance in sides of the volume's half."""
    return np.clip(0.5 + distance * voxels, 0.0, 1.0)


def _made_chest(shape_zyx=(96, 112, 128)) -> np.ndarray:
    """A trunk with ribs, spine, lungs, heart and aorta, as the scan's 8 bits have them."""
    z, y, x = _grid(shape_zyx)
    half = 0.5 * shape_zyx[2]
    values = np.zeros(shape_zyx)

    def paint(inside, value):
        cover = _cover(inside, half)
        values[...] += (value - values) * cover

    around = np.hypot(x / 0.92, y / 0.68)
    paint(0.6 * (1.0 - around), 26.0)
    for side in (-1.0, 1.0):
        paint(0.3 * (1.0 - np.sqrt(((x - 0.42 * side) / 0.36) ** 2 + (y / 0.48) ** 2 + (z / 0.85) ** 2)), 2.0)
    ribs = np.minimum(0.025 - np.abs(around - 0.86) * 0.6, 0.035 - np.abs(((z + 0.25 * y) * 4.0) % 1.0 - 0.5) / 4.0)
    paint(np.minimum(ribs, 0.9 - np.abs(z)), 190.0)
    paint(0.13 - np.hypot(x, y - 0.42), 170.0)
    paint(0.25 * (1.0 - np.sqrt(((x - 0.1) / 0.3) ** 2 + ((y + 0.2) / 0.26) ** 2 + ((z + 0.25) / 0.36) ** 2)), 90.0)
    arch = np.hypot(np.hypot(y - 0.08, z - 0.25) - 0.26, x + 0.04)
    paint(np.minimum(0.07 - arch, z - 0.2), 120.0)
    paint(np.minimum(0.07 - np.hypot(x + 0.04, y - 0.34), 0.25 - z), 120.0)
    return np.rint(values).astype(np.uint8)


def _made_brain(shape_zyx=(110, 128, 104)) -> np.ndarray:
    """Two halves, folded, with a lighter inside."""
    z, y, x = _grid(shape_zyx)
    radius = np.sqrt((x / 0.8) ** 2 + (y / 0.92) ** 2 + (z / 0.72) ** 2)
    folds = np.sin(17.0 * x + 5.0 * np.sin(7.0 * z)) * np.sin(15.0 * y + 4.0 * np.sin(9.0 * x)) * np.sin(16.0 * z)
    outside = 0.95 + 0.05 * folds - radius - 0.06 * np.exp(-((x / 0.03) ** 2)) * (z > -0.2)
    half = 0.5 * shape_zyx[2]
    gray, white = _cover(outside, half), _cover(outside - 0.09 + 0.03 * folds, half)
    return np.rint(gray * 130.0 + white * 60.0).astype(np.uint8)
