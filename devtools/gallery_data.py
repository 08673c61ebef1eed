"""What the gallery shows: scans where the data folder has them, else volumes made of numbers.

Each function takes a folder that it may write to and returns (file, properties of rle_splat.import_volume, where it is
from).  Runs in an environment with numpy.
"""

from __future__ import annotations

import gzip
import json
import os
import zlib
from pathlib import Path

import numpy as np
from gallery_grids import connected, doubled, share, smoothed

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
    """A CT head in Hounsfield units, with twice the scan's slices; its z runs from the crown down."""
    path = _scan("cthead_256x256x113_uint16be.raw.gz")
    if path is not None:
        slices = np.frombuffer(gzip.decompress(path.read_bytes()), ">u2").reshape(113, 256, 256) - 1024.0
        fine = np.rint(smoothed(doubled(slices, 0))).astype(np.int16)
        return *_raw(folder, "head", fine, (1.0, 1.0, 1.0), **IN_HU), path.name
    from phantom import SPACING_MM, head_phantom

    return *_raw(folder, "head", head_phantom()[::-1, ::-1], (SPACING_MM,) * 3, **IN_HU), MADE


IN_HU = {"modality": "CT", "value_unit": "HU", "preset": "ct-bone"}
PEELED, STRAY = 1, 2  # labels of a head: one side of it; noise, and what it lies on


def peel(folder: Path, head_file: Path, shape_xyz) -> Path:
    """A file of the labels of a head as ``head`` gives it: one side, and what is not the head."""
    voxels = np.fromfile(head_file, np.int16).reshape(tuple(reversed(shape_xyz)))
    nx = voxels.shape[2]
    x = np.arange(nx)[None, None, :]
    labels = np.zeros(voxels.shape, np.uint8)
    labels[np.broadcast_to(x < 0.43 * nx, voxels.shape)] = PEELED
    body = voxels > -450
    thick = share(body, 2) > 0.7  # so that no thin thing links the head to what it lies on
    middle = np.zeros(voxels.shape, bool)
    middle[tuple(slice(n // 2 - 2, n // 2 + 2) for n in voxels.shape)] = True
    near = share(connected(thick, middle), 4) > 0.0
    labels[(voxels > -700) & ~near] = STRAY
    path = folder / "peel.raw"
    path.write_bytes(labels.tobytes())
    return path


def _chest_voxels() -> tuple[np.ndarray, tuple, str]:
    """(nz, ny, nx) uint8 of a chest with contrast in its vessels, its spacing, and where it is from.

    Soft tissue from 20, blood from 50 to 150, bone from 150; z upwards, y to the back.
    """
    path = _scan("ct_chest_256x256x133_uint8.mha")
    if path is None:
        return _made_chest(), (2.5, 2.5, 2.5), MADE
    header, _, data = path.read_bytes().partition(b"ElementDataFile = LOCAL\n")
    facts = dict(line.split(" = ", 1) for line in header.decode("ascii").splitlines())
    voxels = np.frombuffer(zlib.decompress(data), np.uint8)
    voxels = voxels.reshape([int(n) for n in reversed(facts["DimSize"].split())])
    spacing = tuple(round(float(s), 5) for s in facts["ElementSpacing"].split())
    return voxels[::-1, ::-1], spacing, path.name  # its slices run from the head down, its rows from the back


def chest(folder: Path):
    """The chest with twice its slices."""
    voxels, spacing, source = _chest_voxels()
    return *_raw(folder, "chest", _fine(voxels), _halved(spacing), modality="CT", preset="x-ray"), source


def vessels(folder: Path):
    """The heart and the great vessels alone, as when bone is subtracted from an angiography."""
    voxels, spacing, source = _chest_voxels()
    near = smoothed(doubled(255.0 * blood(voxels), 0), 1) / 255.0
    alone = np.rint(_fine(voxels) * np.clip(2.0 * near, 0.0, 1.0)).astype(np.uint8)
    return *_raw(folder, "vessels", alone, _halved(spacing), modality="CT", preset="x-ray"), source


def _fine(voxels) -> np.ndarray:
    return np.rint(smoothed(doubled(voxels, 0))).astype(np.uint8)


def _halved(spacing) -> tuple:
    return *spacing[:2], 0.5 * spacing[2]


def blood(voxels: np.ndarray) -> np.ndarray:
    """Where a chest's heart and great vessels are, with a rim of two voxels."""
    values = smoothed(voxels)
    bright = (values > 50) & (values < 150)
    inner = share(bright, 1) > 0.85
    nz, ny, _ = voxels.shape
    # The widest of what is bright in the front of the middle is the heart.
    heart = np.zeros(voxels.shape, bool)
    heart[3 * nz // 10 : 8 * nz // 10, ny // 4 : ny // 2] = True
    found = connected(inner, heart & (share(inner, 4) > 0.8))
    return (share(found, 2) > 0.0) & (values > 25)


HEART, KIDNEYS, SPECKS = 1, 2, 3  # labels of a chest; 0 for all else
FRONT = 0.297  # where the front of a chest is cut off, in shares of its depth


def organs(folder: Path) -> Path:
    """A file of the labels of a chest as ``chest`` gives it."""
    voxels, _, _ = _chest_voxels()
    labels = np.zeros((2 * len(voxels) - 1, *voxels.shape[1:]), np.uint8)
    kidneys, heart = _kidneys(voxels), blood(voxels) | _dense_blood(voxels)
    for label, mask in ((SPECKS, _specks(voxels, kidneys | heart)), (KIDNEYS, kidneys), (HEART, heart)):
        labels[doubled(mask, 0) > 0.5] = label
    path = folder / "organs.raw"
    path.write_bytes(labels.tobytes())
    return path


def _between(shape, *sides) -> np.ndarray:
    """Mask of a box; ``sides``: (from, to) along z, y and x in shares of the grid."""
    mask = np.zeros(shape, bool)
    mask[tuple(slice(round(low * n), round(high * n)) for (low, high), n in zip(sides, shape))] = True
    return mask


def _dense_blood(voxels) -> np.ndarray:
    """What is as bright as bone between breastbone and spine: contrast that runs in through the upper vein; with a rim
    of a voxel."""
    bright = (smoothed(voxels) > 100) & _between(voxels.shape, (0.37, 0.88), (0.3, 0.53), (0.35, 0.75))
    vein = _between(voxels.shape, (0.5, 0.7), (0.4, 0.5), (0.38, 0.48))
    return share(connected(bright, vein), 1) > 0.0


def _kidneys(voxels) -> np.ndarray:
    """The kidneys of the scan, on both sides of its lowest vertebrae, with a rim of a voxel."""
    shape, low, depth = voxels.shape, (0.0, 0.2), (0.46, 0.645)
    beside = _between(shape, low, depth, (0.25, 0.415)) | _between(shape, low, depth, (0.65, 0.815))
    return beside & (share(smoothed(voxels) > 35, 1) > 0.0)


def _specks(voxels, organs_mask) -> np.ndarray:
    """What is bright in the lower front, is no organ and behind the cut not connected to the spine: lime in cartilage,
    food."""
    behind = _between(voxels.shape, (0.0, 1.0), (FRONT, 1.0), (0.0, 1.0))
    bright = (voxels > 60) & ~organs_mask & behind
    spine = _between(voxels.shape, (0.0, 1.0), (0.6, 0.68), (0.4, 0.52))
    loose = bright & ~connected(bright, spine) & _between(voxels.shape, (0.0, 0.5), (0.0, 0.6), (0.0, 1.0))
    return share(loose, 1) > 0.0


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


def engine(folder: Path):
    """An engine block: aluminium from 80, steel from 170."""
    path = _scan("engine_256x256x110_uint8.raw.gz")
    if path is None:
        raise RuntimeError("The data folder has no engine; set RLE_SPLAT_DATA to the folder that holds it.")
    return path, {"shape": (256, 256, 110), "dtype": "uint8", "byte_order": "little", "header_bytes": 0,
                  "spacing": (1.0, 1.0, 1.0), "modality": "CT", "preset": "ct-industrial"}, path.name  # fmt: skip


def template(folder: Path):
    """The sample volume, an average of 152 brains, which dev.py has put there."""
    facts = json.loads((ROOT / "out" / "sample" / "sample.json").read_text())
    options = {key: facts[key] for key in ("shape", "dtype", "byte_order", "spacing", "modality", "preset")}
    return ROOT / "out" / "sample" / facts["file"], {"header_bytes": 0, **options}, facts["title"]


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
